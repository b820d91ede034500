"""Torques at the friction contacts along a plan, compared with what they can transmit.

Every contact presses two wheels together with a force N, so that it transmits at most the torque
C = μ N r₁, as a force at the rims times the radius r₁ of disk B (`friction_capacity_nm`). While
joints 2 … n move, the contacts must overcome the friction of each,

    τᵢ = coulomb + viscous |θ̇ᵢ|,

and on an inclined plane also gravity where it opposes the motion, and the sideways drag of later
contacts that are turned. The law is that of the emulated machine
(`planner.machine.friction.contacts`). Inertia is neglected: on the prototype, in a motion of ten
seconds, its torque is less than a hundredth of the friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.machine.friction.contacts import Grip, chain_loads, friction_capacity, lateral_friction
from planner.machine.machine import Draws, Machine, draw, machine_for, sample_numbers
from planner.plan.plan import Plan, refuse_inexecutable
from planner.support.arrays import Array
from planner.support.calculus.extremes import sample_times
from planner.systems.manipulator import Manipulator, gravity_torques

LEAST_INSTANTS = 100
"""Least number of sample times of a plan: the torque is smooth, and its maxima are flat. A plan
with more pieces, such as a compensated plan, is sampled only where a piece ends."""

BLOCK = 64
"""Instants per block, so few that the arrays of a thousand machines fit into the cache."""

GRAVITY_M_S2 = 9.80665
"""Standard acceleration of free fall."""


def gear_constants(system: Manipulator, draws: Draws) -> Array:
    """Return the gear constants k₂ … kₙ of each machine, (n−1, S)."""
    k = system.k_g * system.K[:, None] * (1 + draws["gear_ratio_error"])
    return np.broadcast_to(k, (len(k), draws.count)).copy()


def weights(draws: Draws, joints: int) -> Array | None:
    """Return the largest torque of gravity about each link's own joint, (n, S), N m; None on a
    level plane."""
    if not (draws.has_effect("incline_deg") and draws.has_effect("link_moment_kgm")):
        return None
    slope = GRAVITY_M_S2 * np.sin(np.deg2rad(draws["incline_deg"]))
    return np.broadcast_to(slope * draws["link_moment_kgm"], (joints, draws.count))


@dataclass(frozen=True, eq=False)
class ContactLoad:
    """The largest load of the friction contacts, on S machines.

    Attributes:
        torque_nm: Largest load of any contact at any time, force at its rim times r₁, (S,), N m.
        capacity_nm: Largest torque that a contact transmits, (S,), N m; infinite if the machine
            has no limit.
        share: Largest ratio of a load to the load at which that contact slips grossly at its angle,
            (S,); from 1 on, the contact no longer drives its joint.
        motor_nm: Largest torque that these loads require of motor 1, (S,), N m.
    """

    torque_nm: Array
    capacity_nm: Array
    share: Array
    motor_nm: Array

    def __repr__(self) -> str:
        slipping, count = int(np.sum(self.share >= 1)), len(self.torque_nm)
        return (
            f"ContactLoad({np.median(self.torque_nm):.3g} N m,"
            f" {np.median(self.share):.3g} of what a contact transmits in the median; slips on"
            f" {slipping} of {count} machine{'s' if count > 1 else ''})"
        )


def contact_load(
    plan: Plan, machine: Machine | str | None = None, samples: int = 0, seed: int = 0
) -> ContactLoad:
    """Return the largest torque at the friction contacts along a plan.

    Args:
        plan: An executable plan of an arm with friction disks.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Number of machines to draw, the same as in `replay`; 0 takes only the nominal one.
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
    times = sample_times(plan.t, LEAST_INSTANTS, 2 if len(plan.t) > LEAST_INSTANTS else 9)
    q = plan.trajectory.q(times)
    return largest_load(system, draws, q, system.rates(q, plan.trajectory.u(times)))


def refuse_sliding(plan: Plan, system: Manipulator, draws: Draws) -> None:
    """Refuse machines on which gravity overcomes a friction contact: they need dynamic fidelity.

    Args:
        plan: The plan.
        system: The plan's manipulator.
        draws: The machines, quasi-static.

    Raises:
        InputError: If at rest the weight of the links exceeds what a contact can transmit.
    """
    if weights(draws, system.n) is None:
        return
    q = plan.q(np.linspace(0.0, plan.duration, LEAST_INSTANTS))
    load = largest_load(system, draws, q, np.zeros_like(q))
    worst = np.argmax(load.share)
    if load.share[worst] >= 1:
        raise InputError(
            "machine: on this slope gravity loads a friction contact with"
            f" {load.torque_nm[worst]:.3g} N m, and it transmits at most"
            f" {load.capacity_nm[worst]:.3g} N m, so the arm slides by itself; reduce"
            " machine.incline_deg or link_moment_kgm, raise friction_capacity_nm, or set"
            ' fidelity = "dynamic", which simulates the sliding'
        )


def largest_load(system: Manipulator, draws: Draws, q: Array, rates: Array) -> ContactLoad:
    """Return the largest loads of the friction contacts over T states of motion.

    Args:
        system: The manipulator.
        draws: The machines.
        q: Coordinates, (T, N).
        rates: Rates of the coordinates, (T, N); 0 at rest.
    """
    capacity = np.broadcast_to(draws["friction_capacity_nm"][0], draws.count)
    begins = range(0, len(q), BLOCK)
    blocks = [_loads(system, draws, q[k : k + BLOCK], rates[k : k + BLOCK]) for k in begins]
    torque, share, motor = np.max(blocks, axis=0)
    return ContactLoad(torque, capacity, np.where(np.isfinite(capacity), share, 0.0), motor)


def _loads(system: Manipulator, draws: Draws, q: Array, rates: Array) -> tuple[Array, Array, Array]:
    """Return the largest load of any contact, the largest ratio of a load to that at which its
    contact slips, and the largest torque of motor 1, (S,) each."""
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
    driven = rates[:, :1] != 0  # no contact slides sideways at rest; `DiskChain` then moves nothing
    lateral, capacity = lateral_friction(draws) * driven, friction_capacity(draws)
    k = gear_constants(system, draws)
    loads, _, most = chain_loads(cosines, k, torques, lateral[None], capacity)
    first = Grip(cosines[0], lateral, capacity)
    motor = np.abs(first.driver_torque(loads[0, 0])).max(axis=0)
    loads = np.abs(loads)
    return loads.max(axis=(0, 1, 2)), (loads / most).max(axis=(0, 1, 2)), motor
