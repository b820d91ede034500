"""Functions on many cells at once, each held as a polynomial and a proven remainder.

A model stands for every function f with |f(τ) − Σ cₖ Tₖ(τ)| ≤ r on each cell, τ in [−1, 1]. Sums,
products and integrals of models are models again; what is cut off and what rounding may do goes
into r. Source: M. Joldes, "Rigorous polynomial approximations and applications", 2011 (Chebyshev
models); K. Makino, M. Berz, "Taylor models and other validated functional inclusion methods", 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.certificate import series
from planner.systems.base import Array

UNIT = 1.2e-16
"""Unit of rounding, 2⁻⁵³, a little enlarged for what its own bounds lose by rounding."""

Index = NDArray[Any]
"""Indices, or a mask."""

INFLATE = 1 + 1e-14
"""Covers the rounding of the few sums of positive numbers that make up one remainder."""


@dataclass(frozen=True, eq=False)
class Model:
    """Polynomials and remainders on C cells.

    Attributes:
        c: Chebyshev coefficients, shape (C, width), width ≤ `series.WIDTH`.
        r: Remainders, shape (C,), ≥ 0; infinite where the function could not be bounded.
    """

    c: Array
    r: Array

    @classmethod
    def constant(cls, value: float, cells: int, remainder: float = 0.0) -> Model:
        """One number on all cells."""
        return cls(np.full((cells, 1), float(value)), np.full(cells, remainder))

    @classmethod
    def cut(cls, c: Array, r: Array) -> Model:
        """Of coefficients of any width: those beyond the common degree go to the remainder."""
        tail = np.sum(np.abs(c[:, series.WIDTH :]), axis=1)
        r = np.asarray((r + tail) * INFLATE)
        bad = ~np.isfinite(r)
        if np.any(bad):
            c, r = np.where(bad[:, None], 0.0, c), np.where(bad, np.inf, r)
        return cls(c[:, : series.WIDTH], r)

    @cached_property
    def norm(self) -> Array:
        """Σ|cₖ|, shape (C,): no value of the polynomial is greater."""
        return np.asarray(np.sum(np.abs(self.c), axis=1))

    @cached_property
    def wander(self) -> Array:
        """Greatest distance of f from c₀, shape (C,)."""
        inner = np.sum(np.abs(self.c[:, 1:]), axis=1)
        return np.asarray((inner + self.r + 4 * UNIT * self.norm) * INFLATE)

    @property
    def low(self) -> Array:
        """Lower bound of f, shape (C,)."""
        return np.asarray(self.c[:, 0] - self.wander)

    @property
    def high(self) -> Array:
        """Upper bound of f, shape (C,)."""
        return np.asarray(self.c[:, 0] + self.wander)

    @property
    def size(self) -> Array:
        """Upper bound of |f|, shape (C,)."""
        return np.asarray((self.norm + self.r) * INFLATE)

    def polynomial(self) -> Model:
        """Its polynomial alone."""
        return Model(self.c, np.zeros_like(self.r))

    def widened(self, by: Array) -> Model:
        """With more remainder."""
        return Model(self.c, np.asarray((self.r + by) * INFLATE))

    def only(self, cells: Index) -> Model:
        """Some of the cells, by index or mask."""
        return Model(self.c[cells], self.r[cells])

    # -- arithmetic ----------------------------------------------------------------------------

    def __neg__(self) -> Model:
        return Model(-self.c, self.r)

    def __add__(self, other: Model | float) -> Model:
        if not isinstance(other, Model):
            other = Model.constant(other, len(self.c))
        long, short = (self, other) if self.c.shape[1] >= other.c.shape[1] else (other, self)
        c = long.c.copy()
        c[:, : short.c.shape[1]] += short.c
        return Model.cut(c, self.r + other.r + UNIT * np.sum(np.abs(c), axis=1))

    def __sub__(self, other: Model | float) -> Model:
        return self + (-other)

    def __mul__(self, other: Model | float) -> Model:
        if not isinstance(other, Model):
            return self.scaled(np.full(len(self.c), float(other)))
        c, r = times(self.c, other.c)
        r = r + self.norm * other.r + other.norm * self.r + _both(self.r, other.r)
        return Model.cut(c, r)

    __radd__ = __add__
    __rmul__ = __mul__

    def scaled(self, by: Array) -> Model:
        """Times a number on each cell, shape (C,)."""
        c = self.c * by[:, None]
        return Model.cut(c, np.abs(by) * self.r + UNIT * np.sum(np.abs(c), axis=1))

    def integral(self, width: Array) -> Model:
        """∫ f from the left end of each cell, over cells `width` long, one degree higher."""
        c = self.c @ series.integral(self.c.shape[1]).T * (width[:, None] / 2)
        rounding = 4 * (self.c.shape[1] + 2) * UNIT * self.norm
        return Model.cut(c, np.asarray((self.r + rounding) * width))

    def at_end(self) -> tuple[Array, Array]:
        """Value at the right end and its uncertainty, each (C,)."""
        rounding = self.c.shape[1] * UNIT * self.norm
        return np.sum(self.c, axis=1), np.asarray((self.r + rounding) * INFLATE)

    def slope(self) -> Model:
        """d/dτ of the polynomial (not of f)."""
        width = self.c.shape[1]
        c = self.c @ series.derivative(width).T
        grown = np.abs(self.c) @ (2.0 * np.arange(width) ** 2)
        return Model.cut(c, np.asarray(width * UNIT * grown))

    def at_nodes(self) -> Array:
        """Values of the polynomial at the Chebyshev points, shape (C, WIDTH); not bounds."""
        return np.asarray(self.c @ series.evaluation(self.c.shape[1]).T)


def times(a: Array, b: Array) -> tuple[Array, Array]:
    """Product of polynomials (C, m) and (C, k): (C, m+k−1), and a bound on rounding (C,)."""
    if min(a.shape[1], b.shape[1]) == 1:
        c = a * b
        return c, UNIT * np.sum(np.abs(c), axis=1)
    inner = (a[:, 1:, None] * b[:, None, 1:]).reshape(len(a), -1)
    c = inner @ _inner_product(a.shape[1], b.shape[1])
    c[:, : b.shape[1]] += a[:, :1] * b
    c[:, 1 : a.shape[1]] += b[:, :1] * a[:, 1:]
    sizes = [np.sum(np.abs(m[:, 1:]), axis=1) for m in (a, b)]
    few = np.sum(np.abs(c), axis=1) + np.abs(a[:, 0]) * sizes[1] + np.abs(b[:, 0]) * sizes[0]
    rounding = 3 * few + 3 * np.abs(a[:, 0] * b[:, 0])
    return c, UNIT * (rounding + (a.shape[1] + b.shape[1] + 6) * sizes[0] * sizes[1])


@lru_cache(maxsize=256)
def _inner_product(first: int, second: int) -> Array:
    """`series.product` without the rows of the constant terms, which are added one by one."""
    whole = series.product(first, second).reshape(first, second, -1)
    return np.ascontiguousarray(whole[1:, 1:].reshape((first - 1) * (second - 1), -1))


def interpolated(values: Array) -> Array:
    """Coefficients (C, WIDTH) of the polynomials through values at the nodes (C, WIDTH)."""
    return np.asarray(values @ series.interpolation().T)


def _both(a: Array, b: Array) -> Array:
    return np.asarray(np.where((a == 0) | (b == 0), 0.0, a * b))
