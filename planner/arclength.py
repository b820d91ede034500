"""How far the inputs have moved along a path: the parameter in which retiming is posed.

With inputs u(σ) over a trajectory's own time σ and scales c, the length s(σ) = ∫ ‖u/c‖ dσ belongs
to the path alone, and any timing s(t) of the path has inputs u(σ(s)) / ‖u(σ(s))/c‖ · ds/dt.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import BPoly, PPoly

from planner.extrema import sample_times, zeros
from planner.pieces import Grid
from planner.systems.base import Array
from planner.trajectory import Trajectory, at_times

Norm = Literal["max", "euclid"]

_RESOLVED = 1e-9
"""Chebyshev tail of ‖u/c‖ at which a piece is fine enough, over the piece's largest value."""

_NOISE = 1e-6
"""Tail below which a half no better than its whole shows rounding noise in u, not shape."""

_NEGLIGIBLE = 1e-10
"""Tail that does not count, over the mean of the whole path."""


def arc_length(path: Trajectory, scale: Array, norm: Norm) -> BPoly:
    """s over the path's own time, increasing from 0; its pieces are smooth.

    Args:
        path: Any trajectory with inputs at all times.
        scale: c, shape (2,).
        norm: "max" for max|uᵢ/cᵢ|, "euclid" for the root of the sum of squares.
    """

    def speed(sigma: Array) -> Array:
        scaled = np.abs(path.u(sigma)) / scale
        size = np.max(scaled, axis=-1) if norm == "max" else np.linalg.norm(scaled, axis=-1)
        return np.asarray(size)

    samples = sample_times(path.breaks)
    mean = float(np.mean(speed(samples)))
    edges = _merged(path.breaks, _corners(path, scale, norm, samples, mean))
    grid = _resolved(speed, edges, _NEGLIGIBLE * mean)
    return grid.curve(np.maximum(speed(_inner(grid)), 0.0)).antiderivative()


class Inverse:
    """Own time σ at a length s: Newton's method inside a shrinking bracket, to rounding.

    Args:
        length: As `arc_length` returns it.
    """

    def __init__(self, length: BPoly) -> None:
        self._length, self._slope = length, length.derivative()
        self._quick = PPoly.from_bernstein_basis(length)  # faster, good to about 1e-9
        self._quick_slope = self._quick.derivative()

    def slope(self, sigma: Array) -> Array:
        """ds/dσ, shape as sigma."""
        return at_times(self._slope, sigma)

    def __call__(self, s: Array, low: Array, high: Array) -> Array:
        """σ at lengths s (…), known to lie between own times low and high (…) of one piece."""
        high = np.nextafter(high, low)  # at the very end the next piece would answer
        base, top = self._quick(low), self._quick(high)
        at = low + (high - low) * np.clip((s - base) / np.maximum(top - base, 1e-300), 0.0, 1.0)
        left, right = low, high
        for _ in range(60):
            gap = self._quick(at) - s
            left, right = np.where(gap <= 0, at, left), np.where(gap >= 0, at, right)
            new = _step(at, gap, self._quick_slope(at))
            new = np.where((new >= left) & (new <= right), new, (left + right) / 2)
            moved, at = np.abs(new - at), new
            if np.all(moved <= 1e-8 * (high - low)):
                break
        for _ in range(2):
            new = np.clip(_step(at, at_times(self._length, at) - s, self.slope(at)), low, high)
            at = np.where(np.isnan(new), at, new)
        return np.asarray(at)


def _step(at: Array, gap: Array, slope: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(at - gap / slope)


def _merged(breaks: Array, extra: Array) -> Array:
    """Breaks and the extra times that are not next to one, or to one another."""
    apart = 1e-9 * breaks[-1]
    kept = list(breaks)
    for time in np.sort(extra):
        if np.min(np.abs(np.array(kept) - time)) > apart:
            kept.append(time)
    return np.sort(kept)


def _corners(path: Trajectory, scale: Array, norm: Norm, samples: Array, mean: float) -> Array:
    """Times inside pieces at which the speed has a kink: a stop, or the larger input changes."""

    def scaled(sigma: Array) -> Array:
        return np.where(np.abs(u := path.u(sigma) / scale) < 1e-12 * mean, 0.0, u)

    found: list[float] = []
    for i in range(2):
        still = zeros(lambda t, i=i: scaled(t)[..., i], samples)  # type: ignore[misc]
        found += [t for t in still if np.max(np.abs(scaled(np.array(t)))) < 1e-6 * mean]
    if norm == "max":
        found += zeros(lambda t: np.abs(scaled(t)[..., 0]) - np.abs(scaled(t)[..., 1]), samples)
    return np.array(found)


def _resolved(function: Callable[[Array], Array], edges: Array, atol: float) -> Grid:
    """Pieces between the edges, halved until the function's interpolant is as good as it gets."""
    work = [(float(a), float(b), np.inf) for a, b in pairwise(edges)]
    starts: list[float] = []
    shortest = 1e-12 * (edges[-1] - edges[0])
    while work:
        left, right, before = work.pop()
        grid = Grid(np.array([left, right]))
        values = function(_inner(grid))
        size = float(np.max(values))
        tail = max(float(grid.tail(values)[0]) - atol, 0.0)
        noise = 0.2 * before < tail < _NOISE * size
        if tail <= _RESOLVED * size or noise or right - left <= shortest:
            starts.append(left)
        else:
            middle = (left + right) / 2
            work += [(left, middle, tail), (middle, right, tail)]
    return Grid(np.append(np.sort(starts), edges[-1]))


def _inner(grid: Grid) -> Array:
    """The grid's points, the last of each piece just before its end, where inputs may jump."""
    return np.minimum(grid.times, np.nextafter(grid.breaks[1:, None], -np.inf))
