"""Feedback for replays: `planner.replay(plan, machine, feedback=True)`.

The controller of some samples: read, estimate, predict, optimise, command.

What all samples of a replay share: reference, regulator, programmes.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import expect
from planner.machine.feedback.course import Course, timing
from planner.machine.feedback.estimate import Estimate, Forecast, History, gearhead_play
from planner.machine.feedback.programme import Programme
from planner.machine.feedback.reference import Reference, Weights, reference, regulator, resting
from planner.machine.feedback.run_up import input_limit, input_scale, refuse_beyond, run_up
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.support.user_tables import parse
from planner.systems.triangular_system import TriangularSystem


class Tracker:
    """A receding-horizon tracker: one small quadratic programme every control period.

    Every 0.1 s it reads the joint encoders, predicts where the commands already on their way will
    take the arm, and corrects the plan's inputs so that a cost over the whole rest of the motion is
    least, within the limits on inputs, their rates, joints and z₂. What it knows of the machine are
    its mean values: control period, delay, servo bandwidth, gearhead play, encoder resolution,
    velocity limit.

    When a programme has no solution its state limits are widened to what the regulator, clipped to
    the input limits, makes of them; when OSQP is late, the corrections decided before go on as
    planned. Both are counted in `Replay.fallbacks`.

    Args:
        options: The `[feedback]` table; defaults when left out.
        changes: Keys of the table that replace it: `Tracker(run_up=False)`.

    Raises:
        InputError: If a key is unknown or a value impossible.
    """

    _KEPT = 4

    def __init__(self, options: FeedbackTable | None = None, **changes: Any) -> None:
        if options is not None:
            expect(FeedbackTable, options, "give keys by name, as in planner.Tracker(run_up=False)")
        given = {} if options is None else options.model_dump(exclude_unset=True)
        self.options = parse(FeedbackTable, {**given, **changes}, "feedback")
        self._designs: OrderedDict[tuple[int, Machine], tuple[Plan, Design]] = OrderedDict()

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Control:
        """A controller of the samples `numbers` (S,); see `planner.machine.closed_loop.Feedback`.

        Raises:
            InputError: If the options do not fit the machine.
            UntrackableError: If the plan's inputs are far beyond what may be commanded.
        """
        return Control(self.design(plan, machine), len(numbers))

    def design(self, plan: Plan, machine: Machine) -> Design:
        """What the samples share; kept for the next run of the same plan on the same machine."""
        key = (id(plan), machine)
        if key not in self._designs:
            self._designs[key] = (plan, design(plan, machine, self.options))
            if len(self._designs) > self._KEPT:
                self._designs.popitem(last=False)
        return self._designs[key][1]


AHEAD = 5
"""Periods in which a reversal must be worth crossing the play."""

UNCERTAIN = 0.2
"""How well the play of a gearhead is known: to this part of its mean."""


class Control:
    """One controller of S samples; see `planner.machine.closed_loop.Controller`.

    Args:
        design: What all samples share.
        count: Number of samples S.
    """

    def __init__(self, design: Design, count: int) -> None:
        ref, clock = design.ref, design.ref.timing
        self._design, self._ref, self._clock = design, ref, clock
        self.period_s, self.tick_s = clock.period, clock.tick
        self.lead_s = -clock.begin
        self.end_s = clock.begin + len(ref.feed) * clock.period + clock.latency * clock.tick
        self.fallbacks: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._k = 0
        self._history = History(clock.tick, ref.first, count)
        self._answer = design.programme.none(count)
        self._side = np.zeros((2, count))
        self._forecast = Forecast(design.system, design.play, clock.tick)
        start = np.repeat(ref.start[:, None], count, axis=1)
        self._estimate = Estimate(design.system, start, design.resolution)

    def __call__(self, t: float, measured: Array) -> Array:
        """Commands of the ticks from t to the next reading, (M, 2, S), rad/s.

        Args:
            t: Time of the reading, s; readings come in order, one a period.
            measured: What the encoders read, (N, S); NaN where a reading is lost.
        """
        clock, k = self._clock, self._k
        now, estimate = k * clock.period - clock.shift, self._estimate
        if k:
            before = now - clock.period
            q, self._side = self._forecast(estimate.q, self._side, before, now, self._history)
            estimate.predicted(q)
        estimate.read(measured)
        if k < len(self._ref.feed):
            self._decide(k, now)
        self._k += 1
        return self._history.ticks(k * clock.ticks, clock.ticks)

    def _decide(self, k: int, now: Array) -> None:
        """Add the commands of one period, from when they can act."""
        clock, ref = self._clock, self._ref
        told = np.full(2, k * clock.period + clock.wait)
        q, side = self._forecast(self._estimate.q, self._side, now, told, self._history)
        w = self._answer.corrections[0]
        state = np.concatenate([q - ref.q[k][:, None], w, self._estimate.rate_error])
        self._answer = self._design.programme(k, state, self._answer)
        self.fallbacks += self._answer.fallback
        v = self._answer.corrections[0]
        added = v[None]
        if self._design.ramp:
            share = (np.arange(clock.ticks)[:, None, None] + 0.5) / clock.ticks
            added = w + share * (v - w)
        commands = self._limited(ref.feed[k][:, :, None] + added)
        self._history.append(self._limited(commands + self._crossing(k, commands, side)))

    def _crossing(self, k: int, commands: Array, side: Array) -> Array:
        """What must be added to reverse a motor through its play, (M, 2, S).

        The crossing is spread over the period. It is not begun for less travel than the play is
        uncertain by: the motor stands until the next periods ask for more.
        """
        clock, half = self._clock, self._design.play / 2
        if not np.any(half):
            return np.zeros_like(commands)
        way = np.sign(commands.sum(axis=0))
        gap = np.where(way == 0, 0.0, half - way * side)
        feed = self._ref.feed[k : k + min(AHEAD, self._design.programme.horizon)].mean(axis=1)
        soon = feed[:, :, None] + self._answer.corrections[: len(feed)]
        worth = way * clock.period * soon.sum(axis=0) > UNCERTAIN * 2 * half
        added = np.where(worth, way * gap / clock.period, 0.0)
        stand = ~worth & (gap > half / 2)
        return np.where(stand, -commands, added)

    def _limited(self, commands: Array) -> Array:
        """Within the limits of speed and of its change from tick to tick."""
        limit, rate = self._ref.limit[:, None], self._ref.rate[:, None]
        commands = np.clip(commands, -limit, limit)
        if not np.any(np.isfinite(rate)):
            return commands
        most = rate * self._clock.tick
        before = self._history.last
        out = []
        for u in commands:
            before = np.clip(u, before - most, before + most)
            out.append(before)
        return np.stack(out)


RUN_UP_ERROR_DEG = 5.0
"""The error during the run-up that weighs as much as one unit of correction, degrees."""

RESTING_WEIGHT = 1e4
"""Weight of a correction where the drive rests, as a part of that elsewhere."""


@dataclass(frozen=True, eq=False)
class Design:
    """The tracker of one plan on one kind of machine.

    Attributes:
        ref: The course on the tracker's clock.
        programme: The control steps.
        play: Whole play of each motor's gearhead, (2, 1), rad; zero when it is not crossed.
        resolution: Of each reading, (N, 1).
    """

    ref: Reference
    programme: Programme
    play: Array
    resolution: Array
    system: TriangularSystem

    @property
    def ramp(self) -> bool:
        """Whether corrections change steadily over a period, for the limit of the input rates."""
        return bool(np.any(np.isfinite(self.ref.rate)))


def design(plan: Plan, machine: Machine, options: FeedbackTable) -> Design:
    """Prepare the tracker of a plan on a kind of machine; what differs between samples is not used.

    Raises:
        InputError: If the options do not fit the machine.
        UntrackableError: If the plan's inputs are far beyond what may be commanded.
    """
    refuse_beyond(plan, machine)
    system = plan.problem.system
    course = Course(plan, run_up(plan, machine, options))
    clock = timing(options, system, machine, course.lead_s)
    span = plan.duration + options.overtime_s - clock.wait - clock.shift[0] - clock.begin
    count = max(1, int(np.ceil(span / clock.period - 1e-9)))
    ref = reference(course, clock, input_limit(plan, machine), count, options.least_speed)
    law = regulator(ref, _weights(plan, ref, input_scale(plan, machine), options))
    horizon = max(1, round(options.horizon_s / clock.period))
    play = gearhead_play(system, machine) * options.take_up_play
    return Design(
        ref=ref,
        programme=Programme(ref, law, horizon, options.max_iterations),
        play=play,
        resolution=_resolution(system, machine),
        system=system,
    )


def _weights(plan: Plan, ref: Reference, scale: Array, options: FeedbackTable) -> Weights:
    """The cost, from the options' units; a length in metres counts as an angle in radians."""
    tracked = np.ones(ref.q.shape[1])
    if plan.problem.system.coordinates[0].unit == "rad":
        tracked[0] = 0.0
    goal = tracked / np.deg2rad(options.goal_error_deg) ** 2
    path = tracked / np.deg2rad(options.path_error_deg) ** 2
    path = np.repeat(path[None], len(ref.feed), axis=0)
    begun = ref.s[:-1] >= 0
    path[~begun] = tracked / np.deg2rad(RUN_UP_ERROR_DEG) ** 2
    if not begun[0]:
        path[np.argmax(begun)] += goal / ref.timing.period
    size, step = options.correction * scale, options.correction_step * scale
    sizes = np.repeat(1 / size[None] ** 2, len(ref.feed), axis=0)
    sizes[resting(ref), 0] *= RESTING_WEIGHT
    return Weights(path, goal, sizes, 1 / step**2)


def _resolution(system: TriangularSystem, machine: Machine) -> Array:
    """Smallest step of each reading, (N, 1).

    Of the angles' encoders; infinite for the disk's angle, which has none; 0 for the rest, which is
    read exactly.
    """
    effect = machine.effects.get("encoder_resolution_deg")
    steps = np.broadcast_to(np.array(effect.value if effect else 0.0), system.size - 1)
    out = np.zeros((system.size, 1))
    for i, coordinate in enumerate(system.coordinates):
        if coordinate.unit == "rad":
            out[i] = np.deg2rad(steps[i - 1]) if i else np.inf
    return out
