"""Functions on many cells at once, each enclosed at points and on ellipses.

On each cell, τ in [−1, 1], a ball stands for every function f with

    |f(τ_k) − c_k| ≤ r_k               at the 16 Chebyshev points τ_k: `Points`
    |f(τ) − c − b τ| ≤ r               on the segment [−1, 1] itself (the ellipse of ρ = 1), and
    |f(z) − c − b z| ≤ r               for every complex z in the Bernstein ellipse of ρ, where f is
                                       analytic, for each of eight ρ: `Ellipses`

A `Ball` stores all triples (c, b, r) as columns of three arrays, with b = 0 at points, because each
operation has one formula for all columns. (Two sets of arrays take 1.1 to 1.8 times as long.)
f is real on the segment, so c and b are real. If r is infinite or NaN, f is unbounded there. The
points give the interpolant of f, and the ellipses bound its error (`models`): it is at most
4 r ρ⁻¹⁵/(ρ − 1), since c + b z is interpolated exactly.
Source: L. N. Trefethen, "Approximation Theory and Approximation Practice", 2013, theorem 8.2.

The same formula holds for every column. With R the greatest |z| of the column (zero at points),
f = c + d where |d| ≤ δ = |b| R + r, and a function g has g(f) = g(c) + g'(c) d + rest, so

    c' = g(c),   b' = g'(c) b,   r' = |g'(c)| r + rest(δ) + rounding

Each function states a bound of the rest for all complex |d| ≤ δ. We assume that NumPy's elementary
functions have errors of at most four units of rounding, which the tests check. δ is rounded up, and
every bound of a rest increases with δ, so it stays valid. A difference of two such floats is itself
rounded by at most one unit, so cancellation does not invalidate a bound either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, TypeVar

import numpy as np

from planner.support.arrays import Array
from planner.verification.models import (
    COEFFICIENT_SUM_BOUND,
    LEBESGUE_BOUND,
    POINTS,
    ROUNDING_FACTOR,
    ROUNDING_UNIT,
    Index,
    Model,
    evaluation,
    interpolation,
)

RHO = np.array([1.0, 1.6, 2.25, 3.15, 4.4, 6.2, 8.7, 12.2, 17.0])
"""Parameter ρ of the segment and of the ellipses. The smallest ellipse, 1.6, still bounds functions
on cells that are too wide for the others; at 17 the interpolation error is pure rounding."""

SEGMENT = POINTS
"""Index of the segment's column in a `Ball`; points are on its left, ellipses on its right."""

REAL_COLUMNS = np.arange(POINTS + len(RHO)) <= SEGMENT
"""Mask of the columns of a `Ball` on which its functions are real: the points and the segment."""


RADIUS = (RHO + 1 / RHO) / 2 * (1 + 8 * ROUNDING_UNIT)
"""Greatest |z|, called R, on the segment and in each ellipse, shape (9,)."""

SQUARE = (RHO**2 + RHO**-2) / 4 * (1 + 8 * ROUNDING_UNIT)
"""Bound of |z² − 1/2| on each ellipse: z = (w + 1/w)/2 has z² − 1/2 = (w² + w⁻²)/4, |w| ≤ ρ."""

RADIUS_COLUMN = np.append(np.zeros(POINTS), RADIUS)
SQUARE_COLUMN = np.append(np.zeros(POINTS), SQUARE)
HALF_COLUMN = np.append(np.zeros(POINTS), np.full(len(RHO), 0.5))
"""Values of R, of the bound of |z² − 1/2| and of 1/2 by column of a `Ball`; zero at points."""

REMAINDER_FACTOR = 4 * RHO[1:] ** (1 - POINTS) / (RHO[1:] - 1) * (1 + 64 * ROUNDING_UNIT)
"""Bound of the interpolation error of a function with radius r = 1, for each ellipse."""


class Points(NamedTuple):
    """Values c of functions at the 16 points of each of C cells, and their errors r, (C, 16)."""

    c: Array
    r: Array


