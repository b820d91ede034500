"""Mean properties of a machine, the only ones that the tracker and compensated plans may use.

They are the time at which commands act, the lost motion of gearheads and joints, the speed limits
of the motors, and the resolution of the encoders.
"""

from __future__ import annotations

import numpy as np

from planner.machine.friction.contact_load import gear_constants
from planner.machine.friction.contacts import chain_loads, friction_capacity, lateral_friction
from planner.machine.machine import Machine, draw
from planner.plan.measures import peak_inputs
from planner.plan.plan import Plan
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem


def shift_of(system: TriangularSystem, machine: Machine) -> Array:
    """Return the time from each motor's command to its effect, (2,), s: the sum of delay, servo lag
    (1/b, or 2ζ/b for second order) and joints' lag d/k."""
    out = np.full(2, float(np.mean(machine.mean("delay_s"))))
    lag = 1 / machine.mean("servo_bandwidth_rad_s")
    if "servo_damping" in machine.effects:
        lag = lag * 2 * machine.mean("servo_damping")
    out += lag
    if isinstance(system, Manipulator):
        stiffness = machine.mean("shaft_stiffness_nm_per_rad")
        out[0] += float(np.mean(machine.mean("viscous_friction_nms_per_rad") / stiffness))
    return out


def gearhead_play(system: TriangularSystem, machine: Machine) -> Array:
    """Return the whole play of each motor's gearhead, (2,), rad; 0 for systems without
    gearheads."""
    if not isinstance(system, Manipulator):
        return np.zeros(2)
    return np.deg2rad(np.broadcast_to(machine.mean("gearhead_backlash_deg"), 2))


LOST_MOTION = ("backlash_deg", "coulomb_friction_nm", "shaft_stiffness_nm_per_rad")
"""Effects that a joint's lost motion depends on."""


def lost_motion(system: TriangularSystem, machine: Machine) -> Array:
    """Return the mean lost motion of each passive joint, (N−2,), rad: the angle by which its axis
    leads the joint, in either direction."""
    if not isinstance(system, Manipulator):
        return np.zeros(system.size - 2)
    play, friction, stiffness = (machine.mean(name, system.n) for name in LOST_MOTION)
    return np.array(np.broadcast_to(np.deg2rad(play) / 2 + friction / stiffness, system.n - 1))


def lost_spread(machine: Machine, joints: int) -> Array:
    """Return the standard deviation of the lost motion of joints to first order, rad: one for all
    joints or one each."""
    _, friction, stiffness = (machine.mean(name, joints) for name in LOST_MOTION)
    play, rough, soft = (machine.spread(name, joints) for name in LOST_MOTION)
    of_play, of_friction = (np.deg2rad(play) / 2) ** 2, (rough / stiffness) ** 2
    of_shaft = (friction / stiffness * soft / stiffness) ** 2
    return np.asarray(np.sqrt(of_play + of_friction + of_shaft))


def mean_passing(system: TriangularSystem, machine: Machine, q: Array) -> Array:
    """Return the fraction of the rates that the contacts of the mean arm transmit under its joints'
    friction.

    Contacts lose some rate by creep, and some where joints turn them; see `friction.contacts`.

    Args:
        system: The system; for other systems than arms the result is 1.
        machine: The machine; only its means are used.
        q: Coordinates, (K, N).

    Returns:
        Fraction of the ideal rate of each coordinate after the first, (K, N−1).
    """
    out = np.ones_like(q[:, 1:])
    if isinstance(system, Manipulator):
        draws = draw(machine.nominal(), system.n, np.zeros(1, dtype=np.int64), 0)
        k = gear_constants(system, draws)
        friction = np.broadcast_to(draws["coulomb_friction_nm"], k.shape)
        lateral, capacity = lateral_friction(draws), friction_capacity(draws)
        loads, parts, _ = chain_loads(np.cos(q[:, 1:-1].T), k, friction, lateral, capacity)
        creep = draws["creep"][0] + draws["creep_per_nm"][0] * np.abs(loads)
        parts *= np.maximum(1 - creep, 0.0)
        out[:, 1:] = (np.cumprod(parts[0], axis=0) * parts[1] * parts[2]).T
    return out


def input_limit(plan: Plan, machine: Machine) -> Array:
    """Return the largest |u| to command, (2,): the problem's limit or the motors', whichever is
    less."""
    return np.asarray(np.minimum(plan.problem.limits.input, machine.mean("velocity_limit_rad_s")))


def input_scale(plan: Plan, machine: Machine) -> Array:
    """Return the speeds by which corrections are scaled, (2,): the input limits; without a limit
    the peak of the plan's input, or 1 if the input is zero."""
    limit, peak = input_limit(plan, machine), peak_inputs(plan.trajectory)
    return np.where(np.isfinite(limit), limit, np.where(peak > 0, peak, 1.0))


LEAST_NOISE_SHARE = 0.25
"""Least noise that is assumed where there is noise, as a fraction of the resolution: rounding makes
of less noise a whole step now and then, and the mean of such readings is not the angle. Told its
0.005 degrees with steps of 0.088, a compensated plan that reverses has E of 8.9 degrees instead of
3.2 on one machine of twelve."""


def noise_of(system: TriangularSystem, machine: Machine) -> Array:
    """Return the standard deviation of the noise of each coordinate's reading that the tracker
    assumes, (N, 1), rad; 0 for coordinates without an encoder."""
    noise, step = (
        np.broadcast_to(machine.mean(name), system.size - 1)
        for name in ("encoder_noise_deg", "encoder_resolution_deg")
    )
    is_angle = np.array([coordinate.unit == "rad" for coordinate in system.coordinates[1:]])
    assumed = np.where(noise > 0, np.maximum(noise, LEAST_NOISE_SHARE * step), 0.0)
    return np.deg2rad([0.0, *np.where(is_angle, assumed, 0.0)])[:, None]


def resolution_of(system: TriangularSystem, machine: Machine) -> Array:
    """Return the resolution of each coordinate's reading, (N, 1).

    Angles have the resolution of their encoders, except the disk's angle, which has no encoder and
    thus infinity. All other coordinates are read exactly and have 0.
    """
    steps = np.broadcast_to(machine.mean("encoder_resolution_deg"), system.size - 1)
    out = np.zeros((system.size, 1))
    for i, coordinate in enumerate(system.coordinates):
        if coordinate.unit == "rad":
            out[i] = np.deg2rad(steps[i - 1]) if i else np.inf
    return out
