"""Turn a plan's u(t) into commands of the servos: sample and hold, delay, resolution.

Before the plan's start and after its end the command is zero.

This file also makes the time grid of a simulation: no step crosses a jump of the command or is
longer than allowed. A long run is cut into stretches, so that memory does not grow with its
duration.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.machine import Draws
from planner.plan.plan import Plan
from planner.support.arrays import Array


class CommandSource(Protocol):
    """Motor commands over plan time, before delay and rounding to the resolution.

    Attributes:
        jumps: Increasing times, s, between which the command is smooth enough for the quadrature,
            from the plan's start to its end.
        parts: Positions in a step where the command is read: 0 at the start, 1 just before the end.
    """

    jumps: Array
    parts: tuple[float, ...]

    def __call__(self, times: Array) -> Array:
        """Return the commands (…, 2) at plan times (…), s: right-hand limits, zero outside the
        plan."""


class SampleAndHold:
    """Plan inputs sampled at the start of each period and held until the next or the plan's end.

    A sampling instant within rounding of a break of the plan takes the value after the break. The
    values are computed for plan times from `low` to `high`, s.
    """

    parts: tuple[float, ...] = (0.0, 1.0)

    def __init__(self, plan: Plan, period: float, low: float = 0.0, high: float = np.inf) -> None:
        end = plan.duration
        count = np.ceil(end / period)
        first, last = max(0.0, low // period - 1), min(count, high // period + 2)
        ticks: Array = period * np.arange(first, last, dtype=np.float64)
        ends = np.array([0.0, end])[[first == 0, last == count]]
        self.jumps = merge_times(ends, snap_times(ticks, plan.t))
        values = _check_finite(plan.u(self.jumps[:-1]), self.jumps[:-1])
        self._values = np.concatenate([values, np.zeros((1, 2))])

    def __call__(self, times: Array) -> Array:
        """Return the commands at plan times; see `CommandSource`."""
        return np.asarray(self._values[np.searchsorted(self.jumps, times, side="right") - 1])


class ContinuousSource:
    """Plan inputs u(t) without sampling, for plan times from `low` to `high`, s."""

    parts: tuple[float, ...] = (0.0, 0.5, 1.0)

    def __init__(self, plan: Plan, step: float, low: float = 0.0, high: float = np.inf) -> None:
        self._plan = plan
        self.jumps = refine_times(self, subdivide(plan.t, step, low, high))

    def __call__(self, times: Array) -> Array:
        """Return the commands at plan times; see `CommandSource`."""
        inside = (times >= 0) & (times < self._plan.duration)
        values = np.where(inside[..., None], self._plan.u(np.where(inside, times, 0.0)), 0.0)
        return _check_finite(values, times)


class TableSource:
    """Table of a continuous command, interpolated for samples that read it at different times."""

    def __init__(self, source: CommandSource) -> None:
        self.jumps, self.parts = source.jumps, source.parts
        self._times = np.stack(_points(self.jumps, self.parts), axis=-1).ravel()
        self._values = source(self._times)

    def __call__(self, times: Array) -> Array:
        """Return the commands at plan times; see `CommandSource`."""
        columns = [np.interp(times, self._times, u, left=0, right=0) for u in self._values.T]
        return np.stack(columns, axis=-1)


class CommandGrid(Protocol):
    """Commands of the servos on the time grid of one simulation.

    Attributes:
        t: The grid, shape (M+1,), s.
        running: Whether a plan or a controller is running in each step, shape (M,).
    """

    t: Array
    running: NDArray[np.bool_]

    def block(self, first: int, last: int) -> Array:
        """Return the commands at the P points of steps first ≤ k < last, (K, P, 2, S or 1).

        A held command has 2 points, the ends of the step, with equal values; a continuous one has
        3, the ends and the middle.
        """


class Command:
    """The command of one plan on the time grid of one simulation, or of a stretch of it.

    Args:
        plan: The plan; executable.
        period: Sampling period, s, or None for a continuous command.
        draws: The machines, for delay and resolution.
        step: Largest step, s.
        stops: Times (m,) that the grid must contain, s; the grid begins with the first, at or after
            0, and ends with the last.

    Raises:
        InputError: If the plan's input is not finite somewhere.

    Attributes:
        t: The grid, shape (M+1,), s. If all samples have the same delay, it contains every jump;
            otherwise a jump inside a step takes effect at the step's next point.
        running: Whether each step lies before the plan's end, shape (M,).
    """

    def __init__(
        self, plan: Plan, period: float | None, draws: Draws, step: float, stops: Array
    ) -> None:
        delay = draws["delay_s"][0]
        low = min(float(stops[0] - delay.max()), plan.duration - step)
        window = low, float(stops[-1] - delay.min())
        source: CommandSource = (
            ContinuousSource(plan, step, *window)
            if period is None
            else SampleAndHold(plan, period, *window)
        )
        self._resolution = draws["velocity_resolution_rad_s"][:, :1]
        self._table: Array | None = None
        if np.all(delay == delay[0]):
            jumps = source.jumps + delay[0]
            self.t = subdivide(merge_times(stops, interior(jumps, stops)), step)
            plan_time = snap_times(self.t - delay[0], source.jumps)
            points = _points(plan_time, source.parts)
            table = np.stack([source(t) for t in points], axis=1)
            self._table = quantise(table[..., None], self._resolution)
        else:
            self.t = subdivide(stops, step)
            self._source = TableSource(source) if period is None else source
            self._delay = delay
            self._times = np.stack(_points(self.t, source.parts), axis=1)
        self.running: NDArray[np.bool_] = self.t[:-1] + np.diff(self.t) / 2 < plan.duration

    def part(self, chosen: slice) -> Command:
        """Return the command of the samples in the range `chosen`."""
        out = copy(self)
        if self._table is None:
            out._delay = self._delay[chosen]
        return out

    def block(self, first: int, last: int) -> Array:
        """Return the commands in the steps first ≤ k < last; see `CommandGrid`."""
        if self._table is not None:
            return self._table[first:last]
        times = self._times[first:last, :, None] - self._delay
        return quantise(np.moveaxis(self._source(times), -1, 2), self._resolution)


class CommandVariants:
    """Commands that differ between the samples of one machine; a `CommandGrid`.

    Args:
        t: Ends of the ticks, shape (K+1,), s.
        values: Commanded inputs in each tick, shape (K, 2, S).
        is_linear: Whether inputs are linear from the beginning of one tick to the next.
        draws: The samples, which all have the same delay.
        step: Largest step, s.
        stops: See `Command`.
    """

    def __init__(
        self, t: Array, values: Array, is_linear: bool, draws: Draws, step: float, stops: Array
    ) -> None:
        delay = float(draws["delay_s"][0][0])
        self.t = subdivide(merge_times(stops, interior(t + delay, stops)), step)
        self.running: NDArray[np.bool_] = self.t[:-1] + np.diff(self.t) / 2 < t[-1]
        plan_times = snap_times(self.t - delay, t)
        points = np.stack(_points(plan_times, (0.0, 0.5, 1.0)), axis=1)
        tick = np.searchsorted(t, points, side="right") - 1
        self._tick = np.where((tick < 0) | (tick >= len(values)), len(values), tick)
        length = np.append(np.diff(t), 1.0)[self._tick]
        self._share = (points - t[np.minimum(self._tick, len(t) - 1)]) / length
        nothing = np.zeros((1, *values.shape[1:]))
        self._values = np.concatenate([values, nothing])
        self._after = np.concatenate([values[1:], values[-1:], nothing]) if is_linear else None
        self._resolution = draws["velocity_resolution_rad_s"][:, :1]

    def block(self, first: int, last: int) -> Array:
        """Return the commands in the steps first ≤ k < last; see `CommandGrid`."""
        tick = self._tick[first:last]
        if self._after is None:
            values = quantise(self._values[tick[:, 0]], self._resolution)
            return np.broadcast_to(values[:, None], (len(values), 2, *values.shape[1:]))
        share = self._share[first:last, :, None, None]
        between = (1 - share) * self._values[tick] + share * self._after[tick]
        return quantise(between, self._resolution)


def quantise(values: Array, resolution: Array) -> Array:
    """Round commands (…, 2, S) to each motor's resolution (2, 1); a resolution of 0 keeps them."""
    if not np.any(resolution):
        return values
    step = np.where(resolution > 0, resolution, 1.0)
    return np.asarray(np.where(resolution > 0, np.round(values / step) * step, values))


