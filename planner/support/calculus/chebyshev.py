"""Functions represented by values at Chebyshev–Lobatto points, or by Chebyshev series.

At these points products are exact up to the degree, and integrals and derivatives are one small
matrix (Trefethen, "Spectral Methods in MATLAB", 2000, ch. 6 and 12). Functions are on 0 ≤ x ≤ 1;
the argument of a series is 2x − 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import comb

import numpy as np
from numpy.polynomial import chebyshev

from planner.support.arrays import Array, product
from planner.support.calculus.bernstein import Bernstein, elevate


@lru_cache(maxsize=64)
def points(count: int) -> Array:
    """Return the Chebyshev–Lobatto points on [0, 1], increasing, shape (count,)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1)))


@lru_cache(maxsize=16)
def to_series(count: int) -> Array:
    """Return the matrix from values at `count` Lobatto points to Chebyshev coefficients."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(2 * points(count) - 1, count - 1)))


@lru_cache(maxsize=16)
def from_series(width: int, count: int) -> Array:
    """Return the matrix from `width` Chebyshev coefficients to values at `count` Lobatto points."""
    return np.asarray(chebyshev.chebvander(2 * points(count) - 1, width - 1))


@lru_cache(maxsize=16)
def resampling(count: int, new: int) -> Array:
    """Return the matrix from values at `count` Lobatto points to values at `new` Lobatto points."""
    return np.asarray(from_series(count, new) @ to_series(count))


@lru_cache(maxsize=16)
def integration(count: int) -> Array:
    """Return the matrix from values at `count` Lobatto points to the integral from 0 to each."""
    integrals = chebyshev.chebint(np.eye(count), lbnd=-1) / 2
    return np.asarray(chebyshev.chebval(2 * points(count) - 1, integrals).T @ to_series(count))


@lru_cache(maxsize=16)
def series_slopes(count: int) -> Array:
    """Return the matrix from Chebyshev coefficients to the derivative at `count` Lobatto points."""
    return np.asarray(from_series(count - 1, count) @ (2 * chebyshev.chebder(np.eye(count))))


@lru_cache(maxsize=16)
def differentiation(count: int) -> Array:
    """Return the matrix from values at `count` Lobatto points to the derivative at each point."""
    return np.asarray(series_slopes(count) @ to_series(count))


@lru_cache(maxsize=16)
def to_bernstein(count: int) -> Array:
    """Return the matrix from values at `count` Lobatto points to Bernstein coefficients.

    Tₙ(2x−1) has the coefficients (−1)^{n−i} C(2n, 2i)/C(n, i) at degree n; `elevate` raises them to
    the degree `count` − 1.
    """
    out = np.zeros((count, count))
    for n in range(count):
        weights = [(-1.0) ** (n - i) * comb(2 * n, 2 * i) / comb(n, i) for i in range(n + 1)]
        out[:, n] = elevate(np.array(weights), count - 1)
    out = out @ to_series(count)
    out[0], out[-1] = np.eye(count)[[0, -1]]  # exact ends, so that pieces are continuous
    return np.asarray(out)


@lru_cache(maxsize=64)
def from_bernstein(width: int) -> Array:
    """Return the exact matrix (width, width) from Bernstein to Chebyshev coefficients.

    With τ = 2x − 1 the basis is C(d, i) (1+τ)^i (1−τ)^{d−i} / 2^d, and τⁿ = 2^{1−n} Σ C(n, (n−k)/2)
    Tₖ over all k of the parity of n, with the term of T₀ halved.
    """
    d = width - 1
    out = np.zeros((width, width))
    for i in range(width):
        power = [0] * width
        for a in range(i + 1):
            for b in range(d - i + 1):
                power[a + b] += comb(i, a) * comb(d - i, b) * (-1) ** b
        for k in range(width):
            terms = ((n, comb(n, (n - k) // 2)) for n in range(k, width, 2))
            total = sum(Fraction(2 * power[n] * c, 2**n) for n, c in terms)
            out[k, i] = float(total * comb(d, i) / 2**d / (2 if k == 0 else 1))
    return out


def apply(matrix: Array, values: Array) -> Array:
    """Apply a matrix (M, P) to the first axis of values (P, …); return shape (M, …)."""
    return product(matrix, values.reshape(len(values), -1)).reshape(len(matrix), *values.shape[1:])


DEGREE = 14


@dataclass(frozen=True)
class Grid:
    """P pieces with DEGREE + 1 Lobatto points each; a function is given by its values there.

    Values have the shape (P, DEGREE+1, …).

    Attributes:
        breaks: Times of the breaks between the pieces, shape (P+1,).
    """

    breaks: Array

    @property
    def times(self) -> Array:
        """Times of the grid's points, shape (P, DEGREE+1); inner breaks appear twice."""
        left, width = self.breaks[:-1, None], np.diff(self.breaks)[:, None]
        return np.asarray(left + width * points(DEGREE + 1))

    def integral(self, f: Array) -> Array:
        """Return ∫ f dt from the first break to every point of the grid, from values f there."""
        integrals = _on_pieces(integration(DEGREE + 1), f) * self._width(f)
        before = np.cumsum(integrals[:, -1], axis=0) - integrals[:, -1]
        return integrals + before[:, None]

    def derivative(self, f: Array) -> Array:
        """Return df/dt at the points of the grid, from values f there."""
        return _on_pieces(differentiation(DEGREE + 1), f) / self._width(f)

    def tail(self, f: Array) -> Array:
        """Return the larger magnitude of each piece's last two Chebyshev coefficients, (P, …)."""
        return np.asarray(np.max(np.abs(_on_pieces(to_series(DEGREE + 1)[-2:], f)), axis=1))

    def curve(self, f: Array) -> Bernstein:
        """Return the piecewise polynomial that has the values f at the points of the grid."""
        return Bernstein(np.swapaxes(_on_pieces(to_bernstein(DEGREE + 1), f), 0, 1), self.breaks)

    def _width(self, f: Array) -> Array:
        return np.diff(self.breaks).reshape(-1, *[1] * (f.ndim - 1))


def _on_pieces(matrix: Array, f: Array) -> Array:
    """Apply a matrix (M, D) to the second axis of f (P, D, …); return shape (P, M, …)."""
    flat = matrix @ f.reshape(*f.shape[:2], -1)
    return np.asarray(flat.reshape(len(f), len(matrix), *f.shape[2:]))
