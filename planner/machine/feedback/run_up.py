"""The preparatory motion of feedback: it takes up backlash and shaft torsion before the start.

A joint behind backlash and a soft shaft rests until its axis has taken them up, some degrees later.
The preparatory motion (run-up) moves back and returns. Every joint then stands at the plan's start,
its backlash is taken up in the direction of the plan, and its lost motion and ratio are known. With
θ₁ between 0 and 90 degrees the ratio of the speeds of axes 2 and 3 is K₂ cos²θ₁ to K₃ cos³θ₂. So
one drive brings both joints to their start, in stages between which θ₁ swings (`LEGS`):

    back, at a middle θ₁                joint 3 goes further back than joint 2
    forward, at a small θ₁              joint 2 comes closer, joint 3 still lags
    forward, at a large θ₁              joint 3 comes closer, joint 2 hardly moves
    forward, as θ₁ goes to its start    both arrive; the remaining distances are known by now

The angle of each stage is computed with the machine's mean backlash; the tracker corrects the rest.
cosθ₁ is even, so the swing may go to either side; a smaller swing costs accuracy. The first of
`SHAPES` that keeps clear of every limit is taken; if none does, there is no run-up.

It has to move back: only a drive through the full backlash corrects a joint that stands ahead of
its start (0.2 degrees at random). Without moving back the two joints cannot be brought into contact
one by one, since their backlash and their positions in it differ by more than θ₁ can compensate.
Even if both were known, the best motion that only goes forward would start with an error of
0.7 degrees (95 %).

This motion and the tracker's commands have the same limits (`input_limit`).
"""

from __future__ import annotations

import numpy as np

from planner.errors import InputError, UntrackableError
from planner.machine.feedback.course import RunUp, first_motion, through_play, turns_back
from planner.machine.feedback.means import (
    gearhead_play,
    input_limit,
    input_scale,
    lost_motion,
    lost_spread,
)
from planner.machine.limits import lower_margins, parts_of
from planner.machine.machine import Machine
from planner.plan.measures import excess_share, peak_inputs
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

STEP_S = 0.02
"""Time step of the run-up, s."""

LEGS = np.array(
    [
        [20.0, 0.0, 0.0, 0.0, 0.0],
        [34.0, 0.5, 0.0, 0.0, 0.0],
        [20.0, 0.5, 0.0, 0.0, 0.0],
        [10.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.0, 0.0],
        [10.0, 0.0, 0.5, 0.0, 0.0],
        [62.0, 0.0, 0.0, 0.6, 0.0],
        [50.0, 0.0, 0.0, 0.4, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0],
    ]
)
"""Legs of the run-up: |θ₁| at the end, degrees, and fractions of the four drives: back, at small
θ₁, at large θ₁, and the last. θ₁ = 0 drives joint 2 fastest. Beyond 62 degrees the swing costs more
time than it gains; below 60 degrees the drive of joint 3 moves joint 2 too much (E 0.27 degrees
instead of 0.23, 95 %; on the paper's problem, where the run-up takes 8 s)."""

SHAPES = tuple((most, side) for most in (62.0, 55.0, 50.0, 45.0) for side in (1, -1))
"""Largest |θ₁|, degrees, and side (1 for the start's, −1 for the other) of the run-ups to try in
turn. On the paper's problem E is 0.22, 0.31, 0.34 and 0.36 degrees (95 %) on the start's side,
0.22, 0.26, 0.36 and 0.39 on the other; from (30, 30, 30) to (1, 1, 1) 0.58, 0.80, 1.4 and 2.7 on
the start's side. Without run-up it is 3.8 and 3.7. A plan that straightens joint 2 takes the
start's side only: on the other, machines with a large lost motion had E of 6 to 16 degrees, where
plans that bend joint 2 had 0.2."""

ROUNDING = 1e-9
"""Excess over a limit that counts as rounding, in its unit."""

ROOM_SHARE, ROOM_DEG = 0.05, 1.0
"""Room that the nominal run-up keeps to each limit, or as much as the plan's start has if that is
less: a share of the arm's length to obstacles and links, or its `clearance`; degrees to joints'."""

