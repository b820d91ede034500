"""Subintervals of the motion, and piecewise polynomials on them.

The least value of many functions over many cells: bounds from both sides.

On a cell whose Chebyshev coefficients show that the polynomial p rises, falls or bends downwards
all over, the least value is at an end. Where p'' ≥ m > 0 all over, a parabola from below says

    p(x) ≥ p(y) − p'(y)²/(2m)   for any y; Newton's step makes p'(y) all but zero,

and a slope that points out of the cell at an end does not count. Cells that may hold the least
value and are none of these are halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import BPoly

from planner.plan.curves import Cells
from planner.support import deadline
from planner.support.arrays import Array
from planner.verification import affine_models
from planner.verification.affine_models import INFLATE, POINTS, UNIT, Index, Model
from planner.verification.balls import Ball, polynomial_balls


def joined_models(parts: Sequence[Model]) -> Model:
    """The models of several groups of cells as one."""
    width = max(p.c.shape[1] for p in parts)
    c = np.concatenate([np.pad(p.c, ((0, 0), (0, width - p.c.shape[1]))) for p in parts])
    return Model(c, np.concatenate([p.r for p in parts]))


def polynomials(curve: BPoly, cells: Cells, order: int = 0) -> list[Model]:
    """The components of a piecewise polynomial with values (k,), or of a scalar one, or of a
    derivative of it in time."""
    return [Model(*pair) for pair in zip(*_restricted(curve, cells, order), strict=True)]


def on(curve: BPoly, cells: Cells, order: int = 0) -> list[Ball]:
    """Piecewise polynomials on the cells as balls."""
    return polynomial_balls(*_restricted(curve, cells, order))


def derivative(curve: BPoly, order: int) -> tuple[Array, Array]:
    """Bernstein coefficients (d+1, P, k) of a derivative, and what rounding did to them (P, k)."""
    c = curve.c.reshape(*curve.c.shape[:2], -1)
    width, size = np.diff(curve.x)[:, None], np.max(np.abs(c), axis=0)
    for _ in range(order):
        degree = len(c) - 1
        size = 2 * degree * size / width
        c = degree * np.diff(c, axis=0) / width if degree else np.zeros_like(c)
    return c, 6 * order * UNIT * size


def refined(curve: BPoly, breaks: Array) -> BPoly:
    """The same curve on more pieces, to rounding; every break of the curve is one of `breaks`."""
    if np.array_equal(curve.x, breaks):
        return curve
    k = np.searchsorted(curve.x, (breaks[:-1] + breaks[1:]) / 2) - 1
    low, high = ((x - curve.x[k]) / np.diff(curve.x)[k] for x in (breaks[:-1], breaks[1:]))
    return BPoly(_part(curve.c.transpose(2, 1, 0)[:, k], low, high).transpose(2, 1, 0), breaks)


def _restricted(curve: BPoly, cells: Cells, order: int) -> tuple[Array, Array]:
    """Chebyshev coefficients (k, C, d+1) on the cells, wrong by no more than (k, C) together."""
    c, slip = derivative(curve, order)
    c = c.transpose(2, 1, 0)[:, cells.piece]
    size, degree = np.max(np.abs(c), axis=2), c.shape[2] - 1
    slips = slip.T[:, cells.piece]
    if degree == 0:
        return c, slips
    whole = np.all(cells.size == 1)
    if not whole:
        c = _part(c, cells.low, cells.low + cells.size)
    matrix = affine_models.from_bernstein(degree + 1)
    steps = degree + 4 + (0 if whole else 8 * degree)
    return c @ matrix.T, steps * np.sum(np.abs(matrix)) * UNIT * size + slips * INFLATE


def _part(c: Array, low: Array, high: Array) -> Array:
    """Coefficients (k, C, d+1) on [low, high], each (C,), of those on [0, 1]."""
    c = _left_of(c, high[:, None])
    return _left_of(c[:, :, ::-1], 1 - (low / high)[:, None])[:, :, ::-1]


def _left_of(c: Array, at: Array) -> Array:
    """Coefficients (…, C, d+1) on [0, at] of those on [0, 1], by de Casteljau; at is (C, 1)."""
    out, row, rest = [c[..., :1]], c, 1 - at
    for _ in range(c.shape[-1] - 1):
        row = rest * row[..., :-1] + at * row[..., 1:]
        out.append(row[..., :1])
    return np.concatenate(out, axis=-1)


MOST_HALVINGS = 40
RESOLVED = 1e-9
"""Distance of the two bounds at which halving stops, over the function's scale."""

NEWTON = 4
"""Steps from the least of the 16 points: more than enough for rounding where p'' > 0."""

Margin = tuple[float, Model, float]
"""(sign, value, limit): the function sign · value + limit."""


@dataclass(frozen=True)
class Least:
    """The least value of one function over all cells.

    Attributes:
        guaranteed: The function is nowhere less.
        attained: It is no greater than this at `time_s`.
        time_s: Seconds.
    """

    guaranteed: float
    attained: float
    time_s: float


