"""Motions of the chained form made of legs, each with constant v₁ and polynomial v₂.

On a leg z is polynomial in time and its end is affine in the coefficients of v₂, so every law
made of legs is one linear solve. v₂ is written in shifted Legendre polynomials on the
leg's own unit time, for which the system of eq. (27) becomes triangular and well scaled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np

from planner.methods.laws.law import Ends, Motion, solve_conditions
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, basis, elevate, integral


@dataclass(frozen=True)
class Leg:
    """One leg of a motion: constant v₁, and a polynomial v₂ whose coefficients are sought.

    Attributes:
        duration: Duration of the leg, s.
        travel: Change of z₁ over the leg, for all candidates or for each of C, (C,).
        terms: Number of coefficients of v₂ (its degree plus one).
    """

    duration: float
    travel: float | Array
    terms: int


@dataclass(frozen=True)
class Point:
    """A constraint point z₂(time_s) = value (eq. 28); `value` is (C,) for C candidates."""

    time_s: float
    value: float | Array


def even_legs(ends: Ends, reach: float | Array, count: int, terms: int) -> list[Leg]:
    """Return `count` equal legs over the travel; for travel zero, `count` out and `count` back.

    The reach is the travel or, with travel zero, the total travel of the legs out.
    """
    if ends.problem.travel != 0:
        return [Leg(ends.duration / count, reach / count, terms)] * count
    out = Leg(ends.duration / 2 / count, reach / count, terms)
    back = Leg(ends.duration / 2 / count, -reach / count, terms)
    return [out] * count + [back] * count


def steer(start: Array, goal: Array, legs: Sequence[Leg], points: Sequence[Point] = ()) -> Motion:
    """Find the motion of z from start to goal over the given legs, through the given points.

    With more coefficients than conditions, the solution has the least ∫(T v₂)².

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,), or (C, N) of C candidates; the first entry is the sum of the legs'
            travels.
        legs: The legs in order.
        points: Conditions on z₂ at times within the legs.

    Raises:
        numpy.linalg.LinAlgError: If the conditions of a single motion are dependent (two points at
            one time, or one leg without travel). Among C candidates such a motion is NaN.
    """
    blocks = [_basis(leg.terms) / leg.duration for leg in legs]
    goals = np.atleast_2d(goal)
    rows, drift = _conditions(start, legs, points, blocks)
    values = [np.broadcast_to(p.value, len(goals))[:, None] for p in points]
    targets = np.concatenate([goals[:, 1:], *values], axis=1)
    coefficients, condition = solve_conditions(rows, targets - drift)
    v, v2, first = [], [], 0
    for leg, block in zip(legs, blocks, strict=True):
        v2.append(block.T @ coefficients[:, first : first + leg.terms].T)
        v1 = np.broadcast_to(leg.travel / leg.duration, v2[-1].shape)
        v.append(np.stack([v1, v2[-1]], axis=-1))
        first += leg.terms
    z = [np.moveaxis(c, 1, -1) for c in _propagate(start[:, None], legs, v2)]
    return Motion.of(_stack(z, legs), _stack(v, legs), coefficients, condition, goal)


@lru_cache(maxsize=64)
def _basis(terms: int) -> Array:
    """Return orthonormal shifted Legendre polynomials as rows of Bernstein coefficients."""
    out = np.zeros((terms, terms))
    for j in range(terms):
        coefficients = np.array([(-1.0) ** (j + i) * comb(j, i) for i in range(j + 1)])
        out[j] = np.sqrt(2 * j + 1) * elevate(coefficients, terms - 1)
    return out


def _propagate(start: Array, legs: Sequence[Leg], v2: Sequence[Array]) -> list[Array]:
    """Integrate z over all legs; return Bernstein coefficients (degree+1, N, …, C) for each leg."""
    out = []
    for leg, w in zip(legs, v2, strict=True):
        columns = [
            np.stack(np.broadcast_arrays(start[0], start[0] + leg.travel)),
            start[1] + integral(w) * leg.duration,
        ]
        for i in range(2, len(start)):
            columns.append(start[i] + integral(columns[-1]) * leg.travel)
        degree = len(columns[-1]) - 1
        shape = columns[-1].shape[1:]
        raised = [elevate(c, degree) for c in columns]
        out.append(np.stack([np.broadcast_to(c, (degree + 1, *shape)) for c in raised], axis=1))
        start = out[-1][-1]
    return out


def _conditions(
    start: Array, legs: Sequence[Leg], points: Sequence[Point], blocks: Sequence[Array]
) -> tuple[Array, Array]:
    """Return A (C, m, k), b (C, m): A · coefficients + b is z₂(T) … z_N(T), then z₂ at the points.

    All columns are integrated together: the first is the drift from `start`, each other column the
    response to a single coefficient.
    """
    total = sum(len(block) for block in blocks)
    v2, first = [], 1
    for block in blocks:
        coefficients = np.zeros((block.shape[1], 1 + total, 1))
        coefficients[:, first : first + len(block), 0] = block.T
        v2.append(coefficients)
        first += len(block)
    columns = np.zeros((len(start), 1 + total, 1))
    columns[:, 0, 0] = start
    z = _propagate(columns, legs, v2)
    at_points = [_z2_at(z, legs, p.time_s)[None] for p in points]
    rows = np.moveaxis(np.concatenate([z[-1][-1, 1:], *at_points]), -1, 0)
    return rows[..., 1:], rows[..., 0]


def _z2_at(z: Sequence[Array], legs: Sequence[Leg], time: float) -> Array:
    """Return z₂ at one time for every column of z, given by Bernstein coefficients on each leg."""
    ends = np.cumsum([leg.duration for leg in legs])
    k = min(int(np.searchsorted(ends, time)), len(legs) - 1)
    x = 1 - (ends[k] - time) / legs[k].duration
    weights = basis(len(z[k]) - 1, np.array(x))
    return np.asarray(np.tensordot(weights, z[k][:, 1], axes=1))


def _stack(pieces: Sequence[Array], legs: Sequence[Leg]) -> Bernstein:
    degree = max(len(c) - 1 for c in pieces)
    breaks = np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])])
    return Bernstein(np.stack([elevate(c, degree) for c in pieces], axis=1), breaks)
