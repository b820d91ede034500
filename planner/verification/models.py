"""Functions on many cells at once, each given by a polynomial and a proven remainder.

A model stands for every function f with |f(τ) − Σ cₖ Tₖ(τ)| ≤ r on each cell, τ in [−1, 1]. Balls
are converted to models to bound their least value; r includes truncation and rounding. Sources:
M. Joldes, "Rigorous polynomial approximations and applications", 2011 (Chebyshev models);
K. Makino, M. Berz, "Taylor models and other validated functional inclusion methods", 2003.

The file also has the matrices of such polynomials on [−1, 1], each computed once, and bounds from
both sides on the least value of many functions over many cells. If the coefficients show that the
polynomial p is monotonic or concave on a cell, its least value is at an end. If p'' ≥ m > 0 on the
whole cell, then

    p(x) ≥ p(y) − p'(y)²/(2m)   for any y; a Newton step makes p'(y) nearly zero,

where at an end y of the cell p'(y) counts only if p decreases into the cell. Other cells that may
contain the least value are halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from planner.plan.curves import Cells
from planner.support import deadline
from planner.support.arrays import Array

ROUNDING_UNIT = 1.2e-16
"""Unit of rounding, 2⁻⁵³, slightly enlarged so that rounding of the bounds is covered too."""

Index = NDArray[Any]
"""Array of indices, or a mask, that selects cells."""

ROUNDING_FACTOR = 1 + 1e-14
"""Factor on remainders that covers rounding in the few positive terms of their sums."""


@dataclass(frozen=True, eq=False)
class Model:
    """A function on C cells as polynomials with bounds of the remainders.

    Attributes:
        c: Chebyshev coefficients, shape (C, width), width ≤ `POINTS`.
        r: Remainders, shape (C,), ≥ 0; infinite where the function is unbounded.
    """

    c: Array
    r: Array

    @classmethod
    def truncate(cls, c: Array, r: Array) -> Model:
        """Make a model of c (C, any width); coefficients beyond `POINTS` enlarge remainder r."""
        r = np.asarray((r + np.sum(np.abs(c[:, POINTS:]), axis=1)) * ROUNDING_FACTOR)
        bad = ~np.isfinite(r)
        if np.any(bad):
            c, r = np.where(bad[:, None], 0.0, c), np.where(bad, np.inf, r)
        return cls(c[:, :POINTS], r)

    @cached_property
    def norm(self) -> Array:
        """Upper bound Σ|cₖ| of the polynomial's magnitude on each cell, shape (C,)."""
        return np.asarray(np.sum(np.abs(self.c), axis=1))

    @cached_property
    def deviation(self) -> Array:
        """Upper bound of the distance of the function from c₀ on each cell, shape (C,)."""
        inner = np.sum(np.abs(self.c[:, 1:]), axis=1)
        return np.asarray((inner + self.r + 4 * ROUNDING_UNIT * self.norm) * ROUNDING_FACTOR)

    @property
    def low(self) -> Array:
        """Lower bound of the function on each cell, shape (C,)."""
        return np.asarray(self.c[:, 0] - self.deviation)

    @property
    def high(self) -> Array:
        """Upper bound of the function on each cell, shape (C,)."""
        return np.asarray(self.c[:, 0] + self.deviation)

    @property
    def size(self) -> Array:
        """Upper bound of the function's magnitude on each cell, shape (C,)."""
        return np.asarray((self.norm + self.r) * ROUNDING_FACTOR)

    def select(self, cells: Index) -> Model:
        """Return the model on some of the cells, selected by indices or a mask."""
        return Model(self.c[cells], self.r[cells])

    # -- arithmetic ----------------------------------------------------------------------------

    def __neg__(self) -> Model:
        return Model(-self.c, self.r)

    def __add__(self, other: Model | float) -> Model:
        if not isinstance(other, Model):
            other = Model(np.full((len(self.c), 1), other), np.zeros(len(self.c)))
        long, short = (self, other) if self.c.shape[1] >= other.c.shape[1] else (other, self)
        c = long.c.copy()
        c[:, : short.c.shape[1]] += short.c
        return Model.truncate(c, self.r + other.r + ROUNDING_UNIT * np.sum(np.abs(c), axis=1))

    def __sub__(self, other: Model | float) -> Model:
        return self + (-other)

    def scaled(self, k: Array) -> Model:
        """Return the model multiplied by one number per cell, k (C,)."""
        c = self.c * k[:, None]
        return Model.truncate(c, np.abs(k) * self.r + ROUNDING_UNIT * np.sum(np.abs(c), axis=1))

    def at_begin(self) -> tuple[Array, Array]:
        """Return value and error bound of the function at the left end of each cell, both (C,)."""
        signs = np.where(np.arange(self.c.shape[1]) % 2 == 0, 1.0, -1.0)
        return Model(self.c * signs, self.r).at_end()

    def at_end(self) -> tuple[Array, Array]:
        """Return value and error bound of the function at the right end of each cell, both (C,)."""
        rounding = self.c.shape[1] * ROUNDING_UNIT * self.norm
        return np.sum(self.c, axis=1), np.asarray((self.r + rounding) * ROUNDING_FACTOR)


