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
from planner.machine.machine import Draws, Machine, draw, machine_for, sample_numbers
from planner.plan.plan import Plan, refuse_inexecutable
from planner.support.arrays import Array
from planner.support.calculus.extremes import sample_times
from planner.systems.manipulator import Manipulator, gravity_torques

LEAST_INSTANTS = 100
"""Least number of sample times; the torque is smooth, and its maxima are flat."""

GRAVITY_M_S2 = 9.80665
"""Standard acceleration of free fall."""


def gear_constants(system: Manipulator, draws: Draws) -> Array:
    """Gear constants k₂ … kₙ of each machine, (n−1, S)."""
    k = system.k_g * system.K[:, None] * (1 + draws["gear_ratio_error"])
    return np.broadcast_to(k, (len(k), draws.count)).copy()


def weights(draws: Draws, joints: int) -> Array | None:
    """Largest torque of gravity about each link's own joint, (n, S), N m; None on a level plane."""
    if not (draws.has_effect("incline_deg") and draws.has_effect("link_moment_kgm")):
        return None
    slope = GRAVITY_M_S2 * np.sin(np.deg2rad(draws["incline_deg"]))
    return np.broadcast_to(slope * draws["link_moment_kgm"], (joints, draws.count))


def contact_torques(k: Array, torques: Array, cosines: Array) -> Array:
    """Torques of joints 2 … n as disk B of each stage feels them.

    Args:
        k: Gear constants k₂ … kₙ of each machine, (n−1, S).
        torques: Of joints 2 … n, (n−1, …, S), N m.
        cosines: Of θ₁ … θₙ₋₁, likewise.

    Returns:
        Shape (2, n−1, …, S), N m: first those that pass P₁, of the stage's joint and all later
        ones; then those that pass P₂ and P₃, of the stage's joint alone.
    """
    out = np.empty((2, *torques.shape))
    out[1] = k[0] * cosines * cosines * cosines * torques
    out[0, -1] = out[1, -1]
    for j in range(len(torques) - 2, -1, -1):
        out[0, j] = out[1, j] + k[j + 1] / k[j] * cosines[j] * out[0, j + 1]
    return out


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
    times = sample_times(plan.t, LEAST_INSTANTS)
    q = plan.trajectory.q(times)
    return _largest_load(system, draws, q, system.rates(q, plan.trajectory.u(times)))


def refuse_sliding(plan: Plan, system: Manipulator, draws: Draws) -> None:
    """Refuse gravity that friction cannot hold, which takes masses to compute.

    Args:
        plan: The plan.
        system: Its manipulator.
        draws: The machines, quasi-static.

    Raises:
        InputError: If the weight of some link asks more of a contact at rest than it passes.
    """
    if weights(draws, system.n) is None:
        return
    q = plan.q(np.linspace(0.0, plan.duration, LEAST_INSTANTS))
    load = _largest_load(system, draws, q, np.zeros_like(q))
    worst = np.argmax(load.share)
    if load.share[worst] >= 1:
        raise InputError(
            f"machine: on this slope gravity asks {load.torque_nm[worst]:.3g} N m of a friction"
            f" contact that passes {load.capacity_nm[worst]:.3g} N m, so the arm slides by itself;"
            " lessen machine.incline_deg or link_moment_kgm, raise friction_capacity_nm, or set"
            ' fidelity = "dynamic", which computes how it slides'
        )


def _largest_load(system: Manipulator, draws: Draws, q: Array, rates: Array) -> ContactLoad:
    """The largest torques at coordinates q (T, N) in motion at `rates` (T, N); 0 is at rest."""
    friction = [draws[name] for name in ("coulomb_friction_nm", "viscous_friction_nms_per_rad")]
    coulomb, viscous = (values[:, None, :] for values in friction)
    turning = rates[:, 2:].T[..., None]
    torques = coulomb + viscous * np.abs(turning)
    weighed = weights(draws, system.n)
    if weighed is not None:
        down = gravity_torques(weighed[:, None, :], q[:, 1:].T[..., None])[1:]
        static_torque = np.maximum(np.abs(down) - coulomb, 0.0)
        torques = np.where(turning == 0, static_torque, torques - down * np.sign(turning))
    torques = np.broadcast_to(torques, (system.n - 1, len(q), draws.count))
    cosines = np.cos(q[:, 1:-1]).T[..., None]
    felt = np.abs(contact_torques(gear_constants(system, draws), torques, cosines))
    capacity = np.broadcast_to(draws["friction_capacity_nm"][0], draws.count)
    return ContactLoad(felt.max(axis=(0, 1, 2)), capacity)
