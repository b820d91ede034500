"""Functions of time on pieces: values at Chebyshev points, and Bernstein coefficients.

On each piece a function is held by its values at Chebyshev–Lobatto points, where products are exact
and integrals are one small matrix; `BPoly` curves are made from them at the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import BPoly

from planner.systems.base import Array

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
