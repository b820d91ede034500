"""Extremes and zeros of a function of time, also between its samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.support.arrays import Array
from planner.support.calculus.chebyshev import points

Function = Callable[[Array], Array]


def sample_times(breaks: Array, count: int = 2000, least: int = 9) -> Array:
    """Return about `count` times over the pieces between `breaks`, denser near each piece's ends.

    Each piece has at least `least` times, including its two ends; inner breaks appear twice, once
    for each side. The spacing (Chebyshev–Lobatto) resolves the short, steep starts of plans close
    to a singularity.
    """
    per_piece = max(least, count // (len(breaks) - 1))
    left, right = breaks[:-1, None], np.nextafter(breaks[1:, None], -np.inf)
    times = np.minimum(left + (breaks[1:, None] - left) * points(per_piece), right).ravel()
    times[-1] = breaks[-1]
    return times


FLAT_DEPTH = 1e-13
"""Depth below which a dip of a function of order one is rounding."""

_ROUNDS = 11
"""Rounds that narrow a dip eightfold each, together to 1e-10 of the distance between samples."""

_SECTIONS = 13
"""Rounds that narrow a change of sign 16-fold each, together to the rounding of its time."""


def minimum(function: Function, times: Array) -> tuple[float, float]:
    """Find the least value of `function` and its time.

    Between samples the search covers each dip, a sample that is not above its two neighbours. It
    leaves out a dip if its value minus twice its depth below the higher neighbour is still above
    the least sample.

    Args:
        function: Vectorised, times (m,) to values (m,); NaN values are ignored.
        times: Increasing samples.

    Returns:
        (value, time); (nan, nan) if every value is NaN.
    """
    values = function(times)
    if np.all(np.isnan(values)):
        return np.nan, np.nan
    filled = np.where(np.isnan(values), np.inf, values)
    best = int(np.argmin(filled))
    dips, depth = _dips(filled)
    deep = (depth > FLAT_DEPTH) & (filled[dips] - 2 * depth <= filled[best])
    lowest, when = _narrow_samples(function, times, dips[deep])
    lowest, when = np.append(filled[best], lowest), np.append(times[best], when)
    k = int(np.argmin(lowest))
    return float(lowest[k]), float(when[k])


def maximum(function: Function, times: Array) -> tuple[float, float]:
    """Find the greatest value of `function` and its time, in the same way as `minimum`."""
    value, time = minimum(lambda t: -function(t), times)
    return -value, time


def zeros(function: Function, times: Array) -> list[float]:
    """Find the times at which `function` changes sign, accurate to rounding.

    Each time is on the side where the function is ≤ 0; NaN counts as negative. Where neighbouring
    samples have the same sign but come near zero, the function is searched between them too, so
    that a short change of sign is not missed.
    """
    values = _nan_negative(function(times))
    extra: list[float] = []
    for sign in (1.0, -1.0):
        sided = np.where(sign * values > 0, sign * values, np.inf)
        dips, depth = _dips(sided)
        near = dips[sided[dips] < 2 * depth]

        def signed(t: Array, s: float = sign) -> Array:
            return s * _nan_negative(function(t))

        lowest, when = _narrow_samples(signed, times, near)
        extra += when[lowest < 0].tolist()
    grid = np.unique(np.concatenate([times, extra]))
    inside = _nan_negative(function(grid)) > 0
    changes = np.flatnonzero(inside[1:] != inside[:-1])
    low, high, falls = grid[changes], grid[changes + 1], inside[changes]
    row = np.arange(len(changes))
    for _ in range(_SECTIONS if len(changes) else 0):
        x = np.vstack([low + (high - low) * np.linspace(0.0, 1.0, 17)[:-1, None], high])
        inside = _nan_negative(function(x.ravel())).reshape(x.shape) > 0
        inside[0], inside[-1] = falls, ~falls
        k = np.argmax(inside != falls, axis=0)
        low, high = x[k - 1, row], x[k, row]
    return [float(t) for t in np.where(falls, high, low)]


def _nan_negative(values: Array) -> Array:
    return np.where(np.isnan(values), -1.0, values)


def _dips(values: Array) -> tuple[NDArray[np.int_], Array]:
    """Return the indices of local minima, and their depths below the higher finite neighbour."""
    middle, sides = values[1:-1], np.stack([values[:-2], values[2:]])
    with np.errstate(invalid="ignore"):
        is_dip = np.all(middle <= sides, axis=0) & np.isfinite(middle)
        depth = np.max(np.where(np.isfinite(sides), sides - middle, 0.0), axis=0)
    return np.flatnonzero(is_dip) + 1, depth[is_dip]


def _narrow_samples(
    function: Function, times: Array, dips: NDArray[np.int_]
) -> tuple[Array, Array]:
    """Return the least value between the samples before and after each dip, and its time, (M,).

    `dips` are the indices (M,) of local minima of the samples at `times`.
    """

    def together(x: Array) -> Array:
        return function(x.ravel()).reshape(x.shape)

    return narrow_dips(together, times[dips - 1], times[dips + 1])


def narrow_dips(function: Function, low: Array, high: Array) -> tuple[Array, Array]:
    """Find the minima of M functions, each of which dips once between its `low` and its `high`.

    Args:
        function: From x (R, M), one column per dip, to values (R, M); NaN is ignored.
        low: Lower ends of the intervals, shape (M,).
        high: Upper ends of the intervals, shape (M,).

    Returns:
        Least values (M,) and their x (M,).
    """
    row, share = np.arange(len(low)), np.linspace(0.0, 1.0, 17)[:, None]
    value, where = np.full(len(low), np.inf), (low + high) / 2
    for _ in range(_ROUNDS if len(low) else 0):
        x = low + (high - low) * share
        with np.errstate(invalid="ignore"):  # beside the dip values may be infinite
            values = function(x)
        values = np.where(np.isnan(values), np.inf, values)
        k = np.argmin(values, axis=0)
        value, where = values[k, row], x[k, row]
        low, high = x[np.maximum(k - 1, 0), row], x[np.minimum(k + 1, 16), row]
    return value, where