def least(functions: list[Margin], cells: Cells, scales: Array) -> list[Least]:
    """Bounds on the least value of each function.

    Args:
        functions: Their values are models on the cells.
        cells: Where.
        scales: What each function's values are compared with, shape (F,).
    """
    count, number = len(functions), len(cells.piece)
    c: Array = np.zeros((count * number, POINTS))
    for i, (sign, f, limit) in enumerate(functions):
        rows = slice(i * number, (i + 1) * number)
        c[rows, : f.c.shape[1]] = sign * f.c
        c[rows, 0] += limit
    r = np.concatenate([f.r for _, f, _ in functions])
    c[~np.isfinite(r)] = 0.0
    r = r + 6 * POINTS * UNIT * np.sum(np.abs(c), axis=1)
    which, cell = np.divmod(np.arange(count * number), number)
    low, size = np.full(len(r), -1.0), 2.0
    best, closed = np.full(count, np.inf), np.full(count, np.inf)
    place = np.zeros((count, 2))  # cell and τ of the best

    def keep(value: Array, at: Array, rows: Index) -> None:
        """Of some rows, what they attain."""
        order = np.lexsort((value, which[rows]))
        own = which[rows][order]
        new = order[np.append(True, own[1:] != own[:-1])]
        new = new[value[new] < best[which[rows][new]]]
        row = rows[new]
        best[which[row]] = value[new]
        place[which[row]] = np.stack([cell[row], low[row] + size * (at[new] + 1) / 2], axis=1)

    for step in range(MOST_HALVINGS + 1):
        deadline.check_stopped()
        slope = np.sum(c[:, 1::2], axis=1)
        keep(np.sum(c[:, ::2], axis=1) - np.abs(slope) + r, np.sign(-slope), np.arange(len(r)))
        bound = c[:, 0] - np.sum(np.abs(c[:, 1:]), axis=1) - r
        open_ = (bound < (best - RESOLVED * scales)[which]) & (bound + 2 * r < best[which])
        halve = np.flatnonzero(open_ & np.isfinite(r))
        if len(halve):
            settled, value, at, under = _bent(c[halve])
            keep(value + r[halve], at, halve)
            bound[halve[settled]] = under[settled] - r[halve[settled]]
            halve = halve[~settled & (step < MOST_HALVINGS)]
            halve = halve[bound[halve] < (best - RESOLVED * scales)[which[halve]]]
        np.minimum.at(closed, np.delete(which, halve), np.delete(bound, halve))
        if not len(halve):
            break
        c, r = halved(c[halve], r[halve])
        which, cell, low = (np.tile(x[halve], 2) for x in (which, cell, low))
        size /= 2
        low[len(halve) :] += size
    some = cells.only(place[:, 0].astype(int)).times(place[:, 1:])[:, 0]
    times = np.where(np.isfinite(best), some, np.nan)
    return [Least(float(closed[k]), float(best[k]), float(times[k])) for k in range(count)]


def _bent(c: Array) -> tuple[Index, Array, Array, Array]:
    """Of each row: whether it is one of the cases above; a value, its place, and a lower bound.

    All sums are wrong by at most (POINTS + 4) units of the sums of their terms' sizes; those of
    p'(y) and p(y), with Tₖ(y) = cos kθ, by 6 POINTS units, for p already in the row's remainder.
    """
    size, k = np.abs(c), np.arange(POINTS)
    d, dd = (c @ affine_models.slopes(POINTS, n).T for n in (1, 2))
    slip, slips = (6 * POINTS * UNIT * (size @ k**n) for n in (2, 4))
    swing, bend = (np.sum(np.abs(x[:, 1:]), axis=1) for x in (d, dd))
    hollow = dd[:, 0] - bend - slips
    hollowed = hollow > 0
    settled = hollowed | (dd[:, 0] + bend + slips < 0) | (np.abs(d[:, 0]) > swing + slip)
    odd = np.sum(c[:, 1::2], axis=1)
    theta = np.where(odd > 0, np.pi, 0.0)
    if np.any(hollowed):
        start = np.arccos(affine_models.nodes())[
            np.argmin(c @ affine_models.evaluation(POINTS).T, axis=1)
        ]
        theta = np.where(hollowed, start, theta)
        for _ in range(NEWTON):
            t = np.cos(theta[:, None] * k)
            step = np.sum(d * t, axis=1) / np.sum(dd * t, axis=1)
            theta = np.where(hollowed, np.arccos(np.clip(t[:, 1] - step, -1.0, 1.0)), theta)
    t = np.cos(theta[:, None] * k)
    value, slope = np.sum(c * t, axis=1), np.sum(d * t, axis=1)
    inward = np.where(theta == 0, slope, np.where(theta == np.pi, -slope, np.abs(slope)))
    steep = np.maximum(inward, 0.0) + slip
    under = value - np.where(hollowed, steep**2 / 2 / np.where(hollowed, hollow, 1.0), 0.0)
    return settled, value, t[:, 1], under


def halved(c: Array, r: Array) -> tuple[Array, Array]:
    """Left halves, then right halves."""
    left, right, sums = _halves()
    r = (r + (POINTS + 8) * UNIT * (np.abs(c) @ sums)) * INFLATE
    return np.concatenate([c @ left.T, c @ right.T]), np.tile(r, 2)


@lru_cache(maxsize=1)
def _halves() -> tuple[Array, Array, Array]:
    """Coefficients to those on the halves of the cell, and the sums of their columns' sizes."""
    nodes, back = affine_models.nodes(), affine_models.interpolation()
    parts = [back @ chebyshev.chebvander((nodes + s) / 2, POINTS - 1) for s in (-1, 1)]
    return parts[0], parts[1], np.max([np.sum(np.abs(m), axis=0) for m in parts], axis=0)