class Ellipses(NamedTuple):
    """Centres c, slopes b and radii r on the segment and eight ellipses of C cells, (C, 9)."""

    c: Array
    b: Array
    r: Array

    @property
    def remainder(self) -> Array:
        """Bound of the error of interpolation at the 16 points, the least of all ellipses, (C,)."""
        return np.asarray(np.fmin.reduce(self.r[:, 1:] * REMAINDER_FACTOR, axis=1))

    def integral(self, half: Array, middle: Array, doubt: Array) -> Ellipses:
        """Return the ellipses of middle + half · ∫ (c + bz + e) dz from 0 to z, where |e| ≤ r.

        The integral is cz + bz²/2 + ∫ e, where z² = 1/2 + (z² − 1/2), and |∫ e| ≤ r R along the
        straight line from 0 to z.

        Args:
            half: Half the width of each cell, (C, 1).
            middle: Value of the integral in the middle of each cell, (C, 1).
            doubt: Error of `middle`, (C, 1).
        """
        c, b = middle + half * self.b / 4, half * self.c
        rest = half * (np.abs(self.b) * SQUARE / 2 + self.r * RADIUS)
        rest = rest + doubt + 4 * ROUNDING_UNIT * (np.abs(c) + np.abs(b) * RADIUS)
        return Ellipses(c, b, rest * ROUNDING_FACTOR)

    def lie_in(self, other: Ellipses) -> Index:
        """Return whether `other` encloses all functions of these ellipses, by column, (C, 9)."""
        gap = np.abs(self.c - other.c) + np.abs(self.b - other.b) * RADIUS + self.r
        return np.asarray(gap * ROUNDING_FACTOR <= other.r)


Triple = TypeVar("Triple", "Ball", Ellipses)


@dataclass(frozen=True, eq=False)
class Ball:
    """An enclosure of functions on C cells: centres c, slopes b and radii r, each (C, 25).

    The 25 columns are the 16 points, the segment and the eight ellipses."""

    c: Array
    b: Array
    r: Array

    @classmethod
    def constant(cls, value: float) -> Ball:
        """Return the ball of a constant, with arrays of shape (1, 1) that stand for all cells."""
        return cls(np.full((1, 1), value), np.zeros((1, 1)), np.zeros((1, 1)))

    @classmethod
    def join(cls, points: Points, ellipses: Ellipses) -> Ball:
        """Return the ball with the columns of `points` followed by the columns of `ellipses`."""
        left = points.c, np.zeros_like(points.c), points.r
        return cls(*map(np.hstack, zip(left, ellipses, strict=True)))

    def __iter__(self) -> Iterator[Array]:
        return iter((self.c, self.b, self.r))

    @cached_property
    def points(self) -> Points:
        """Values and errors at the 16 points."""
        return Points(self.c[:, :SEGMENT], self.r[:, :SEGMENT])

    @cached_property
    def ellipses(self) -> Ellipses:
        """Centres, slopes and radii on the segment and the ellipses."""
        return Ellipses(self.c[:, SEGMENT:], self.b[:, SEGMENT:], self.r[:, SEGMENT:])

    @property
    def number(self) -> float | None:
        """Value of the ball if it is an exact constant; else None."""
        return None if self.c.size > 1 or self.r[0, 0] else float(self.c[0, 0])

    @cached_property
    def size(self) -> Array:
        """Bound of |c + b z| in each column, shape (C, 25)."""
        return np.abs(self.c) + np.abs(self.b) * RADIUS_COLUMN

    @cached_property
    def reach(self) -> Array:
        """Bound δ of |f − c| in each column, shape (C, 25)."""
        return (np.abs(self.b) * RADIUS_COLUMN + self.r) * ROUNDING_FACTOR

    def replace_rows(self, rows: Index, fresh: Index, new: Ball) -> Ball:
        """Return the ball on the cells `rows`, with those in the mask `fresh` replaced by `new`."""
        out = [x[rows] for x in self]
        for part, other in zip(out, new, strict=True):
            part[fresh] = other
        return Ball(*out)

    # -- to real intervals ---------------------------------------------------------------------

    @property
    def relative_remainder(self) -> Array:
        """Bound of the interpolation error, relative to the function's size, shape (C,).

        The size is the largest |value| at the points, at least 1. The result is zero where the
        bound is below rounding errors, and infinite where there is none.
        """
        size = np.maximum(np.max(np.abs(self.points.c), axis=1), 1.0)
        remainder = self.ellipses.remainder
        rough = np.where(remainder <= np.max(self.points.r, axis=1), 0.0, remainder / size)
        return np.asarray(np.where(np.isnan(rough), np.inf, rough))

    @property
    def range(self) -> tuple[Array, Array]:
        """Lower and upper bound of the function over each cell, both (C,)."""
        c, reach = self.c[:, SEGMENT], self.reach[:, SEGMENT] * ROUNDING_FACTOR
        slip = ROUNDING_UNIT * np.abs(c)
        return c - reach - slip, c + reach + slip

    # -- arithmetic ----------------------------------------------------------------------------

    def __neg__(self) -> Ball:
        return Ball(-self.c, -self.b, self.r)

    def __add__(self, other: Ball | float) -> Ball:
        if not isinstance(other, Ball):
            c = self.c + other
            return Ball(c, self.b, (self.r + ROUNDING_UNIT * np.abs(c)) * ROUNDING_FACTOR)
        c, b = self.c + other.c, self.b + other.b
        r = self.r + other.r + ROUNDING_UNIT * (np.abs(c) + np.abs(b) * RADIUS_COLUMN)
        return Ball(c, b, r * ROUNDING_FACTOR)

    def __sub__(self, other: Ball | float) -> Ball:
        return self + (-other)

    def __mul__(self, other: Ball | float) -> Ball:
        """Return the ball of the product (c + bz + e)(c' + b'z + e').

        Its quadratic term is bb'z² = bb'/2 + bb'(z² − 1/2). Rounding adds three units of |cc'| +
        |bb'|/2 + R (|cb'| + |bc'|), at most the product of the sizes, as R² ≥ 1/2 except at points.
        """
        if not isinstance(other, Ball):
            return self.scaled(np.float64(other))
        bent = self.b * other.b
        c = self.c * other.c + bent * HALF_COLUMN
        b = self.c * other.b + self.b * other.c
        r = self.r * (other.size + other.r) + other.r * self.size + np.abs(bent) * SQUARE_COLUMN
        return Ball(c, b, (r + 3 * ROUNDING_UNIT * self.size * other.size) * ROUNDING_FACTOR)

    __radd__ = __add__
    __rmul__ = __mul__

    def scaled(self, factor: Array | np.float64) -> Ball:
        """Return the ball multiplied by a number, or by one number per cell, (C, 1)."""
        r = self.r + ROUNDING_UNIT * self.size
        return Ball(self.c * factor, self.b * factor, np.abs(factor) * r * ROUNDING_FACTOR)

    def widen(self, extra: Array) -> Ball:
        """Return the ball with radii increased by `extra`, shape (C, 1) or (C, 25)."""
        return Ball(self.c, self.b, (self.r + extra) * ROUNDING_FACTOR)


