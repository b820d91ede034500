"""Subintervals of the motion, and piecewise polynomials on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from planner.certificate import series
from planner.certificate.balls import Ball, polynomial_balls
from planner.certificate.model import INFLATE, UNIT, Index, Model
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Cells:
    """Parts [low, high] of pieces, as fractions of the piece that floats hold exactly.

    Attributes:
        breaks: Times between the pieces, shape (P+1,), seconds.
        piece: Piece numbers, shape (C,).
        low: Shape (C,).
        high: Shape (C,).
    """

    breaks: Array
    piece: Index
    low: Array
    high: Array

    @classmethod
    def of(cls, breaks: Array) -> Cells:
        """Every piece, whole."""
        count = len(breaks) - 1
        return cls(breaks, np.arange(count), np.zeros(count), np.ones(count))

    @property
    def width(self) -> Array:
        """Seconds, shape (C,), to a rounding."""
        return np.asarray(np.diff(self.breaks)[self.piece] * (self.high - self.low))

    def times(self, tau: Array) -> Array:
        """Times (C, M) at places tau (M,) in [−1, 1] of each cell, or at one of each (C, 1)."""
        whole = np.diff(self.breaks)[self.piece, None]
        fraction = self.low[:, None] + (self.high - self.low)[:, None] * (tau + 1) / 2
        return np.asarray(self.breaks[self.piece, None] + whole * fraction)

    def only(self, which: Index) -> Cells:
        """Some of them, by index or mask."""
        return Cells(self.breaks, self.piece[which], self.low[which], self.high[which])

    def halved(self) -> Cells:
        """The left halves of all, then the right halves."""
        middle = (self.low + self.high) / 2
        low, high = np.append(self.low, middle), np.append(middle, self.high)
        return Cells(self.breaks, np.tile(self.piece, 2), low, high)

    def split(self, parts: Index) -> tuple[Cells, Index]:
        """Each in so many equal parts (a power of two), and which cell each came from."""
        origin = np.repeat(np.arange(len(parts)), parts)
        place = np.arange(len(origin)) - np.repeat(np.cumsum(parts) - parts, parts)
        share = ((self.high - self.low) / parts)[origin]
        low = self.low[origin] + share * place
        return Cells(self.breaks, self.piece[origin], low, low + share), origin

    def joints(self) -> Index:
        """Indices k of cells (but the last) after which another piece begins."""
        return np.asarray(np.flatnonzero(np.diff(self.piece)))


def joined(parts: Sequence[Cells]) -> Cells:
    """All of several groups."""
    columns = [np.concatenate([getattr(p, n) for p in parts]) for n in ("piece", "low", "high")]
    return Cells(parts[0].breaks, *columns)


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
    """The same as balls."""
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
    whole = np.all((cells.low == 0) & (cells.high == 1))
    if not whole:
        c = _part(c, cells.low, cells.high)
    matrix = series.from_bernstein(degree + 1)
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
