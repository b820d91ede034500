"""Sinusoids all at once: one period of v₁ = a₀ + a₁ sin ωt, v₂ = Σ bⱼ cos jωt, ω = 2π/T.

Tilbury, Murray and Sastry, "Trajectory generation for the N-trailer problem using Goursat normal
form", IEEE Trans. Automatic Control 40(5), 1995. z(T) is affine in b: one linear solve (theory.md
§4). It needs no second leg when z₁(0) = z₁(T).

Sinusoids step by step (Murray and Sastry, IEEE Trans. Automatic Control 38(5), 1993, §III).

First z₁ and z₂ go to their goals with constant v; then one period each of v₁ = α sin ωt,
v₂ = β cos kωt, for k = 1 … N−2, moves z_{k+2} to its goal by (2π/ω)(α/2ω)ᵏ β/k! and returns
z₁ … z_{k+1} to theirs.

Motions of the chained form under sinusoids are computed to rounding error: the pieces of time are
so short that the interpolation error of the highest harmonic is below rounding.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import factorial, pi

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import choose_swing
from planner.methods.laws.law import Ends, finish
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory
from planner.problem.problem import Problem
from planner.problem.tables.method_options import SinusoidOptions, SinusoidStepsOptions
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.chebyshev import Grid

SINUSOID = "sinusoid"


@dataclass(frozen=True)
class SinusoidMotion:
    """A solved motion; see `sinusoids`.

    Attributes:
        grid: Pieces and points.
        z: Values at the points, shape (P, D+1, N).
        v: Values of v at the points, shape (P, D+1, 2).
        b: Coefficients of v₂, shape (N−1,).
        residual: Largest |zᵢ(T) − goalᵢ|, each relative to the largest |zᵢ| of the motion (or 1).
        condition: Condition number of the scaled linear system.
    """

    grid: Grid
    z: Array
    v: Array
    b: Array
    residual: float
    condition: float


def plan_sinusoid(problem: Problem, options: SinusoidOptions) -> Plan:
    """Steer with one period of sinusoids, all coordinates at once.

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times; or if it does so for every
            amplitude and travel tried.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)

    def make(travel: float, amplitude: float) -> ChainedTrajectory:
        return _trajectory(problem, _motion(ends, travel, amplitude))

    travel, amplitude, notes = choose_swing(problem, make, options)
    motion = _motion(ends, travel, amplitude)
    omega = 2 * np.pi / ends.duration
    notes |= {
        "amplitude": amplitude,
        "endpoint_residual": motion.residual,
        "condition_number": motion.condition,
        "unit_period": {
            "a": [travel, float(amplitude * omega * ends.duration)],
            "b": (motion.b * ends.duration).tolist(),
        },
    }
    return finish(problem, SINUSOID, options, _trajectory(problem, motion), notes, began)


def sinusoids(start: Array, goal: Array, amplitude: float, duration: float) -> SinusoidMotion:
    """Steer z from start to goal by one period.

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,).
        amplitude: a₁/ω, not zero.
        duration: T, seconds.

    Raises:
        numpy.linalg.LinAlgError: If z(T) does not fix b (amplitude zero, or one of the few ratios
            of amplitude to travel for which the system is singular).
    """
    m, omega = len(start) - 1, 2 * np.pi / duration
    grid = period(0.0, duration, 2 * m - 2)
    t = grid.times
    v1 = (goal[0] - start[0]) / duration + amplitude * omega * np.sin(omega * t)
    basis = np.cos(omega * t[..., None] * np.arange(m)) / duration
    # Column 0 is the drift from the start; the others are responses to one coefficient each.
    begin = np.concatenate([start[:, None], np.zeros((m + 1, m))], axis=1)
    columns = propagate(grid, begin, v1, np.concatenate([np.zeros_like(t)[..., None], basis], 2))
    rows, drift = columns[-1, -1, 1:, 1:], columns[-1, -1, 1:, 0]
    scale = np.linalg.norm(rows, axis=1)
    if np.any(scale == 0):
        raise np.linalg.LinAlgError("a coordinate does not move")
    scale = 1.0 / scale
    matrix = rows * scale[:, None]
    condition = float(np.linalg.cond(matrix))
    if not condition < 1e14:
        raise np.linalg.LinAlgError("the coefficients are not determined")
    b = np.linalg.solve(matrix, (goal[1:] - drift) * scale)
    b += np.linalg.solve(matrix, (goal[1:] - drift - rows @ b) * scale)
    v = np.stack([v1, basis @ b], axis=-1)
    z = columns[..., 0] + columns[..., 1:] @ b
    z[..., 0] = columns[..., 0, 0]
    size = np.maximum(np.max(np.abs(z), axis=(0, 1)), 1.0)
    residual = float(np.max(np.abs(z[-1, -1] - goal) / size))
    return SinusoidMotion(grid, z, v, b / duration, residual, condition)


def _motion(ends: Ends, travel: float, amplitude: float) -> SinusoidMotion:
    try:
        return sinusoids(ends.start, ends.goal(travel), amplitude, ends.duration)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{ends.problem.source}: amplitude {amplitude:g} with travel {travel:g}"
            f" {ends.problem.system.coordinates[0].unit} leaves the sinusoids'"
            " coefficients undetermined",
            advice="another method.sinusoid.amplitude",
        ) from None


def _trajectory(problem: Problem, motion: SinusoidMotion) -> ChainedTrajectory:
    z, v = motion.grid.curve(motion.z), motion.grid.curve(motion.v)
    return ChainedTrajectory(problem.system, z, v, problem.branch)


SINUSOID_STEPS = "sinusoid_steps"


