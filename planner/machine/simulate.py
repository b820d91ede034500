"""Simulate a plan on S machines, open loop or under a controller.

The machines are simulated in blocks, and each block in stretches of time. Only the errors and the
requested motions are kept, so that memory grows neither with the samples nor with the duration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.closed_loop import Feedback, FeedbackCommand, encoder_readings
from planner.machine.commands import (
    ROUNDING,
    Command,
    CommandGrid,
    CommandVariants,
    merge_times,
    stretches,
)
from planner.machine.compiled import MOST_PASSIVE, CompiledMotion, library
from planner.machine.disk_chain import DiskChain
from planner.machine.friction.contact_load import refuse_sliding
from planner.machine.limits import breakable_limits, lower_margins
from planner.machine.machine import Draws, Machine, draw
from planner.machine.stepwise import MachineMotion, StepwiseMotion
from planner.plan.plan import Plan
from planner.plan.recorded.log import RECORDED
from planner.support import deadline
from planner.support.arrays import Array, locked
from planner.systems.manipulator import Manipulator

CHUNK_SAMPLES = 1000
"""Number of samples in a block: enough to keep NumPy busy, few enough to stay in the cache."""

PROGRESS_PARTS = 1000
"""Number of parts in which the progress of each block of samples is reported."""

MOST_BYTES = 2_000_000_000
"""Limit on the memory of recorded motions: half of the memory of the smallest computers in use."""

STRETCH_STEPS = 100_000
"""Number of steps in a stretch of time; each step takes some hundred bytes."""

BLOCK_BYTES = 250_000_000
"""Limit on the memory for the motions of one block in one stretch."""

FEWEST_TIMES = 3
"""Number of times of the plan that are always recorded (start, end and rest): too few to show
whether a motion keeps its limits."""

Progress = Callable[[int, int], None]
Tell = Callable[[float], None]
"""Function that is called with the fraction that is done, 0 … 1."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Results of a simulation of S samples; for the attributes see `planner.Replay`.

    A new quantity over time that follows from these and `draws` is a property of `Replay`, as
    `measured`. Any other is a field: `_blank` makes it, both motions record it (`MachineMotion`;
    for C also `ARRAYS` of compiled.py and `record` in chain.h), `_keep` stores it for the first
    samples only, and `_row_bytes` counts it. `Replay.motion` makes the motions that are not kept.
    """

    t: Array
    q: Array
    motor_rates: Array
    peak_rates: Array
    saturated_s: Array
    slip_s: Array
    slip_begin: Array
    slip_contact: NDArray[np.int64]
    margin: Array
    margin_s: Array
    terminal_error: Array
    deviation: Array
    end_state: Array
    effort: Array | None
    fallbacks: NDArray[np.int64]
    run_s: float


def _blank(plan: Plan, times: Array, count: int, motions: int, has_feedback: bool) -> Recording:
    """Return an empty recording of `count` samples that keeps the motions of the first
    `motions`."""
    size = plan.problem.system.size
    parts = sum(len(each.parts) for each in breakable_limits(plan.problem))
    return Recording(
        t=times,
        q=np.empty((motions, len(times), size)),
        motor_rates=np.empty((motions, len(times), 2)),
        peak_rates=np.zeros((count, 2)),
        saturated_s=np.zeros((count, 2)),
        slip_s=np.zeros(count),
        slip_begin=np.full(count, np.nan),
        slip_contact=np.full(count, -1, dtype=np.int64),
        margin=np.full((count, parts), np.inf),
        margin_s=np.zeros((count, parts)),
        terminal_error=np.zeros((count, size)),
        deviation=np.zeros((count, size - 1)),
        end_state=np.zeros((count, size)),
        effort=np.zeros(count) if has_feedback else None,
        fallbacks=np.zeros(count, dtype=np.int64),
        run_s=plan.duration,
    )


def simulate(
    plan: Plan,
    machine: Machine,
    draws: Draws,
    *,
    settle_s: float,
    record_s: float | None,
    motions: int | None = None,
    feedback: Feedback | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Simulate the motions of single machines that execute a plan.

    All samples share the step and the control period of `machine`. The motions of the first
    `motions` samples are kept, by default those of all.

    Raises:
        InputError: If the machine does not match the system, if the plan's input or a command of
            the feedback is not finite, or if the motions would take too much memory.
    """
    count = draws.count
    records = count if motions is None else min(motions, count)
    lead = feedback.start(plan, machine, draws.numbers[:1]).lead_s if feedback else 0.0
    _refuse_too_large(plan, records, lead + settle_s, record_s)
    times = _record_times(lead, plan.duration, settle_s, record_s)
    whole = _blank(plan, times, count, records, feedback is not None)
    run = _ReplayRun(plan, machine, draws, whole)
    block = max(1, min(CHUNK_SAMPLES, count, int(BLOCK_BYTES / (run.most_rows * _row_bytes(plan)))))
    firsts = range(0, count, block)
    for i, first in enumerate(firsts):
        chosen, tell = slice(first, first + block), partial(_tell, progress, i, len(firsts))
        if feedback is None:
            run.open_loop(chosen, tell)
        else:
            whole = replace(whole, run_s=run.closed_loop(chosen, tell, feedback))
    if np.sum(times >= 0) <= FEWEST_TIMES:
        whole.margin[:] = np.nan
    for each in vars(whole).values():
        if isinstance(each, np.ndarray):
            locked(each)
    return whole


