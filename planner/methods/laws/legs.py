"""Motions of the chained form made of legs: v₁ constant and v₂ polynomial on each.

On such legs z is polynomial in time and its end is affine in the coefficients of v₂, so every law
that steers with them is one linear solve. v₂ is written in shifted Legendre polynomials on the
leg's own unit time, for which the system of eq. (27) becomes triangular and well scaled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np

from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, basis, elevate, integral


@dataclass(frozen=True)
class Leg:
    """One leg.

    Attributes:
        duration: Seconds.
        travel: Change of z₁ over the leg.
        terms: Number of coefficients of v₂ (its degree plus one).
    """

    duration: float
    travel: float
    terms: int


@dataclass(frozen=True)
class Point:
    """A constraint point: z₂(time_s) = value (eq. 28)."""

    time_s: float
    value: float


@dataclass(frozen=True)
class LegMotion:
    """The solved motion: z and v as piecewise polynomials, and how well the ends are met.

    Attributes:
        z: Bernstein with values (N,).
        v: Bernstein with values (2,).
        residual: Largest |zᵢ(T) − goalᵢ| of the solved motion, each relative to the largest |zᵢ|
            of the motion (or 1 if that is less).
        condition: Condition number of the scaled linear system.
    """

    z: Bernstein
    v: Bernstein
    residual: float
    condition: float


def steer(
    start: Array, goal: Array, legs: Sequence[Leg], points: Sequence[Point] = ()
) -> LegMotion:
    """Steer z from start to goal over the given legs, through the given points.

    With more coefficients than conditions, the solution has the least ∫(T v₂)².

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,); its first entry is the sum of the legs' travels.
        legs: In order.
        points: Conditions on z₂ at times within the legs.

    Raises:
        numpy.linalg.LinAlgError: If the conditions are dependent (two points at one time, or a
            leg without travel alone).
    """
    blocks = [_basis(leg.terms) / leg.duration for leg in legs]
    rows, offset = _conditions(start, legs, points, blocks)
    wanted = np.concatenate([goal[1:], [p.value for p in points]]) - offset
    scale = 1.0 / np.linalg.norm(rows, axis=1)
    matrix = rows * scale[:, None]
    condition = float(np.linalg.cond(matrix))
    if condition > 1e14:
        raise np.linalg.LinAlgError("conditions are dependent")
    orthogonal, triangular = np.linalg.qr(matrix.T)
    coefficients = orthogonal @ np.linalg.solve(triangular.T, wanted * scale)
    remainder = (wanted - rows @ coefficients) * scale
    coefficients += orthogonal @ np.linalg.solve(triangular.T, remainder)
    v, v2, at = [], [], 0
    for leg, block in zip(legs, blocks, strict=True):
        v2.append(coefficients[at : at + leg.terms] @ block)
        v.append(np.stack([np.full(leg.terms, leg.travel / leg.duration), v2[-1]], axis=1))
        at += leg.terms
    z = _propagate(start, legs, v2)
    curve = _stack(z, legs)
    size = np.maximum(np.max(np.abs(curve.c), axis=(0, 1)), 1.0)
    residual = float(np.max(np.abs(z[-1][-1] - goal) / size))
    return LegMotion(curve, _stack(v, legs), residual, condition)


@lru_cache(maxsize=64)
def _basis(terms: int) -> Array:
    """Bernstein coefficients, (terms, terms), of the orthonormal shifted Legendre polynomials."""
    out = np.zeros((terms, terms))
    for j in range(terms):
        own = np.array([(-1.0) ** (j + i) * comb(j, i) for i in range(j + 1)])
        out[j] = np.sqrt(2 * j + 1) * elevate(own, terms - 1)
    return out


def _propagate(start: Array, legs: Sequence[Leg], v2: Sequence[Array]) -> list[Array]:
    """Bernstein coefficients of z on every leg, each (degree+1, N, …), from start (N, …)."""
    out = []
    for leg, w in zip(legs, v2, strict=True):
        columns = [
            np.stack([start[0], start[0] + leg.travel]),
            start[1] + integral(w) * leg.duration,
        ]
        for i in range(2, len(start)):
            columns.append(start[i] + integral(columns[-1]) * leg.travel)
        degree = len(columns[-1]) - 1
        out.append(np.stack([elevate(c, degree) for c in columns], axis=1))
        start = out[-1][-1]
    return out


def _conditions(
    start: Array, legs: Sequence[Leg], points: Sequence[Point], blocks: Sequence[Array]
) -> tuple[Array, Array]:
    """The affine map coefficients → (z₂(T) … z_N(T), z₂ at the points): matrix and offset.

    All columns are propagated together: the first is the drift from `start`, each other one the
    response to a single coefficient.
    """
    total = sum(len(block) for block in blocks)
    v2, at = [], 1
    for block in blocks:
        own = np.zeros((block.shape[1], 1 + total))
        own[:, at : at + len(block)] = block.T
        v2.append(own)
        at += len(block)
    z = _propagate(np.concatenate([start[:, None], np.zeros((len(start), total))], 1), legs, v2)
    rows = np.concatenate([z[-1][-1, 1:], *(_z2_at(z, legs, p.time_s)[None] for p in points)])
    return rows[:, 1:], rows[:, 0]


def _z2_at(z: Sequence[Array], legs: Sequence[Leg], time: float) -> Array:
    """z₂ of every column at one time."""
    ends = np.cumsum([leg.duration for leg in legs])
    k = min(int(np.searchsorted(ends, time)), len(legs) - 1)
    x = 1 - (ends[k] - time) / legs[k].duration
    weights = basis(len(z[k]) - 1, np.array(x))
    return np.asarray(np.tensordot(weights, z[k][:, 1], axes=1))


def _stack(pieces: Sequence[Array], legs: Sequence[Leg]) -> Bernstein:
    degree = max(len(c) - 1 for c in pieces)
    breaks = np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])])
    return Bernstein(np.stack([elevate(c, degree) for c in pieces], axis=1), breaks)