BACK_DEG, BACK_SPREADS, FINAL_BACK_DEG = 8.0, 10.0, 4.0
"""Least distance that the last joint goes back so that its lost motion w is measured, first in
degrees, then in standard deviations of w; and the last drive of joint 2, degrees, which the tracker
can leave out if joint 2 arrives early. Each joint loses 2w on the way back and forth. The
difference between two joints varies by 2√2 standard deviations of w, so ten leave room for 3.5
times that. With five, E is 2.1 degrees instead of 0.4 (95 %, twice the prototype's spreads)."""

APPROACH_DEG, APPROACH_S, REST_S = 1.5, 0.4, 0.2
"""Last approach of θ₁ to its start: distance, degrees; time, s; and rest afterwards, s, of ten time
constants of the servos and of the joints' friction."""

SWING_SHARE, DRIVE_SHARE = 0.95, 0.7
"""Speeds of motor 2 and of the drive, as fractions of their limits; the rest is for corrections.
With 0.9 for the drive the run-up is up to 1.5 s shorter, but a machine whose lost motion exceeds
the mean by a fifth lacks time: E is 3.3 degrees instead of 0.6 ((30, 30, 30) to (-12, -13, -8))."""

COAST_DEG, LEAST_SPEED_SHARE = 0.25, 0.2
"""Largest distance that a joint with inertia may coast until friction stops it, degrees, since the
plan starts with that error; and least speed, as a fraction of the speed without inertia, so that
the run-up takes at most five times as long. At full speed the prototype's joints coast by up to 4
degrees, and E is 1.2 instead of 0.3 degrees (50 %).
"""

RAMP_S = 1 / 30
"""Longest time in which a motor reaches the run-up's speed, s, since the run-up's nominal motion
jumps to it. Without limits of the inputs the prototype's motors would go at 3 rad/s, and E is 14.4
instead of 0.3 degrees (50 %, the paper's problem); limits up to 1 rad/s decide themselves."""


def run_up(plan: Plan, machine: Machine, options: FeedbackTable) -> RunUp | None:
    """Return the run-up of a plan on a machine; None if it is not wanted or would not help.

    Raises:
        InputError: If the run-up is requested, and the arm has more than three joints or no room.
    """
    if not options.run_up:
        return None
    found, why = _search(plan, machine, wanted=options.run_up is True)
    if why and options.run_up is True:
        raise InputError(f"feedback.run_up = true: {why}")
    return found


def hindrance(plan: Plan, machine: Machine) -> str:
    """Return why a run-up cannot take up the play before a plan, in words; "" if it can, or without
    play."""
    return _search(plan, machine)[1]


def _search(plan: Plan, machine: Machine, *, wanted: bool = False) -> tuple[RunUp | None, str]:
    """Return the first run-up of `SHAPES` that fits, or None and why there is none ("" without
    play); if `wanted`, one before a plan that reverses, too."""
    system = plan.problem.system
    if not isinstance(system, Manipulator) or not (lost := lost_motion(system, machine)).any():
        return None, ""
    if system.n > 3:
        return None, (
            f"one drive cannot take up the play of {system.n - 1} joints before the start; the"
            " run-up works for arms of two or three joints"
        )
    if turns_back(plan) and not plan.is_compensated and not wanted:
        why = "the drive reverses during the plan, and every joint must then cross its play again"
        return None, why
    if (first := first_motion(plan))[0] == 0:
        return None, ""
    speed = np.array([DRIVE_SHARE, SWING_SHARE]) * input_scale(plan, machine)
    speed = np.minimum(speed, RAMP_S * machine.mean("acceleration_limit_rad_s2"))
    speed = np.minimum(speed, np.maximum(_coasting_speed(machine), LEAST_SPEED_SHARE * speed))
    lost = np.concatenate([gearhead_play(system, machine) / 2, lost])
    behind = max(np.deg2rad(BACK_DEG), BACK_SPREADS * float(lost_spread(machine, system.n).max()))
    why, straightens = "", first[0] * plan.q(plan.lead_s)[2] < 0
    for most_deg, side in SHAPES if system.n == 3 else SHAPES[:1]:
        if side < 0 and straightens:
            continue
        found = _Approach(plan, lost, first, speed, behind, most_deg, side).solve()
        if not (way := _breach(plan, system, found)):
            return found, ""
        why = why or f"there is no room to take up the play before the start: {way}"
    return None, why


