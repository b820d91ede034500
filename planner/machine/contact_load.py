"""Torques at the friction contacts along a plan, compared with what they can transmit.

Every contact presses two wheels together with a force N, so that it transmits at most the torque
μ N r, with r the radius of the disk B that drives it (`friction_capacity_nm`). Wheels transmit
the force at their rims: with equal contact force, P₁, P₂ and P₃ all hold up to that torque of
disk B. While joints 2 … n move, the contacts must overcome the friction of each,

    τᵢ = coulomb + viscous |θ̇ᵢ|,

and on an inclined plane also gravity where it opposes the motion. By the virtual work of eq. (6),
this loads disk B of stage j (of joint j) with

    P₂, P₃:  k₂ cos³θⱼ τⱼ₊₁        P₁:  that + (kⱼ₊₂/kⱼ₊₁) cosθⱼ · (P₁ of the next stage).

The emulated machine uses the same formulas for slip (`planner.machine.disk_chain`; paper, Fig. 2).
Inertia is neglected: on the prototype, in a motion of ten seconds, its torque is less than a
hundredth of the friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.machine.disk_chain import at_contacts, weights
from planner.machine.machine import Machine, draw, machine_for
from planner.machine.replay import sample_numbers
from planner.plan.plan import Plan, refuse_inexecutable
from planner.support.arrays import Array
from planner.support.one_variable import sample_times
from planner.systems.manipulator import Manipulator, gravity_torques

INSTANTS = 100
"""Least number of sample times; the torque is smooth, and its maxima are flat."""


@dataclass(frozen=True, eq=False)
class ContactLoad:
    """The contact that is loaded most, on S machines.

    Attributes:
        torque_nm: Largest torque of any contact at any time, at its disk B, (S,), N m.
        capacity_nm: Largest torque that a contact transmits, (S,), N m; infinite where the machine
            knows none.
    """

    torque_nm: Array
    capacity_nm: Array

    @property
    def share(self) -> Array:
        """Torque over capacity, (S,): above 1 a contact slips, and the motion behind it is lost."""
        return np.asarray(self.torque_nm / self.capacity_nm)

    def __repr__(self) -> str:
        slipping, count = int(np.sum(self.share > 1)), len(self.torque_nm)
        return (
            f"ContactLoad({np.median(self.torque_nm):.3g} N m,"
            f" {np.median(self.share):.3g} of what a contact transmits in the median; slips on"
            f" {slipping} of {count} machine{'s' if count > 1 else ''})"
        )


def contact_load(
    plan: Plan, machine: Machine | str | None = None, samples: int = 0, seed: int = 0
) -> ContactLoad:
    """The largest torque at the friction contacts along a plan.

    Args:
        plan: An executable plan of an arm with friction disks.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Machines to draw, those that `replay` draws; 0: the nominal one alone.
        seed: Random seed.

    Raises:
        InputError: If the plan has no real inputs, or is of another system.
    """
    refuse_inexecutable(plan)
    system = plan.problem.system
    if not isinstance(system, Manipulator):
        raise InputError(f"a {system.kind} has no friction disks; only a manipulator has")
    used = machine_for(plan.problem.machine, machine)
    if not samples:
        used = used.nominal()
    draws = draw(used, system.n, sample_numbers(samples or 1), seed)
    times = sample_times(plan.t, INSTANTS)
    q, u = plan.trajectory.q(times), plan.trajectory.u(times)
    rates = system.rates(q, u)[:, 2:].T[..., None]
    friction = [draws[name] for name in ("coulomb_friction_nm", "viscous_friction_nms_per_rad")]
    coulomb, viscous = (values[:, None, :] for values in friction)
    k = system.k_g * system.K[:, None] * (1 + draws["gear_ratio_error"])
    shape = (system.n - 1, len(times), draws.count)
    torques = np.broadcast_to(coulomb + viscous * np.abs(rates), shape)
    weighed = weights(draws, system.n)
    if weighed is not None:
        down = gravity_torques(weighed[:, None, :], q[:, 1:].T[..., None])[1:]
        held = np.maximum(np.abs(down) - coulomb, 0.0)
        torques = np.where(rates == 0, held, torques - down * np.sign(rates))
    felt = np.abs(at_contacts(k, torques, np.cos(q[:, 1:-1]).T[..., None]))
    capacity = np.broadcast_to(draws["friction_capacity_nm"][0], draws.count)
    return ContactLoad(felt.max(axis=(0, 1, 2)), capacity)