@dataclass(frozen=True)
class StepsMotion:
    """A motion made step by step; see `steps`.

    Attributes:
        z: Bernstein with values (N,).
        v: Bernstein with values (2,).
        betas: β of every period, shape (N−2,).
        residual: Largest |zᵢ(T) − goalᵢ|, each over the largest |zᵢ| on the way (or 1).
    """

    z: Bernstein
    v: Bernstein
    betas: Array
    residual: float


def plan_sinusoid_steps(problem: Problem, options: SinusoidStepsOptions) -> Plan:
    """Steer z₁ and z₂ first, then one further coordinate a period.

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times; or if it does so for every
            amplitude and travel tried.
        InputError: If the lists of amplitudes or shares do not have one entry a step.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)
    periods = problem.system.size - 2
    shares = _shares(problem, options, periods)
    pattern = _pattern(problem, options, periods)

    def motion(travel: float, amplitude: float) -> StepsMotion:
        amplitudes = amplitude * pattern
        return steps(ends.start, ends.goal(travel), amplitudes, shares * ends.duration)

    def make(travel: float, amplitude: float) -> ChainedTrajectory:
        made = motion(travel, amplitude)
        return ChainedTrajectory(problem.system, made.z, made.v, problem.branch)

    travel, amplitude, notes = choose_swing(problem, make, options)
    made = motion(travel, amplitude)
    notes |= {
        "amplitudes": (amplitude * pattern).tolist(),
        "endpoint_residual": made.residual,
        "unit_betas": (made.betas * ends.duration).tolist(),
    }
    return finish(problem, SINUSOID_STEPS, options, make(travel, amplitude), notes, began)


def steps(start: Array, goal: Array, amplitudes: Array, durations: Array) -> StepsMotion:
    """Steer z from start to goal step by step.

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,).
        amplitudes: α/ω of each period, shape (N−2,), none zero.
        durations: Seconds of the first leg and of each period, shape (N−1,).
    """
    edges = np.concatenate([[0.0], np.cumsum(durations)])
    grid = Grid(edges[:2])
    constant = np.ones_like(grid.times)
    rates = (goal[:2] - start[:2]) / durations[0]
    v1, v2 = rates[0] * constant, rates[1] * constant
    z = propagate(grid, start, v1, v2)
    z_curves, v_curves, betas = [grid.curve(z)], [grid.curve(np.stack([v1, v2], -1))], []
    for k, amplitude in enumerate(amplitudes, start=1):
        here = z[-1, -1]
        omega = 2 * np.pi / durations[k]
        grid = period(edges[k], edges[k + 1], 2 * len(start) - 4)
        phase = omega * (grid.times - edges[k])
        v1 = amplitude * omega * np.sin(phase)
        per_beta = durations[k] * (amplitude / 2) ** k / factorial(k)
        beta = (goal[k + 1] - here[k + 1]) / per_beta
        v2 = beta * np.cos(k * phase)
        z = propagate(grid, here, v1, v2)
        betas.append(beta)
        z_curves.append(grid.curve(z))
        v_curves.append(grid.curve(np.stack([v1, v2], -1)))
    curve = joined_curves(z_curves)
    size = np.maximum(np.max(np.abs(curve.c), axis=(0, 1)), 1.0)
    residual = float(np.max(np.abs(z[-1, -1] - goal) / size))
    return StepsMotion(curve, joined_curves(v_curves), np.array(betas), residual)


def _shares(problem: Problem, options: SinusoidStepsOptions, periods: int) -> Array:
    given = options.shares
    if given is not None and len(given) != periods + 1:
        raise InputError(
            f"{problem.source}: method.sinusoid_steps.shares has {len(given)} parts; give"
            f" {periods + 1}: the first leg and {periods} periods"
        )
    shares = np.ones(periods + 1) if given is None else np.array(given)
    return np.asarray(shares / np.sum(shares))


def _pattern(problem: Problem, options: SinusoidStepsOptions, periods: int) -> Array:
    """Amplitudes of the periods relative to the common one."""
    given = options.amplitude
    if not isinstance(given, list):
        return np.ones(periods)
    if len(given) != periods:
        raise InputError(
            f"{problem.source}: method.sinusoid_steps.amplitude has {len(given)} values; give one,"
            f" or one for each of {periods} periods"
        )
    return np.array(given)


_PHASE = 2.4
"""Phase of the highest harmonic on one piece, rad: with h half of it, the interpolant of degree 14
has a relative error of 2 (h/2)¹⁵/15! = 7e-16."""


def period(start: float, end: float, harmonics: int) -> Grid:
    """Equal pieces over one period, fine enough for functions of that many harmonics."""
    pieces = max(4, int(np.ceil(2 * pi * harmonics / _PHASE)))
    return Grid(np.linspace(start, end, pieces + 1))


def propagate(grid: Grid, start: Array, v1: Array, v2: Array) -> Array:
    """Values of z at the grid's points.

    Args:
        grid: Pieces and points.
        start: z at the first break, shape (N, …).
        v1: Values of v₁, shape (P, DEGREE+1).
        v2: Values of v₂, shape (P, DEGREE+1, …).

    Returns:
        Shape (P, DEGREE+1, N, …).
    """
    first = v1.reshape(*v1.shape, *[1] * (v2.ndim - 2))
    path = grid.integral(first)
    columns = [start[0] + np.broadcast_to(path, v2.shape), start[1] + grid.integral(v2)]
    for i in range(2, len(start)):
        columns.append(start[i] + grid.integral(columns[-1] * first))
    return np.stack(columns, axis=2)


def joined_curves(curves: list[Bernstein]) -> Bernstein:
    """Join curves of one degree that follow each other in time."""
    breaks = np.concatenate([curves[0].x[:1], *(c.x[1:] for c in curves)])
    return Bernstein(np.concatenate([c.c for c in curves], axis=1), breaks)
