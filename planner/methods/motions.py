"""Motions of an arm without a given goal: `excitation`, for identification, `homing` and `seating`.

`excitation` gives `planner.identify` the most information in little time: the drive reverses in a
square wave while θ₁ follows two sines, so that every joint crosses its backlash many times, at many
angles of the contacts, slowly and fast.

`homing` leaves an arm in a known state. A joint that was pushed forward rests with its axis ahead
by its lost motion w. So the drive turns back, then forward until every passive encoder has risen:
then every axis is ahead, for any w. Joint 1 turns forward last, since the bias of motor 2 would
otherwise move the gearhead away again. The drive ends slowly, since links with inertia coast
through their backlash when it stops. A controller runs the motion with the encoders: see
`planner.machine.feedback.homing`.

`seating` leaves it in the same state without readings: the drive turns back and forward by more
than the whole lost motion, which must be known.

All are verified plans from the problem's start. Their inputs are linear between knots (`KNOT_S`),
their coordinates follow from the kinematics, and their goal is their own end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError, PlannerError, VerificationError
from planner.methods.refusal import looser_limits
from planner.plan.measures import Objective
from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.runge_kutta import step
from planner.systems.manipulator import Manipulator
from planner.verification.verdict import judge

KNOT_S = 0.02
"""Time between the knots of the inputs, s: two periods of the usual controller."""

SHARE = 0.9
"""Fraction of a limit that a motion uses, so that a machine with errors keeps the limit too."""

USUAL_RATE = 4.0
"""Largest acceleration of a motor, rad/s², if no limit is lower: 0.1 s from rest to full speed."""

# -- excitation -----------------------------------------------------------------------------------

WAVES = {
    "excitation": (30.0, 0.45, 5.3, (0.35, 0.12), (11.0, 3.1)),
    "check": (20.0, 0.3, 6.0, (0.15, 0.1), (17.0, 5.0)),
}
"""Motions in waves: length, s; speed, rad/s, and period, s, of the drive's square wave; speeds and
periods of the two sines of θ₁. Two motors that move at once give more information per second than
in turn. Only a drive that reverses shows the lost motion; the paper's motion never reverses.

