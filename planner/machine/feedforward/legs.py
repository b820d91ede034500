"""Take up lost motion: a list of legs, each with its place in the plan and the motors' motion.

A passive joint rests until its axis has turned through its lost motion: w, half of the backlash
plus the twist at which the shaft overcomes friction, from the middle of its play; 2w when the drive
reverses. A stop does not change the path in angles. So the plan's clock is held while the drive
turns the axes through their lost motion, the joints rest, and the plan then continues with each
axis in contact with its joint.

While the joints rest, the ratio of the axes' speeds depends only on θ₁, and only at a certain θ₁ do
all axes take up their lost motion together. Before the plan, joint 1 moves there and back; the
passive joints do not move meanwhile. During the plan joint 1 cannot be chosen: it follows the plan,
fast near a reversal of the drive, where the passive joints hardly move. So the leg is placed
shortly before or after the reversal, where the axes' needs are most even.

After the plan the drive turns back as far as no joint of the nominal machine follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from planner.machine.feedback.course import first_motion, turn_angles, turns_back
from planner.machine.feedback.means import input_limit, input_scale, lost_motion
from planner.machine.feedback.run_up import REST_S
from planner.machine.machine import Machine, draw_start
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.reach import keeps_requirements
from planner.problem.tables.problem_file import CompensationTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator, chain_inertia
from planner.systems.triangular_system import TriangularSystem

MOST_THETA1_DEG = 75.0
"""Largest |θ₁| of the preparation; beyond it the drive turns the axes ten times slower."""

PRICE_DEG_S = 0.05
"""Cost of a second of preparation, in degrees of a joint's error: the prototype's input bias turns
joint 1 by 0.03 degrees per second (one standard deviation)."""

LEAST_TURN_RAD = 0.02
"""Least angle by which the drive turns back in a reversal that counts, rad. A smaller one moves a
joint by at most one degree, a fifth of the lost motion."""

MOST_AWAYS_DEG, AWAY_SHARE = (2.0, 6.0), 0.2
"""Largest distance of the passive joints, when a leg begins, from their position at the reversal,
degrees; the second is tried if the first misses the goal or a requirement. And the fraction of that
distance that counts as an error, since the correction removes a part of the distance."""

WAY_BACK_SHARE = 0.95
"""Fraction of the way back after which a joint of the nominal machine would follow. Creep and the
machine's true pose may make it follow a little earlier."""

SLIP_DEG = 0.3
"""Largest slip of a passive joint when joint 1 swings back on a machine with inertia, degrees. The
other remaining errors of the prototype are as large; half the slip takes 1.4 times as long."""

END_S = 1.0
"""Rest after a plan whose drive reverses, so that corrections up to the end take effect, s."""

STOPS = 1 + math.sqrt(2)
"""Time that a motor needs to stop at a given place, as a multiple of the time from its speed limit
to zero: it stops, then turns back by the angle that it went too far."""

PLACES = 401
"""Number of instants compared near a reversal, and of angles of joint 1."""


def compensable(system: TriangularSystem) -> bool:
    """Return whether machines of this system have systematic errors that commands can allow for."""
    return isinstance(system, Manipulator)


@dataclass(frozen=True, eq=False)
class MotorLeg:
    """Motion of the motors while the plan's clock is held.

    Attributes:
        place_s: Reading of the plan's clock during the leg, s.
        angles: Angles of both motors at the ticks, from 0 at the leg's start, shape (m+1, 2), rad.
        misses: Amount by which each passive axis falls short of its lost motion or exceeds it,
            shape (N−2,), rad ≥ 0; or empty.
    """

    place_s: float
    angles: Array
    misses: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def uneven_rad(self) -> float:
        """Largest angle by which a passive axis misses its lost motion, rad; see `misses`."""
        return float(np.max(self.misses, initial=0.0))

    def seconds(self, tick: float) -> float:
        """Return the duration of the leg, s, for ticks of `tick` seconds."""
        return tick * (len(self.angles) - 1)


