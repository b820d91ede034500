"""Enclose the true motion under a plan's input, one coordinate after the other.

A coordinate whose rate depends only on earlier coordinates is an integral of enclosed functions:
its errors add up and do not grow exponentially. Coordinates that depend on themselves or on each
other (trailers, some custom systems) are enclosed together, in a tube about a reference p that a
few Newton–Picard sweeps compute without proof. With P(t) = x(0) + ∫ f(p, t), and E = p − P bounded
by balls, the distance of the true motion x from P obeys, in the maximum norm of these coordinates,

    D⁺‖x − P‖ ≤ μ ‖x − P‖ + ‖J‖ ‖E‖,   μ = maxᵢ (Jᵢᵢ + Σ_{j≠i} |Jᵢⱼ|)

with the Jacobian J bounded over the tube. The result is valid only if the tube contains it
(continuation argument). On ellipses Picard's map X ↦ x(middle) + ∫ f(X, z) dz is applied to balls:
if it maps a ball into itself, the motion is analytic there and lies in the image (Schauder).
Source: G. Dahlquist's logarithmic norm, 1958; R. E. Moore, "Interval Analysis", 1966.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.plan.curves import Cells
from planner.plan.trajectory import Trajectory
from planner.support.arrays import Array
from planner.support.compiled_calls import Pointwise
from planner.systems.triangular_system import TriangularSystem
from planner.verification.balls import REAL_COLUMNS, Ball, Points, choose, models, polynomial_balls
from planner.verification.functions import Expression
from planner.verification.models import (
    INTEGRAL_BOUND,
    POINTS,
    ROUNDING_UNIT,
    Model,
    integration,
    interpolation,
    nodes,
)

TUBE_RADII = (1e-6, 1e-3)
"""Radii to try for the tube about the reference, in the coordinates' units."""

MOST_SWEEPS = 12
SWEEP_TOLERANCE = 1e-15
"""Change of the reference, in the coordinates' units, below which no further sweep is made."""

PICARD_IMAGES = 3
"""Number of times that Picard's map is applied to the balls of a block."""


@dataclass(frozen=True, eq=False)
class Enclosure:
    """An enclosure of the true motion by balls.

    Attributes:
        cells: C subintervals, in order of time.
        q: One ball per coordinate; empty if only the inputs are enclosed.
        u: The inputs as balls.
        rates: Balls of the coordinates' rates q̇, as far as they are enclosed.
    """

    cells: Cells
    q: list[Ball]
    u: list[Ball]
    rates: list[Ball] = field(default_factory=list)

    @cached_property
    def states(self) -> list[Model]:
        """Models of the coordinates: polynomials on the cells with bounds of their remainders."""
        return self.models(*self.q)

    def models(self, *values: Ball) -> list[Model]:
        """Convert balls of functions of the motion to models on the cells of the motion."""
        return models(values, len(self.cells.piece))


def enclose(path: Trajectory, cells: Cells, u: list[Ball], start: Array) -> Enclosure:
    """Enclose the true motion of a system from a start under given inputs.

    Args:
        path: A trajectory whose q(t) is near the motion; nothing else of it is used.
        cells: Cells in order of time, without gaps.
        u: The two inputs on the cells.
        start: q(0), shape (N,).
    """
    system, width = path.system, cells.width
    rates = rates_of(system)
    q: dict[int, Ball] = {}
    done: dict[object, Ball] = {}
    near, every = None, []
    for block in blocks(system):
        if not any(set(block) & rates.reads(i, 0) for i in block):
            balls = [full_ball(rates.entry(i, (q, u), done), cells) for i in block]
            q |= {i: integral(f, width, start[i]) for i, f in zip(block, balls, strict=True)}
        else:
            if near is None:
                near = _reference(system, cells, path.q(cells.times(nodes())), u, start)
            tubed, balls = _tube(system, block, cells, (q, u), near, start)
            q |= tubed
        every += balls
    return Enclosure(cells, [q[i] for i in range(system.size)], u, every)


