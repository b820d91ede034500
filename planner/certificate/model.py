"""Functions on many cells at once, each held as a polynomial and a proven remainder.

A model stands for every function f with |f(τ) − Σ cₖ Tₖ(τ)| ≤ r on each cell, τ in [−1, 1]. Balls
become models where their least value is asked for; what is cut off and what rounding may do goes
into r. Source: M. Joldes, "Rigorous polynomial approximations and applications", 2011 (Chebyshev
models); K. Makino, M. Berz, "Taylor models and other validated functional inclusion methods", 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
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
        c: Chebyshev coefficients, shape (C, width), width ≤ `series.POINTS`.
        r: Remainders, shape (C,), ≥ 0; infinite where the function could not be bounded.
    """

    c: Array
    r: Array

    @classmethod
    def cut(cls, c: Array, r: Array) -> Model:
        """Of coefficients of any width: those beyond the common degree go to the remainder."""
        tail = np.sum(np.abs(c[:, series.POINTS :]), axis=1)
        r = np.asarray((r + tail) * INFLATE)
        bad = ~np.isfinite(r)
        if np.any(bad):
            c, r = np.where(bad[:, None], 0.0, c), np.where(bad, np.inf, r)
        return cls(c[:, : series.POINTS], r)

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

    def only(self, cells: Index) -> Model:
        """Some of the cells, by index or mask."""
        return Model(self.c[cells], self.r[cells])

    # -- arithmetic ----------------------------------------------------------------------------

    def __neg__(self) -> Model:
        return Model(-self.c, self.r)

    def __add__(self, other: Model | float) -> Model:
        if not isinstance(other, Model):
            other = Model(np.full((len(self.c), 1), other), np.zeros(len(self.c)))
        long, short = (self, other) if self.c.shape[1] >= other.c.shape[1] else (other, self)
        c = long.c.copy()
        c[:, : short.c.shape[1]] += short.c
        return Model.cut(c, self.r + other.r + UNIT * np.sum(np.abs(c), axis=1))

    def __sub__(self, other: Model | float) -> Model:
        return self + (-other)

    def scaled(self, by: Array) -> Model:
        """Times a number on each cell, shape (C,)."""
        c = self.c * by[:, None]
        return Model.cut(c, np.abs(by) * self.r + UNIT * np.sum(np.abs(c), axis=1))

    def at_begin(self) -> tuple[Array, Array]:
        """Value at the left end and its uncertainty, each (C,)."""
        signs = np.where(np.arange(self.c.shape[1]) % 2 == 0, 1.0, -1.0)
        return Model(self.c * signs, self.r).at_end()

    def at_end(self) -> tuple[Array, Array]:
        """Value at the right end and its uncertainty, each (C,)."""
        rounding = self.c.shape[1] * UNIT * self.norm
        return np.sum(self.c, axis=1), np.asarray((self.r + rounding) * INFLATE)
