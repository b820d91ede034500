"""Where lost motion is taken up, and how far the motors turn for it: one list of legs.

A passive joint rests until its axis has turned through its lost motion w, half of the backlash and
the twist at which the shaft overcomes friction: w from the middle of its play, 2w where the drive
turns back. A path in angles does not mind a stop. So the plan's clock is held, the drive turns by
what the axes need while the joints stand, and the plan goes on with each joint at its axis.

How fast the axes turn under one drive depends on θ₁ alone while the joints stand, and only at a
certain θ₁ do all of them use up their lost motion together. Before the plan, joint 1 goes there and
comes back, for the passive joints do not move meanwhile. On the way it is the plan that moves joint
1, fast where the drive turns back, and the passive joints hardly move there; so the leg comes a
little before or after, where the needs are most even.

After the plan the drive turns back, as far as no joint of the nominal machine follows.
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
from planner.problem.requirements.requirement import MotionPoint
from planner.problem.tables.problem_file import CompensationTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

MOST_THETA1_DEG = 75.0
"""Largest |θ₁| of the preparation: beyond it the axes turn ten times slower than the drive asks."""

PRICE_DEG_S = 0.05
"""What a second of preparation is worth, in degrees of a joint that starts late: the prototype's
input bias turns joint 1 by 0.03 degrees a second (one standard deviation)."""

LEAST_TURN_RAD = 0.02
"""Drive back and forth that is no reversal: it moves a joint by a degree at most, a fifth of what
is lost."""

MOST_AWAYS_DEG, AWAY_SHARE = (2.0, 6.0), 0.2
"""How far passive joints may be from where the drive turns back when the leg comes: the second is
tried where the first leads elsewhere or too close to something. And how much of that counts as an
error: joints wait for so long, and the correction takes off some of it."""

WAY_BACK_SHARE = 0.95
"""Part of the way back at which a joint of the nominal machine would follow: creep and the pose
that the machine has indeed may make it come a little sooner."""

END_S = 1.0
"""Rest after a plan whose drive turns back: what is corrected till its end needs time to arrive."""

STOPS = 1 + math.sqrt(2)
"""Of the time from a limit to zero: a motor stops, and goes back by as much as it went too far."""

PLACES = 401
"""Instants that are compared near a reversal, and angles of joint 1."""


def compensable(system: TriangularSystem) -> bool:
    """Whether a machine of that kind has systematic errors that commands can allow for."""
    return isinstance(system, Manipulator)


@dataclass(frozen=True, eq=False)
class Leg:
    """What the motors do while the plan's clock is held.

    Attributes:
        place_s: What the clock reads meanwhile, s.
        angles: Angles of both motors at the ticks from its begin, shape (m+1, 2), from 0, rad.
        misses: By how much each passive axis is left short of its lost motion, or beyond it,
            shape (N−2,), rad ≥ 0; or empty.
    """

    place_s: float
    angles: Array
    misses: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def uneven_rad(self) -> float:
        """The largest of the misses."""
        return float(np.max(self.misses, initial=0.0))

    def seconds(self, tick: float) -> float:
        """How long it takes."""
        return tick * (len(self.angles) - 1)


def start_shares(machine: Machine, system: Manipulator) -> Array:
    """Where gears stand before the start, as `Draws.start`, (1+n,); in the middle, 0, where that is
    unwound or unknown."""
    first = np.zeros(1, dtype=np.int64)
    return np.nan_to_num(draw_start(machine.nominal(), system.n, first, 0))[:, 0]


def legs_of(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    options: CompensationTable,
    tick: float,
    most_away: float = MOST_AWAYS_DEG[0],
) -> list[Leg]:
    """The legs of a plan, in their order.

    Args:
        plan: The plan.
        system: Its arm.
        machine: Mean backlash, friction and stiffness, and how it stands before.
        options: Which of them are wanted.
        tick: Length of a tick, s.
        most_away: One of `MOST_AWAYS_DEG`.
    """
    out: list[Leg] = []
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
        out.append(Leg(plan.duration, np.zeros((1 + int(np.ceil(still_s / tick - 1e-9)), 2))))
    return [leg for leg in out if len(leg.angles) > 1]


def stopping_s(plan: Plan, machine: Machine) -> float:
    """How long motors take from their limits to rest where they should; 0 for any rate."""
    return float(np.max(STOPS * input_limit(plan, machine) / plan.problem.limits.input_rate))


def reversals(plan: Plan) -> tuple[float, list[float]]:
    """The direction of the drive's first motion, 0 for none, and when it turns back, s."""
    times, angles = turn_angles(plan, plan.duration / 500)
    drive = angles[:, 0]
    moved = np.flatnonzero(np.abs(drive) > LEAST_TURN_RAD)
    if not len(moved):
        return float(np.sign(drive[np.argmax(np.abs(drive))])), []
    first = way = float(np.sign(drive[moved[0]]))
    far, out = int(moved[0]), []
    for k in range(far, len(drive)):
        if way * (drive[k] - drive[far]) >= 0:
            far = k
        elif way * (drive[far] - drive[k]) > LEAST_TURN_RAD:
            out.append(float(times[far]))
            way, far = -way, k
    return first, out


def axis_rates(system: Manipulator, q: Array) -> Array:
    """How far the passive axes turn at q (…, N) as the drive turns by one, (…, N−2)."""
    return np.asarray(np.abs(system.rates(q, np.array([1.0, 0.0]))[..., 2:]))


