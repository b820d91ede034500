"""The tracker's reference motion (a preparatory motion, if any, then the plan) and its clock."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from planner.errors import InputError
from planner.machine.feedback.means import shift_of
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class RunUp:
    """Preparatory motion before a plan, which ends at rest at the plan's first coordinates.

    Attributes:
        t: Increasing times (m+1,), s; the last is 0, where the plan's motion starts.
        q: Coordinates at these times, (m+1, N).
        u: Inputs between these times, (m, 2).
    """

    t: Array
    q: Array
    u: Array


class Course:
    """Reference motion of the tracker: coordinates and commanded motor angles at any time.

    For a plan without compensation this is the plan's own motion. For a compensated plan it is the
    predicted motion if there is no run-up or the drive reverses, else the original plan's motion,
    since the tracker itself removes the errors.

    Args:
        plan: The plan.
        run_up: The preparatory motion before the plan, if any.
        shift: Time from each motor's command to its effect, (2,), s.
        play: Full backlash of each motor's gearhead, (2,), rad.

    Attributes:
        plan: The plan.
        is_predicted: Whether the course is the predicted motion, which includes lost motion.
        begin: Time at which the course begins, s, in the plan's time; at most 0.
        start: Time at which the motion whose errors are measured starts, s.
        end: Time at which that motion ends, s.
        swing: Least and greatest θ₁ before the start, (2,), rad; infinite without a run-up.
    """

    def __init__(self, plan: Plan, run_up: RunUp | None, shift: Array, play: Array) -> None:
        self.plan, self._run_up = plan, run_up
        self.start, self.end = plan.lead_s, plan.duration - plan.tail_s
        if turns_back(plan):  # the predicted motion continues until the plan's end
            self.end = plan.duration
        self.swing: Array = np.array([-np.inf, np.inf])
        if run_up is not None:
            self.swing = np.array([run_up.q[:, 1].min(), run_up.q[:, 1].max()])
        self.begin = 0.0 if run_up is None else min(0.0, float(self.start + run_up.t[0]))
        self.is_predicted = plan.compensates is not None and (run_up is None or turns_back(plan))
        self._followed, self._late = plan, 0.0
        if plan.compensates is not None and not self.is_predicted:
            self._followed, self._late = plan.compensates, self.start
        times, angles = turn_angles(self._followed, DEFAULT_TICK_S)
        times = times + self._late
        if self.is_predicted:
            motors = zip(angles.T, play / 2, strict=True)
            angles = np.stack([through_play(*motor) for motor in motors], axis=1)
        self._commanded: list[tuple[Array, Array]] = []
        for i in range(2):
            # The commands of a compensated plan already allow for the shift.
            when = times if self.is_predicted else times - shift[i]
            is_early = when <= self.end - shift[i]
            when, angle = when[is_early], angles[is_early, i]
            if run_up is not None:
                before = run_up.t + self.start - shift[i]
                way = np.concatenate([[0.0], np.cumsum(run_up.u[:, i] * np.diff(run_up.t))])
                first = np.interp(before[-1], when, angle)
                later = when > before[-1]
                when = np.concatenate([before, when[later]])
                angle = np.concatenate([way, way[-1] + angle[later] - first])
            self._commanded.append((when, angle))

    def q(self, t: Array) -> Array:
        """Return the coordinates (…, N) to follow at times t (…), s; constant before and after."""
        out = self._followed.trajectory.q(np.minimum(t, self.end) - self._late)
        if self._run_up is None:
            return out
        when = t - self.start
        columns = [np.interp(when, self._run_up.t, column) for column in self._run_up.q.T]
        before = np.stack(columns, axis=-1)
        return np.where((when < 0)[..., None], before, out)

    def commanded_angles(self, t: Array) -> Array:
        """Return the angles (…, 2), rad, by which the commands that follow the course turn the
        motors up to times t (…), s."""
        return np.stack([np.interp(t, when, angle) for when, angle in self._commanded], axis=-1)


def first_motion(plan: Plan) -> Array:
    """Return the signs of the first motion of both inputs, (2,); 0 for an input that never acts.

    The signs of a compensated plan are those of the original plan.
    """
    plan = plan.compensates or plan
    u = plan.u(np.linspace(0.0, plan.duration, 501))
    moving = np.abs(u) > 1e-6 * np.max(np.abs(u))
    return np.sign(u[np.argmax(moving, axis=0), [0, 1]])


def turns_back(plan: Plan) -> bool:
    """Return whether a plan's drive reverses and so crosses its backlash again."""
    plan = plan.compensates or plan
    drive = plan.u(np.linspace(0.0, plan.duration, 501))[:, 0]
    least = -1e-6 * np.max(np.abs(drive))
    return bool(np.min(drive) < least and np.max(drive) > -least)