The check is slower, as usual plans are. On six emulated arms with inertia, identified without, its
half width covered 18 of 23 ends of plans; that of a second excitation 17, those of a faster θ₁ or a
slower drive (period 16 s) fewer."""

SIZES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4)
"""Sizes to try in turn, as fractions of the usual excitation, until the motion keeps joint limits
and touches nothing. At 0.3 the axes would hardly exceed twice the prototype's lost motion of 4.7
degrees."""


def excitation(problem: AnyProblem) -> Plan:
    """Return a motion of 30 s to record, from which `planner.identify` learns the machine.

    The drive reverses in a square wave of 5.3 s while θ₁ follows two sines of 11 and 3.1 s. The
    motion starts at the problem's start, which should be near θ₁ = 0, and keeps every limit except
    that of z₂, which is for plans towards a goal; waypoints are ignored.

    Args:
        problem: Defines the arm, the start and the limits.

    Raises:
        InputError: If the system is not an arm with friction disks, or the motion ends in an
            obstacle.
        VerificationError: If no motion of a useful size keeps the limits; the error lists the
            violations of the largest motion tried.
    """
    return _waves(problem, "excitation")


def check_run(problem: AnyProblem) -> Plan:
    """Return a motion of 20 s to keep out of the fit, on which `planner.identify` tests its result.

    Every joint reverses six times: a run in one direction is predicted as well by a machine whose
    lost motion is a degree off. Its speeds and angles are not those of `excitation`, since a second
    run of one motion hides what the model lacks. For arguments and errors see `excitation`.
    """
    return _waves(problem, "check")


def _waves(given: AnyProblem, name: str) -> Plan:
    problem, system = _arm(given, f"a motion of kind '{name}'")
    length_s, drive_rad_s, period_s, speeds, periods_s = WAVES[name]
    t = KNOT_S * np.arange(round(length_s / KNOT_S) + 1, dtype=np.float64)
    most = SHARE * problem.limits.input
    rate = np.minimum(SHARE * problem.limits.input_rate, USUAL_RATE)
    drive = min(drive_rad_s, most[0]) * np.sign(np.sin(2 * np.pi * t / period_s))
    sines = zip(speeds, periods_s, strict=True)
    turn = sum(speed * np.sin(2 * np.pi * t / period) for speed, period in sines)
    turn *= min(1.0, most[1] / sum(speeds))
    side = -1.0 if problem.start[1] > 0 else 1.0  # first towards the wider part of the range
    tries = [(size, way) for size in SIZES for way in (side, -side)]
    inputs = [np.stack([size * drive, size * way * turn], axis=1) for size, way in tries]
    u = _within_rate(np.stack(inputs, axis=1), rate)
    q = _course(system, problem.start, t, u)  # all at once, which takes hardly longer than one
    why: PlannerError | None = None
    for k, (size, _) in enumerate(tries):
        try:
            return _motion(problem, system, name, t, u[:, k], q[:, k], {"size": size})
        except (InputError, VerificationError) as error:
            why = why or error
    assert why is not None
    raise why


def signs(problem: AnyProblem) -> Plan:
    """Return a motion that shows the sign of each drive: motor 2 turns forward by 2 degrees, then
    motor 1. For arguments and errors see `homing`."""
    problem, system = _arm(problem, "a motion of kind 'signs'")
    turns = [(motor, np.deg2rad(LAST_TURN_DEG), LAST_TURN_RAD_S, RAMP_S) for motor in (1, 0)]
    return _turned(problem, system, "signs", _in_turn(problem, turns)[0], {})


# -- homing ---------------------------------------------------------------------------------------

BACK_RAD, FORWARD_RAD, QUICK_RAD_S = 0.6, 0.5, 0.3
SLOW_RAD, SLOW_RAD_S = 0.9, 0.075
"""Turns, rad, and speeds, rad/s, of the drive while homing: quickly back and forward, then slowly
forward; for an arm whose last axis turns `USUAL_AXIS` times as far. The turn back exceeds twice the
largest lost motion of a prototype (2 · 7 degrees). The slow turn is long enough for the encoders of
every machine to rise; the homing rule shortens it. The rule counts only the rise in the slow turn,
since joints with inertia run ahead of their axes when the quick turn stops."""
USUAL_AXIS = 0.476

LAST_TURN_DEG, LAST_TURN_RAD_S = 2.0, 0.05
"""Angle and speed of the last turn of joint 1; the angle is four times its gearhead's backlash."""

RAMP_S = 0.75
"""Time in which slow turns reach their speed, and stop, s. With short ramps inertia overcomes
friction and turns joints ahead of their axes: by 0.9 degrees as joint 1 stops in 0.05 s."""

RISE_DEG = 1.5
"""Rise of a passive encoder that proves its axis to be ahead: seventeen times its resolution. With
more noise than 0.15 degrees it is no proof; see `planner.machine.feedback.homing`."""

REST_S, BETWEEN_S = 0.3, 0.05
"""Rest at the end, s, in which servos and joints settle; and further rest after every turn, s."""

MOST_STRETCH = 2.5
"""Largest factor on the usual turns for slower axes; a larger factor exceeds the joints' range."""