def _breach(plan: Plan, system: Manipulator, found: RunUp) -> str:
    """Return the limit to which a run-up does not keep its room, and the room, in words; or ""."""
    parts = [(part, each) for each, part, *_ in parts_of(plan.problem)]
    least, at_start, when = np.full((3, 1, len(parts)), np.inf)
    lower_margins(least, when, plan.problem, found.q[None], found.t)
    lower_margins(at_start, when, plan.problem, found.q[None, -1:], found.t[-1:])
    reach = float(np.sum(system.link_lengths))
    for (part, each), margin, start in zip(parts, least[0], at_start[0], strict=True):
        room = max(ROOM_SHARE * reach, getattr(each, "clearance", 0.0))
        room = {"m": room, "rad": np.deg2rad(ROOM_DEG)}.get(part.unit, 0.0)
        if each.physical and margin < min(room, start) - ROUNDING:
            scale, unit = (180 / np.pi, "deg") if part.unit == "rad" else (1.0, part.unit)
            return f"{part.label} would have {scale * margin:.3g} {unit}, {scale * room:.3g} wanted"
    return ""


def _coasting_speed(machine: Machine) -> Array:
    """Return the speeds (2,), rad/s, at which joints coast by `COAST_DEG`; infinite without
    inertia.

    A link that θ₁ swings keeps its speed when θ₁ stops. A link that its axis hits at the end of the
    play leaves at up to twice the axis's speed. Friction absorbs its energy, I v²/2.
    """
    if machine.fidelity != "dynamic":
        return np.full(2, np.inf)
    friction = float(np.min(machine.mean("coulomb_friction_nm")))
    inertia = float(np.max(machine.mean("link_inertia_kgm2")))
    with np.errstate(divide="ignore"):
        speed = np.sqrt(np.divide(2 * friction * np.deg2rad(COAST_DEG), inertia))
    return np.array([speed / 2, speed])