def choose(mask: Index, one: Triple, other: Triple) -> Triple:
    """Return the ball (or ellipses) of `one` where the mask is true, of `other` elsewhere."""
    return type(one)(*(np.where(mask, *pair) for pair in zip(one, other, strict=True)))


def _compose(p: Ball, value: Array, slope: Array, rest: Array) -> Ball:
    """Return the ball of a function g of p by the formula at the file's start.

    `value` is g(c), `slope` is g'(c), each wrong by up to 8 units of rounding; `rest` is the bound
    of g's rest.
    """
    steep = np.abs(slope)
    rounding = 8 * ROUNDING_UNIT * (np.abs(value) + steep * p.reach)
    return Ball(value, slope * p.b, (steep * p.r + rest + rounding) * ROUNDING_FACTOR)


# -- functions ---------------------------------------------------------------------------------


def sine_cosine(p: Ball) -> tuple[Ball, Ball]:
    """Return the balls of sin p and cos p.

    With c and δ as at the file's start, the rest of sin is |sin c| (cosh δ − 1) + |cos c| (sinh δ −
    δ); for the rest of cos, exchange sin c and cos c. By comparing terms, sinh δ − δ is at most
    δ (cosh δ − 1)/3; and cosh δ − 1 = 2 sinh²(δ/2).
    """
    s, c, reach = np.sin(p.c), np.cos(p.c), p.reach
    bow = 2 * np.sinh(reach / 2) ** 2
    third = bow * reach / 3
    size = np.abs(s), np.abs(c)
    slip = 4 * ROUNDING_UNIT * (1 + reach)  # also valid where sin or cos is nearly zero
    of_s = _compose(p, s, c, size[0] * bow + size[1] * third + slip)
    return of_s, _compose(p, c, -s, size[1] * bow + size[0] * third + slip)


def reciprocal(p: Ball) -> Ball:
    """Return the ball of 1/p, unbounded where p may be zero.

    With c, d and δ as at the file's start, the rest of 1/(c + d) is d²/(c² (c + d)) for |c| > δ.
    """
    value, gap = 1 / p.c, np.abs(p.c) - p.reach
    rest = np.where(gap > 0, (p.reach * value) ** 2 / gap, np.inf)
    return _compose(p, value, -value * value, rest)