def simulate_variants(
    plan: Plan, machine: Machine, t: Array, values: Array, is_linear: bool, times: Array
) -> Array:
    """Simulate the nominal machine under S variants of its commands.

    Args:
        plan: Plan that gives the system, the start, and the loads to hold against gravity.
        machine: The machine; its spreads are ignored.
        t: Ends of the commands' ticks, shape (K+1,), s.
        values: Commanded inputs in each tick, shape (K, 2, S).
        is_linear: Whether inputs are linear from the beginning of one tick to the next.
        times: Times to record, increasing, shape (R,), s; the simulation ends at the last.

    Returns:
        Coordinates, shape (S, R, N).

    Raises:
        InputError: As `simulate`.
    """
    nominal, alike = machine.nominal(), np.zeros(values.shape[2], dtype=np.int64)
    draws = draw(nominal, plan.problem.system.size - 1, alike, 0)
    motion = _at_start(plan, nominal, draws)
    out = np.empty((draws.count, len(times), plan.problem.system.size))
    for stops, rows in stretches(times, 0.0, STRETCH_STEPS * nominal.step_s):
        orders = CommandVariants(t, values, is_linear, draws, nominal.step_s, stops)
        _begin(motion, plan, orders, times, rows)
        motion.advance(len(orders.t) - 1, lambda _: deadline.check())
        out[:, rows] = motion.q
    return out


def _row_bytes(plan: Plan) -> int:
    """Return the bytes of memory that the motion of one sample takes per recorded time."""
    return 8 * (plan.problem.system.size + 2)


def _refuse_too_large(plan: Plan, records: int, beside: float, record: float | None) -> None:
    """Refuse to record motions that need too much memory, with `beside` s before and after the
    plan.

    Raises:
        InputError: If the motions to keep, or a single motion, would take more than `MOST_BYTES`.
    """
    span, width = plan.duration + beside, _row_bytes(plan)
    rows = 3 if record is None else 3 + span / record
    room = int(MOST_BYTES / (rows * width))
    if room >= max(records, 1):
        return
    ways = [f"motions = {room} or fewer (errors are kept for all samples)"] if room else []
    if (least := MOST_BYTES / (width * max(records, 1)) - 3) > 1:
        ways.append(f"record_s = {np.ceil(1e3 * span / least) / 1e3:g} or more")
    ways.append("record_s = None")
    raise InputError(
        f"the motions of {records} samples, recorded {rows:.4g} times each, take"
        f" {records * rows * width / 1e9:.3g} GB of memory, more than the limit of"
        f" {MOST_BYTES / 1e9:g} GB; give {', or '.join(ways)}"
    )


