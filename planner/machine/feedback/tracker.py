"""Feedback for replays: `planner.replay(plan, machine, feedback=True)`.

`TrackerControl` controls S samples: it reads, estimates, predicts, optimises and commands.
`TrackerDesign` has what all samples of a replay share: reference, regulator, programmes.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, expect
from planner.machine.feedback.course import DEFAULT_TICK_S, Course, timing
from planner.machine.feedback.estimate import (
    Forecast,
    History,
    Pose,
    StateEstimate,
    reading_variance,
)
from planner.machine.feedback.means import (
    gearhead_play,
    input_limit,
    input_scale,
    lost_motion,
    mean_passing,
    noise_of,
    resolution_of,
    shift_of,
)
from planner.machine.feedback.programme import TrackingProgramme
from planner.machine.feedback.reference import Reference, Regulator, Weights, reference, regulator
from planner.machine.feedback.run_up import REST_S, refuse_excess, run_up
from planner.machine.machine import Machine
from planner.machine.simulate import MOST_BYTES
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.support.user_tables import parse


class Tracker:
    """A receding-horizon tracker: one small quadratic programme every control period.

    Every 0.1 s the tracker reads the joint encoders, predicts the effect of the commands already
    sent, and corrects the plan's inputs so as to minimise a cost over the remaining motion, within
    the limits of inputs, their rates, joints and z₂. The tracker knows only mean values of the
    machine: control period, delay, servo bandwidth, gearhead backlash, lost motion of the joints,
    resolution and noise of encoders, velocity limit. The preparatory motion also uses the spread of
    lost motion and, with dynamic fidelity, the inertia.

    The tracker follows the path of the plan. For a compensated plan whose drive reverses, or if the
    tracker makes no preparatory motion, the tracker follows the predicted motion to the same goal.

    If a programme has no solution, its state limits are widened to the motion of the regulator
    clipped to the input limits. If OSQP is late, the earlier corrections continue as planned.
    `Replay.fallbacks` counts both.

    Args:
        options: The `[feedback]` table; defaults when left out.
        changes: Keys of the table that replace it: `Tracker(run_up=False)`.

    Raises:
        InputError: If a key is unknown or a value impossible.
    """

    _MOST_DESIGNS = 4

    def __init__(self, options: FeedbackTable | None = None, **changes: Any) -> None:
        if options is not None:
            expect(FeedbackTable, options, "give keys by name, as in planner.Tracker(run_up=False)")
        settings = {} if options is None else options.model_dump(exclude_unset=True)
        self.options = parse(FeedbackTable, {**settings, **changes}, "feedback")
        self._designs: OrderedDict[tuple[int, Machine], tuple[Plan, TrackerDesign]] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return Tracker, (self.options,)

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> TrackerControl:
        """Return a controller of the samples `numbers` (S,); see
        `planner.machine.closed_loop.Feedback`.

        Raises:
            InputError: If the options do not fit the machine.
            UntrackableError: If the plan's inputs far exceed what may be commanded.
        """
        return TrackerControl(self.design(plan, machine), len(numbers))

    def design(self, plan: Plan, machine: Machine) -> TrackerDesign:
        """Return the tracker's design for a plan on a machine, which all samples share; designs are
        cached."""
        key = (id(plan), machine)
        if key not in self._designs:
            self._designs[key] = (plan, design(plan, machine, self.options))
            if len(self._designs) > self._MOST_DESIGNS:
                self._designs.popitem(last=False)
        return self._designs[key][1]


CROSSING_PERIODS = 5
"""Number of periods whose travel must justify crossing the play at a reversal."""

PLAY_SPREAD_SHARE = 0.1
"""Uncertainty of the estimated play of a gearhead, as a fraction of its mean."""


class TrackerControl:
    """Controller of S samples that tracks a plan; see `planner.machine.closed_loop.Controller`.

    Args:
        design: The design that all samples share.
        count: Number of samples S.
    """

    def __init__(self, design: TrackerDesign, count: int) -> None:
        ref, clock = design.ref, design.ref.timing
        self._design, self._ref, self._clock = design, ref, clock
        self.period_s, self.tick_s = clock.period, clock.tick
        self.lead_s = -clock.begin
        self.end_s = clock.begin + len(ref.feed) * clock.period + clock.latency * clock.tick
        self.fallbacks: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._k = 0
        self._history = History(clock.tick, ref.first_inputs, count)
        self._answer = design.programme.empty_decision(count)
        start = np.repeat(ref.start[:, None], count, axis=1)
        known = design.resolution, design.noise, design.lost_motion, design.variance
        self._estimate = StateEstimate(start, *known)

    def __call__(self, t: float, measured: Array) -> Array:
        """Return the commands of the ticks from t to the next reading, (M, 2, S), rad/s.

        Args:
            t: Time of the reading, s; readings come in order, one per period.
            measured: Encoder readings, (N, S); NaN where a reading is lost.
        """
        clock, k = self._clock, self._k
        now, estimate = k * clock.period - clock.shift, self._estimate
        if k:
            before = now - clock.period
            pose = self._design.forecast(estimate, before, now, self._history, self._passing)
            estimate.take_forecast(pose)
            self._history.forget(float(np.min(before)))
        estimate.read(measured)
        if k < len(self._ref.feed):
            self._decide(k, now)
        self._k += 1
        return self._history.ticks(k * clock.ticks, clock.ticks)

    @property
    def _passing(self) -> Array:
        """Return the fraction of the ideal joint rates that the contacts of the mean arm transmit
        at the current point of the reference motion, (N−1, 1)."""
        last = len(self._ref.feed) - 1
        passing: Array = self._design.passing[min(self._k, last)][:, None]
        return passing

    def _decide(self, k: int, now: Array) -> None:
        """Compute the commands of period k and add them to the history."""
        clock, ref = self._clock, self._ref
        until = np.full(2, k * clock.period + clock.wait)
        pose = self._design.forecast(self._estimate, now, until, self._history, self._passing)
        w, state = self._answer.corrections[0], self._state(k, pose)
        self._answer = self._design.programme(k, state, self._answer)
        self.fallbacks += self._answer.fallback
        v = self._answer.corrections[0]
        added = v[None]
        if self._design.ramp:
            share = (np.arange(clock.ticks)[:, None, None] + 0.5) / clock.ticks
            added = w + share * (v - w)
        commands = self._clip_commands(k, ref.feed[k][:, :, None] + added)
        self._history.append(self._clip_commands(k, commands + self._crossing(k, commands, pose)))

    def _state(self, k: int, pose: Pose) -> Array:
        """Return the regulator's state, (n, S): deviations from the course, last corrections,
        errors of rates and of lost motion. A passive joint counts at the position where its axis
        will push it to, or where it rests if the axis does not reach it. In the course the axis
        pushes the joint by `more` (if negative, the gap that remains) and later by `then`; lost
        motion counts only as far as it changes that later push.
        """
        ref, state = self._ref, self._estimate
        off, way = pose.q - ref.q[k][:, None], ref.way[k][:, None]
        more, then = ref.push[k][:, None], ref.next_push[k][:, None]
        stays = way * (pose.q[2:] - ref.joints[k][:, None]) - np.maximum(more, 0)
        axes = way * (pose.axis[1:] - ref.q[k][2:, None])
        pushed = axes - state.lost_motion[1:] + np.minimum(more, 0)
        off[2:] = way * np.maximum(stays, pushed)
        lost = state.lost_motion[1:] - ref.lost_motion - np.minimum(then, 0) / 2
        lost = np.minimum(lost, np.maximum(then, 0) / 2)
        return np.concatenate([off, self._answer.corrections[0], state.rate_error[1:], lost])

    def _crossing(self, k: int, commands: Array, pose: Pose) -> Array:
        """Return the speeds to add so that a reversing motor crosses its play, (M, 2, S), rad/s.

        The crossing is spread over the period. The crossing begins only if the travel exceeds the
        uncertainty of the play; until then the motor stands.
        """
        clock, play = self._clock, self._design.play
        if not np.any(play):
            return np.zeros_like(commands)
        half = np.stack([np.full(len(pose.side), play[0] / 2), self._estimate.lost_motion[0]])
        side = np.stack([pose.side, pose.axis[0] - pose.q[1]])
        way = np.sign(commands.sum(axis=0))
        gap = np.where(way == 0, 0.0, half - way * side)
        periods = min(CROSSING_PERIODS, self._design.programme.horizon)
        feed = self._ref.feed[k : k + periods].mean(axis=1)
        soon = feed[:, :, None] + self._answer.corrections[: len(feed)]
        worth = way * clock.period * soon.sum(axis=0) > PLAY_SPREAD_SHARE * 2 * half
        added = np.where(worth, way * gap / clock.period, 0.0)
        stand = ~worth & (gap > half / 2)
        return np.where(stand, -commands, added)

    def _clip_commands(self, k: int, commands: Array) -> Array:
        """Clip the commands of period k to the limits of speed and of changes from tick to tick.

        If the course ends with a speed, the motor may stop at once there, as the plan does.
        """
        limit, rate = self._ref.limit[:, None], self._ref.rate[:, None]
        commands = np.clip(commands, -limit, limit)
        if not np.any(np.isfinite(rate)):
            return commands
        most = rate * self._clock.tick
        before, out = self._history.last, []
        for i, u in enumerate(commands, k * self._clock.ticks + self._clock.latency):
            before = np.where(self._ref.last_ticks[:, None] == i, 0.0, before)
            before = np.clip(u, before - most, before + most)
            out.append(before)
        return np.stack(out)


RUN_UP_ERROR_DEG, RUN_UP_STEP = 5.0, 0.05
"""Weights of the run-up: the error that weighs as much as one unit of correction, degrees; and the
weight of a change of corrections, as a fraction of that weight during the plan. The rest at the end
of the run-up has the plan's weight of errors: the tracker has learnt the ratios of joints 2 and 3
and reduces small initial errors during the plan. With the goal's weight at that rest, E and the
error at the end would be 0.26 and 0.09 degrees (95 %) instead of 0.24 and 0.07."""

LIGHT_LINK_KGM2 = 0.003
"""Largest inertia of a link that follows its axis. A jump of speed excites a heavier link, which
then swings at about 1 Hz with little damping; corrections that respond to each swing sustain it. So
the unit of a change of corrections is divided by the link's inertia over this inertia. The
prototype's links have 0.032; without the division E is 2.9 degrees instead of 0.9, and the end 0.85
instead of 0.29 (95 %)."""

RESTING_WEIGHT = 1e4
"""Weight of a correction of the drive while it rests, relative to the weight at other times."""


@dataclass(frozen=True, eq=False)
class TrackerDesign:
    """The tracker of one plan on one kind of machine.

    Attributes:
        ref: The course on the tracker's clock.
        law: The regulator, which holds where no limit is active.
        programme: The quadratic programmes of the control steps.
        forecast: The model of the nominal machine.
        passing: Fraction of the ideal rates that the mean arm's contacts transmit, (K, N−1).
        lost_motion: Mean lost motion of each joint, (N−1, 1), rad.
        play: Whole play of each motor's gearhead, (2,), rad; zero if the tracker ignores play.
        resolution: Resolution of each reading, (N, 1).
        noise: Standard deviation of the noise of each reading, (N, 1).
        variance: Variance of each joint's reading, (N−1, 1).
    """

    ref: Reference
    law: Regulator
    programme: TrackingProgramme
    forecast: Forecast
    passing: Array
    lost_motion: Array
    play: Array
    resolution: Array
    noise: Array
    variance: Array

    @property
    def ramp(self) -> bool:
        """Whether corrections change linearly over a period, because input rates are limited."""
        return bool(np.any(np.isfinite(self.ref.rate)))


def design(plan: Plan, machine: Machine, options: FeedbackTable) -> TrackerDesign:
    """Design the tracker of a plan on a machine, from the machine's means and spreads.

    Raises:
        InputError: If the options do not fit the machine, or the plan takes too much memory.
        UntrackableError: If the plan's inputs far exceed what may be commanded.
    """
    refuse_excess(plan, machine)
    system = plan.problem.system
    _refuse_too_long(plan, system.size)
    shift, play = shift_of(system, machine), gearhead_play(system, machine) * options.take_up_play
    before, lost = run_up(plan, machine, options), lost_motion(system, machine)[:, None]
    course = Course(plan, before, shift, play)
    clock = timing(options, system, machine, course.begin, course.start)
    span = course.end + options.overtime_s - clock.wait - clock.shift[0] - clock.begin
    count = max(1, int(np.ceil(span / clock.period - 1e-9)))
    forecast = Forecast(system, play[0], clock.tick)
    allowed = lost if before is not None or course.is_predicted else 0 * lost
    limit, resolution = input_limit(plan, machine), resolution_of(system, machine)
    noise, swings = noise_of(system, machine), machine.fidelity == "dynamic"
    ref = reference(course, clock, forecast, allowed, limit, count, options.least_speed)
    law = regulator(ref, cost_weights(plan, machine, ref, options))
    horizon = max(1, round(options.horizon_s / clock.period))
    return TrackerDesign(
        ref=ref,
        law=law,
        programme=TrackingProgramme(ref, law, horizon, options.max_iterations),
        forecast=forecast,
        passing=mean_passing(system, machine, ref.q[:count]),
        lost_motion=np.concatenate([play[1:, None] / 2, lost]),
        play=play,
        resolution=resolution,
        noise=noise,
        variance=reading_variance(resolution, noise, swings),
    )


COURSE_BYTES, MODEL_BYTES = 1500, 48
"""Memory per tick of a course, bytes: while the course is integrated, and of the linear model per
pair of coordinates. Measured are up to 1412 bytes, and 770 bytes with four coordinates."""


def _refuse_too_long(plan: Plan, size: int) -> None:
    """Refuse a plan so long that its course takes more memory than a replay's motions may."""
    each = max(COURSE_BYTES, MODEL_BYTES * size**2)
    longest = MOST_BYTES / each * DEFAULT_TICK_S
    if plan.duration > longest:
        raise InputError(
            f"feedback during {plan.duration:.6g} s takes"
            f" {each * plan.duration / DEFAULT_TICK_S / 1e9:.3g} GB of memory, and at most"
            f" {MOST_BYTES / 1e9:g} GB are allowed; give a plan of {longest:.0f} s or less, or"
            " replay it without feedback"
        )