def homing(problem: AnyProblem) -> Plan:
    """Return a motion after which backlash and torsion are known: every axis is ahead of its joint.

    The drive turns back by 0.6 rad, forward by 0.5 rad at 0.3 rad/s, then slowly until every
    passive encoder has risen by 1.5 degrees above its least reading in that turn. Joint 1 then
    turns forward slowly by 2 degrees, and the arm rests. The plan contains the longest slow turn
    that may be needed. A controller ends this turn once the encoders have risen, and goes on with
    the rest of the plan. `notes["until"]` says how: the turn may end from `from_s` on, once the
    readings since `count_from_s` have risen by `rise_deg`; the plan continues at `to_s`. For
    emulated machines use `planner.replay(plan, feedback=planner.HomingRule())`.

    Args:
        problem: Defines the arm, its present pose and the limits, of which that of z₂ is ignored.

    Raises:
        InputError: If the system is not an arm with friction disks, or an axis hardly turns at the
            start.
        VerificationError: If the motion breaks a limit or touches something.
    """
    problem, system = _arm(problem, "a homing motion")
    stretch = max(1.0, USUAL_AXIS / float(_axis_rates(problem, system, "a homing motion").min()))
    turns = [
        (0, -BACK_RAD * stretch, QUICK_RAD_S, 0.0),
        (0, FORWARD_RAD * stretch, QUICK_RAD_S, 0.0),
        (0, SLOW_RAD * stretch, SLOW_RAD_S, RAMP_S),
        (1, np.deg2rad(LAST_TURN_DEG), LAST_TURN_RAD_S, RAMP_S),
    ]
    u, pieces = _in_turn(problem, turns)
    slow = np.flatnonzero(u[:, 0] == pieces[3][len(pieces[3]) // 2, 0])  # without its ramps
    until = {
        "from_s": float(KNOT_S * slow[0]),
        "to_s": float(KNOT_S * slow[-1]),
        "count_from_s": float(KNOT_S * slow[0]),
        "rise_deg": RISE_DEG,
    }
    notes = {"until": until, "end_state": [1.0] * (1 + system.n)}
    return _turned(problem, system, "homing", u, notes)


# -- seating --------------------------------------------------------------------------------------

SEAT_RAD_S, LAST_SEAT_RAD_S, LAST_SEAT_RAMP_S = 0.45, 0.1, 0.25
"""Speeds of the drive and of the last turn of joint 1 while seating, rad/s; time in which that turn
reaches its speed, s. Without readings nothing is gained by slow turns."""


def seating(problem: Problem, axis_turns: Array, gearhead_play: float) -> Plan:
    """Return the motion of `planner.seating`.

    Args:
        problem: Defines the arm, its present pose and the limits, of which that of z₂ is ignored.
        axis_turns: Angle by which the drive must turn each passive axis in either direction, were
            its contacts ideal, (n−1,), rad.
        gearhead_play: Whole play of the drive's gearhead, rad.
    """
    problem, system = _arm(problem, "a seating motion")
    axes = _axis_rates(problem, system, "a seating motion")
    drive = float(np.max(axis_turns / axes)) + 2 * gearhead_play
    turns = [
        (0, -drive, SEAT_RAD_S, RAMP_S),
        (0, drive, SEAT_RAD_S, RAMP_S),
        (1, np.deg2rad(LAST_TURN_DEG), LAST_SEAT_RAD_S, LAST_SEAT_RAMP_S),
    ]
    notes = {"end_state": [1.0] * (1 + system.n)}
    return _turned(problem, system, "seating", _in_turn(problem, turns)[0], notes)


def _axis_rates(problem: Problem, system: Manipulator, what: str) -> Array:
    """Return the turn of each passive axis per turn of the drive at the start, (n−1,)."""
    axes = np.abs(system.rates(problem.start, np.array([1.0, 0.0]))[2:])
    if MOST_STRETCH * axes.min() < USUAL_AXIS:
        raise InputError(
            f"at the start the slowest passive axis turns by {axes.min():.3g} of"
            f" the drive, too little for {what}; bring joints 1 to n-1 nearer to 0 degrees",
            source=problem.source,
        )
    return np.asarray(axes)


def _turned(
    problem: Problem, system: Manipulator, name: str, u: Array, notes: dict[str, Any]
) -> Plan:
    """Return the verified plan with the inputs u (K+1, 2) at its knots."""
    t = KNOT_S * np.arange(len(u), dtype=np.float64)
    return _motion(problem, system, name, t, u, _course(system, problem.start, t, u), notes)


def _in_turn(
    problem: Problem, turns: Sequence[tuple[int, float, float, float]]
) -> tuple[Array, list[Array]]:
    """Return the inputs (K+1, 2) at the knots of turns one after the other and of the rest at the
    end, and those of each turn; a turn is a motor, an angle, a speed and the time of a ramp."""
    rate = np.minimum(SHARE * problem.limits.input_rate, USUAL_RATE)
    pieces = [np.zeros((1, 2))]
    for motor, angle, speed, ramp_s in turns:
        speed = min(speed, SHARE * problem.limits.input[motor])
        pieces.append(_turn(motor, angle, speed, max(ramp_s, speed / rate[motor])))
    pieces.append(np.zeros((round(REST_S / KNOT_S), 2)))
    return np.concatenate(pieces), pieces


def _turn(motor: int, angle: float, speed: float, ramp_s: float) -> Array:
    """Return the inputs (K, 2) at the knots of one motor's turn and of the rest after the turn.

    The first knot is left out, since it is the last knot of the previous turn.
    """
    ramp = max(1, int(np.ceil(ramp_s / KNOT_S - 1e-9)))
    whole = max(2 * ramp, int(np.ceil(abs(angle) / speed / KNOT_S)) + ramp)
    shape = np.minimum(1.0, np.minimum(np.arange(1, whole + 1), np.arange(whole, 0, -1) - 1) / ramp)
    out = np.zeros((whole + round(BETWEEN_S / KNOT_S), 2))
    out[:whole, motor] = angle * shape / (shape.sum() * KNOT_S)
    return out


MOTIONS: dict[str, Callable[[AnyProblem], Plan]] = {
    "excitation": excitation,
    "check": check_run,
    "homing": homing,
    "signs": signs,
}
"""Functions that make motions, by name; the plan of a motion has this name as its method."""

# -- both -----------------------------------------------------------------------------------------


def _arm(problem: AnyProblem, what: str) -> tuple[Problem, Manipulator]:
    """Return the problem of an arm, and the arm."""
    problem = problem_of(problem)
    system = problem.system
    if not isinstance(system, Manipulator):
        raise InputError(
            f"{what} is for arms with friction disks (system.kind ="
            f" 'manipulator'), and this is a {system.kind}",
            source=problem.source,
        )
    return problem, system


def _within_rate(u: Array, rate: Array) -> Array:
    """Return inputs (K+1, …, 2) that follow u from rest to rest, with rates up to `rate` (2,)."""
    most, out = rate * KNOT_S, u.copy()
    out[0] = 0.0
    for k in range(1, len(u)):
        out[k] = np.clip(u[k], out[k - 1] - most, out[k - 1] + most)
    out[-1] = 0.0
    for k in range(len(u) - 2, 0, -1):
        out[k] = np.clip(out[k], out[k + 1] - most, out[k + 1] + most)
    return out


def _course(system: Manipulator, start: Array, t: Array, u: Array) -> Array:
    """Return q (K+1, …, n+1) of an arm under inputs u (K+1, …, 2) linear between times t."""
    nodes = [np.broadcast_to(start, (*u.shape[1:-1], system.size))]
    for k, h in enumerate(np.diff(t)):
        inputs = np.stack([u[k], (u[k] + u[k + 1]) / 2, u[k + 1]])
        nodes.append(step(lambda q, part, v=inputs: system.rates(q, v[part]), nodes[-1], h))  # type: ignore[misc]
    return np.array(nodes)


def _motion(
    problem: Problem,
    system: Manipulator,
    name: str,
    t: Array,
    u: Array,
    q: Array,
    notes: dict[str, Any],
) -> Plan:
    """Return the verified plan of a motion, with the motion's own end as the goal.

    Args:
        problem: The problem; its goal, waypoints, compensation and margin of z₂ are dropped.
        system: The arm of the problem.
        name: Name of the motion, which the plan has as its method.
        t: Times of the knots, shape (K+1,).
        u: Inputs at the knots, shape (K+1, 2), linear between them.
        q: Coordinates at the knots, shape (K+1, n+1).
        notes: Notes of the plan.

    Raises:
        InputError: If the end of the motion is not allowed as a goal.
        VerificationError: If the motion breaks a limit or touches something.
    """
    third = system.rates(q, u) * np.diff(t, append=t[-1] + KNOT_S)[:, None] / 3
    q_curve = Bernstein(np.stack([q[:-1], q[:-1] + third[:-1], q[1:] - third[1:], q[1:]]), t)
    trajectory = StateTrajectory(system, q_curve, Bernstein(np.stack([u[:-1], u[1:]]), t))
    goal = {"theta_deg": np.rad2deg(q[-1, 1:]).tolist(), "travel": "free", "duration": t[-1]}
    towards_no_goal: dict[str, Any] = {
        "limits.z2_margin": None,
        "waypoints": [],
        "compensation": {},
    }
    try:
        task = problem.changed({"goal": goal, **towards_no_goal})
    except InputError as error:
        raise InputError(
            f"the {name} motion has an end that is not allowed: {error.body}", source=problem.source
        ) from None
    plan, check = judge(Plan(task, name, {}, trajectory, aim=Objective("none"), notes=notes))
    if check.ok:
        return plan
    raise VerificationError(
        f"the {name} motion breaks {len(check.violations)}"
        f" requirement{'s' if len(check.violations) > 1 else ''}",
        source=problem.source,
        plan=replace(plan, status=VerificationError.status),
        violations=check.violations,
        advice=["start near 0 degrees", *looser_limits(problem), "no obstacles within reach"],
    )
