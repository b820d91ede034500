"""Functions of one variable: extremes, zeros and inverses, between samples as well as on them.

Functions of time on pieces: values at Chebyshev points, and Bernstein coefficients.

On each piece a function is held by its values at Chebyshev–Lobatto points, where products are exact
and integrals are one small matrix; `BPoly` curves are made from them at the end.

Equations f(x) = y are solved on the stretch of an interval where f rises, or falls; many at once. f
may turn once in the interval. The search needs no turning point beforehand: a point beyond it is
known by the sign of f' and counts as too far. Newton's method inside a shrinking bracket, with
bisection wherever a Newton step leaves the bracket, the stretch, or does not halve the last step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from scipy.optimize import brentq

from planner.support.arrays import Array

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


FLAT = 1e-13
"""Depth of a dip that is rounding, where a function is of order one."""

_ROUNDS = 11
"""Rounds that each narrow a dip eight times: to 1e-10 of the distance between samples."""


def minimum(function: Function, times: Array) -> tuple[float, float]:
    """Least value of `function` and its time.

    Every dip between samples is narrowed but those that would have to fall by more than twice their
    sides.

    Args:
        function: Vectorised, times (m,) to values (m,); NaN values are passed over.
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
    deep = (depth > FLAT) & (filled[dips] - 2 * depth <= filled[best])
    lowest, when = _narrowed(function, times, dips[deep])
    lowest, when = np.append(filled[best], lowest), np.append(times[best], when)
    k = int(np.argmin(lowest))
    return float(lowest[k]), float(when[k])


def maximum(function: Function, times: Array) -> tuple[float, float]:
    """Greatest value of `function` and its time; see `minimum`."""
    value, time = minimum(lambda t: -function(t), times)
    return -value, time


def zeros(function: Function, times: Array) -> list[float]:
    """Times at which `function` changes sign, found to rounding by Brent's method.

    Dips between two samples of the same sign are narrowed first, so that a short excursion between
    samples is not missed. NaN counts as negative.
    """
    values = _nan_negative(function(times))
    extra: list[float] = []
    for sign in (1.0, -1.0):
        sided = np.where(sign * values > 0, sign * values, np.inf)
        dips, depth = _dips(sided)
        near = dips[sided[dips] < 2 * depth]
        lowest, when = _narrowed(lambda t, s=sign: s * _nan_negative(function(t)), times, near)  # type: ignore[misc]
        extra += when[lowest < 0].tolist()
    grid = np.unique(np.concatenate([times, extra]))
    values = _nan_negative(function(grid))
    inside = values > 0
    changes = np.flatnonzero(inside[1:] != inside[:-1])
    return [_root(function, grid[k], grid[k + 1]) for k in changes]


def _root(function: Function, a: float, b: float) -> float:
    def scalar(t: float) -> float:
        return float(_nan_negative(function(np.array([t])))[0])

    if scalar(a) == 0.0:
        return float(a)
    if scalar(a) * scalar(b) > 0:  # an exact zero at one end counts as outside
        return float(b)
    return float(brentq(scalar, a, b, xtol=1e-13, rtol=1e-14, maxiter=MOST_STEPS))


def _nan_negative(values: Array) -> Array:
    return np.where(np.isnan(values), -1.0, values)


def _dips(values: Array) -> tuple[NDArray[np.int_], Array]:
    """Indices of finite interior local minima, and how far the higher finite side is above each."""
    middle, sides = values[1:-1], np.stack([values[:-2], values[2:]])
    with np.errstate(invalid="ignore"):
        is_dip = np.all(middle <= sides, axis=0) & np.isfinite(middle)
        depth = np.max(np.where(np.isfinite(sides), sides - middle, 0.0), axis=0)
    return np.flatnonzero(is_dip) + 1, depth[is_dip]


def _narrowed(function: Function, times: Array, dips: NDArray[np.int_]) -> tuple[Array, Array]:
    """Least values between the samples beside each dip, and when; NaN is passed over."""
    low, high, row = times[dips - 1], times[dips + 1], np.arange(len(dips))
    value, when = np.full(len(dips), np.inf), times[dips]
    for _ in range(_ROUNDS if len(dips) else 0):
        x = low + (high - low) * np.linspace(0.0, 1.0, 17)[:, None]
        with np.errstate(invalid="ignore"):  # beside the dip it may be infinite
            found = function(x.ravel()).reshape(x.shape)
        found = np.where(np.isnan(found), np.inf, found)
        k = np.argmin(found, axis=0)
        value, when = found[k, row], x[k, row]
        low, high = x[np.maximum(k - 1, 0), row], x[np.minimum(k + 1, 16), row]
    return value, when


