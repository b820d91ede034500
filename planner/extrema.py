"""Extremes and zeros of a function of time, between the samples as well as on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from planner.systems.base import Array

Function = Callable[[Array], Array]

MOST_STEPS = 4000
"""Brent's method may take the square of bisection's steps where a zero is flat or a jump."""


def sample_times(breaks: Array, count: int = 2000) -> Array:
    """About `count` times over the pieces between `breaks`, crowded towards each piece's ends.

    The crowding (Chebyshev–Lobatto) finds the short, steep starts that plans have close to a
    singularity. Interior breaks appear from both sides.
    """
    per_piece = max(9, count // (len(breaks) - 1))
    unit = 0.5 - 0.5 * np.cos(np.pi * np.arange(per_piece) / (per_piece - 1))
    left, right = breaks[:-1, None], np.nextafter(breaks[1:, None], -np.inf)
    times = np.minimum(left + (breaks[1:, None] - left) * unit, right).ravel()
    times[-1] = breaks[-1]
    return times


def minimum(function: Function, times: Array, refine: int = 3) -> tuple[float, float]:
    """Least value of `function` and its time.

    Args:
        function: Vectorised, times (m,) to values (m,); NaN values are passed over.
        times: Increasing samples; the `refine` dips among them whose parabola through three
            samples goes lowest are polished.

    Returns:
        (value, time); (nan, nan) if every value is NaN.
    """
    values = function(times)
    if np.all(np.isnan(values)):
        return np.nan, np.nan
    filled = np.where(np.isnan(values), np.inf, values)
    best = int(np.argmin(filled))
    found = (float(filled[best]), float(times[best]))
    dips = np.array(_dips(filled), dtype=int)
    likely = np.argsort(_bottoms(filled, times, dips), kind="stable")
    for k in dips[likely[:refine]]:
        candidate = _polish(function, times, int(k))
        found = min(found, candidate)
    return found


def maximum(function: Function, times: Array, refine: int = 3) -> tuple[float, float]:
    """Greatest value of `function` and its time; see `minimum`."""
    value, time = minimum(lambda t: -function(t), times, refine)
    return -value, time


def zeros(function: Function, times: Array) -> list[float]:
    """Times at which `function` changes sign, found to rounding by Brent's method.

    Dips between two samples of the same sign are polished first, so that a short excursion between
    samples is not missed. NaN counts as negative.
    """
    values = _nan_negative(function(times))
    extra = []
    for sign in (1.0, -1.0):
        dips = _dips(np.where(sign * values > 0, sign * values, np.inf))
        for k in dips[:20]:
            value, time = _polish(lambda t, s=sign: s * _nan_negative(function(t)), times, k)  # type: ignore[misc]
            if value < 0:
                extra.append(time)
    grid = np.unique(np.concatenate([times, extra]))
    values = _nan_negative(function(grid))
    inside = values > 0
    return [_root(function, grid[k], grid[k + 1]) for k in _changes(inside)]


def _root(function: Function, a: float, b: float) -> float:
    def scalar(t: float) -> float:
        return float(_nan_negative(function(np.array([t])))[0])

    if scalar(a) == 0.0:
        return float(a)
    if scalar(a) * scalar(b) > 0:  # an exact zero at one end counts as outside
        return float(b)
    return float(brentq(scalar, a, b, xtol=1e-13, rtol=1e-14, maxiter=MOST_STEPS))


def _changes(inside: NDArray[np.bool_]) -> list[int]:
    return [int(k) for k in np.flatnonzero(inside[1:] != inside[:-1])]


def _nan_negative(values: Array) -> Array:
    return np.where(np.isnan(values), -1.0, values)


def _dips(values: Array) -> list[int]:
    """Indices of finite interior local minima, lowest first."""
    middle = values[1:-1]
    with np.errstate(invalid="ignore"):
        is_dip = (middle <= values[:-2]) & (middle <= values[2:]) & np.isfinite(middle)
    indices = np.flatnonzero(is_dip) + 1
    return [int(k) for k in indices[np.argsort(values[indices], kind="stable")]]


def _bottoms(values: Array, times: Array, dips: NDArray[np.int_]) -> Array:
    """Lowest value of the parabola through each dip and its neighbours; the dip's own value where
    a neighbour is not finite.
    """
    t = times[dips[:, None] + [-1, 0, 1]] - times[dips, None]
    f = values[dips[:, None] + [-1, 0, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        left, right = (f[:, 0] - f[:, 1]) / t[:, 0], (f[:, 2] - f[:, 1]) / t[:, 2]
        bend = (right - left) / (t[:, 2] - t[:, 0])
        slope = right - bend * t[:, 2]
        lowest = f[:, 1] - slope**2 / (4 * bend)
    return np.asarray(np.where(np.isfinite(lowest) & (bend > 0), lowest, f[:, 1]))


def _polish(function: Function, times: Array, k: int) -> tuple[float, float]:
    def scalar(t: float) -> float:
        value = float(function(np.array([t]))[0])
        return np.inf if np.isnan(value) else value

    result = minimize_scalar(
        scalar,
        bounds=(times[k - 1], times[k + 1]),
        method="bounded",
        options={"xatol": 1e-10 * max(1.0, abs(times[-1]))},
    )
    return float(result.fun), float(result.x)