PARTS_A_TICK = 16
"""Parts of a tick for integrating a plan's inputs, which may jump inside a tick."""

BLOCK_PARTS = 100_000
"""Number of parts whose inputs are computed at once."""


def turn_angles(plan: Plan, tick: float) -> tuple[Array, Array]:
    """Return times (M,), s, and the angles (M, 2), rad, by which a plan's inputs turn the motors up
    to these times."""
    count = PARTS_A_TICK * int(np.ceil(plan.duration / tick))
    times = np.unique(np.concatenate([plan.t, np.linspace(0.0, plan.duration, count + 1)]))
    angles = np.zeros((len(times), 2))
    for first in range(0, len(times) - 1, BLOCK_PARTS):  # for inputs take far more memory
        edges = times[first : first + BLOCK_PARTS + 1]
        turned = plan.u((edges[:-1] + edges[1:]) / 2) * np.diff(edges)[:, None]
        angles[first + 1 : first + 1 + len(turned)] = turned
    return times, np.cumsum(angles, axis=0)


def through_play(angles: Array, half: float) -> Array:
    """Return the output angles (M,) behind a play of ± `half` for input angles (M,), rad; the first
    output equals the first input."""
    room = zip((angles[1:] - half).tolist(), (angles[1:] + half).tolist(), strict=True)
    follow = accumulate(
        room, lambda last, ends: min(max(last, ends[0]), ends[1]), initial=float(angles[0])
    )
    return np.array([*follow])


DEFAULT_TICK_S = 0.01
"""Time for which a command is held if the machine has no control period, s."""


@dataclass(frozen=True, eq=False)
class Timing:
    """Clock of the tracker: times of readings, of commands and of their effects.

    Attributes:
        begin: Time of the first reading, s; 0 is the beginning of the plan.
        tick: Time for which a command is held, s.
        ticks: Number of ticks per period, M.
        latency: Ticks from a reading to the first command that depends on it.
        shift: Time from each motor's command to its effect, (2,), s: the machine's mean delay, the
            lag of the servo and, for the drive, that of the joints' viscous friction.
    """

    begin: float
    tick: float
    ticks: int
    latency: int
    shift: Array

    @property
    def period(self) -> float:
        """Time between two encoder readings, s."""
        return self.tick * self.ticks

    @property
    def wait(self) -> float:
        """Time from a reading to the first command that depends on it, s."""
        return self.latency * self.tick


def timing(
    options: FeedbackTable, system: TriangularSystem, machine: Machine, begin: float, start: float
) -> Timing:
    """Return the tracker's clock: it begins at or before `begin`, whole periods before `start`, s.

    Raises:
        InputError: If the period is shorter than the machine's control period or than the latency.
    """
    hold = machine.effects.get("control_period_s")
    longest = hold.value[0] if hold else min(DEFAULT_TICK_S, options.period_s)
    if options.period_s < longest * (1 - 1e-9):
        raise InputError(
            f"feedback.period_s = {options.period_s:g}: must be at least the machine's"
            f" control_period_s = {longest:g} s, for which commands are held"
        )
    ticks = int(np.ceil(options.period_s / longest - 1e-9))
    tick = options.period_s / ticks
    latency = int(np.ceil(options.latency_s / tick - 1e-9))
    if latency > ticks:
        raise InputError(
            f"feedback.latency_s = {options.latency_s:g}: must be at most the period,"
            f" feedback.period_s = {options.period_s:g}"
        )
    begin = start - options.period_s * int(np.ceil((start - begin) / options.period_s - 1e-9))
    return Timing(begin, tick, ticks, latency, shift_of(system, machine))
