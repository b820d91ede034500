"""Motions of the chained form under smooth inputs that are not polynomials, to rounding error.

Time is cut into short pieces; on each, every function is held by its values at Chebyshev–Lobatto
points, where products are exact and integrals are one small matrix. The pieces are so short that
what the highest harmonic leaves out of the interpolants is below rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb, pi

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import BPoly

from planner.methods.legs import elevate
from planner.systems.base import Array

DEGREE = 14

_PHASE = 2.4
"""Radians of the highest harmonic on one piece: the interpolant errs by 2 (h/2)¹⁵/15! = 7e-16 of
it, with h half of that."""


@dataclass(frozen=True)
class Grid:
    """Pieces and their points.

    Attributes:
        breaks: Times between the pieces, shape (P+1,).
    """

    breaks: Array

    @classmethod
    def for_harmonic(cls, start: float, end: float, harmonics: int) -> Grid:
        """Equal pieces over one period, fine enough for functions of that many harmonics."""
        pieces = max(4, int(np.ceil(2 * pi * harmonics / _PHASE)))
        return cls(np.linspace(start, end, pieces + 1))

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

    def curve(self, f: Array) -> BPoly:
        """The interpolating piecewise polynomial of values f (P, DEGREE+1, …)."""
        return BPoly(np.swapaxes(_apply(_to_bernstein(), f), 0, 1), self.breaks)


def propagate(grid: Grid, start: Array, v1: Array, v2: Array) -> Array:
    """Values of z at the grid's points.

    Args:
        grid: Pieces and points.
        start: z at the first break, shape (N, …).
        v1: Values of v₁, shape (P, DEGREE+1).
        v2: Values of v₂, shape (P, DEGREE+1, …).

    Returns:
        Shape (P, DEGREE+1, N, …).
    """
    first = v1.reshape(*v1.shape, *[1] * (v2.ndim - 2))
    path = grid.integral(first)
    columns = [start[0] + np.broadcast_to(path, v2.shape), start[1] + grid.integral(v2)]
    for i in range(2, len(start)):
        columns.append(start[i] + grid.integral(columns[-1] * first))
    return np.stack(columns, axis=2)


def joined(curves: list[BPoly]) -> BPoly:
    """Curves of one degree that follow each other in time, as one."""
    breaks = np.concatenate([curves[0].x[:1], *(c.x[1:] for c in curves)])
    return BPoly(np.concatenate([c.c for c in curves], axis=1), breaks)


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
def _to_bernstein() -> Array:
    """Values at the points → Bernstein coefficients.

    Tₙ(2x−1) has the coefficients (−1)^{n−i} C(2n, 2i)/C(n, i) at its own degree; they are raised to
    the common one.
    """
    out = np.zeros((DEGREE + 1, DEGREE + 1))
    for n in range(DEGREE + 1):
        own = np.array([(-1.0) ** (n - i) * comb(2 * n, 2 * i) / comb(n, i) for i in range(n + 1)])
        out[:, n] = elevate(own, DEGREE)
    return np.asarray(out @ _to_chebyshev())