def integral(f: Ball, width: Array, start: float) -> Ball:
    """Return the ball of start + ∫ f dt, integrated from the first cell to the last.

    On the real line the interpolant is integrated, and the errors of f add up. An integral
    is a sum of 16 products whose factors have errors of a few rounding units. In total, with the
    error of the width, these are at most 400 rounding units of the greatest value.
    """
    half, v = width / 2, f.points.c
    steps = v @ integration().T * half[:, None]
    most = np.max(np.abs(v), axis=1)
    wrong = INTEGRAL_BOUND * np.max(f.points.r, axis=1) + 2 * f.ellipses.remainder
    wrong = half * (wrong + 400 * ROUNDING_UNIT * most)
    left = start + np.append(0.0, np.cumsum(steps[:, -1])[:-1])
    slips = wrong + 2 * ROUNDING_UNIT * (np.abs(left) + np.abs(steps[:, -1]))
    doubt = wrong + 4 * ROUNDING_UNIT * np.abs(left)
    doubt = (doubt + np.append(0.0, np.cumsum(slips)[:-1]))[:, None] * (1 + 1e-12)
    places = left[:, None] + steps[:, :-1]
    points = Points(places[:, :-1], np.repeat(doubt, POINTS, 1))
    return Ball.join(points, f.ellipses.integral(half[:, None], places[:, -1:], doubt))


def full_ball(f: Ball, cells: Cells) -> Ball:
    """Return a ball with a row for each cell and all 25 columns; a constant ball is repeated."""
    shape = (len(cells.piece), len(REAL_COLUMNS))
    return f if f.c.shape == shape else Ball(*(np.broadcast_to(x, shape) for x in f))