def cost_weights(plan: Plan, machine: Machine, ref: Reference, options: FeedbackTable) -> Weights:
    """Return the weights of the regulator's cost from the feedback options; 1 m counts as 1 rad."""
    tracked = np.ones(ref.q.shape[1])
    if plan.problem.system.coordinates[0].unit == "rad":
        tracked[0] = 0.0
    goal = tracked / np.deg2rad(options.goal_error_deg) ** 2
    path = np.repeat(tracked[None] / np.deg2rad(options.path_error_deg) ** 2, len(ref.feed), axis=0)
    start = int(np.argmax(ref.is_counted))
    moving = max(0, start - round(REST_S / ref.timing.period))
    path[:moving] = tracked / np.deg2rad(RUN_UP_ERROR_DEG) ** 2
    scale = input_scale(plan, machine)
    size, step = options.correction * scale, options.correction_step * scale
    if machine.fidelity == "dynamic":
        step *= LIGHT_LINK_KGM2 / max(np.max(machine.mean("link_inertia_kgm2")), LIGHT_LINK_KGM2)
    sizes = np.repeat(1 / size[None] ** 2, len(ref.feed), axis=0)
    sizes[ref.rests, 0] *= RESTING_WEIGHT
    steps = np.repeat(1 / step[None] ** 2, len(ref.feed), axis=0)
    steps[:start] *= RUN_UP_STEP
    return Weights(path, goal, sizes, steps)