def start_shares(machine: Machine, system: Manipulator) -> Array:
    """Return where each gear rests before the start within the range that friction allows, −1 … 1
    as in `Draws.start`, (1+n,); 0, the middle, if the arm is unwound or its state unknown."""
    first = np.zeros(1, dtype=np.int64)
    return np.nan_to_num(draw_start(machine.nominal(), system.n, first, 0))[:, 0]


def unknown_rad(machine: Machine, system: Manipulator) -> float:
    """Return the largest lost motion of a passive joint whose state before the start is unknown,
    rad; 0 if all are known.

    A joint is a play operator: two arms that differ in their past alone stay apart by their
    difference, whatever the commands. From the middle of the range that is up to the lost motion.
    """
    state = machine.start_state * (system.n if len(machine.start_state) == 1 else 1)
    unknown = np.array([each == "unknown" for each in state[1 - system.n :]])
    return float(np.max(lost_motion(system, machine) * unknown))


def legs_of(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    options: CompensationTable,
    tick: float,
    most_away: float = MOST_AWAYS_DEG[0],
) -> list[MotorLeg]:
    """Return the legs of a plan, in their order.

    Args:
        plan: The plan.
        system: The plan's arm.
        machine: The machine, for its mean backlash, friction, stiffness and start state.
        options: Which legs are on.
        tick: Length of a tick, s.
        most_away: Entry of `MOST_AWAYS_DEG`, degrees.
    """
    out: list[MotorLeg] = []
    lost = lost_motion(system, machine)
    if not np.any(lost > 0):
        return out
    way, turns = reversals(plan)
    needs = lost - way * start_shares(machine, system)[2:] * lost
    if options.preparation == "forward" and way:
        out.append(preparation(plan, system, machine, way, needs, tick))
    if options.take_up:
        out += take_ups(plan, system, machine, way, turns, 2 * lost, tick, most_away)
    if options.back_off and plan.problem.travel is None:
        out.append(return_leg(plan, system, machine, needs, tick))
    if options.correction:
        still_s = END_S * bool(turns) + stopping_s(plan, machine)
        out.append(MotorLeg(plan.duration, np.zeros((1 + int(np.ceil(still_s / tick - 1e-9)), 2))))
    return [leg for leg in out if len(leg.angles) > 1]


def stopping_s(plan: Plan, machine: Machine) -> float:
    """Return the time, s, that motors at their speed limits need to stop at a given place; 0
    without limits on rates."""
    return float(np.max(STOPS * input_limit(plan, machine) / plan.problem.limits.input_rate))


def reversals(plan: Plan) -> tuple[float, list[float]]:
    """Return the direction of the drive's first motion (0 for none), and the times at which it
    reverses, s."""
    times, angles = turn_angles(plan, plan.duration / 500)
    drive = angles[:, 0]
    turns = np.flatnonzero(np.abs(drive) > LEAST_TURN_RAD)
    if not len(turns):
        return float(np.sign(drive[np.argmax(np.abs(drive))])), []
    first = way = float(np.sign(drive[turns[0]]))
    far, out = int(turns[0]), []
    for k in range(far, len(drive)):
        if way * (drive[k] - drive[far]) >= 0:
            far = k
        elif way * (drive[far] - drive[k]) > LEAST_TURN_RAD:
            out.append(float(times[far]))
            way, far = -way, k
    return first, out


def axis_rates(system: Manipulator, q: Array) -> Array:
    """Return the |turn| of each passive axis per turn of the drive at q (…, N), (…, N−2)."""
    return np.asarray(np.abs(system.rates(q, np.array([1.0, 0.0]))[..., 2:]))


