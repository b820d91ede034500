"""The times of a simulation: no step crosses a jump of the command, none is too long."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.systems.base import Array

QUADRATURE_TOLERANCE = 1e-12
"""Largest estimated error of Simpson's rule on a continuous command, in radians a step."""

ROUNDING = 1e-12
"""Times closer than this part of the longest (or of a second) are the same."""

Command = Callable[[Array], Array]

Steps = Callable[[int], None]
"""Told how many steps are done."""


def merged(*times: Array) -> Array:
    """All these times, increasing; of those closer than rounding, the one named first."""
    every = np.concatenate(times)
    rank = np.concatenate([np.full(len(t), i) for i, t in enumerate(times)])
    order = np.lexsort((rank, every))
    every, rank = every[order], rank[order]
    close = ROUNDING * max(1.0, float(np.max(np.abs(every))))
    group = np.cumsum(np.concatenate([[0], np.diff(every) > close]))
    first = np.lexsort((rank, group))
    _, where = np.unique(group[first], return_index=True)
    return np.asarray(every[first][where])


def subdivided(times: Array, step: float) -> Array:
    """`times` with equal steps between, none longer than `step`."""
    gaps = np.diff(times)
    counts = np.maximum(1, np.ceil(gaps / step - 1e-9)).astype(int)
    starts = np.repeat(times[:-1], counts)
    inner = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.append(starts + inner * np.repeat(gaps / counts, counts), times[-1])


def refined(command: Command, times: Array, tolerance: float = QUADRATURE_TOLERANCE) -> Array:
    """`times` with steps halved until Simpson's rule integrates the command over each of them.

    Args:
        command: Times (…) to values (…, 2); smooth inside each step, right-hand limits at jumps.
        times: Increasing; includes every jump.
        tolerance: Largest estimated error a step, in the command's unit times seconds.

    Returns:
        The times, increasing, with what was added.
    """
    left, right = times[:-1], times[1:]
    narrow = 4 * ROUNDING * max(1.0, abs(float(times[-1])))
    added = [times]
    while left.size:
        rough = _simpson_gap(command, left, right) > tolerance
        rough &= right - left > narrow
        left, right = left[rough], right[rough]
        middle = left + (right - left) / 2
        added.append(middle)
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    return np.unique(np.concatenate(added))


def lengths(times: Array) -> list[float]:
    """Lengths of the steps, equal where they differ by rounding alone (their factors are kept)."""
    return [float(f"{h:.11g}") for h in np.diff(times)]


def snapped(times: Array, marks: Array) -> Array:
    """`times`, each within rounding of one of the increasing `marks` moved onto it."""
    index = np.clip(np.searchsorted(marks, times), 1, len(marks) - 1)
    below, above = marks[index - 1], marks[index]
    near = np.where(times - below < above - times, below, above)
    close = ROUNDING * max(1.0, float(marks[-1]))
    return np.where(np.abs(times - near) < close, near, times)


def inside(left: Array, right: Array, part: float) -> Array:
    """Times at a part (0 … 1) of each step, the last one just before its end."""
    return np.minimum(left + part * (right - left), np.nextafter(right, left))


def _simpson_gap(command: Command, left: Array, right: Array) -> Array:
    """|Simpson on halves − Simpson on the whole|, the larger of both motors, shape (m,).

    Fifteen times the error of the finer rule where the command is smooth; so a safe estimate.
    """
    u = np.stack([command(inside(left, right, p)) for p in (0.0, 0.25, 0.5, 0.75, 1.0)])
    width = (right - left)[:, None]
    whole = width / 6 * (u[0] + 4 * u[2] + u[4])
    halves = width / 12 * (u[0] + 4 * u[1] + 2 * u[2] + 4 * u[3] + u[4])
    gap = np.max(np.abs(halves - whole), axis=-1)
    return np.where(np.isfinite(gap), gap, 0.0)