@lru_cache(maxsize=32)
def rates_of(system: TriangularSystem) -> Expression:
    """Return the rates q̇ of a system as an expression in (q, u) that balls can evaluate."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    return Expression([q, u], ca.vertcat(*system.rates_expr(q, u)))


@lru_cache(maxsize=32)
def blocks(system: TriangularSystem) -> list[list[int]]:
    """Return blocks of mutually dependent coordinates, each before the blocks that depend on it."""
    rates, size = rates_of(system), system.size
    reach = np.eye(size, dtype=bool)
    for i in range(size):
        reach[i, list(rates.reads(i, 0))] = True
    for _ in range(size):
        reach = reach @ reach
    groups = {tuple(np.flatnonzero(reach[i] & reach[:, i]).tolist()) for i in range(size)}
    return [list(g) for g in sorted(groups, key=lambda g: (int(np.sum(reach[g[0]])), g))]


# -- coordinates that depend on themselves -----------------------------------------------------

Given = tuple[dict[int, Ball], list[Ball]]
"""Balls of the coordinates before a block, by index, and balls of the inputs."""


def _tube(
    system: TriangularSystem, block: list[int], cells: Cells, given: Given, ref: Array, start: Array
) -> tuple[dict[int, Ball], list[Ball]]:
    """Enclose coordinates that depend on each other in a tube about a reference motion.

    Args:
        system: The system that moves.
        block: Indices of the coordinates, which depend on themselves or on each other.
        cells: The cells.
        given: The enclosed functions on which the block depends.
        ref: The reference p at the nodes, shape (C, POINTS, N).
        start: q(0), shape (N,).

    Returns:
        Balls of the block's coordinates, by index, and balls of their rates at the reference.
    """
    (known, u), width = given, cells.width
    c = ref.transpose(2, 0, 1)[block] @ interpolation().T
    p = {i: Model(coefficients, 0 * width) for i, coefficients in zip(block, c, strict=True)}
    core = dict(zip(block, polynomial_balls(c, 0 * c[:, :, 0]), strict=True))
    image_rates = _rates(system, block, cells, known | core, u)
    integrals = [integral(f, width, start[i]) for i, f in zip(block, image_rates, strict=True)]
    images = models(integrals, len(width))
    gaps = [(image - p[i]).size for i, image in zip(block, images, strict=True)]
    error = np.max(gaps, axis=0)
    for most in TUBE_RADII:
        wide = {i: ball.widen(np.array([[most]])) for i, ball in core.items()}
        size, high = _growth(system, cells, known | wide, u, block)
        mu, norm = _logarithmic_norm(size, high, block), np.max(np.sum(size[block], axis=1), axis=0)
        radius = _error_bounds(mu, norm, error, width) + error
        if np.all(radius * (1 + 1e-12) < most):
            break
    inside = np.logical_and.accumulate(radius * (1 + 1e-12) < most)
    doubt = np.where(inside, radius * (1 + 1e-12), np.inf)[:, None]
    # The ball is the tube on real columns, and on ellipses a region that Picard's map proves, or
    # unbounded where the proof fails.
    half, signs = width[:, None] / 2, (-1.0) ** np.arange(POINTS // 2)
    out = {i: ball.widen(np.where(REAL_COLUMNS, doubt, np.inf)) for i, ball in core.items()}
    trial = {i: ball.widen(doubt + 0.2 * ball.reach) for i, ball in core.items()}
    for _ in range(PICARD_IMAGES):
        fits, regions = np.array([[True]]), []
        for i, f in zip(block, _rates(system, block, cells, known | trial, u), strict=True):
            middle, slip = p[i].c[:, ::2] @ signs, 2 * POINTS * ROUNDING_UNIT * p[i].norm
            regions.append(f.ellipses.integral(half, middle[:, None], doubt + slip[:, None]))
            fits = fits & regions[-1].lie_in(trial[i].ellipses)
        for i, new in zip(block, regions, strict=True):
            points = out[i].points
            out[i] = Ball.join(points, choose(fits, new, out[i].ellipses))
            trial[i] = Ball.join(points, new._replace(r=1.2 * new.r))
    return out, image_rates


def _rates(
    system: TriangularSystem, block: list[int], cells: Cells, q: dict[int, Ball], u: list[Ball]
) -> list[Ball]:
    done: dict[object, Ball] = {}
    return [full_ball(rates_of(system).entry(i, (q, u), done), cells) for i in block]


def _growth(
    system: TriangularSystem, cells: Cells, q: dict[int, Ball], u: list[Ball], block: list[int]
) -> tuple[Array, Array]:
    """Bound the Jacobian ∂q̇/∂q of a block of coordinates over each cell.

    Returns:
        Upper bounds of the entries' magnitudes, shape (N, N, C), and of the diagonal entries
        themselves, shape (N, C).
    """
    entries, row, column, _ = _jacobian(system)
    done: dict[object, Ball] = {}
    size = np.zeros((system.size, system.size, len(cells.piece)))
    diagonal = np.zeros(size.shape[1:])
    for k, (i, j) in enumerate(zip(row, column, strict=True)):
        if i in block and j in block:
            low, high = full_ball(entries.entry(k, (q, u), done), cells).range
            size[i, j] = np.maximum(np.abs(low), np.abs(high))
            if i == j:
                diagonal[i] = high
    return size, diagonal


def perturbed_motion(system: TriangularSystem, motion: Enclosure, off: Array) -> Enclosure:
    """Enclose the motions under all inputs that differ from the motion's by at most `off` (2,).

    With s the difference of the inputs and J from the widened coordinates, the distance δ obeys,
    block by block, ‖δ‖' ≤ μ ‖δ‖ + max (|J| |δ of earlier blocks| + |rates(q, s)|), since rates are
    linear in the inputs. At any fixed time the coordinates are those of the motion plus a constant,
    the value of δ there. So balls widened in all columns contain them, and functions evaluated on
    these balls are valid bounds.
    """
    cells, every = motion.cells, list(range(system.size))
    still = np.zeros((len(cells.piece), len(REAL_COLUMNS)))
    astray = [Ball(still, still, still + by) for by in off]
    for most in TUBE_RADII:
        wide = {i: ball.widen(np.array([[most]])) for i, ball in enumerate(motion.q)}
        size, high = _growth(system, cells, wide, motion.u, every)
        ranges = [f.range for f in _rates(system, every, cells, wide, astray)]
        push = np.array([np.maximum(np.abs(low), np.abs(up)) for low, up in ranges])
        far = np.zeros_like(push)
        for block in blocks(system):
            force = push[block] + np.einsum("ijc,jc->ic", size[block], far)
            mu = _logarithmic_norm(size, high, block)
            far[block] = _error_bounds(mu, np.ones_like(mu), np.max(force, axis=0), cells.width)
        if np.all(far < most):
            break
    inside = np.logical_and.accumulate(np.all(far < most, axis=0))
    far = np.where(inside, far, np.inf)
    q = [ball.widen(radius[:, None]) for ball, radius in zip(motion.q, far, strict=True)]
    return Enclosure(cells, q, motion.u, motion.rates)


def _logarithmic_norm(size: Array, high: Array, block: list[int]) -> Array:
    """Bound the logarithmic norm μ of the Jacobian of a block of coordinates on each cell, (C,).

    `size` and `high` are the two bounds by `_growth`.
    """
    off = size[block][:, block].copy()
    off[range(len(block)), range(len(block))] = high[block]
    return np.asarray(np.max(np.sum(off, axis=1), axis=0))


def _error_bounds(mu: Array, norm: Array, error: Array, width: Array) -> Array:
    """Bound a distance D that begins at 0 and obeys D' ≤ μ D + norm · error, on each cell, (C,).

    All arguments have one number per cell; `width` is the cells' duration, s.
    """
    most = np.exp(np.maximum(mu, 0.0) * width) * (1 + 1e-9)
    growth, pushed = np.exp(mu * width) * (1 + 1e-9), norm * error * width * most
    out, now = np.empty(len(mu)), 0.0
    for k in range(len(mu)):
        out[k] = most[k] * now + pushed[k]
        now = growth[k] * now + pushed[k]
    return out


@lru_cache(maxsize=32)
def _jacobian(system: TriangularSystem) -> tuple[Expression, Array, Array, Pointwise]:
    """Return the Jacobian ∂q̇/∂q of a system, as a function of (q, u), in two forms.

    Returns:
        Its nonzero entries as an expression for balls, their row and column indices, and the whole
        matrix as a function of points.
    """
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    matrix: Any = ca.jacobian(ca.vertcat(*system.rates_expr(q, u)), q)
    row, column = (np.array(x, dtype=int) for x in matrix.sparsity().get_triplet())
    return Expression([q, u], matrix.nz[:]), row, column, Pointwise("jacobian", [q, u], matrix)


def _reference(
    system: TriangularSystem, cells: Cells, guess: Array, u: list[Ball], start: Array
) -> Array:
    """Return a reference motion at the nodes, (C, POINTS, N), improved from a guess without proof.

    Each sweep uses Picard integrals within cells and Newton steps across cells.
    """
    inputs = np.stack([x.points.c for x in u], axis=-1)
    width, middle = cells.width, POINTS // 2
    flow = _change(_jacobian(system)[3](guess[:, middle], inputs[:, middle]), width)
    smallest = np.inf
    for _ in range(MOST_SWEEPS):
        new = _sweep(system, guess, inputs, width, flow, start)
        change = float(np.max(np.abs(new - guess)))
        if not change < smallest:
            break
        guess, smallest = new, change
        if change < SWEEP_TOLERANCE:
            break
    return guess


def _sweep(
    system: TriangularSystem, values: Array, inputs: Array, width: Array, flow: Array, start: Array
) -> Array:
    """Return the motion's values at the nodes, (C, POINTS, N), after one sweep of `_reference`.

    `flow` (C, N, N) maps a change at the left end of each cell to its growth up to the right end.
    """
    rates = system.rates(values, inputs) * (width[:, None, None] / 2)
    steps = np.einsum("mk,ckn->cmn", integration(), rates)
    signs = np.where(np.arange(POINTS) % 2 == 0, 1.0, -1.0)
    before = np.einsum("k,ckn->cn", signs @ interpolation(), values)
    starts, now = np.empty_like(before), start
    for k in range(len(values)):
        starts[k] = now
        now = now + steps[k, -1] + flow[k] @ (now - before[k])
    change = np.einsum("cij,cj->ci", flow, starts - before)
    share = (nodes() + 1) / 2
    return np.asarray(starts[:, None] + steps[:, :POINTS] + share[:, None] * change[:, None])


def _change(jacobian: Array, width: Array) -> Array:
    """Return an approximation of e^A − 1, (C, N, N), with A the Jacobian times the cell's width."""
    term = out = a = jacobian * width[:, None, None]
    for k in range(2, 8):
        term = term @ a / k
        out = out + term
    return np.asarray(out)
