"""Matrices of polynomials on [−1, 1] by Chebyshev coefficients, each made once and kept."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import comb

import numpy as np
from numpy.polynomial import chebyshev

from planner.systems.base import Array

DEGREE = 12
"""Degree at which models are cut off."""

WIDTH = DEGREE + 1


@lru_cache(maxsize=1)
def nodes() -> Array:
    """The WIDTH Chebyshev points of the first kind, increasing."""
    return np.asarray(-np.cos(np.pi * (np.arange(WIDTH) + 0.5) / WIDTH))


@lru_cache(maxsize=32)
def evaluation(width: int) -> Array:
    """Coefficients (width) to values at the nodes, shape (WIDTH, width)."""
    return np.asarray(chebyshev.chebvander(nodes(), width - 1))


@lru_cache(maxsize=1)
def interpolation() -> Array:
    """Values at the nodes to coefficients, shape (WIDTH, WIDTH)."""
    return np.asarray(np.linalg.inv(evaluation(WIDTH)))


@lru_cache(maxsize=256)
def product(first: int, second: int) -> Array:
    """Outer product of coefficients to those of the product: (first·second, first+second−1).

    TᵢTⱼ = (Tᵢ₊ⱼ + T_{|i−j|})/2, so that the absolute values of each row sum to one.
    """
    out = np.zeros((first, second, first + second - 1))
    for i in range(first):
        for j in range(second):
            out[i, j, i + j] += 0.5
            out[i, j, abs(i - j)] += 0.5
    return out.reshape(first * second, -1)


@lru_cache(maxsize=64)
def integral(width: int) -> Array:
    """Coefficients to those of the integral from −1, shape (width+1, width)."""
    return np.asarray(chebyshev.chebint(np.eye(width), lbnd=-1))


@lru_cache(maxsize=64)
def derivative(width: int) -> Array:
    """Coefficients to those of the derivative, shape (max(width−1, 1), width)."""
    return np.asarray(chebyshev.chebder(np.eye(width)))


@lru_cache(maxsize=64)
def to_bernstein(width: int) -> Array:
    """Chebyshev coefficients to Bernstein coefficients of the same degree, (width, width).

    Tₙ has the Bernstein coefficients (−1)^{n−i} C(2n, 2i)/C(n, i) at its own degree; they are
    raised to the common one. Formed in whole numbers, so each entry is right to its last digit.
    """
    out = np.zeros((width, width))
    for n in range(width):
        own = [(-1) ** (n - i) * Fraction(comb(2 * n, 2 * i), comb(n, i)) for i in range(n + 1)]
        for d in range(n + 1, width):
            own = [
                Fraction(i, d) * own[max(i - 1, 0)] + Fraction(d - i, d) * own[min(i, d - 1)]
                for i in range(d + 1)
            ]
        out[:, n] = [float(value) for value in own]
    return out


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
