"""A plan through some machines: the loop over time, for many samples at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.machine.chain import Chain
from planner.machine.command import Command
from planner.machine.direct import Direct
from planner.machine.draw import Draws, draw
from planner.machine.grid import merged
from planner.machine.machine import Machine
from planner.machine.servo import Servos
from planner.plan import Plan
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator

CHUNK = 1000
"""Samples that advance together: enough to keep NumPy busy, few enough to stay in the cache."""

REPORT_EVERY = 250
"""Steps between two reports of progress."""

Progress = Callable[[int, int], None]


class Plant(Protocol):
    """What the motors move."""

    @property
    def q(self) -> Array:
        """Coordinates, (N, S)."""

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by h seconds under motor speeds (P, 2, S) and travels (P−1, 2, S)."""


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
    """

    draws: Draws
    t: Array
    q: Array
    speed: Array
    deviation: Array
    saturated_s: Array


def simulate(
    plan: Plan,
    machine: Machine,
    numbers: NDArray[np.int64],
    seed: int,
    *,
    settle_s: float,
    record_s: float | None,
    progress: Progress | None = None,
) -> Recording:
    """Run an executable plan open loop through the samples `numbers` (S,) of a machine.

    Raises:
        InputError: If the machine does not match the system, or the plan's input is not finite.
    """
    size = plan.problem.system.size
    draws = draw(machine, size - 1, numbers, seed)
    times = _record_times(plan.duration, settle_s, record_s)
    period = machine.effects.get("control_period_s")
    command = Command(plan, period.value[0] if period else None, draws, machine.step_s, times)
    rows = np.searchsorted(command.t, times)
    desired = plan.q(command.t)[:, 1:, None]
    q, speed = np.empty((len(numbers), len(times), size)), np.empty((len(numbers), len(times), 2))
    deviation, saturated = np.empty((len(numbers), size - 1)), np.empty((len(numbers), 2))
    total = (len(command.t) - 1) * -(-len(numbers) // CHUNK)
    for i, first in enumerate(range(0, len(numbers), CHUNK)):
        chosen = slice(first, first + CHUNK)
        run = _Run(plan, draws.part(chosen), command.part(chosen), desired, rows)
        run.go(progress, i * (len(command.t) - 1), total)
        q[chosen], speed[chosen] = run.q, run.speed
        deviation[chosen], saturated[chosen] = run.deviation.T, run.servos.saturated_s.T
    return Recording(draws, times, q, speed, deviation, saturated)


class _Run:
    """One chunk of samples from start to end."""

    def __init__(
        self,
        plan: Plan,
        draws: Draws,
        command: Command,
        desired: Array,
        rows: NDArray[np.int64],
    ) -> None:
        self._command, self._desired, self._rows = command, desired, rows
        start = _start(plan, draws)
        self.servos = Servos(draws)
        self.plant = plant(plan, draws, start)
        self.q = np.empty((draws.count, len(rows), len(start)))
        self.speed = np.empty((draws.count, len(rows), 2))
        self.deviation = np.abs(start[1:] - desired[0])

    def go(self, progress: Progress | None, done: int, total: int) -> None:
        """Advance from the first time to the last."""
        command, wanted = self._command, set(self._rows.tolist())
        row, speed = 0, np.zeros((2, 2, self.q.shape[0]))
        for k, h in enumerate(_lengths(command.t)):
            speed, travel = self.servos.step(command.at(k), h, bool(command.running[k]))
            if k in wanted:
                self._record(row, speed[0])
                row += 1
            self.plant.step(speed, travel, h)
            gap = np.abs(self.plant.q[1:] - self._desired[k + 1])
            np.maximum(self.deviation, gap, out=self.deviation)
            if progress and (k + 1) % REPORT_EVERY == 0:
                progress(done + k + 1, total)
        self._record(row, speed[-1])
        if progress:
            progress(done + len(command.t) - 1, total)

    def _record(self, row: int, speed: Array) -> None:
        self.q[:, row] = self.plant.q.T
        self.speed[:, row] = speed.T


def plant(plan: Plan, draws: Draws, start: Array) -> Plant:
    """What the motors move: the disk chain of a manipulator, or the bare system of any other."""
    system = plan.problem.system
    if isinstance(system, Manipulator):
        return Chain(system, draws, start)
    return Direct(system, start)


def _lengths(times: Array) -> list[float]:
    """Lengths of the steps, equal where they differ by rounding alone (their factors are kept)."""
    return [float(f"{h:.11g}") for h in np.diff(times)]


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
