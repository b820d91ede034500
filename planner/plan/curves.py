"""Subdivision of a curve's pieces, and checks on curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, Pieces


@dataclass(frozen=True, eq=False)
class Cells:
    """Subintervals (cells) of a trajectory's pieces, which floats represent exactly as fractions.

    Attributes:
        breaks: Times of the breaks between the pieces, shape (K+1,), seconds.
        piece: Index of the piece that each cell belongs to, shape (C,).
        low: Start of the cell, as a fraction of its piece, shape (C,).
        size: Width of the cell, as a fraction of its piece, shape (C,).
    """

    breaks: Array
    piece: Pieces
    low: Array
    size: Array

    @classmethod
    def of(cls, breaks: Array) -> Cells:
        """Return one cell per piece; pieces of zero duration are left out."""
        piece = np.flatnonzero(np.diff(breaks) > 0)
        return cls(breaks, piece, np.zeros(len(piece)), np.ones(len(piece)))

    @classmethod
    def between(cls, breaks: Array, times: Array, finest: float) -> Cells:
        """Return the pieces divided near the given times, at multiples of the fraction `finest`."""
        piece = np.clip(np.searchsorted(breaks, times, side="right") - 1, 0, len(breaks) - 2)
        share = np.round((times - breaks[piece]) / np.diff(breaks)[piece] / finest) * finest
        edges = ((k, 0.0) for k in range(len(breaks)))
        begins = np.array([*zip(piece, share, strict=True), *edges])
        whole = np.unique(begins[(begins[:, 1] >= 0) & (begins[:, 1] < 1)], axis=0)
        piece, low = whole[:-1, 0].astype(int), whole[:-1, 1]
        size = np.where(whole[1:, 0] > piece, 1.0, whole[1:, 1]) - low
        some = np.diff(breaks)[piece] > 0
        return cls(breaks, piece[some], low[some], size[some])

    @property
    def width(self) -> Array:
        """Durations of the cells in seconds, shape (C,), rounded."""
        return np.asarray(np.diff(self.breaks)[self.piece] * self.size)

    def fractions(self, share: Array) -> Array:
        """Convert shares (M,) of each cell to fractions of its piece, shape (M, C)."""
        return np.asarray(self.low + self.size * share[:, None])

    def time(self, cell: Pieces, x: Array) -> Array:
        """Return the times in seconds at x in [−1, 1] of the cells with the indices `cell`."""
        begins = self.breaks[self.piece] + np.diff(self.breaks)[self.piece] * self.low
        return np.asarray(begins[cell] + self.width[cell] * (x + 1) / 2)

    def times(self, x: Array) -> Array:
        """Return the times (C, M) in seconds at x in [−1, 1] of each cell; x is (M,) or (C, 1)."""
        return self.time(np.arange(len(self.piece))[:, None], x)

    def select(self, which: NDArray[Any]) -> Cells:
        """Return the cells that an index or mask selects."""
        return Cells(self.breaks, self.piece[which], self.low[which], self.size[which])

    def split(self, parts: NDArray[np.int_] | int = 4) -> tuple[Cells, Pieces]:
        """Return each cell split into equal parts (a power of two), and the old cell of each part.

        Near a singularity, splitting in four needs half as many rounds as halving.
        """
        origin = np.repeat(np.arange(len(self.piece)), parts)
        first = np.searchsorted(origin, origin)
        size = (self.size / parts)[origin]
        low = self.low[origin] + size * (np.arange(len(origin)) - first)
        return Cells(self.breaks, self.piece[origin], low, size), origin

    def halves(self) -> Cells:
        """Return the left halves of all cells, then their right halves."""
        size = self.size / 2
        low = np.append(self.low, self.low + size)
        return Cells(self.breaks, np.tile(self.piece, 2), low, np.tile(size, 2))


def join_cells(parts: Sequence[Cells]) -> Cells:
    """Return groups of cells as one, in order."""
    columns = [np.concatenate([getattr(p, n) for p in parts]) for n in ("piece", "low", "size")]
    return Cells(parts[0].breaks, *columns)


MOST_DEGREE = 50
"""Largest degree of a curve: methods need less (35 for an input law of eight joints through twenty
points), and up to this degree floats hold the binomial coefficients exactly. The verification
evaluates each polynomial at more points than its degree."""


def expect_curve(name: str, curve: Bernstein, values: tuple[int, ...]) -> Bernstein:
    """Return a curve over [0, duration], checked, and as `Bernstein` if it was SciPy's `BPoly`.

    Raises:
        ValueError: If the breaks do not increase from 0, the values have the wrong shape, or the
            degree is too high.
    """
    breaks, shape = np.asarray(curve.x), curve.c.shape[2:]
    if breaks[0] != 0 or not np.all(np.diff(breaks) > 0) or not np.isfinite(breaks[-1]):
        raise ValueError(f"the breaks of {name} must increase from 0 and be finite")
    if shape != values or np.iscomplexobj(curve.c):
        raise ValueError(f"{name} must have real values of shape {values}, not {shape}")
    if len(curve.c) - 1 > MOST_DEGREE:
        raise ValueError(f"{name} has degree {len(curve.c) - 1}; at most {MOST_DEGREE} is allowed")
    return curve if isinstance(curve, Bernstein) else Bernstein(curve.c, curve.x)


def nonfinite_part(**parts: Array) -> str:
    """Say which of the arrays contain NaN or infinity; empty if all are finite."""
    bad = [name for name, part in parts.items() if not np.all(np.isfinite(part))]
    return f"{' and '.join(bad)} hold numbers that are not finite" if bad else ""
