"""Subintervals of the motion, and piecewise polynomials as models on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from planner.certificate import series
from planner.certificate.model import UNIT, Index, Model
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

    def order(self) -> Index:
        """Indices that sort them by time."""
        return np.asarray(np.lexsort((self.low, self.piece)))

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


def polynomials(curve: BPoly, cells: Cells) -> list[Model]:
    """The components of a piecewise polynomial with values (k,), or of a scalar one."""
    c = curve.c.reshape(*curve.c.shape[:2], -1)
    return [_restricted(c[:, :, i].T[cells.piece], cells) for i in range(c.shape[2])]


def slopes(curve: BPoly, cells: Cells, order: int = 1) -> list[Model]:
    """The same of a derivative in time."""
    derived, rounding = derivative(curve, order)
    models = polynomials(derived, cells)
    return [m.widened(rounding[cells.piece, i]) for i, m in enumerate(models)]


def derivative(curve: BPoly, order: int) -> tuple[BPoly, Array]:
    """A derivative of a piecewise polynomial, and what rounding may have done to it (P, k)."""
    c = curve.c.reshape(*curve.c.shape[:2], -1)
    width, size = np.diff(curve.x)[:, None], np.max(np.abs(c), axis=0)
    for _ in range(order):
        degree = len(c) - 1
        size = 2 * degree * size / width
        c = degree * np.diff(c, axis=0) / width if degree else np.zeros_like(c)
    return BPoly(c, curve.x), 6 * order * UNIT * size


def _restricted(c: Array, cells: Cells) -> Model:
    """Bernstein coefficients (C, d+1) on whole pieces as models on the cells."""
    size = np.max(np.abs(c), axis=1)
    whole = np.all((cells.low == 0) & (cells.high == 1))
    degree = c.shape[1] - 1
    if not whole:
        c = _left_of(c, cells.high[:, None])
        c = _left_of(c[:, ::-1], 1 - (cells.low / cells.high)[:, None])[:, ::-1]
    if degree == 0:
        return Model(c, np.zeros(len(c)))
    matrix = series.from_bernstein(degree + 1)
    steps = degree + 4 + (0 if whole else 8 * degree)
    return Model.cut(c @ matrix.T, steps * np.sum(np.abs(matrix)) * UNIT * size)


def _left_of(c: Array, at: Array) -> Array:
    """Coefficients on [0, at] of those on [0, 1], by de Casteljau; at is (C, 1)."""
    out, row = [c[:, :1]], c
    for _ in range(c.shape[1] - 1):
        row = (1 - at) * row[:, :-1] + at * row[:, 1:]
        out.append(row[:, :1])
    return np.concatenate(out, axis=1)
