"""From a plan's u(t) to what the servos are told: sample and hold, delay, resolution.

Before the plan's start and after its end the command is zero.
"""

from __future__ import annotations

from copy import copy
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.draw import Draws
from planner.machine.grid import ROUNDING, inside, merged, refined, snapped, subdivided
from planner.plan import Plan
from planner.systems.base import Array


class Source(Protocol):
    """A command before delay and resolution.

    Attributes:
        jumps: Increasing times, s, between which it is smooth enough for the quadrature; the first
            is the plan's start, the last its end.
        parts: Where in a step it is read: 0 at the start, 1 just before the end.
    """

    jumps: Array
    parts: tuple[float, ...]

    def __call__(self, times: Array) -> Array:
        """Values (…, 2) at plan times (…), s: right-hand limits, zero outside the plan."""


class Held:
    """Sample and hold: u at the start of each period, held until the next or the plan's end.

    A sampling instant within rounding of a break of the plan reads what follows the break.
    """

    parts: tuple[float, ...] = (0.0, 1.0)

    def __init__(self, plan: Plan, period: float) -> None:
        end = plan.duration
        ticks: Array = period * np.arange(int(np.ceil(end / period)), dtype=np.float64)
        self.jumps = merged(np.array([0.0, end]), snapped(ticks, plan.t))
        held = _finite(plan.u(self.jumps[:-1]), self.jumps[:-1])
        self._values = np.concatenate([held, np.zeros((1, 2))])

    def __call__(self, times: Array) -> Array:
        """See `Source`."""
        return np.asarray(self._values[np.searchsorted(self.jumps, times, side="right") - 1])


class Continuous:
    """The plan's own u(t)."""

    parts: tuple[float, ...] = (0.0, 0.5, 1.0)

    def __init__(self, plan: Plan, step: float) -> None:
        self._plan = plan
        self.jumps = refined(self, subdivided(plan.t, step))

    def __call__(self, times: Array) -> Array:
        """See `Source`."""
        on = (times >= 0) & (times < self._plan.duration)
        values = np.where(on[..., None], self._plan.u(times), 0.0)
        return _finite(values, times)


class Tabulated:
    """A continuous source by linear interpolation, for when every sample reads it elsewhere."""

    def __init__(self, source: Source) -> None:
        self.jumps, self.parts = source.jumps, source.parts
        self._times = np.stack(_points(self.jumps, self.parts), axis=-1).ravel()
        self._values = source(self._times)

    def __call__(self, times: Array) -> Array:
        """See `Source`."""
        columns = [np.interp(times, self._times, u, left=0, right=0) for u in self._values.T]
        return np.stack(columns, axis=-1)