def _points(times: Array, parts: tuple[float, ...]) -> list[Array]:
    return [step_times(times[:-1], times[1:], part) for part in parts]


def _check_finite(values: Array, times: Array) -> Array:
    bad = ~np.all(np.isfinite(values), axis=-1)
    if np.any(bad):
        when = float(times[bad][0])
        raise InputError(
            f"the plan's input is not finite at t = {when:.6g} s; it cannot be replayed"
        )
    return values


QUADRATURE_TOLERANCE = 1e-12
"""Largest estimated error of Simpson's rule on a continuous command, rad per step."""

ROUNDING = 1e-12
"""Difference of two times that count as equal, as a fraction of the largest time or of 1 s."""

EXACT_S = 1000.0
"""Time up to which rounding leaves eleven correct digits in the lengths of steps, s."""

InputOfTime = Callable[[Array], Array]

Steps = Callable[[int], None]
"""Function that is called with the number of steps done."""


def merge_times(*times: Array) -> Array:
    """Merge arrays of times in increasing order. Of times that are equal within rounding, that of
    the first array is kept."""
    every = np.concatenate(times)
    rank = np.concatenate([np.full(len(t), i) for i, t in enumerate(times)])
    order = np.lexsort((rank, every))
    every, rank = every[order], rank[order]
    close = ROUNDING * max(1.0, float(np.max(np.abs(every))))
    group = np.cumsum(np.concatenate([[0], np.diff(every) > close]))
    first = np.lexsort((rank, group))
    _, where = np.unique(group[first], return_index=True)
    return np.asarray(every[first][where])


