"""The true motion under a plan's input, enclosed: a polynomial and a proven radius on each cell.

A reference p close to the solution of x' = f(x, u) comes from a few Newton–Picard sweeps; nothing
is proven of it. With its Picard image P(t) = x(0) + ∫ f(p, u), of which model arithmetic knows
E = p − P to rounding, P' = f(p, u), and so the distance of the true motion from P obeys

    D⁺|xᵢ − Pᵢ| ≤ Jᵢᵢ |xᵢ − Pᵢ| + Σ_{j≠i} |Jᵢⱼ| |xⱼ − Pⱼ| + Σⱼ |Jᵢⱼ| |Eⱼ|

with the Jacobian J bounded entry by entry over a tube about p. Its structural zeros make the bound
triangular for the systems planned here: what the manipulator adds up are integrals, not
exponentials. The tube must contain the result, or nothing is claimed (continuation argument).
Source: G. Dahlquist's comparison lemma; R. E. Moore, "Interval Analysis", 1966, for the tube.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.certificate import series
from planner.certificate.cells import Cells
from planner.certificate.evaluate import Evaluator
from planner.certificate.model import UNIT, Model, interpolated
from planner.systems.base import Array, TriangularSystem
from planner.systems.pointwise import Pointwise

TUBES = (1e-6, 1e-3)
"""Radii of the tube tried, in the coordinates' units."""

SWEEPS = 12
SETTLED = 1e-15
"""Change by a sweep, in the coordinates' units, that is rounding."""

TAYLOR = 20
MOST_GROWTH = 8.0
"""Largest norm of J times the width of a cell for which its exponential is bounded."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the true motion is.

    Attributes:
        cells: C subintervals, in order of time.
        p: A polynomial a coordinate, no remainder.
        radius: The motion is nowhere further from p than this, shape (N, C); infinite where the
            proof did not go through.
        u: The inputs as models.
    """

    cells: Cells
    p: list[Model]
    radius: Array
    u: list[Model]

    @property
    def states(self) -> list[Model]:
        """Models of the coordinates of the true motion."""
        return [p.widened(r) for p, r in zip(self.p, self.radius, strict=True)]


def enclose(
    system: TriangularSystem, cells: Cells, guess: Array, u: list[Model], start: Array
) -> Motion:
    """Enclose the motion from a start under inputs given as models.

    Args:
        system: What moves.
        cells: In order of time, without gaps.
        guess: Coordinates near the motion at the cells' nodes, shape (C, WIDTH, N).
        u: The two inputs on the cells.
        start: q(0), shape (N,).
    """
    p = _reference(system, cells, guess, u, start)
    width = cells.width
    rates = rates_of(system)(p, u)
    image = [f.integral(width) for f in rates]
    image = [m.widened(3 * UNIT * m.size) for m in image]  # the widths' own rounding
    error = np.stack([_distance(p[i], image[i], start[i]) for i in range(system.size)])
    for tube in TUBES:
        radius = _transported(*_growth(system, p, u, tube), error, width) + error
        if np.all(radius * (1 + 1e-12) < tube):
            return Motion(cells, p, np.asarray(radius * (1 + 1e-12)), u)
    inside = np.logical_and.accumulate(np.all(radius * (1 + 1e-12) < tube, axis=0))
    return Motion(cells, p, np.where(inside, radius * (1 + 1e-12), np.inf), u)


@lru_cache(maxsize=32)
def rates_of(system: TriangularSystem) -> Evaluator:
    """q̇ of (q, u) on models."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    return Evaluator([q, u], ca.vertcat(*system.rates_expr(q, u)))


@lru_cache(maxsize=32)
def _jacobian(system: TriangularSystem) -> tuple[Evaluator, Array, Array, Pointwise]:
    """∂q̇/∂q: its nonzero entries on models, their rows and columns, and the whole at points."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    matrix: Any = ca.jacobian(ca.vertcat(*system.rates_expr(q, u)), q)
    row, column = (np.array(x, dtype=int) for x in matrix.sparsity().get_triplet())
    entries = Evaluator([q, u], matrix.nz[:]) if len(row) else Evaluator([q, u], ca.SX(0))
    return entries, row, column, Pointwise("jacobian", [q, u], matrix)


def _distance(p: Model, image: Model, start: float) -> Array:
    """Greatest |p − P| on each cell, where P is the start plus all increments so far."""
    step, slip = image.at_end()
    before = start + np.append(0.0, np.cumsum(step)[:-1])
    slips = np.append(0.0, np.cumsum(slip + 2 * UNIT * (np.abs(before) + np.abs(step)))[:-1])
    level = Model(before[:, None], slips * (1 + 1e-12) + UNIT * abs(start))
    return (p - image - level).size