DEGREE = 14


@dataclass(frozen=True)
class Grid:
    """Pieces and their points.

    Attributes:
        breaks: Times between the pieces, shape (P+1,).
    """

    breaks: Array

    @property
    def times(self) -> Array:
        """The points, shape (P, DEGREE+1); piece ends appear twice."""
        left, width = self.breaks[:-1, None], np.diff(self.breaks)[:, None]
        return np.asarray(left + width * _points())

    def integral(self, f: Array) -> Array:
        """∫ f from the first break to every point; f of shape (P, DEGREE+1, …)."""
        width = np.diff(self.breaks).reshape(-1, *[1] * (f.ndim - 1))
        own = _apply(_integration(), f) * width
        before = np.cumsum(own[:, -1], axis=0) - own[:, -1]
        return own + before[:, None]

    def derivative(self, f: Array) -> Array:
        """df/dt at the points."""
        width = np.diff(self.breaks).reshape(-1, *[1] * (f.ndim - 1))
        return _apply(_differentiation(), f) / width

    def tail(self, f: Array) -> Array:
        """Largest of the last two Chebyshev coefficients, shape (P, …)."""
        return np.asarray(np.max(np.abs(_apply(_to_chebyshev()[-2:], f)), axis=1))

    def curve(self, f: Array) -> BPoly:
        """The interpolating piecewise polynomial of values f (P, DEGREE+1, …)."""
        return BPoly(np.swapaxes(_apply(_to_bernstein(), f), 0, 1), self.breaks)


def elevate(c: Array, degree: int) -> Array:
    """The same polynomial with Bernstein coefficients c (d+1, …) written at a higher degree."""
    return np.tensordot(_elevation(len(c) - 1, degree), c, axes=1)


@lru_cache(maxsize=256)
def _elevation(low: int, high: int) -> Array:
    """Matrix (high+1, low+1) that raises Bernstein coefficients from one degree to another."""
    out = np.eye(low + 1)
    for d in range(low + 1, high + 1):
        share = (np.arange(d + 1) / d)[:, None]
        out = share * np.concatenate([out[:1], out]) + (1 - share) * np.concatenate([out, out[-1:]])
    return out


def _apply(matrix: Array, f: Array) -> Array:
    """The matrix (M, D) on the second axis of f (P, D, …)."""
    flat = matrix @ f.reshape(*f.shape[:2], -1)
    return np.asarray(flat.reshape(len(f), len(matrix), *f.shape[2:]))


@lru_cache(maxsize=1)
def _points() -> Array:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE))


@lru_cache(maxsize=1)
def _to_chebyshev() -> Array:
    """Values at the points → Chebyshev coefficients, both on [0, 1], (DEGREE+1)²."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(2 * _points() - 1, DEGREE)))


@lru_cache(maxsize=1)
def _integration() -> Array:
    """Values of f at the points → values of ∫₀ f at the points."""
    integrals = chebyshev.chebint(np.eye(DEGREE + 1), lbnd=-1) / 2
    return np.asarray(chebyshev.chebval(2 * _points() - 1, integrals).T @ _to_chebyshev())


@lru_cache(maxsize=1)
def _differentiation() -> Array:
    """Values of f at the points → values of df/dx at the points, on the unit interval."""
    slopes = 2 * chebyshev.chebder(np.eye(DEGREE + 1))
    return np.asarray(chebyshev.chebval(2 * _points() - 1, slopes).T @ _to_chebyshev())


@lru_cache(maxsize=1)
def _to_bernstein() -> Array:
    """Values at the points → Bernstein coefficients.

    Tₙ(2x−1) has the coefficients (−1)^{n−i} C(2n, 2i)/C(n, i) at its own degree; they are raised to
    the common one.
    """
    out = np.zeros((DEGREE + 1, DEGREE + 1))
    for n in range(DEGREE + 1):
        own = np.array([(-1.0) ** (n - i) * comb(2 * n, 2 * i) / comb(n, i) for i in range(n + 1)])
        out[:, n] = elevate(own, DEGREE)
    out = out @ _to_chebyshev()
    out[0], out[-1] = np.eye(DEGREE + 1)[[0, -1]]  # ends exact, so that pieces join
    return np.asarray(out)


WithSlope = Callable[[Array], tuple[Array, Array]]
"""From x (M,) to f(x) and f'(x), each (M,)."""