POINTS = 16
"""Number of Chebyshev points of a cell, and largest number of a model's coefficients."""


def _cosines(m: NDArray[np.int_]) -> Array:
    """Return cos(π m/(2 POINTS)) for integers m, with errors of at most 4 rounding units.

    The angle is first reduced to the first quadrant.
    """
    m = m % (4 * POINTS)
    m = np.minimum(m, 4 * POINTS - m)
    near = np.cos(np.pi / (2 * POINTS) * np.minimum(m, 2 * POINTS - m))
    return np.asarray(np.where(m == POINTS, 0.0, np.where(m > POINTS, -near, near)))


@lru_cache(maxsize=1)
def nodes() -> Array:
    """Return the Chebyshev points of the first kind in [−1, 1], increasing, shape (POINTS,)."""
    return evaluation(2)[:, 1]


@lru_cache(maxsize=64)
def evaluation(width: int) -> Array:
    """Return the matrix, (POINTS, width), from Chebyshev coefficients to values at the nodes."""
    return _cosines(np.outer(2 * np.arange(POINTS)[::-1] + 1, np.arange(width)))


@lru_cache(maxsize=1)
def interpolation() -> Array:
    """Return the matrix, (POINTS, POINTS), from values at the nodes to Chebyshev coefficients."""
    out = evaluation(POINTS).T * (2 / POINTS)
    out[0] /= 2
    return out


@lru_cache(maxsize=1)
def integration() -> Array:
    """Return the matrix from values at the nodes to integrals from −1 to each node, to 0 and to 1.

    Its shape is (POINTS+2, POINTS), and ∫ Tₖ = (Tₖ₊₁/(k+1) − Tₖ₋₁/(k−1))/2.
    """
    whole = chebyshev.chebint(np.eye(POINTS), lbnd=-1)
    ends = chebyshev.chebvander(np.array([0.0, 1.0]), POINTS)
    return np.asarray(np.vstack([evaluation(POINTS + 1), ends]) @ whole @ interpolation())


@lru_cache(maxsize=32)
def slopes(width: int, order: int) -> Array:
    """Return the matrix, (width, width), from Chebyshev coefficients to those of a derivative."""
    out = np.zeros((width, width))
    out[: max(width - order, 1)] = chebyshev.chebder(np.eye(width), order)
    return out


COEFFICIENT_SUM_BOUND = float(np.sum(np.abs(interpolation()))) * (1 + 1e-12)
"""Largest ratio of an interpolant's sum of |coefficients| to its greatest value at the nodes."""