class _ReplayRun:
    """Simulation of all samples of a replay, one block of samples after another.

    Args:
        plan: The plan.
        machine: The parameters that all samples share.
        draws: All samples.
        whole: The recording to fill in.

    Attributes:
        most_rows: Largest number of recorded times in a stretch.
    """

    def __init__(self, plan: Plan, machine: Machine, draws: Draws, whole: Recording) -> None:
        self._plan, self._machine, self._draws, self._whole = plan, machine, draws, whole
        spacing = float(whole.t[-1] - whole.t[0]) / len(whole.t)
        self._longest = STRETCH_STEPS * min(machine.step_s, max(spacing, ROUNDING))
        self.most_rows = min(len(whole.t), int(self._longest / spacing) + 1) if spacing else 1
        period = machine.effects.get("control_period_s")
        if plan.status == RECORDED:  # the commands are already sampled and held
            period = None
        hold = period.value[0] if period else None
        self._stretches = parts = stretches(whole.t, 0.0, _whole_periods(self._longest, hold))
        # Blocks of samples share a command; keep one only, since those of a long run are large.
        self._command = lru_cache(1)(
            lambda i: Command(plan, hold, draws, machine.step_s, parts[i][0])
        )

    def open_loop(self, chosen: slice, tell: Tell) -> None:
        """Simulate the samples `chosen` under the plan's commands, without feedback."""
        motion = _at_start(self._plan, self._machine, self._draws.part(chosen))
        for i, (_, rows) in enumerate(self._stretches):
            orders = self._command(i).part(chosen)
            steps = len(orders.t) - 1
            _begin(motion, self._plan, orders, self._whole.t, rows)
            motion.advance(steps, partial(_tell_steps, tell, i, len(self._stretches), steps))
            self._keep(chosen, motion, orders, rows)
        self._end(chosen, motion)
        tell(1.0)

    def closed_loop(self, chosen: slice, tell: Tell, feedback: Feedback) -> float:
        """Simulate the samples `chosen` under a controller; return how long it commands, s."""
        draws, delay, whole = self._draws.part(chosen), self._draws["delay_s"][0], self._whole
        controller = feedback.start(self._plan, self._machine, draws.numbers)
        one_delay, until = bool(np.all(delay == delay[0])), float(whole.t[-1])
        fed = FeedbackCommand(controller, draws, self._machine.step_s, until, one_delay)
        motion = _at_start(self._plan, self._machine, draws)
        longest = _whole_periods(self._longest, controller.period_s)
        parts = stretches(whole.t, -controller.lead_s, longest)
        for i, (stops, rows) in enumerate(parts):
            fed.begin(stops)
            steps = len(fed.t) - 1
            report = partial(_tell_steps, tell, i, len(parts), steps)
            _begin(motion, self._plan, fed, whole.t, rows)
            for reading, k in enumerate(fed.reading_steps):
                motion.advance(k, report)
                t, system = float(fed.readings[reading]), self._plan.problem.system
                read = encoder_readings(system, draws, motion.coordinates, t)
                fed.set_command(reading, controller(t, read))
            motion.advance(steps, report)
            self._keep(chosen, motion, fed, rows)
        self._end(chosen, motion)
        tell(1.0)
        assert whole.effort is not None
        whole.effort[chosen], whole.fallbacks[chosen] = fed.effort, controller.fallbacks
        return controller.lead_s + controller.end_s

    def _keep(self, chosen: slice, motion: MachineMotion, orders: CommandGrid, rows: slice) -> None:
        """Store the results of one stretch for the samples `chosen`."""
        whole, kept = self._whole, max(0, len(self._whole.q) - chosen.start)
        whole.q[chosen, rows] = motion.q[:kept]
        whole.motor_rates[chosen, rows] = motion.speed[:kept]
        # One motor after the other is twenty times as fast as both at once.
        for i in (0, 1):
            peak, speed = whole.peak_rates[chosen, i], np.abs(motion.speed[..., i])
            np.maximum(peak, speed.max(axis=1, initial=0.0), out=peak)
        least, when = whole.margin[chosen], whole.margin_s[chosen]
        lower_margins(least, when, self._plan.problem, motion.q, whole.t[rows])
        step, begin = motion.slip[:, 1].astype(np.int64), whole.slip_begin[chosen]
        new = (step >= 0) & np.isnan(begin)
        begin[new] = orders.t[step[new]]

    def _end(self, chosen: slice, motion: MachineMotion) -> None:
        """Store the results of the samples `chosen` that are known only at the end of the run."""
        whole, plan = self._whole, self._plan
        whole.terminal_error[chosen] = motion.q[:, -1] - plan.goal
        whole.deviation[chosen] = motion.deviation
        if isinstance(system := plan.problem.system, Manipulator):
            there = DiskChain(system, self._draws.part(chosen), motion.coordinates)
            whole.end_state[chosen] = there.shares(motion.lead).T
        whole.saturated_s[chosen] = motion.saturated_s
        whole.slip_s[chosen], _, whole.slip_contact[chosen] = motion.slip.T