def power(p: Ball, a: float) -> Ball:
    """Return the ball of p^a for a real number a.

    For integers 0 ≤ a ≤ 8 it is a product; for any other a it is unbounded where p may be ≤ 0. The
    rest is c^a |a(a − 1)|/2 t² max((1 − t)^{a−2}, (1 + t)^{a−2}) with t = δ/c (see the file's
    start), by Lagrange's bound, as |w^{a−2}| = |w|^{a−2} for real a.
    """
    if a == int(a) and 0 <= a <= 8:
        out = Ball.constant(1.0) if a == 0 else p
        for _ in range(int(a) - 1):
            out = out * p
        return out
    t = p.reach / p.c * ROUNDING_FACTOR
    value = np.abs(p.c) ** a
    most = np.maximum((1 - t) ** (a - 2), (1 + t) ** (a - 2)) * (1 + 2 * abs(a) * ROUNDING_UNIT)
    rest = np.where((p.c > 0) & (t < 1), value * (abs(a * (a - 1)) / 2) * t * t * most, np.inf)
    return _compose(p, value, a * value / p.c, rest)


def exponential(p: Ball) -> Ball:
    """Return the ball of e^p.

    With c and δ as at the file's start, the rest is e^c (e^δ − 1 − δ), and e^δ − 1 − δ is at most
    δ (e^δ − 1)/2, term by term. For large δ the bound is e^(c + δ), which stays small for very
    negative c even if e^δ overflows. A result that underflows is less than the least normal float.
    """
    value, reach = np.exp(p.c), p.reach
    near = value * reach * np.expm1(np.minimum(reach, 2.0)) / 2
    far = np.exp(p.c + reach + 2 * ROUNDING_UNIT * (np.abs(p.c) + reach)) * (1 + 8 * ROUNDING_UNIT)
    rest = np.where(reach <= 2.0, near, far) + np.finfo(float).tiny
    return _compose(p, value, value, rest)


def logarithm(p: Ball) -> Ball:
    """Return the ball of log p, unbounded where p may be ≤ 0.

    The rest is at most t²/(2 (1 − t)) with t = δ/c, for c and δ as at the file's start.
    """
    t = p.reach / p.c * ROUNDING_FACTOR
    rest = np.where((p.c > 0) & (t < 1), t * t / 2 / (1 - t), np.inf)
    return _compose(p, np.log(p.c), 1 / p.c, rest)


def arctangent(p: Ball) -> Ball:
    """Return the ball of arctan p, unbounded where p may reach the poles ±i.

    The distance of c from the poles is h = √(1 + c²), and δ is as at the file's start. The rest
    follows from |g''| = |2z/((z − i)² (z + i)²)| ≤ 2 (|c| + δ)/(h − δ)⁴.
    """
    square, reach = 1 + p.c * p.c, p.reach
    gap = np.sqrt(square) * (1 - 4 * ROUNDING_UNIT) - reach
    rest = np.where(gap > 0, reach**2 * (np.abs(p.c) + reach) / gap**4, np.inf)
    return _compose(p, np.arctan(p.c), 1 / square, rest)


def arcsine(p: Ball) -> Ball:
    """Return the ball of arcsin p, unbounded where |p| may reach 1.

    With c and δ as at the file's start, the rest follows from g'' = z (1 − z²)^{−3/2} and
    |1 − z²| ≥ (1 − |c| − δ)(1 + |c| − δ).
    """
    size, reach = np.abs(p.c), p.reach
    near = 1 - size - reach
    gap = near * (1 + size - reach)
    rest = np.where(near > 1e-6, reach**2 / 2 * (size + reach) / gap**1.5 * (1 + 1e-9), np.inf)
    slope = 1 / np.sqrt((1 - p.c) * (1 + p.c))
    return _compose(p, np.arcsin(p.c), slope, rest)


def arctangent2(y: Ball, x: Ball) -> Ball:
    """Return the ball of the angle of (x, y); unbounded unless y keeps its sign or x > 0 is proven.

    The angle is ±π/2 − arctan(x/y) where y keeps its sign, and arctan(y/x) where x > 0.
    """
    low = np.abs(y.c) - y.reach, x.c - x.reach
    upright = low[0] > np.maximum(low[1], 0.0)
    angle = arctangent(choose(upright, x, y) * reciprocal(choose(upright, y, x)))
    quarter = np.where(upright, np.copysign(np.pi / 2, y.c), 0.0)
    turned = angle.scaled(np.where(upright, -1.0, 1.0)) + Ball(quarter, 0 * quarter, 0 * quarter)
    slip = np.where(upright | (low[1] > 0), ROUNDING_UNIT, np.inf)  # π/2 itself is rounded
    return turned.widen(slip)


