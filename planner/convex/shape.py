"""The class of inputs: v₂ piecewise constant, or continuous and piecewise linear, on equal pieces.

Written over τ ∈ [0, 1], the fraction of the travel, with ω = dz₂/dτ (so v₂ = ω/T for a plan of
duration T). ω has coefficients c, whitened as c = W x so that ∫ω² dτ = |x|².
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numpy as np
from numpy.typing import NDArray

from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Shape:
    """One class of ω; build it with `input_shape`.

    Attributes:
        pieces: Number of equal pieces.
        degree: 0 for constant pieces, 1 for continuous linear ones.
        whiten: W, shape (m, m), from whitened to plain coefficients.
    """

    pieces: int
    degree: int
    whiten: Array

    @property
    def size(self) -> int:
        """Number of coefficients m."""
        return len(self.whiten)

    @property
    def breaks(self) -> Array:
        """τ of the nodes, shape (pieces+1,)."""
        return np.linspace(0.0, 1.0, self.pieces + 1)

    def integral(self, order: int, tau: Array) -> Array:
        """The `order`-fold integral of ω from 0, rows (len(tau), m) on x; order 0 is ω itself.

        At a node, order 0 takes the piece on the right, and the last piece at τ = 1.
        """
        if order == 0:
            piece = np.minimum((tau * self.pieces).astype(int), self.pieces - 1)
            return self.values(piece, tau * self.pieces - piece)
        raw = (
            _steps(tau, order, self.pieces) if self.degree == 0 else _hats(tau, order, self.pieces)
        )
        return np.asarray(raw @ self.whiten)

    def values(self, piece: NDArray[np.intp], local: Array) -> Array:
        """ω at the fraction `local` ∈ [0, 1] of each given piece, rows (len(piece), m) on x."""
        raw = np.zeros((len(piece), self.size))
        rows = np.arange(len(piece))
        if self.degree == 0:
            raw[rows, piece] = 1.0
        else:
            raw[rows, piece] = 1 - local
            raw[rows, piece + 1] = local
        return np.asarray(raw @ self.whiten)

    def bernstein(self, x: Array) -> Array:
        """Bernstein coefficients of ω on every piece, shape (degree+1, pieces)."""
        c = self.whiten @ x
        return c[None, :] if self.degree == 0 else np.stack([c[:-1], c[1:]])


@lru_cache(maxsize=32)
def input_shape(pieces: int, degree: int) -> Shape:
    """The class with that many pieces, built once and kept."""
    if degree == 0:
        return Shape(pieces, 0, np.sqrt(pieces) * np.eye(pieces))
    diagonal = np.full(pieces + 1, 4.0)
    diagonal[[0, -1]] = 2.0
    mass = np.diag(diagonal) + np.eye(pieces + 1, k=1) + np.eye(pieces + 1, k=-1)
    factor = np.linalg.cholesky(mass / (6 * pieces))
    return Shape(pieces, 1, np.linalg.inv(factor).T)


@lru_cache(maxsize=32)
def end_basis(shape: Shape, orders: int) -> tuple[Array, Array, Array]:
    """The end conditions, the integrals of orders 1 … `orders` at τ = 1, as E = R ᵀQ₁ᵀ.

    Returns:
        Q₁ (m, orders), R (orders, orders) and the null space Q₂ (m, m − orders), orthonormal.
    """
    ends = np.concatenate([shape.integral(j, np.ones(1)) for j in range(1, orders + 1)])
    q, r = np.linalg.qr(ends.T, mode="complete")
    return q[:, :orders], r[:orders], q[:, orders:]


@lru_cache(maxsize=128)
def node_rows(shape: Shape, order: int, orders: int) -> tuple[Array, Array]:
    """Rows of the `order`-fold integral at the inner nodes, on all and on the free coefficients."""
    rows = shape.integral(order, shape.breaks[1:-1])
    return rows, rows @ end_basis(shape, orders)[2]


def _ramp(tau: Array, knots: Array, power: int) -> Array:
    """(τ − knot)₊ᵖ/p!, shape (len(tau), len(knots))."""
    return np.asarray(np.maximum(tau[:, None] - knots, 0.0) ** power / factorial(power))


def _steps(tau: Array, order: int, pieces: int) -> Array:
    ramps = _ramp(tau, np.linspace(0, 1, pieces + 1), order)
    return np.asarray(ramps[:, :-1] - ramps[:, 1:])


def _hats(tau: Array, order: int, pieces: int) -> Array:
    ramps = _ramp(tau, np.linspace(0, 1, pieces + 1), order + 1) * pieces
    padded = np.concatenate([ramps[:, :1] * 0, ramps, ramps[:, :1] * 0], axis=1)
    hats = padded[:, :-2] - 2 * padded[:, 1:-1] + padded[:, 2:]
    hats[:, 0] = ramps[:, 1] - ramps[:, 0] + _ramp(tau, np.zeros(1), order)[:, 0]
    return np.asarray(hats)
