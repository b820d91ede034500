"""Sinusoids all at once: one period of v₁ = a₀ + a₁ sin ωt, v₂ = Σ bⱼ cos jωt, ω = 2π/T.

Tilbury, Murray and Sastry, "Trajectory generation for the N-trailer problem using Goursat normal
form", IEEE Trans. Automatic Control 40(5), 1995. z(T) is affine in b: one linear solve (theory.md
§4). It needs no second leg when z₁(0) = z₁(T).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from planner.errors import SingularError
from planner.methods.law import Ends, finish
from planner.methods.spectral import period, propagate
from planner.methods.swing import Swing, choose_swing
from planner.pieces import Grid
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import SinusoidOptions
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory

NAME = "sinusoid"


@dataclass(frozen=True)
class SinusoidMotion:
    """A solved motion; see `sinusoids`.

    Attributes:
        grid: Pieces and points.
        z: Values at the points, shape (P, D+1, N).
        v: The same for v, shape (P, D+1, 2).
        b: Coefficients of v₂, shape (N−1,).
        residual: Largest |zᵢ(T) − goalᵢ|, each over the largest |zᵢ| on the way (or 1).
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
        InfeasibleError: If the travel is free and no one-way motion exists.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)

    def make(swing: Swing) -> ChainedTrajectory:
        return _trajectory(problem, _motion(ends, swing))

    swing, notes = choose_swing(problem, make, options)
    motion = _motion(ends, swing)
    omega = 2 * np.pi / ends.duration
    notes |= {
        "amplitude": swing.amplitude,
        "endpoint_residual": motion.residual,
        "condition_number": motion.condition,
        "unit_period": {
            "a": [swing.travel, float(swing.amplitude * omega * ends.duration)],
            "b": (motion.b * ends.duration).tolist(),
        },
    }
    return finish(problem, NAME, options, _trajectory(problem, motion), notes, began)


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


def _motion(ends: Ends, swing: Swing) -> SinusoidMotion:
    try:
        return sinusoids(ends.start, ends.goal(swing.travel), swing.amplitude, ends.duration)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{ends.problem.source}: amplitude {swing.amplitude:g} with travel {swing.travel:g}"
            " leaves the sinusoids' coefficients undetermined",
            advice="another method.sinusoid.amplitude",
        ) from None


def _trajectory(problem: Problem, motion: SinusoidMotion) -> ChainedTrajectory:
    z, v = motion.grid.curve(motion.z), motion.grid.curve(motion.v)
    return ChainedTrajectory(problem.system, z, v, problem.branch)
