"""A plan through some machines, open loop or corrected by feedback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from planner.machine.command import Command
from planner.machine.draw import Draws, draw
from planner.machine.grid import merged
from planner.machine.loop import Correct, Feedback, measured, readings
from planner.machine.machine import Machine
from planner.machine.motion import Motion, Steps, Stepwise
from planner.plan import Plan
from planner.systems.base import Array

CHUNK = 1000
"""Samples that advance together: enough to keep NumPy busy, few enough to stay in the cache."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Recording:
    """What happened to S samples.

    Attributes:
        draws: The machines.
        t: Recorded times, (R,), s.
        q: True coordinates then, (S, R, N).
        speed: Speeds of the motors then, (S, R, 2); after a jump, where there is one.
        deviation: Largest |q − plan| of each coordinate after the first over all steps, (S, N−1).
        saturated_s: Seconds each motor was asked for more than its velocity limit, (S, 2).
        corrections: What feedback added to the command from each of its K readings on, (S, K, 2);
            K is 0 in open loop.
    """

    draws: Draws
    t: Array
    q: Array
    speed: Array
    deviation: Array
    saturated_s: Array
    corrections: Array


def simulate(
    plan: Plan,
    machine: Machine,
    numbers: NDArray[np.int64],
    seed: int,
    *,
    settle_s: float,
    record_s: float | None,
    feedback: Feedback | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Run an executable plan through the samples `numbers` (S,) of a machine.

    Raises:
        InputError: If the machine does not match the system, or the plan's input, or what feedback
            adds to it, is not finite.
    """
    size, count = plan.problem.system.size, len(numbers)
    draws = draw(machine, size - 1, numbers, seed)
    times = _record_times(plan.duration, settle_s, record_s)
    period = machine.effects.get("control_period_s")
    command = Command(
        plan,
        period.value[0] if period else None,
        draws,
        machine.step_s,
        times,
        readings(feedback, plan.duration),
    )
    rows = np.searchsorted(command.t, times)
    desired = plan.q(command.t)[:, 1:, None]
    out = Recording(
        draws=draws,
        t=times,
        q=np.empty((count, len(times), size)),
        speed=np.empty((count, len(times), 2)),
        deviation=np.empty((count, size - 1)),
        saturated_s=np.empty((count, 2)),
        corrections=np.empty((count, len(command.readings), 2)),
    )
    steps = len(command.t) - 1
    total = steps * -(-count // CHUNK)
    for i, first in enumerate(range(0, count, CHUNK)):
        chosen = slice(first, first + CHUNK)
        part, own = draws.part(chosen), command.part(chosen)
        motion = Stepwise(plan, part, own, desired, rows, _start(plan, part))
        tell = partial(_tell, progress, i * steps, total) if progress else None
        correct = feedback.start(plan, part.numbers) if feedback else None
        _run(plan, part, own, motion, correct, tell)
        out.q[chosen], out.speed[chosen] = motion.q, motion.speed
        out.deviation[chosen], out.saturated_s[chosen] = motion.deviation, motion.saturated_s
        out.corrections[chosen] = own.corrections
    return out


def _run(
    plan: Plan,
    draws: Draws,
    command: Command,
    motion: Motion,
    correct: Correct | None,
    tell: Steps | None,
) -> None:
    """One chunk of samples from start to end, with a correction at each reading."""
    if correct is not None:
        for i, k in enumerate(command.reading_steps):
            motion.advance(k, tell)
            reading = measured(plan.problem.system, draws, motion.now)
            command.correct(i, correct(float(command.readings[i]), reading))
    motion.advance(len(command.t) - 1, tell)
    if tell:
        tell(len(command.t) - 1)


def _tell(progress: Progress, before: int, total: int, done: int) -> None:
    progress(before + done, total)


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
        return merged(ends)
    count = int(np.ceil((duration + settle) / record))
    return merged(ends, np.arange(count, dtype=np.float64) * record)