_ANGLES = np.pi / (4 * POINTS) * (2 * np.arange(POINTS) + 1)
LEBESGUE_BOUND = float(np.sum(1 / np.tan(_ANGLES))) / POINTS * (1 + 1e-12)
"""An interpolant is at most this times the greatest value at the nodes (Lebesgue's constant)."""

INTEGRAL_BOUND = float(np.max(np.sum(np.abs(integration()), axis=1))) * (1 + 1e-12)
"""Largest ratio of an interpolant's integral from −1 to its greatest value at the nodes."""


# -- the least value -----------------------------------------------------------------------------

MOST_HALVINGS = 40
BOUND_TOLERANCE = 1e-9
"""Difference of the two bounds, as a fraction of the function's scale, at which halving stops."""

NEWTON_STEPS = 4
"""Number of Newton steps from the lowest of the 16 points, enough for rounding accuracy."""

Margin = tuple[float, Model, float]
"""A function sign · value + limit, given as (sign, value, limit)."""


@dataclass(frozen=True)
class LeastValue:
    """The least value of one function over all cells.

    Attributes:
        guaranteed: Lower bound of the function.
        attained: Upper bound of the function's value at `time_s`.
        time_s: A time at which the function is near its least value, s.
    """

    guaranteed: float
    attained: float
    time_s: float


def least_values(functions: list[Margin], cells: Cells, scales: Array) -> list[LeastValue]:
    """Bound the least value of each of F functions over all cells from both sides.

    Args:
        functions: The functions, whose values are models on the cells.
        cells: The cells.
        scales: Scale of each function's values, shape (F,).
    """
    count, number = len(functions), len(cells.piece)
    c: Array = np.zeros((count * number, POINTS))
    for i, (sign, f, limit) in enumerate(functions):
        rows = slice(i * number, (i + 1) * number)
        c[rows, : f.c.shape[1]] = sign * f.c
        c[rows, 0] += limit
    r = np.concatenate([f.r for _, f, _ in functions])
    c[~np.isfinite(r)] = 0.0
    r = r + 6 * POINTS * ROUNDING_UNIT * np.sum(np.abs(c), axis=1)
    which, cell = np.divmod(np.arange(count * number), number)
    low, size = np.full(len(r), -1.0), 2.0
    best, closed = np.full(count, np.inf), np.full(count, np.inf)
    place = np.zeros((count, 2))  # cell and τ of the best

    def keep(value: Array, tau: Array, rows: Index) -> None:
        """Record values, attained at `tau` in cells `rows`, below their function's least so far."""
        order = np.lexsort((value, which[rows]))
        functions_of_rows = which[rows][order]
        new = order[np.append(True, functions_of_rows[1:] != functions_of_rows[:-1])]
        new = new[value[new] < best[which[rows][new]]]
        row = rows[new]
        best[which[row]] = value[new]
        place[which[row]] = np.stack([cell[row], low[row] + size * (tau[new] + 1) / 2], axis=1)

    for step in range(MOST_HALVINGS + 1):
        deadline.check_stopped()
        slope = np.sum(c[:, 1::2], axis=1)
        keep(np.sum(c[:, ::2], axis=1) - np.abs(slope) + r, np.sign(-slope), np.arange(len(r)))
        bound = c[:, 0] - np.sum(np.abs(c[:, 1:]), axis=1) - r
        open_ = (bound < (best - BOUND_TOLERANCE * scales)[which]) & (bound + 2 * r < best[which])
        halve = np.flatnonzero(open_ & np.isfinite(r))
        if len(halve):
            settled, value, tau, under = _curved_bounds(c[halve])
            keep(value + r[halve], tau, halve)
            bound[halve[settled]] = under[settled] - r[halve[settled]]
            halve = halve[~settled & (step < MOST_HALVINGS)]
            halve = halve[bound[halve] < (best - BOUND_TOLERANCE * scales)[which[halve]]]
        np.minimum.at(closed, np.delete(which, halve), np.delete(bound, halve))
        if not len(halve):
            break
        c, r = halves(c[halve], r[halve])
        which, cell, low = (np.tile(x[halve], 2) for x in (which, cell, low))
        size /= 2
        low[len(halve) :] += size
    some = cells.select(place[:, 0].astype(int)).times(place[:, 1:])[:, 0]
    times = np.where(np.isfinite(best), some, np.nan)
    return [LeastValue(float(closed[k]), float(best[k]), float(times[k])) for k in range(count)]