class Command:
    """The command of one plan on the time grid of one simulation, with what feedback adds to it.

    Args:
        plan: The plan; executable.
        period: Sampling period, s, or None for a continuous command.
        draws: The machines, for delay and resolution.
        step: Largest step, s.
        stops: Times (m,) that the grid must hold, s; the first is 0, the last ends the simulation.
        readings: Times (K,) within the plan at which feedback reads the encoders, s; the first is
            0. What it adds takes the way of the command: it waits for the next sampling instant
            and for the delay.

    Raises:
        InputError: If the plan's input is not finite somewhere.

    Attributes:
        t: The grid, shape (M+1,), s. With one delay for all samples it holds every jump; otherwise
            a jump inside a step is seen at the next point of it.
        running: Whether each step lies before the plan's end, shape (M,).
        readings: As given.
        corrections: What feedback has added since each reading, (S, K, 2); zero until it is known.
    """

    def __init__(
        self,
        plan: Plan,
        period: float | None,
        draws: Draws,
        step: float,
        stops: Array,
        readings: Array | None = None,
    ) -> None:
        self._delay = draws["delay_s"][0]
        source: Source = Continuous(plan, step) if period is None else Held(plan, period)
        self._resolution = draws["velocity_resolution_rad_s"][:, :1]
        self._end = plan.duration
        self.readings = np.empty(0) if readings is None else readings
        self._begins = _sampled(self.readings, period)
        self.corrections = np.zeros((draws.count, len(self.readings), 2))
        self._table: Array | None = None
        if np.all(self._delay == self._delay[0]):
            self._tabulate(source, step, stops)
        else:
            self.t = subdivided(merged(stops, self.readings), step)
            self._source = Tabulated(source) if period is None else source
            self._times = np.stack(_points(self.t, source.parts), axis=1)
        self.running = self.t[:-1] + np.diff(self.t) / 2 < plan.duration

    def _tabulate(self, source: Source, step: float, stops: Array) -> None:
        """One delay for all: the grid holds every jump, and one table serves all samples."""
        delay = self._delay[0]
        jumps = merged(source.jumps, self._begins) + delay
        self.t = subdivided(merged(stops, self.readings, jumps[jumps < stops[-1]]), step)
        plan_time = snapped(self.t - delay, source.jumps)
        points = _points(plan_time, source.parts)
        table = np.stack([source(t) for t in points], axis=1)[..., None]
        self._table = table if len(self.readings) else self._rounded(table)
        self._index = self._reading(plan_time[:-1])

    def part(self, chosen: slice) -> Command:
        """The same command for a run of the samples."""
        out = copy(self)
        out._delay = self._delay[chosen] if len(self._delay) > 1 else self._delay
        out.corrections = self.corrections[chosen]
        return out

    def at(self, k: int) -> Array:
        """What step k asks of both motors at its P points, shape (P, 2, S or 1).

        A held command has 2 points, the ends; a continuous one 3, the middle between them.
        """
        return np.asarray(self.block(k, k + 1)[0])

    def block(self, first: int, last: int) -> Array:
        """What the steps first ≤ k < last ask for, shape (K, P, 2, S or 1)."""
        if self._table is not None:
            table = self._table[first:last]
            if not len(self.readings):
                return table
            return self._rounded(table + self._added(self._index[first:last, None, None]))
        times = self._times[first:last, :, None] - self._delay
        values = np.moveaxis(self._source(times), -1, 2)
        if len(self.readings):
            values = values + self._added(self._reading(times))
        return self._rounded(values)

    def correct(self, i: int, correction: Array) -> None:
        """Add to the plan's input from reading i until the next, (2, S).

        Raises:
            InputError: If a number is not finite.
        """
        if not np.all(np.isfinite(correction)):
            raise InputError(
                f"feedback asks for what is not finite at t = {self.readings[i]:.6g} s"
            )
        self.corrections[:, i] = correction.T

    def _reading(self, times: Array) -> NDArray[np.int64]:
        """The reading whose correction holds at plan times (...); -1 where there is none."""
        index = np.searchsorted(self._begins - self._close, times, side="right") - 1
        return np.where(times < self._end - self._close, index, -1)

    @property
    def reading_steps(self) -> list[int]:
        """The steps that start with a reading."""
        return [int(k) for k in np.searchsorted(self.t, self.readings - self._close)]

    @property
    def _close(self) -> float:
        return 4 * ROUNDING * max(1.0, self._end)

    def _added(self, index: NDArray[np.int64]) -> Array:
        """Corrections (K, P, 2, S) of readings (K, P, S or 1)."""
        samples = np.arange(len(self.corrections))
        added = np.where(index[..., None] >= 0, self.corrections[samples, index], 0.0)
        return np.moveaxis(added, -1, 2)

    def _rounded(self, values: Array) -> Array:
        if not np.any(self._resolution):
            return values
        step = np.where(self._resolution > 0, self._resolution, 1.0)
        return np.asarray(np.where(self._resolution > 0, np.round(values / step) * step, values))


def _sampled(times: Array, period: float | None) -> Array:
    """The first sampling instants not before the times."""
    if period is None:
        return times
    return np.asarray(period * np.ceil(times / period - 1e-9))


def _points(times: Array, parts: tuple[float, ...]) -> list[Array]:
    return [inside(times[:-1], times[1:], part) for part in parts]


def _finite(values: Array, times: Array) -> Array:
    bad = ~np.all(np.isfinite(values), axis=-1)
    if np.any(bad):
        when = float(times[bad][0])
        raise InputError(
            f"the plan's input is not finite at t = {when:.6g} s; it cannot be replayed"
        )
    return values
