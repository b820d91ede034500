"""Sinusoids step by step (Murray and Sastry, IEEE Trans. Automatic Control 38(5), 1993, §III).

First z₁ and z₂ go to their goals with constant v; then one period each of v₁ = α sin ωt,
v₂ = β cos kωt, for k = 1 … N−2, moves z_{k+2} to its goal by (2π/ω)(α/2ω)ᵏ β/k! and returns
z₁ … z_{k+1} to theirs.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.interpolate import BPoly

from planner.errors import InputError
from planner.methods.law import Ends, finish
from planner.methods.spectral import joined, period, propagate
from planner.methods.swing import Swing, choose_swing
from planner.pieces import Grid
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import SinusoidStepsOptions
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory

NAME = "sinusoid_steps"


@dataclass(frozen=True)
class StepsMotion:
    """A motion made step by step; see `steps`.

    Attributes:
        z: BPoly with values (N,).
        v: BPoly with values (2,).
        betas: β of every period, shape (N−2,).
        residual: Largest |zᵢ(T) − goalᵢ|, each over the largest |zᵢ| on the way (or 1).
    """

    z: BPoly
    v: BPoly
    betas: Array
    residual: float


def plan_sinusoid_steps(problem: Problem, options: SinusoidStepsOptions) -> Plan:
    """Steer z₁ and z₂ first, then one further coordinate a period.

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times; or if it does so for every
            amplitude and travel tried.
        InfeasibleError: If the travel is free and no one-way motion exists.
        InputError: If the lists of amplitudes or shares do not have one entry a step.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)
    periods = problem.system.size - 2
    shares = _shares(problem, options, periods)
    pattern = _pattern(problem, options, periods)

    def motion(swing: Swing) -> StepsMotion:
        amplitudes = swing.amplitude * pattern
        return steps(ends.start, ends.goal(swing.travel), amplitudes, shares * ends.duration)

    def make(swing: Swing) -> ChainedTrajectory:
        made = motion(swing)
        return ChainedTrajectory(problem.system, made.z, made.v, problem.branch)

    swing, notes = choose_swing(problem, make, options)
    made = motion(swing)
    notes |= {
        "amplitudes": (swing.amplitude * pattern).tolist(),
        "endpoint_residual": made.residual,
        "unit_betas": (made.betas * ends.duration).tolist(),
    }
    return finish(problem, NAME, options, make(swing), notes, began)


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
    curve = joined(z_curves)
    size = np.maximum(np.max(np.abs(curve.c), axis=(0, 1)), 1.0)
    residual = float(np.max(np.abs(z[-1, -1] - goal) / size))
    return StepsMotion(curve, joined(v_curves), np.array(betas), residual)


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
    """Amplitudes of the periods over the common one."""
    given = options.amplitude
    if not isinstance(given, list):
        return np.ones(periods)
    if len(given) != periods:
        raise InputError(
            f"{problem.source}: method.sinusoid_steps.amplitude has {len(given)} values; give one,"
            f" or one for each of {periods} periods"
        )
    return np.array(given)