def _curved_bounds(c: Array) -> tuple[Index, Array, Array, Array]:
    """Bound the polynomial p of each row of coefficients by its first two derivatives.

    Returns:
        For each row: whether p is proven monotonic, concave or convex; a value of p; its position
        τ; and a lower bound of p, which is valid only for a proven row.

    All sums have errors of at most (POINTS + 4) units of the sum of their terms' magnitudes; the
    sums for p'(y) and p(y), with Tₖ(y) = cos kθ, have 6 POINTS units, which the remainder of the
    row already includes for p.
    """
    size, k = np.abs(c), np.arange(POINTS)
    d, dd = (c @ slopes(POINTS, n).T for n in (1, 2))
    slip, slips = (6 * POINTS * ROUNDING_UNIT * (size @ k**n) for n in (2, 4))
    swing, bend = (np.sum(np.abs(x[:, 1:]), axis=1) for x in (d, dd))
    hollow = dd[:, 0] - bend - slips
    hollowed = hollow > 0
    settled = hollowed | (dd[:, 0] + bend + slips < 0) | (np.abs(d[:, 0]) > swing + slip)
    theta = np.where(np.sum(c[:, 1::2], axis=1) > 0, np.pi, 0.0)
    if np.any(hollowed):
        start = np.arccos(nodes())[np.argmin(c @ evaluation(POINTS).T, axis=1)]
        theta = np.where(hollowed, start, theta)
        for _ in range(NEWTON_STEPS):
            t = np.cos(theta[:, None] * k)
            step = np.sum(d * t, axis=1) / np.sum(dd * t, axis=1)
            theta = np.where(hollowed, np.arccos(np.clip(t[:, 1] - step, -1.0, 1.0)), theta)
    t = np.cos(theta[:, None] * k)
    value, slope = np.sum(c * t, axis=1), np.sum(d * t, axis=1)
    inward = np.where(theta == 0, slope, np.where(theta == np.pi, -slope, np.abs(slope)))
    steep = np.maximum(inward, 0.0) + slip
    lowest = value - np.where(hollowed, steep**2 / 2 / np.where(hollowed, hollow, 1.0), 0.0)
    return settled, value, t[:, 1], lowest


def halves(c: Array, r: Array) -> tuple[Array, Array]:
    """Return c and r of the same functions on the left halves of all cells, then the right ones."""
    left, right, sums = _halving_matrices()
    r = (r + (POINTS + 8) * ROUNDING_UNIT * (np.abs(c) @ sums)) * ROUNDING_FACTOR
    return np.concatenate([c @ left.T, c @ right.T]), np.tile(r, 2)


@lru_cache(maxsize=1)
def _halving_matrices() -> tuple[Array, Array, Array]:
    """Return the matrices from a cell's coefficients to those of its left and of its right half.

    The third array bounds the sum of magnitudes in each column of both matrices.
    """
    parts = [interpolation() @ chebyshev.chebvander((nodes() + s) / 2, POINTS - 1) for s in (-1, 1)]
    return parts[0], parts[1], np.max([np.sum(np.abs(m), axis=0) for m in parts], axis=0)


def join_models(parts: Sequence[Model]) -> Model:
    """Join models on several groups of cells into one model on all cells, in order."""
    width = max(p.c.shape[1] for p in parts)
    c = np.concatenate([np.pad(p.c, ((0, 0), (0, width - p.c.shape[1]))) for p in parts])
    return Model(c, np.concatenate([p.r for p in parts]))