def _whole_periods(longest: float, period: float | None) -> float:
    """Return the largest multiple of `period` up to `longest`, s; `longest` itself without a
    shorter period."""
    return longest // period * period if period and period < longest else longest


def _at_start(plan: Plan, machine: Machine, draws: Draws) -> MachineMotion:
    """Return drawn machines at the start of a plan, ready to simulate."""
    system = plan.problem.system
    if isinstance(system, Manipulator) and machine.fidelity == "quasi-static":
        refuse_sliding(plan, system, draws)
    return make_motion(plan, machine, draws, _start(plan, draws))


def _begin(
    motion: MachineMotion, plan: Plan, orders: CommandGrid, times: Array, rows: slice
) -> None:
    """Begin a stretch of a simulation, in which the entries `rows` of `times` are recorded."""
    desired = plan.reference(orders.t)[:, 1:, None]
    desired[orders.t < 0] = np.nan  # ignore deviations before the plan's start
    motion.begin(orders, desired, np.searchsorted(orders.t, times[rows]))


def make_motion(plan: Plan, machine: Machine, draws: Draws, start: Array) -> MachineMotion:
    """Return drawn machines at the start, to be simulated by the compiled kernel if possible, else
    in NumPy."""
    system = plan.problem.system
    few = machine.fidelity == "quasi-static" or system.size - 2 <= MOST_PASSIVE
    if isinstance(system, Manipulator) and few and library() is not None:
        return CompiledMotion(system, machine.fidelity, draws, start)
    return StepwiseMotion(plan, machine, draws, start)


def _tell_steps(tell: Tell, stretch: int, count: int, steps: int, done: int) -> None:
    tell((stretch + done / steps) / count)


def _tell(progress: Progress | None, before: int, runs: int, share: float) -> None:
    if progress:
        progress(int(PROGRESS_PARTS * (before + share)), PROGRESS_PARTS * runs)


def _start(plan: Plan, draws: Draws) -> Array:
    """Return the true coordinates at the start, (N, S): those of the plan plus each machine's
    initial errors of the angles, or the pose in which another run left each."""
    q = np.repeat(plan.q(0.0)[:, None], draws.count, axis=1)
    if draws.pose is not None:
        q[1:] = draws.pose
        return q
    angular = [i for i, c in enumerate(plan.problem.system.coordinates) if c.unit == "rad" and i]
    errors = np.broadcast_to(np.deg2rad(draws["initial_angle_error_deg"]), q[1:].shape)
    q[angular] += errors[np.array(angular) - 1]
    return q


def _record_times(lead: float, duration: float, settle: float, record: float | None) -> Array:
    """Return the times to record, s: start, end and rest, and unless `record` is None the beginning
    `lead` before the start and every `record` seconds."""
    if record is None:
        return merge_times(np.array([0.0, duration, duration + settle]))
    ends = merge_times(np.array([0.0 - lead, 0.0, duration, duration + settle]))  # not -0.0
    first, last = np.floor(-lead / record) + 1, np.ceil((duration + settle) / record)
    ticks: Array = np.arange(min(first, 0.0), last, dtype=np.float64) * record
    close, far = ROUNDING * max(1.0, float(ends[-1])), np.ones(len(ticks), dtype=bool)
    for end in ends:
        far[slice(*np.searchsorted(ticks, [end - close, end + close]))] = False
    times = np.concatenate([ends, ticks[far]])
    times.sort()
    return times
