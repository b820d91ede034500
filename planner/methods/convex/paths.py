"""Classes of paths in the chart: at each τ, z is affine in the free coefficients of the class.

Over τ ∈ [0, 1], the fraction of the travel Δ, ω = dz₂/dτ is constant, or continuous and linear, on
equal pieces. Its coefficients are whitened, so that ∫ω² dτ = |x|². With z₁ = z₁(0) + Δ τ the chain
integrates to

    zᵢ(τ) = Σ_{k=0}^{i−2} zᵢ₋ₖ(0) (Δτ)ᵏ/k! + Δ^{i−2} (I^{i−1}ω)(τ)        (i = 2 … N)

and the end conditions fix N−1 combinations of the coefficients, which are eliminated:
x = x₀ + Q₂ y, x₀ ⊥ Q₂. For any y the path starts at z(0) and ends at z(T) within rounding, and
∫ω² dτ = |x₀|² + |y|².
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial

import numpy as np

from planner.support.arrays import Array
from planner.support.calculus.bernstein import integral


@dataclass(frozen=True, eq=False)
class Shape:
    """A class of functions ω(τ), piecewise constant or linear, as built by `input_shape`.

    Attributes:
        pieces: Number of equal pieces.
        degree: 0 for constant pieces, 1 for continuous linear ones.
        whiten: Matrix W from whitened to plain coefficients, shape (m, m).
    """

    pieces: int
    degree: int
    whiten: Array

    @property
    def breaks(self) -> Array:
        """Path fractions τ of the nodes between pieces, from 0 to 1, shape (pieces+1,)."""
        return np.linspace(0.0, 1.0, self.pieces + 1)

    def integral(self, order: int, tau: Array) -> Array:
        """Return the matrix (len(tau), m) from coefficients x to the `order`-fold integral of ω."""
        power = order + self.degree
        ramps = np.maximum(tau[:, None] - self.breaks, 0.0) ** power / factorial(power)
        if self.degree == 0:
            return np.asarray((ramps[:, :-1] - ramps[:, 1:]) @ self.whiten)
        ramps = np.pad(ramps * self.pieces, ((0, 0), (1, 1)))
        hats = ramps[:, :-2] - 2 * ramps[:, 1:-1] + ramps[:, 2:]
        hats[:, 0] = ramps[:, 2] - ramps[:, 1] + tau**order / factorial(order)
        return np.asarray(hats @ self.whiten)

    def bernstein(self, x: Array) -> Array:
        """Return the Bernstein coefficients (degree+1, pieces) of ω with coefficients x (m,)."""
        c = self.whiten @ x
        return c[None, :] if self.degree == 0 else np.stack([c[:-1], c[1:]])


@lru_cache(maxsize=32)
def input_shape(pieces: int, degree: int) -> Shape:
    """Return the class of functions ω with the given number of pieces, of degree 0 or 1, cached."""
    if degree == 0:
        return Shape(pieces, 0, np.sqrt(pieces) * np.eye(pieces))
    diagonal = np.full(pieces + 1, 4.0)
    diagonal[[0, -1]] = 2.0
    mass = np.diag(diagonal) + np.eye(pieces + 1, k=1) + np.eye(pieces + 1, k=-1)
    factor = np.linalg.cholesky(mass / (6 * pieces))
    return Shape(pieces, 1, np.linalg.inv(factor).T)


@lru_cache(maxsize=32)
def end_basis(shape: Shape, orders: int) -> tuple[Array, Array, Array]:
    """Factor the matrix E of the integrals of ω of orders 1 … `orders` at τ = 1 as E = RᵀQ₁ᵀ.

    Returns:
        Q₁ (m, orders), R (orders, orders) and the null space Q₂ (m, m − orders), orthonormal.
    """
    ends = np.concatenate([shape.integral(j, np.ones(1)) for j in range(1, orders + 1)])
    q, r = np.linalg.qr(ends.T, mode="complete")
    return q[:, :orders], r[:orders], q[:, orders:]


@dataclass(frozen=True, eq=False)
class Frame:
    """All paths of one class between two ends at one travel, which differs from zero.

    Array indices of z start at 0: z₂ is z[1].

    Attributes:
        shape: The class of ω.
        start: z(0), shape (N,).
        goal: z(T), shape (N,); its first entry is not used.
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
        """Number of free coefficients y of a path."""
        return int(self._basis[2].shape[1])

    @cached_property
    def least(self) -> Array:
        """Coefficients x₀, shape (m,), with the least ∫ω² that meet the end conditions."""
        ones = np.ones(1)
        each = range(1, len(self.start))
        ends = [(self.goal[i] - self._drift(i, ones)[0]) / self.travel ** (i - 1) for i in each]
        q1, r, _ = self._basis
        return np.asarray(q1 @ np.linalg.solve(r.T, np.array(ends)))

    def x(self, y: Array) -> Array:
        """Return all coefficients x, shape (m,), of the path with free coefficients y."""
        return np.asarray(self.least + self._basis[2] @ y)

    def z_rows(self, i: int, tau: Array) -> tuple[Array, Array]:
        """Return A (k, size), c (k,) such that z[i] = A y + c at path fractions τ (k,); i ≥ 1."""
        rows = self.shape.integral(i, tau) * self.travel ** (i - 1)
        return rows @ self._basis[2], rows @ self.least + self._drift(i, tau)

    def coefficient_rows(self) -> tuple[Array, Array]:
        """Return A and c such that A y + c are the values of ω on pieces or at nodes (m,)."""
        return self.shape.whiten @ self._basis[2], self.shape.whiten @ self.least

    def _drift(self, i: int, tau: Array) -> Array:
        """Return z[i] at path fractions τ (k,) on the path with ω = 0, shape (k,)."""
        terms = [self.start[i - k] * (self.travel * tau) ** k / factorial(k) for k in range(i)]
        return np.asarray(np.sum(terms, axis=0))

    def bernstein(self, y: Array) -> list[Array]:
        """Return the Bernstein coefficients of ω and of z[1] … z[N−1], each (degree+1, pieces)."""
        out = [self.shape.bernstein(self.x(y))]
        width = 1.0 / self.shape.pieces
        for i in range(1, len(self.start)):
            rate = out[-1] * (self.travel if i > 1 else 1.0)
            grown = integral(rate) * width
            out.append(self.start[i] + np.append(0.0, np.cumsum(grown[-1])[:-1]) + grown)
        return out

    def peak(self, y: Array) -> float:
        """Return the largest |dz₂/dτ| of the path with free coefficients y."""
        return float(np.max(np.abs(self.shape.whiten @ self.x(y))))

    def at(self, travel: float) -> Frame:
        """Return the frame of the same class and ends at another travel."""
        return Frame(self.shape, self.start, self.goal, travel)
