"""Matrices of polynomials on [−1, 1] by Chebyshev coefficients, each made once and kept."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import comb

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from planner.systems.base import Array

POINTS = 16
"""Chebyshev points of a cell; models have this many coefficients."""


def _cosines(m: NDArray[np.int_]) -> Array:
    """cos(π m/(2 POINTS)) for whole m: brought to the first quadrant, right to 4 units."""
    m = m % (4 * POINTS)
    m = np.minimum(m, 4 * POINTS - m)
    near = np.cos(np.pi / (2 * POINTS) * np.minimum(m, 2 * POINTS - m))
    return np.asarray(np.where(m == POINTS, 0.0, np.where(m > POINTS, -near, near)))


@lru_cache(maxsize=1)
def nodes() -> Array:
    """The Chebyshev points of the first kind, increasing, shape (POINTS,)."""
    return evaluation(2)[:, 1]


@lru_cache(maxsize=64)
def evaluation(width: int) -> Array:
    """Coefficients (width) to values at the nodes, shape (POINTS, width)."""
    return _cosines(np.outer(2 * np.arange(POINTS)[::-1] + 1, np.arange(width)))


@lru_cache(maxsize=1)
def interpolation() -> Array:
    """Values at the nodes to coefficients, shape (POINTS, POINTS)."""
    out = evaluation(POINTS).T * (2 / POINTS)
    out[0] /= 2
    return out


@lru_cache(maxsize=1)
def integration() -> Array:
    """Values at the nodes to integrals from −1 to each of them, to 0 and to 1: (POINTS+2, POINTS).

    ∫ Tₖ = (Tₖ₊₁/(k+1) − Tₖ₋₁/(k−1))/2.
    """
    whole = chebyshev.chebint(np.eye(POINTS), lbnd=-1)
    ends = chebyshev.chebvander(np.array([0.0, 1.0]), POINTS)
    return np.asarray(np.vstack([evaluation(POINTS + 1), ends]) @ whole @ interpolation())


@lru_cache(maxsize=32)
def slopes(width: int, order: int) -> Array:
    """Coefficients to those of a derivative, (width, width): whole numbers, the last rows zero."""
    out = np.zeros((width, width))
    out[: max(width - order, 1)] = chebyshev.chebder(np.eye(width), order)
    return out


SUMS = float(np.sum(np.abs(interpolation()))) * (1 + 1e-12)
"""No coefficients' sizes together exceed this times the greatest value."""

LEBESGUE = float(np.sum(1 / np.tan(np.pi / (4 * POINTS) * (2 * np.arange(POINTS) + 1)))) / POINTS
LEBESGUE *= 1 + 1e-12
"""No interpolant exceeds this times the greatest value."""

REACHES = float(np.max(np.sum(np.abs(integration()), axis=1))) * (1 + 1e-12)
"""No integral of an interpolant exceeds this times the greatest value."""


@lru_cache(maxsize=64)
def from_bernstein(width: int) -> Array:
    """Bernstein coefficients to Chebyshev coefficients of the same degree, (width, width).

    The basis is C(d, i) (1+τ)^i (1−τ)^{d−i} / 2^d, and τⁿ = 2^{1−n} Σ C(n, (n−k)/2) Tₖ over the k
    of n's parity, the term of T₀ halved; in whole numbers, as above.
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