def _growth(
    system: TriangularSystem, p: list[Model], u: list[Model], tube: float
) -> tuple[Array, Array]:
    """Bounds of ∂q̇/∂q over the tube: sizes (C, N, N), and the diagonal from above (C, N)."""
    entries, row, column, _ = _jacobian(system)
    cells = len(p[0].r)
    sizes = np.zeros((cells, system.size, system.size))
    diagonal = np.zeros((cells, system.size))
    if len(row):
        wide = [m.widened(np.full(cells, tube)) for m in p]
        for i, j, entry in zip(row, column, entries(wide, u), strict=True):
            sizes[:, i, j] = entry.size
            if i == j:
                diagonal[:, i] = entry.high
    return sizes, diagonal


def _transported(sizes: Array, diagonal: Array, error: Array, width: Array) -> Array:
    """Bounds (N, C) on |x − P| anywhere in each cell, by the comparison system cell after cell."""
    cells, size, _ = sizes.shape
    force = np.einsum("cij,jc->ci", sizes, error) * width[:, None]
    damping = np.maximum(np.max(-diagonal, axis=1), 0.0)
    coupling = sizes.copy()
    coupling[:, range(size), range(size)] = diagonal + damping[:, None]  # ≥ 0 in every entry
    within = coupling.copy()
    within[:, range(size), range(size)] = np.maximum(diagonal, 0.0)
    across = _exponential(coupling * width[:, None, None]) * np.exp(-damping * width)[:, None, None]
    most = _exponential(within * width[:, None, None])
    pushed = np.einsum("cij,cj->ci", most, force)
    out, now = np.empty((cells, size)), np.zeros(size)
    for k in range(cells):
        out[k] = most[k] @ now + pushed[k]
        now = across[k] @ now + pushed[k]
    return out.T * (1 + 1e-9)


def _exponential(matrix: Array) -> Array:
    """Upper bounds of e^A for A ≥ 0 (C, N, N); infinite where A is large."""
    norm = np.max(np.sum(matrix, axis=1), axis=1)
    usable = norm <= MOST_GROWTH
    a = np.where(usable[:, None, None], matrix, 0.0)
    term = np.broadcast_to(np.eye(a.shape[1]), a.shape)
    total = term.copy()
    for k in range(1, TAYLOR + 1):
        term = term @ a / k
        total = total + term
    last = np.sum(term, axis=(1, 2)) * norm / (TAYLOR + 1) / (1 - MOST_GROWTH / (TAYLOR + 2))
    total = total * (1 + 1e-13) + np.where(usable, last, 0.0)[:, None, None]
    return np.where(usable[:, None, None], total, np.inf)


def _reference(
    system: TriangularSystem, cells: Cells, guess: Array, u: list[Model], start: Array
) -> list[Model]:
    """Polynomials near the motion: Picard's integral in each cell, Newton's step across them."""
    values, width = guess, cells.width
    inputs = np.stack([m.at_nodes() for m in u], axis=-1)
    middle = series.WIDTH // 2
    local = _jacobian(system)[3](values[:, middle], inputs[:, middle])
    flow = _change(local * width[:, None, None])
    best, smallest = values, np.inf
    for _ in range(SWEEPS):
        new = _swept(system, values, inputs, width, flow, start)
        moved = float(np.max(np.abs(new - values)))
        if not moved < smallest:
            break
        values = best = new
        smallest = moved
        if moved < SETTLED:
            break
    return [Model(interpolated(best[:, :, i]), np.zeros(len(best))) for i in range(system.size)]


def _swept(
    system: TriangularSystem, values: Array, inputs: Array, width: Array, flow: Array, start: Array
) -> Array:
    """One sweep; `flow` (C, N, N) is how a change at a cell's left end grows across it."""
    inner, whole, left = _quadrature()
    rates = system.rates(values, inputs) * (width[:, None, None] / 2)
    inside = np.einsum("mk,ckn->cmn", inner, rates)
    step = np.einsum("k,ckn->cn", whole, rates)
    before = np.einsum("k,ckn->cn", left, values)
    at, now = np.empty_like(before), start
    for k in range(len(values)):
        at[k] = now
        now = now + step[k] + flow[k] @ (now - before[k])
    change = np.einsum("cij,cj->ci", flow, at - before)
    share = (series.nodes() + 1) / 2
    return np.asarray(at[:, None] + inside + share[None, :, None] * change[:, None])


@lru_cache(maxsize=1)
def _quadrature() -> tuple[Array, Array, Array]:
    """From values at the nodes: the integral from −1 to each, that to 1, and the value at −1."""
    antiderivative = series.integral(series.WIDTH) @ series.interpolation()
    signs = np.where(np.arange(series.WIDTH) % 2 == 0, 1.0, -1.0)
    inner = series.evaluation(series.WIDTH + 1) @ antiderivative
    return inner, np.sum(antiderivative, axis=0), signs @ series.interpolation()


def _change(a: Array) -> Array:
    """About e^A − 1, for A (C, N, N)."""
    term = out = a
    for k in range(2, 8):
        term = term @ a / k
        out = out + term
    return np.asarray(out)