def evenest_drive(rates: Array, needs: Array) -> tuple[Array, Array]:
    """How far the drive turns for axes to miss what they need by as little as possible.

    Args:
        rates: Of the axes, shape (…, m).
        needs: What each must turn, shape (m,), rad, ≥ 0.

    Returns:
        The drive (…) and the largest miss of an axis (…), rad. It is least where one axis has too
        little by as much as another has too much; or one alone has what it needs.
    """
    sums = rates[..., :, None] + rates[..., None, :]
    tried = (needs[:, None] + needs) / np.maximum(sums, 1e-12)
    tried = tried.reshape(*rates.shape[:-1], -1)
    miss = np.abs(rates[..., None, :] * tried[..., None] - needs).max(axis=-1)
    best = np.argmin(miss, axis=-1)[..., None]
    return np.take_along_axis(tried, best, -1)[..., 0], np.take_along_axis(miss, best, -1)[..., 0]


def preparation(
    plan: Plan, system: Manipulator, machine: Machine, way: float, needs: Array, tick: float
) -> Leg:
    """Joint 1 to where the axes need the same drive, that drive, and back.

    Of two angles the one is taken that starts joints better, by more than its time is worth.
    """
    start, limits = plan.q(0.0), plan.problem.limits
    if not np.any(needs > 0):
        return Leg(0.0, np.zeros((1, 2)))
    most = min(np.deg2rad(MOST_THETA1_DEG), limits.joint[1])
    side = 1.0 if start[1] >= 0 else -1.0
    angles = np.append(start[1], side * np.linspace(0.0, most, PLACES))
    q = np.repeat(start[None], len(angles), axis=0)
    q[:, 1] = angles
    drive, miss = evenest_drive(axis_rates(system, q), needs)
    swing = angles - start[1]
    seconds = 2 * _seconds(plan, machine, 1, swing) + _seconds(plan, machine, 0, drive)
    cost = np.rad2deg(miss) + PRICE_DEG_S * seconds
    best = int(np.argmin(np.where(_reachable(plan.problem, q, start[1]), cost, np.inf)))
    moves = ((1, swing[best]), (0, way * drive[best]), (1, -swing[best]))
    misses = np.abs(axis_rates(system, q[best]) * drive[best] - needs)
    return Leg(0.0, _motion(plan, machine, moves, tick), misses)


def _reachable(problem: Problem, q: Array, start: float) -> Array:
    """Whether joint 1 can go to each q (M, N) from the start without meeting anything, (M,)."""
    kept = np.ones(len(q), dtype=bool)
    for required in problem.requirements:
        if required.reads == {"q"} and not required.final:
            values = required.values(MotionPoint.of(problem.system, q))
            for part, value in zip(required.parts, values, strict=True):
                slack = 1e-9 * part.scale
                kept &= (value >= part.low - slack) & (value <= part.high + slack)
    away = q[:, 1] - start
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
) -> list[Leg]:
    """A leg for each of the drive's reversals, which begins in the direction `way`."""
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
        angles = _motion(plan, machine, ((0, way * drive[best]),), tick)
        misses = np.abs(axis_rates(system, q[first + best]) * drive[best] - needs)
        out.append(Leg(float(s[first + best]), angles, misses))
    return out


def return_leg(plan: Plan, system: Manipulator, machine: Machine, needs: Array, tick: float) -> Leg:
    """The drive turns back through just less than twice the lost motion of the fastest axis.

    On the nominal machine no joint follows. On one that loses less motion than the mean joints have
    gone too far, and are taken back; so half of the spread of lost motion is folded onto the other
    half. Not where the drive turns back on its way: what a joint loses there has either sign at the
    end (crossing and four joints would end 0.1 degrees worse at 95 %). Nor where an axis stood at
    its end before the plan: its joint goes too far on no machine (of 37 homed arms of two joints 11
    would leave the path farther than their plans as they are, and none does).
    """
    lost, way = lost_motion(system, machine), float(first_motion(plan)[0])
    if way == 0 or turns_back(plan) or np.any(needs <= 0):
        return Leg(plan.duration, np.zeros((1, 2)))
    used = axis_rates(system, plan.q(plan.duration)) / np.maximum(lost, 1e-12)
    angle = -way * WAY_BACK_SHARE * 2 / float(used.max())
    return Leg(plan.duration, _motion(plan, machine, ((0, angle),), tick, rest=0.0))


def _seconds(plan: Plan, machine: Machine, motor: int, angle: Array) -> Array:
    """How long a motor takes from rest to rest: a cubic, whose speed has its peak at 3/2 and whose
    acceleration at 6 of what it is in the mean."""
    speed, rate = input_scale(plan, machine)[motor], plan.problem.limits.input_rate[motor]
    return np.asarray(np.maximum(1.5 * np.abs(angle) / speed, np.sqrt(6 * np.abs(angle) / rate)))


def _motion(
    plan: Plan,
    machine: Machine,
    moves: tuple[tuple[int, float], ...],
    tick: float,
    rest: float = REST_S,
) -> Array:
    """Motors that turn one after the other, and then rest: angles (m+1, 2) at the ticks, rad."""
    out = [np.zeros((1, 2))]
    for motor, angle in moves:
        if angle == 0:
            continue
        seconds = float(_seconds(plan, machine, motor, np.asarray(angle)))
        count = max(1, int(np.ceil(seconds / tick)))
        x = np.arange(1, count + 1) / count
        move = np.zeros((len(x), 2))
        move[:, motor] = angle * x * x * (3 - 2 * x)
        out.append(out[-1][-1] + move)
    if len(out) > 1:
        out.append(np.repeat(out[-1][-1:], round(rest / tick), axis=0))
    return np.concatenate(out)
