"""A plan through some machines, open loop or by a controller.

They march in blocks. Of each block its errors are kept, and its motions where they are asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.closed_loop import Feedback, FeedbackCommand, encoder_readings
from planner.machine.commands import Command, CommandGrid, CommandVariants, merge_times
from planner.machine.compiled import MOST_PASSIVE, CompiledMotion, library
from planner.machine.friction.contact_load import refuse_sliding
from planner.machine.limits import least_margins
from planner.machine.machine import Draws, Machine, draw
from planner.machine.stepwise import MachineMotion, StepwiseMotion
from planner.plan.plan import Plan
from planner.plan.recorded.log import RECORDED
from planner.support import deadline
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

CHUNK_SAMPLES = 1000
"""Samples that advance together: enough to keep NumPy busy, few enough to stay in the cache."""

PROGRESS_PARTS = 1000
"""Parts of a run that progress is counted in."""

MOST_BYTES = 2_000_000_000
"""Of motions, all recorded at a time: half of the memory of the smallest computers in use."""

FEWEST_TIMES = 3
"""Start, end and rest, which are always recorded, say nothing of limits on the way."""

Progress = Callable[[int, int], None]
Tell = Callable[[int, int], None]
"""Told the number of steps in all, and how many are done."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What happened to S samples; the attributes are those of `planner.Replay`."""

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
    effort: Array | None
    fallbacks: NDArray[np.int64]
    run_s: float


def _allocate(part: Recording, count: int, motions: int) -> Recording:
    """Arrays like these for so many samples, and for the motions of so many, not filled in."""
    rows = dict.fromkeys(_SAMPLE_FIELDS, count) | dict.fromkeys(_MOTION_FIELDS, motions)
    empty: dict[str, Any] = {
        name: np.empty((size, *array.shape[1:]), array.dtype)
        for name, size in rows.items()
        if (array := getattr(part, name)) is not None
    }
    return replace(part, **empty)


def _put(whole: Recording, part: Recording, first: int) -> None:
    """Fill in a part, from the sample `first` on."""
    for name in (*_SAMPLE_FIELDS, *_MOTION_FIELDS):
        array = getattr(whole, name)
        if array is not None:
            there = array[first : first + len(part.fallbacks)]
            there[:] = getattr(part, name)[: len(there)]


_MOTION_FIELDS = ("q", "motor_rates")
_SAMPLE_FIELDS = (
    "peak_rates", "saturated_s", "slip_s", "slip_begin", "slip_contact", "margin", "margin_s",
    "terminal_error", "deviation", "effort", "fallbacks",
)  # fmt: skip


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
    """Run an executable plan through single machines.

    What all samples share is taken from `machine`: step and control period. Motions are kept of
    the first `motions` samples, by default of all.

    Raises:
        InputError: If the machine does not match the system, the plan's input, or what feedback
            commands, is not finite, or the motions would take too much memory.
    """
    count = draws.count
    kept = count if motions is None else min(motions, count)
    block = min(CHUNK_SAMPLES, count, _room(plan, kept, settle_s, record_s))
    times = _record_times(plan.duration, settle_s, record_s)
    if feedback is None:
        run = partial(_simulate_open_loop, command=_command(plan, machine, draws, times))
    else:
        delay = draws["delay_s"][0]
        run = partial(
            _simulate_closed_loop, feedback=feedback, one_delay=bool(np.all(delay == delay[0]))
        )
    chunks = [slice(k, k + block) for k in range(0, count, block)]
    whole: Recording | None = None
    for i, chosen in enumerate(chunks):
        tell = partial(_tell, progress, i, len(chunks))
        part = run(plan, machine, draws, chosen, times, tell)
        if kept == block == count:
            return part
        whole = whole or _allocate(part, count, kept)
        _put(whole, part, chosen.start)
        del part  # and its motions, before the next block makes its own
    assert whole is not None
    return whole


def simulate_variants(
    plan: Plan, machine: Machine, t: Array, values: Array, is_linear: bool, times: Array
) -> Array:
    """Motions of one machine, the nominal one, under S variants of its commands.

    Args:
        plan: Says the system, where it starts, and what it must hold against gravity.
        machine: Its spreads count for nothing.
        t: Ends of the commands' ticks, shape (K+1,), s.
        values: What is asked for in each tick, shape (K, 2, S).
        is_linear: Whether inputs go straight from one tick's beginning to the next.
        times: When they are recorded, increasing, shape (R,), s; the last ends them.

    Returns:
        Coordinates, shape (S, R, N).

    Raises:
        InputError: As `simulate`.
    """
    nominal, alike = machine.nominal(), np.zeros(values.shape[2], dtype=np.int64)
    draws = draw(nominal, plan.problem.system.size - 1, alike, 0)
    stops = merge_times(np.zeros(1), times)
    orders = CommandVariants(t, values, is_linear, draws, nominal.step_s, stops)
    motion = _motion(plan, nominal, draws, orders, times)
    motion.advance(len(orders.t) - 1, lambda _: deadline.check())
    return np.asarray(motion.q)


def _room(plan: Plan, kept: int, settle: float, record: float | None) -> int:
    """How many motions there is memory for at a time.

    Raises:
        InputError: If fewer than are to be kept, or none.
    """
    span, width = plan.duration + settle, 8 * (plan.problem.system.size + 2)
    rows = 3 if record is None else 3 + span / record
    room = int(MOST_BYTES / (rows * width))
    if room >= max(kept, 1):
        return room
    ways = [f"motions = {room} or fewer, for errors are kept of all samples"] if room else []
    if (least := MOST_BYTES / (width * max(kept, 1)) - 3) > 1:
        ways.append(f"record_s = {np.ceil(1e3 * span / least) / 1e3:g} or more")
    ways.append("record_s = None")
    raise InputError(
        f"the motions of {kept} samples, recorded {rows:.4g} times each, take"
        f" {kept * rows * width / 1e9:.3g} GB of memory, and at most {MOST_BYTES / 1e9:g} GB are"
        f" used for them; give {', or '.join(ways)}"
    )


