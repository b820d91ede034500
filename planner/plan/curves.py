"""Piecewise polynomials in the Bernstein basis (`scipy.interpolate.BPoly`).

Their values, roots and range, how a file holds them, and parts of their pieces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, PPoly

from planner.support.arrays import Array

Pieces = NDArray[np.int_]
"""Numbers of pieces, or of cells, from 0."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Parts of the pieces of a trajectory, as fractions of a piece that floats hold exactly.

    Attributes:
        breaks: Times between the pieces, shape (K+1,), seconds.
        piece: The piece each cell belongs to, shape (C,).
        low: Where it begins, as a fraction of its piece, shape (C,).
        size: Its width as a fraction of its piece, shape (C,).
    """

    breaks: Array
    piece: Pieces
    low: Array
    size: Array

    @classmethod
    def of(cls, breaks: Array) -> Cells:
        """The pieces themselves, but for those that take no time."""
        piece = np.flatnonzero(np.diff(breaks) > 0)
        return cls(breaks, piece, np.zeros(len(piece)), np.ones(len(piece)))

    @property
    def width(self) -> Array:
        """Seconds, shape (C,), to a rounding."""
        return np.asarray(np.diff(self.breaks)[self.piece] * self.size)

    def fractions(self, share: Array) -> Array:
        """Shares (M,) of each cell as fractions of its piece, shape (M, C)."""
        return np.asarray(self.low + self.size * share[:, None])

    def time(self, cell: Pieces, x: Array) -> Array:
        """Seconds at x in [−1, 1] of cells."""
        begins = self.breaks[self.piece] + np.diff(self.breaks)[self.piece] * self.low
        return np.asarray(begins[cell] + self.width[cell] * (x + 1) / 2)

    def times(self, x: Array) -> Array:
        """Seconds (C, M) at places x (M,) in [−1, 1] of each cell, or at one of each (C, 1)."""
        return self.time(np.arange(len(self.piece))[:, None], x)

    def only(self, which: NDArray[Any]) -> Cells:
        """Some of the cells, by index or mask."""
        return Cells(self.breaks, self.piece[which], self.low[which], self.size[which])

    def split(self, parts: NDArray[np.int_] | int = 4) -> tuple[Cells, Pieces]:
        """Each in so many equal parts (a power of two), and which cell each came from.

        Near a singularity parting in four takes half as many steps as halving.
        """
        origin = np.repeat(np.arange(len(self.piece)), parts)
        first = np.searchsorted(origin, origin)
        size = (self.size / parts)[origin]
        low = self.low[origin] + size * (np.arange(len(origin)) - first)
        return Cells(self.breaks, self.piece[origin], low, size), origin

    def halved(self) -> Cells:
        """The left halves of all, then the right halves."""
        size = self.size / 2
        low = np.append(self.low, self.low + size)
        return Cells(self.breaks, np.tile(self.piece, 2), low, np.tile(size, 2))


def joined(parts: Sequence[Cells]) -> Cells:
    """Several groups of cells as one."""
    columns = [np.concatenate([getattr(p, n) for p in parts]) for n in ("piece", "low", "size")]
    return Cells(parts[0].breaks, *columns)


MOST_DEGREE = 50
"""Of a curve. A law through twenty points has 35 with eight joints; the judge reads each polynomial
at more points than its degree, and the binomials stay exact."""


def expect_curve(name: str, curve: BPoly, values: tuple[int, ...]) -> None:
    """Refuse a curve that cannot be evaluated over [0, duration].

    Raises:
        ValueError: If its breaks do not increase from 0, its values have another shape, or its
            degree is too high.
    """
    breaks, shape = np.asarray(curve.x), curve.c.shape[2:]
    if breaks[0] != 0 or not np.all(np.diff(breaks) > 0) or not np.isfinite(breaks[-1]):
        raise ValueError(f"the breaks of {name} must increase from 0 and be finite")
    if shape != values or np.iscomplexobj(curve.c):
        raise ValueError(f"{name} must have real values of shape {values}, not {shape}")
    if len(curve.c) - 1 > MOST_DEGREE:
        raise ValueError(f"{name} has degree {len(curve.c) - 1}; at most {MOST_DEGREE} is read")


def undefined(**parts: Array) -> str:
    """Which of some arrays holds what is no finite number, in words; empty if none does."""
    bad = [name for name, part in parts.items() if not np.all(np.isfinite(part))]
    return f"{' and '.join(bad)} hold numbers that are not finite" if bad else ""


def on_pieces(curve: BPoly, piece: Pieces, fraction: Array) -> Array:
    """Values (P, C, …) of a piecewise polynomial at fractions (P, C) of its pieces (C,).

    The Bernstein basis at the fractions, times the coefficients.
    """
    degree, shape = len(curve.c) - 1, (*fraction.shape, *curve.c.shape[2:])
    c = curve.c[:, piece].reshape(degree + 1, len(piece), -1)
    if np.all(fraction == fraction[:, :1]):  # the same in all pieces: one matrix
        return product(_bernstein(degree, fraction[:, 0]).T, c.reshape(degree + 1, -1)).reshape(
            shape
        )
    basis = np.transpose(_bernstein(degree, fraction), (2, 1, 0))
    return np.asarray(np.swapaxes(basis @ np.swapaxes(c, 0, 1), 0, 1).reshape(shape))


def at_times(curve: BPoly, t: Array) -> Array:
    """Values (…) of a scalar piecewise polynomial at many times (…): its own call, but faster."""
    piece = np.clip(np.searchsorted(curve.x, t, side="right") - 1, 0, len(curve.x) - 2)
    basis = _bernstein(len(curve.c) - 1, (t - curve.x[piece]) / np.diff(curve.x)[piece])
    return np.asarray(np.sum(basis * curve.c[:, piece], axis=0))


def _bernstein(degree: int, x: Array) -> Array:
    """All Bernstein polynomials of a degree at x, on a new first axis."""
    up, down = np.ones((2, degree + 1, *x.shape))
    rest = 1 - x
    for k in range(1, degree + 1):
        up[k], down[k] = up[k - 1] * x, down[k - 1] * rest
    up *= down[::-1]
    up *= _binomials(degree).reshape(-1, *[1] * x.ndim)
    return np.asarray(up)


@lru_cache(maxsize=32)
def _binomials(degree: int) -> Array:
    return np.array([float(comb(degree, k)) for k in range(degree + 1)])


def product(matrix: Array, columns: Array) -> Array:
    """The matrix times columns (K, M), a few at a time.

    OpenBLAS starts threads for products of more than 2^18 multiplications (its default,
    GEMM_MULTITHREAD_THRESHOLD 4); on a computer that is busy they cost more than they gain.
    """
    most = max(1, 2**18 // matrix.size)
    if columns.shape[1] <= most:
        return np.asarray(matrix @ columns)
    out = np.empty((len(matrix), columns.shape[1]))
    for k in range(0, columns.shape[1], most):
        np.matmul(matrix, columns[:, k : k + most], out=out[:, k : k + most])
    return out


def polynomial_roots(curve: BPoly, component: int) -> list[float]:
    """Times at which one component of a piecewise polynomial is zero, by polynomial roots."""
    scalar = BPoly(np.ascontiguousarray(curve.c[:, :, component]), curve.x)
    roots = PPoly.from_bernstein_basis(scalar).roots(extrapolate=False)
    return sorted({float(r) for r in np.atleast_1d(roots) if np.isfinite(r)})


def polynomial_range(curve: BPoly, component: int) -> tuple[float, float]:
    """Least and greatest value of one component over all time, by the roots of its derivative."""
    times = np.concatenate([curve.x, polynomial_roots(curve.derivative(), component)])
    values = curve(times)[:, component]
    return float(values.min()), float(values.max())


def on_longer_clock(curve: BPoly, factor: float, gain: float = 1.0) -> BPoly:
    """The curve in `factor` times the time, its values times `gain`."""
    return BPoly(curve.c * gain, curve.x * factor)


def curve_to_dict(curve: BPoly) -> dict[str, Any]:
    """JSON-ready form of a piecewise polynomial."""
    return {"breaks": curve.x.tolist(), "bernstein": curve.c.tolist()}


def curve_from_dict(data: Mapping[str, Any]) -> BPoly:
    """Read back what `curve_to_dict` wrote."""
    return BPoly(
        np.asarray(data["bernstein"], dtype=float), np.asarray(data["breaks"], dtype=float)
    )