def evenest_drive(rates: Array, needs: Array) -> tuple[Array, Array]:
    """Return the travel of the drive that minimises the largest error of the axes' turns.

    Args:
        rates: Turn of the axes per turn of the drive, shape (…, m).
        needs: Turn that each axis needs, shape (m,), rad, ≥ 0.

    Returns:
        The travel (…) and the largest error of an axis (…), rad. At the minimum one axis falls
        short by as much as another turns too far, or a single axis turns exactly as needed.
    """
    sums = rates[..., :, None] + rates[..., None, :]
    tried = (needs[:, None] + needs) / np.maximum(sums, 1e-12)
    tried = tried.reshape(*rates.shape[:-1], -1)
    miss = np.abs(rates[..., None, :] * tried[..., None] - needs).max(axis=-1)
    best = np.argmin(miss, axis=-1)[..., None]
    return np.take_along_axis(tried, best, -1)[..., 0], np.take_along_axis(miss, best, -1)[..., 0]


def preparation(
    plan: Plan, system: Manipulator, machine: Machine, way: float, needs: Array, tick: float
) -> MotorLeg:
    """Return the leg before the plan: joint 1 moves away, the drive turns, joint 1 moves back.

    The angle of joint 1 minimises the largest error of the axes plus the cost of the time.
    """
    start, limits = plan.q(0.0), plan.problem.limits
    if not np.any(needs > 0):
        return MotorLeg(0.0, np.zeros((1, 2)))
    most = min(np.deg2rad(MOST_THETA1_DEG), limits.joint[1])
    side = 1.0 if start[1] >= 0 else -1.0
    angles = np.append(start[1], side * np.linspace(0.0, most, PLACES))
    q = np.repeat(start[None], len(angles), axis=0)
    q[:, 1] = angles
    drive, miss = evenest_drive(axis_rates(system, q), needs)
    swing = angles - start[1]
    away_s, drive_s = _seconds(plan, machine, 1, swing), _seconds(plan, machine, 0, drive)
    back_s = np.maximum(away_s, _gentle_s(system, machine, swing))
    cost = np.rad2deg(miss) + PRICE_DEG_S * (away_s + drive_s + back_s)
    best = int(np.argmin(np.where(_reachable(plan.problem, q, start[1]), cost, np.inf)))
    moves = (
        (1, swing[best], away_s[best]),
        (0, way * drive[best], drive_s[best]),
        (1, -swing[best], back_s[best]),
    )
    misses = np.abs(axis_rates(system, q[best]) * drive[best] - needs)
    return MotorLeg(0.0, _motion(moves, tick), misses)


def _gentle_s(system: Manipulator, machine: Machine, swing: Array) -> Array:
    """Return the time of a swing of joint 1, s, in which no passive joint slips by more than
    `SLIP_DEG`; 0 without inertia.

    After the take-up the shafts press the links as hard as friction allows. Any acceleration of
    joint 1 in the direction of that torque then makes a link slip, by its inertia torque over the
    shaft's stiffness.
    """
    if machine.fidelity != "dynamic":
        return np.zeros(swing.shape)
    names = ("link_inertia_kgm2", "link_length_m", "link_moment_kgm")
    means = (np.broadcast_to(machine.mean(name, system.n), system.n)[:, None] for name in names)
    inertia, length, moment = means
    straight = chain_inertia(inertia, length, moment, np.zeros((system.n, 1)))[..., 0]
    carried = np.cumsum(straight.sum(axis=1)[::-1])[::-1][1:]
    twist = carried / machine.mean("shaft_stiffness_nm_per_rad", system.n)
    return np.asarray(np.sqrt(6 * np.abs(swing) * np.max(twist) / np.deg2rad(SLIP_DEG)))


def _reachable(problem: Problem, q: Array, start: float) -> Array:
    """Return whether joint 1 can move from the start to each q (M, N) and keep all requirements,
    (M,)."""
    kept, away = keeps_requirements(problem, q), q[:, 1] - start
    blocked = [np.min(np.abs(away[~kept & (away * s > 0)]), initial=np.inf) for s in (-1.0, 1.0)]
    return np.asarray(np.abs(away) < np.where(away < 0, blocked[0], blocked[1]))