INSET = 1e-10
"""How far inside an open interval its ends are evaluated, relative to its width."""

_STEPS = 200


@dataclass(frozen=True)
class Preimage:
    """Where f(x) = value on the stretch.

    Attributes:
        x: The solution, shape (M,), or the nearest point of the stretch where there is none; NaN
            where f' has the wanted sign nowhere, and where the value is NaN.
        exists: Whether there is one.
        short_low: By how much the value lies below f at the interval's low end (on the scale
            sign·f), where that is why there is none; 0 elsewhere.
        short_high: The same above f at the high end.
        short_turn: The same beyond f at its turning point.
    """

    x: Array
    exists: NDArray[np.bool_]
    short_low: Array
    short_high: Array
    short_turn: Array


def inverse(function: WithSlope, value: Array, low: float, high: float, sign: float) -> Preimage:
    """Solve f(x) = value where sign·f' > 0 in the open interval (low, high).

    Args:
        function: f and f', with at most one turning point in the interval.
        value: Right-hand sides, shape (M,).
        low: Low end of the interval.
        high: High end.
        sign: 1 for the stretch where f rises, −1 where it falls.
    """
    inset = INSET * (high - low)
    a, b = np.full(value.shape, low + inset), np.full(value.shape, high - inset)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        (gap_a, at_a), (gap_b, at_b) = (_look(function, x, value, sign)[:2] for x in (a, b))
        under, over = at_a & (gap_a <= 0), at_b & (gap_b >= 0)
        none = (~at_a & ~at_b) | np.isnan(value)
        outside = none | (at_a & (gap_a > 0)) | (at_b & (gap_b < 0))
        x, under_seen, over_seen = _search(
            function, value, sign, (a, b), (at_a, at_b), (under, over), ~outside
        )
        exists = under_seen & over_seen & ~outside
        x = np.where(at_a & (gap_a > 0), a, np.where(at_b & (gap_b < 0), b, x))
        at_turn = ~exists & ~outside
        gap = sign * (function(x)[0] - value)
    return Preimage(
        x=np.where(none, np.nan, x),
        exists=exists,
        short_low=np.where(~none & at_a & (gap_a > 0), gap_a, 0.0),
        short_high=np.where(~none & at_b & (gap_b < 0), -gap_b, 0.0),
        short_turn=np.where(at_turn, np.abs(gap), 0.0),
    )


def _look(
    function: WithSlope, x: Array, value: Array, sign: float
) -> tuple[Array, NDArray[np.bool_], Array]:
    """sign·(f − value), whether x is on the stretch, and the Newton step's target."""
    f, slope = function(x)
    return sign * (f - value), sign * slope > 0, x - (f - value) / slope


def _search(
    function: WithSlope,
    value: Array,
    sign: float,
    bracket: tuple[Array, Array],
    on_stretch: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    seen: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    active: NDArray[np.bool_],
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """The bracketed iteration; also whether values under and over were met on the stretch."""
    (low, high), (under, over) = bracket, seen
    turn_is_high = on_stretch[0] & ~on_stretch[1]
    x, last = 0.5 * (low + high), high - low
    for _ in range(_STEPS):
        gap, on, newton = _look(function, x, value, sign)
        under, over = under | (on & (gap <= 0)), over | (on & (gap >= 0))
        too_far = np.where(on, gap > 0, turn_is_high)
        low, high = np.where(too_far, low, x), np.where(too_far, x, high)
        safe = on & (newton >= low) & (newton <= high) & (np.abs(newton - x) < 0.5 * np.abs(last))
        settled = active & safe & (np.abs(newton - x) <= 2e-16 * (1e-6 + np.abs(x)))
        under, over = under | settled, over | settled
        following = np.where(safe, newton, 0.5 * (low + high))
        active = active & ~(on & (np.abs(gap) <= 1e-16 * np.abs(value)))
        last, x = np.where(active, following - x, 0.0), np.where(active, following, x)
        active = active & (np.abs(last) > 2e-16 * (1e-6 + np.abs(x)))
        if not np.any(active):
            break
    return x, under, over
