"""z along the path as affine functions of the free coefficients, at one travel.

With z₁ = z₁(0) + Δ τ the chain integrates to

    zᵢ(τ) = Σ_{k=0}^{i−2} zᵢ₋ₖ(0) (Δτ)ᵏ/k! + Δ^{i−2} (I^{i−1}ω)(τ)        (i = 2 … N)

and the end conditions fix N−1 combinations of the coefficients, which are eliminated:
x = x₀ + Q₂ y, x₀ ⊥ Q₂. Whatever y is, the path starts at z(0) and ends at z(T) to rounding, and
∫ω² dτ = |x₀|² + |y|².
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from numpy.typing import NDArray

from planner.convex.shape import Shape, end_basis, node_rows
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Frame:
    """All paths of one shape between two ends at one travel, which is not zero.

    Array indices of z start at 0, as everywhere in the code: z₂ is z[1].

    Attributes:
        shape: The class of ω.
        start: z(0), shape (N,).
        goal: z(T), shape (N,).
        travel: Δ = z₁(T) − z₁(0).
    """

    shape: Shape
    start: Array
    goal: Array
    travel: float

    @cached_property
    def _basis(self) -> tuple[Array, Array, Array]:
        return end_basis(self.shape, len(self.start) - 1)

    @property
    def size(self) -> int:
        """Number of free coefficients y."""
        return int(self._basis[2].shape[1])

    @cached_property
    def least(self) -> Array:
        """x₀, shape (m,): the coefficients of least ∫ω² that meet the ends."""
        ones = np.ones(1)
        ends = [
            (self.goal[i] - self._drift(i, ones)[0]) / self.travel ** (i - 1)
            for i in range(1, len(self.start))
        ]
        q1, r, _ = self._basis
        return np.asarray(q1 @ np.linalg.solve(r.T, np.array(ends)))

    def x(self, y: Array) -> Array:
        """All coefficients, shape (m,), of free ones y."""
        return np.asarray(self.least + self._basis[2] @ y)

    def y(self, x: Array) -> Array:
        """The free coefficients of the path nearest to coefficients x that meets the ends."""
        return np.asarray(self._basis[2].T @ x)

    def z_rows(self, i: int, tau: Array) -> tuple[Array, Array]:
        """z[i] at τ (k,) as A y + c: A (k, size), c (k,); i ≥ 1."""
        rows = self.shape.integral(i, tau) * self.travel ** (i - 1)
        return self._split(rows, self._drift(i, tau))

    def z_rows_at_nodes(self, i: int) -> tuple[Array, Array]:
        """`z_rows` at the inner nodes, from products that are kept from travel to travel."""
        rows, free = node_rows(self.shape, i, len(self.start) - 1)
        gain = self.travel ** (i - 1)
        drift = self._drift(i, self.shape.breaks[1:-1])
        return free * gain, np.asarray(rows @ self.least * gain + drift)

    def omega_rows(self, piece: NDArray[np.intp], local: Array) -> tuple[Array, Array]:
        """ω at fractions of pieces as A y + c."""
        return self._split(self.shape.values(piece, local), np.zeros(len(piece)))

    def coefficient_rows(self) -> tuple[Array, Array]:
        """The plain coefficients of ω as A y + c: its extremes in either class."""
        return self._split(self.shape.whiten, np.zeros(self.shape.size))

    def _split(self, rows: Array, constant: Array) -> tuple[Array, Array]:
        return np.asarray(rows @ self._basis[2]), np.asarray(rows @ self.least + constant)

    def _drift(self, i: int, tau: Array) -> Array:
        """z[i] at τ of the path with ω = 0."""
        terms = [self.start[i - k] * (self.travel * tau) ** k / factorial(k) for k in range(i)]
        return np.asarray(np.sum(terms, axis=0))

    def bernstein(self, y: Array) -> list[Array]:
        """Bernstein coefficients on every piece of ω, z[1] … z[N−1]: arrays (degree+1, pieces)."""
        out = [self.shape.bernstein(self.x(y))]
        width = 1.0 / self.shape.pieces
        for i in range(1, len(self.start)):
            rate = out[-1] * (self.travel if i > 1 else 1.0)
            grown = np.cumsum(rate, axis=0) * width / len(rate)
            left = self.start[i] + np.concatenate([[0.0], np.cumsum(grown[-1])[:-1]])
            out.append(left + np.concatenate([np.zeros((1, grown.shape[1])), grown]))
        return out

    def smoothness(self, y: Array) -> float:
        """½∫(dz₂/dz₁)² |dz₁|."""
        return float((self.least @ self.least + y @ y) / (2 * abs(self.travel)))

    def peak(self, y: Array) -> float:
        """max |dz₂/dτ|."""
        return float(np.max(np.abs(self.shape.whiten @ self.x(y))))

    def at(self, travel: float) -> Frame:
        """The same ends' z₂ … z_N at another travel."""
        goal = self.goal.copy()
        goal[0] = self.start[0] + travel
        return Frame(self.shape, self.start, goal, travel)