def polynomial_balls(c: Array, r: Array) -> list[Ball]:
    """Return the balls of k polynomials from Chebyshev coefficients c (k, C, width) on C cells.

    The errors of a polynomial's coefficients sum to at most r (k, C). On an ellipse |Tₖ| is at
    most (ρᵏ + ρ⁻ᵏ)/2. Values at points are sums of `width` terms with factors wrong by 4 units.
    """
    width = c.shape[2]
    size, most = np.abs(c), _chebyshev_bounds(width)
    slip = (width + 6) * ROUNDING_UNIT * np.sum(size, axis=2) + r
    centre, slope, radius = np.zeros((3, *r.shape, len(RADIUS_COLUMN)))
    centre[..., :SEGMENT] = c @ evaluation(width).T
    centre[..., SEGMENT:] = c[..., :1]
    if width > 1:
        slope[..., SEGMENT:] = c[..., 1:2]
    radius[..., :SEGMENT] = slip[..., None]
    rest = size[..., 2:] @ most[2:] + r[..., None] * most[-1]
    radius[..., SEGMENT:] = rest * (1 + 64 * ROUNDING_UNIT)
    return [Ball(*parts) for parts in zip(centre, slope, radius, strict=True)]


@lru_cache(maxsize=32)
def _chebyshev_bounds(width: int) -> Array:
    """Return bounds of |Tₖ|, k < width, on the segment and the ellipses, shape (width, 9)."""
    k = np.arange(width)[:, None]
    return np.asarray((RHO**k + RHO ** (-1.0 * k)) / 2)


def models(balls: Sequence[Ball], cells: int) -> list[Model]:
    """Convert balls to models: the interpolant at the points, with a bound of its remainder.

    On cells where the line c + b τ has the smaller bound r, it replaces the interpolant. The radii
    at the points count times Lebesgue's constant. Rounding adds less than 28 units times the sum of
    the sizes of 16 products, whose factors have errors of 4 units.
    """
    c, b, r = np.empty((3, len(balls), cells, len(RADIUS_COLUMN)))
    for i, ball in enumerate(balls):
        c[i], b[i], r[i] = ball
    v, line = c[:, :, :SEGMENT], r[:, :, SEGMENT]
    left_over = np.fmin.reduce(r[:, :, SEGMENT + 1 :] * REMAINDER_FACTOR, axis=2)
    wrong = LEBESGUE_BOUND * np.max(r[:, :, :SEGMENT], axis=2)
    rounding = 28 * ROUNDING_UNIT * COEFFICIENT_SUM_BOUND * np.max(np.abs(v), axis=2)
    rest = left_over + wrong + rounding
    out = v @ interpolation().T
    rough = ~(rest <= line)
    out[rough] = 0.0
    out[rough, 0], out[rough, 1] = c[rough, SEGMENT], b[rough, SEGMENT]
    rest = np.where(rough, line, rest) * ROUNDING_FACTOR
    unknown = ~np.isfinite(rest)
    out[unknown], rest[unknown] = 0.0, np.inf
    return [Model(*pair) for pair in zip(out, rest, strict=True)]


def _sign(p: Ball) -> Array:
    """Return the sign of a ball's functions over each cell, shape (C, 1); 0 if it may change."""
    k = min(SEGMENT, p.c.shape[1] - 1)  # constants have one column
    c, reach = p.c[:, [k]], p.reach[:, [k]]
    return np.asarray(np.where(np.abs(c) > reach, np.sign(c), 0.0))


def absolute(p: Ball) -> Ball:
    """Return the ball of |p|: ±p where the sign of p is known.

    Elsewhere |p| lies in [0, |c| + δ] on real columns, and is unbounded on the ellipses.
    """
    sign, half = _sign(p), np.where(REAL_COLUMNS, (np.abs(p.c) + p.reach) / 2, np.inf)
    c = np.where(sign == 0, half, p.c * sign)
    return Ball(c, p.b * sign, np.where(sign == 0, half * (1 + 4 * ROUNDING_UNIT), p.r))


def signum(p: Ball) -> Ball:
    """Return the ball of the sign of p: ±1 where it is known.

    Elsewhere it lies in [−1, 1] on real columns, and is unbounded on the ellipses.
    """
    sign = _sign(p) + 0.0 * p.c
    doubt = np.where(sign == 0, np.where(REAL_COLUMNS, 1.0, np.inf), 0.0)
    return Ball(sign, np.zeros_like(sign), doubt)