def take_ups(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    way: float,
    turns: list[float],
    needs: Array,
    tick: float,
    most_away: float,
) -> list[MotorLeg]:
    """Return a leg for each reversal of the drive; the drive's first motion has the direction
    `way`."""
    edges = [0.0, *((a + b) / 2 for a, b in pairwise(turns)), plan.duration]
    out = []
    for turn, low, high in zip(turns, edges, edges[1:], strict=False):
        way = -way
        s = np.append(np.linspace(low, turn, PLACES), np.linspace(turn, high, PLACES)[1:])
        q = plan.trajectory.q(s)
        away = np.rad2deg(np.abs(q - q[PLACES - 1])[:, 2:].max(axis=1))
        far = np.flatnonzero(away > most_away)
        first = max([-1, *far[far < PLACES]]) + 1
        last = min([len(s), *far[far >= PLACES]])
        drive, miss = evenest_drive(axis_rates(system, q[first:last]), needs)
        best = int(np.argmin(np.rad2deg(miss) + AWAY_SHARE * away[first:last]))
        seconds = float(_seconds(plan, machine, 0, drive[best]))
        angles = _motion(((0, way * drive[best], seconds),), tick)
        misses = np.abs(axis_rates(system, q[first + best]) * drive[best] - needs)
        out.append(MotorLeg(float(s[first + best]), angles, misses))
    return out


def return_leg(
    plan: Plan, system: Manipulator, machine: Machine, needs: Array, tick: float
) -> MotorLeg:
    """Return the leg that turns the drive back by just under twice the fastest axis's lost motion.

    On the nominal machine no joint follows. On a machine with less lost motion the joints have gone
    too far and are moved back, so errors of that sign become smaller. The leg is empty if the drive
    reverses during the plan, since the joints' errors then have either sign (the problem "crossing"
    and four joints would end 0.1 degrees worse at 95 %). The leg is also empty if an axis was in
    contact before the plan, since its joint then goes too far on no machine (of 37 homed arms of
    two joints, 11 would have larger errors than without compensation; without this leg none has).
    """
    lost, way = lost_motion(system, machine), float(first_motion(plan)[0])
    if way == 0 or turns_back(plan) or np.any(needs <= 0):
        return MotorLeg(plan.duration, np.zeros((1, 2)))
    used = axis_rates(system, plan.q(plan.duration)) / np.maximum(lost, 1e-12)
    angle = -way * WAY_BACK_SHARE * 2 / float(used.max())
    seconds = float(_seconds(plan, machine, 0, np.asarray(angle)))
    return MotorLeg(plan.duration, _motion(((0, angle, seconds),), tick, rest=0.0))


def _seconds(plan: Plan, machine: Machine, motor: int, angle: Array) -> Array:
    """Return the rest-to-rest time T, s, of a motor along a cubic: its peak speed is 3/2 · angle/T,
    its peak acceleration 6 · angle/T²."""
    speed, rate = input_scale(plan, machine)[motor], plan.problem.limits.input_rate[motor]
    return np.asarray(np.maximum(1.5 * np.abs(angle) / speed, np.sqrt(6 * np.abs(angle) / rate)))


def _motion(
    moves: tuple[tuple[int, float, float], ...], tick: float, rest: float = REST_S
) -> Array:
    """Return the angles (m+1, 2), rad, at the ticks of motors that turn one after the other and
    then rest.

    Each move is a motor, its angle in rad, and its time in s.
    """
    out = [np.zeros((1, 2))]
    for motor, angle, seconds in moves:
        if angle == 0:
            continue
        count = max(1, int(np.ceil(seconds / tick)))
        x = np.arange(1, count + 1) / count
        move = np.zeros((len(x), 2))
        move[:, motor] = angle * x * x * (3 - 2 * x)
        out.append(out[-1][-1] + move)
    if len(out) > 1:
        out.append(np.repeat(out[-1][-1:], round(rest / tick), axis=0))
    return np.concatenate(out)