class _Approach:
    """The run-up's inputs and nominal motion as functions of the drive's travel in each stage.

    Args:
        plan: The plan.
        lost: Lost motion of each coordinate, (N,), rad; for the first, that of motor 1's gearhead.
        way: Signs of the plan's first inputs, (2,).
        speed: Speeds of the drive and of the swings of θ₁, (2,), rad/s.
        behind: Distance that the last joint goes back, rad.
        most_deg: Largest |θ₁|, degrees.
        side: Whether θ₁ swings to the start's side, 1, or to the other, −1.
    """

    def __init__(
        self,
        plan: Plan,
        lost: Array,
        way: Array,
        speed: Array,
        behind: float,
        most_deg: float,
        side: int,
    ) -> None:
        self._rates, self._lost = plan.problem.system.rates, lost
        begins = plan.q if turns_back(plan) else plan.reference  # as in `Course`
        self._start, self._way, self._speed = begins(plan.lead_s), way, speed
        self._rate = plan.problem.limits.input_rate
        most = min(np.deg2rad(most_deg), plan.problem.limits.joint[1] - np.deg2rad(APPROACH_DEG))
        side *= 1 if self._start[1] >= 0 else -1
        self._places = side * np.minimum(np.deg2rad(LEGS[:, 0]), most)
        self._back = self._drive(34.0, -1, float(lost[-1]) + behind)

    def solve(self) -> RunUp:
        """Return the run-up whose nominal motion ends at the plan's start."""
        from scipy.optimize import least_squares  # slow to import

        def miss(drives: Array) -> Array:
            return np.asarray((self._motion(self._inputs(drives))[-1] - self._start)[2:])

        guess = 3 * self._back * np.ones(len(self._lost) - 2)
        solution = least_squares(miss, guess, bounds=(0.0, np.inf), diff_step=1e-2)
        u = self._inputs(solution.x)
        q = self._motion(u)
        q += (self._start - q[-1]) * np.linspace(0.0, 1.0, len(q))[:, None]
        return RunUp(STEP_S * np.arange(-len(u), 1.0), q, u)

    def _drive(self, theta1_deg: float, joint: int, angle: float) -> float:
        """Return the travel of the drive, rad, that turns the axis of a joint by `angle`, rad."""
        q = self._start.copy()
        q[1] = np.deg2rad(theta1_deg) if len(self._lost) > 3 else q[1]
        return float(angle / self._rates(q, np.array([1.0, 0.0]))[joint])

    def _inputs(self, drives: Array) -> Array:
        """Return the inputs of each step, (m, 2), for the drive's travels in the forward stages,
        (n−1,)."""
        start = self._start[1]
        before = start - self._way[1] * np.deg2rad(APPROACH_DEG)
        if len(self._lost) > 3:
            at_last = self._drive(20.0, 2, np.deg2rad(FINAL_BACK_DEG))
            travels = LEGS[:, 1:] @ np.array([-self._back, *drives, at_last])
            places = self._places
        else:
            travels, places = np.array([-self._back, drives[0]]), np.array([start, start])
        swings = np.diff([start, *places, before])
        moves = list(map(self._leg, swings, [*travels, 0.0]))
        moves.append(self._leg(start - before, 0.0, APPROACH_S))
        return np.concatenate([*moves, np.zeros((round(REST_S / STEP_S), 2))])

    def _leg(self, swing: float, drive: float, least_s: float = 0.0) -> Array:
        """Return the inputs (m, 2) that turn both motors from rest to rest within their limits."""
        travel = np.array([self._way[0] * drive, swing])
        ramp = np.where(np.isfinite(self._rate), np.ceil(self._speed / (self._rate * STEP_S)), 0.0)
        steps = np.ceil(np.abs(travel) / (self._speed * STEP_S)) + ramp * (travel != 0)
        count = max(int(steps.max()), round(least_s / STEP_S))
        room = np.minimum(np.arange(count), np.arange(count)[::-1]) + 0.5
        shape = np.minimum(room[:, None], np.maximum(ramp, 0.5))
        return np.asarray(travel * shape / (shape.sum(axis=0) * STEP_S))

    def _motion(self, u: Array) -> Array:
        """Return the coordinates of the nominal machine at the ends of all steps, (m+1, N).

        The coordinates are integrated one by one, since each rate depends only on the coordinates
        before it and on the drive, whose coordinate comes last.
        """
        turns = STEP_S * u
        motor = np.cumsum([0.0, *turns[:, 0]])
        turns[:, 0] = np.diff(through_play(motor, float(self._lost[0])))
        q = np.repeat(self._start[None], len(u) + 1, axis=0)
        for i in (*range(1, len(self._start)), 0):
            middle = q[:-1] + self._rates(q[:-1], turns) / 2
            steps = self._rates(middle, turns)[:, i]
            axis = np.cumsum([self._start[i], *steps])
            q[:, i] = through_play(axis, float(self._lost[i])) if i else axis
        return q


EXCESS_TRAVEL_SHARE = 0.05
"""Largest fraction of an input's travel above its limit that the tracker can make up for."""


def refuse_excess(plan: Plan, machine: Machine) -> None:
    """Refuse a plan whose inputs exceed their limits during a large part of the motion.

    Raises:
        UntrackableError: If so; the message names the input, its peak and the limit.
    """
    limit = input_limit(plan, machine)
    share = excess_share(plan.trajectory, limit)
    i = int(np.argmax(share))
    if share[i] <= EXCESS_TRAVEL_SHARE:
        return
    c, peak = plan.problem.system.inputs[i], peak_inputs(plan.trajectory)[i]
    by_problem = limit[i] >= plan.problem.limits.input[i]
    source = (
        "the problem's limits allow" if by_problem else "the machine's velocity_limit_rad_s allows"
    )
    request = f"{c.name} asks for {peak:.3g} {c.unit}"
    raise UntrackableError(
        f"feedback cannot follow this {plan.method} plan: {request}, {source} {limit[i]:g}"
        f" {c.unit}, and {share[i]:.0%} of the travel of {c.name} lies above that limit; give the"
        " plan more time (goal.duration, or planner.retime)",
        why=f"feedback cannot follow the plan: {request}, allowed {limit[i]:g} {c.unit}",
    )