def interior(times: Array, stops: Array) -> Array:
    """Return the entries of `times` strictly between the first and the last of `stops`."""
    return np.asarray(times[(times > stops[0]) & (times < stops[-1])])


def subdivide(times: Array, step: float, low: float = -np.inf, high: float = np.inf) -> Array:
    """Divide the intervals of `times` into equal steps, none longer than `step`.

    Only the steps that overlap the range from `low` to `high` are made.
    """
    gaps = np.diff(times)
    counts = np.maximum(1, np.ceil(gaps / step - 1e-9)).astype(int)
    sizes = gaps / counts
    begin = np.floor((low - times[:-1]) / sizes - 1e-9)
    end = np.ceil((high - times[:-1]) / sizes + 1e-9)
    first, last = (np.clip(edge, 0, counts).astype(int) for edge in (begin, end))
    number = np.maximum(last - first, 0)
    inner = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number - first, number)
    starts, sizes = np.repeat(times[:-1], number), np.repeat(sizes, number)
    out = starts + inner * sizes
    return np.append(out, times[-1] if last[-1] == counts[-1] else out[-1:] + sizes[-1:])


def stretches(times: Array, begin: float, longest: float) -> list[tuple[Array, slice]]:
    """Cut a run from `begin` to the last of `times` into stretches of about `longest`, s.

    The cuts lie at entries of `times` where possible, which adds no time to the grid.

    Returns:
        For each stretch: the times that its grid must contain, from its start to its end; and the
        range of `times` recorded in it. A time at which a stretch ends is recorded in the next.
    """
    count = max(1, int(np.ceil((times[-1] - begin) / longest - 1e-9)))
    cuts: Array = begin + longest * np.arange(count, dtype=np.float64)
    after = times[np.searchsorted(times, cuts[1:])]
    cuts[1:] = np.where(after < cuts[1:] + longest / 2, after, cuts[1:])
    ends = np.append(cuts, times[-1])
    places = np.append(np.searchsorted(times, cuts), len(times)).tolist()
    rows = [slice(a, b) for a, b in pairwise(places)]
    return [(merge_times(ends[i : i + 2], times[each]), each) for i, each in enumerate(rows)]


def refine_times(command: InputOfTime, times: Array) -> Array:
    """Halve the steps of `times` until Simpson's rule integrates the command accurately.

    Args:
        command: Maps times (…) to values (…, 2); smooth inside each step, right-hand limits at
            jumps.
        times: Increasing times that include every jump.

    Returns:
        The given and the added times, increasing.
    """
    left, right = times[:-1], times[1:]
    narrow = 4 * ROUNDING * max(1.0, abs(float(times[-1])))
    added = [times]
    while left.size:
        # Simpson's rule on the halves of each step against that on the whole step: for a smooth
        # command fifteen times the error of the finer rule.
        u = np.stack([command(step_times(left, right, p)) for p in (0.0, 0.25, 0.5, 0.75, 1.0)])
        width = (right - left)[:, None]
        whole = width / 6 * (u[0] + 4 * u[2] + u[4])
        halves = width / 12 * (u[0] + 4 * u[1] + 2 * u[2] + 4 * u[3] + u[4])
        gap = np.max(np.abs(halves - whole), axis=-1)
        rough = np.isfinite(gap) & (gap > QUADRATURE_TOLERANCE)
        rough &= right - left > narrow
        left, right = left[rough], right[rough]
        middle = left + (right - left) / 2
        added.append(middle)
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    return np.unique(np.concatenate(added))


def lengths(times: Array) -> Array:
    """Return the lengths of the steps between `times`. Lengths that differ only by rounding are
    made equal, so that factors computed for one length can be reused."""
    steps, which = np.unique(np.diff(times), return_inverse=True)
    late = max(1.0, float(np.max(np.abs(times))) / EXACT_S)  # large times have larger rounding
    digits = 11 - int(np.ceil(np.log10(late)))
    return np.array([float(f"{h:.{max(digits, 1)}g}") for h in steps])[which]


def snap_times(times: Array, marks: Array) -> Array:
    """Move each of `times` that equals one of increasing `marks` within rounding to that mark."""
    index = np.clip(np.searchsorted(marks, times), 1, len(marks) - 1)
    below, above = marks[index - 1], marks[index]
    near = np.where(times - below < above - times, below, above)
    close = ROUNDING * max(1.0, float(marks[-1]))
    return np.where(np.abs(times - near) < close, near, times)


def step_times(left: Array, right: Array, part: float) -> Array:
    """Return the times at the fraction `part` (0 … 1) of each step; `part` = 1 gives the time just
    before the step's end."""
    return np.minimum(left + part * (right - left), np.nextafter(right, left))