def _simulate_open_loop(
    plan: Plan,
    machine: Machine,
    draws: Draws,
    chosen: slice,
    times: Array,
    tell: Tell,
    command: Command,
) -> Recording:
    """A run of the samples under the plan's own command."""
    block_draws = draws.part(chosen)
    motion = _motion(plan, machine, block_draws, command.part(chosen), times)
    steps = len(command.t) - 1
    motion.advance(steps, partial(tell, steps))
    tell(steps, steps)
    return _recording(plan, block_draws, times, motion, command.t)


def _simulate_closed_loop(
    plan: Plan,
    machine: Machine,
    draws: Draws,
    chosen: slice,
    times: Array,
    tell: Tell,
    feedback: Feedback,
    one_delay: bool,
) -> Recording:
    """A run of the samples under a controller, with new commands at each reading."""
    block_draws = draws.part(chosen)
    controller = feedback.start(plan, machine, block_draws.numbers)
    fed = FeedbackCommand(controller, block_draws, machine.step_s, times, one_delay)
    motion = _motion(plan, machine, block_draws, fed, times)
    steps = len(fed.t) - 1
    for i, k in enumerate(fed.reading_steps):
        motion.advance(k, partial(tell, steps))
        read = encoder_readings(plan.problem.system, block_draws, motion.coordinates)
        fed.set_command(i, controller(float(fed.readings[i]), read))
    motion.advance(steps, partial(tell, steps))
    tell(steps, steps)
    out = _recording(plan, block_draws, times, motion, fed.t)
    run_s = controller.lead_s + controller.end_s
    return replace(out, effort=fed.effort, fallbacks=controller.fallbacks, run_s=run_s)


def _motion(
    plan: Plan, machine: Machine, draws: Draws, orders: CommandGrid, times: Array
) -> MachineMotion:
    """Samples at the start of a plan."""
    system = plan.problem.system
    if isinstance(system, Manipulator) and machine.fidelity == "quasi-static":
        refuse_sliding(plan, system, draws)
    start, rows = _start(plan, draws), np.searchsorted(orders.t, times)
    desired = plan.wanted(orders.t)[:, 1:, None]
    desired[orders.t < times[0]] = np.nan  # no deviation is counted before the plan's start
    return begin_motion(plan, machine, draws, orders, desired, rows, start)


def begin_motion(
    plan: Plan,
    machine: Machine,
    draws: Draws,
    orders: CommandGrid,
    desired: Array,
    rows: NDArray[np.int64],
    start: Array,
) -> MachineMotion:
    """Samples at the start: compiled where there is a kernel for them; see `StepwiseMotion`."""
    system = plan.problem.system
    few = machine.fidelity == "quasi-static" or system.size - 2 <= MOST_PASSIVE
    if isinstance(system, Manipulator) and few and library() is not None:
        return CompiledMotion(system, machine.fidelity, draws, orders, desired, rows, start)
    return StepwiseMotion(plan, machine, draws, orders, desired, rows, start)


def _tell(progress: Progress | None, before: int, runs: int, steps: int, done: int) -> None:
    if progress:
        progress(int(PROGRESS_PARTS * (before + done / steps)), PROGRESS_PARTS * runs)


def _recording(
    plan: Plan, draws: Draws, times: Array, motion: MachineMotion, grid: Array
) -> Recording:
    none = np.zeros(draws.count, dtype=np.int64)
    slip_s, step, contact = motion.slip.T.copy()
    margin, place = least_margins(plan.problem, motion.q)
    if len(times) <= FEWEST_TIMES:
        margin[:] = np.nan
    return Recording(
        t=times,
        q=motion.q,
        motor_rates=motion.speed,
        # One motor after the other takes a twentieth of the time of both at once.
        peak_rates=np.stack([np.abs(motion.speed[..., i]).max(axis=1) for i in (0, 1)], axis=1),
        terminal_error=motion.q[:, -1] - plan.wanted(plan.duration),
        deviation=motion.deviation.copy(),
        saturated_s=motion.saturated_s.copy(),
        slip_s=slip_s,
        slip_begin=np.where(step < 0, np.nan, grid[step.astype(np.int64)]),
        slip_contact=contact.astype(np.int64),
        margin=margin,
        margin_s=times[place],
        effort=None,
        fallbacks=none,
        run_s=plan.duration,
    )


def _command(plan: Plan, machine: Machine, draws: Draws, times: Array) -> Command:
    period = machine.effects.get("control_period_s")
    if plan.status == RECORDED:  # commands of a controller, which has held them already
        period = None
    return Command(plan, period.value[0] if period else None, draws, machine.step_s, times)


def _start(plan: Plan, draws: Draws) -> Array:
    """True coordinates at the start, (N, S): the plan's, with the initial errors of its angles."""
    q = np.repeat(plan.q(0.0)[:, None], draws.count, axis=1)
    angular = [i for i, c in enumerate(plan.problem.system.coordinates) if c.unit == "rad" and i]
    errors = np.broadcast_to(np.deg2rad(draws["initial_angle_error_deg"]), q[1:].shape)
    q[angular] += errors[np.array(angular) - 1]
    return q


def _record_times(duration: float, settle: float, record: float | None) -> Array:
    ends = np.array([0.0, duration, duration + settle])
    if record is None:
        return merge_times(ends)
    count = int(np.ceil((duration + settle) / record))
    return merge_times(ends, np.arange(count, dtype=np.float64) * record)
