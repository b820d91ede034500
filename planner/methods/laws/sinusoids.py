"""Two laws with sinusoidal inputs, which steer coordinates all at once or step by step.

All at once: one period of v₁ = a₀ + a₁ sin ωt, v₂ = Σ bⱼ cos jωt, with ω = 2π/T. z(T) is affine in
b, so b follows from one linear solve (theory.md §4). No second leg is needed when z₁(0) = z₁(T).
Source: Tilbury, Murray and Sastry, "Trajectory generation for the N-trailer problem using Goursat
normal form", IEEE Trans. Automatic Control 40(5), 1995.

Step by step: first z₁ and z₂ go to their goals with constant v. Then, for each k = 1 … N−2, one
period of v₁ = α sin ωt, v₂ = β cos kωt moves z_{k+2} by (2π/ω)(α/2ω)ᵏ β/k! to its goal, while
z₁ … z_{k+1} end the period where each began it. Source: Murray and Sastry, IEEE Trans. Automatic
Control 38(5), 1993, §III.

Motions of the chained form under sinusoids are computed to rounding error: time is cut into pieces
so short that the interpolation error of the highest harmonic is below rounding.
"""

from __future__ import annotations

import time
from math import factorial, pi

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import choose_swing
from planner.methods.laws.law import Ends, Motion, finish, solve_conditions
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import SinusoidOptions, SinusoidStepsOptions
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.chebyshev import Grid

SINUSOID = "sinusoid"


def plan_sinusoid(problem: Problem, options: SinusoidOptions) -> Plan:
    """Plan with one period of sinusoids, which steers all coordinates at once.

    Raises:
        SingularError: If start and goal are not in one branch of the chart; if the best motion
            found leaves the chart's domain (unless `options.allow_singular`) at the times that
            the error gives; or if the amplitude leaves the coefficients undetermined.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)

    def law(travel: float | Array, amplitude: float | Array) -> Motion:
        return sinusoids(ends.start, ends.goal(travel), amplitude, ends.duration)

    travel, amplitude, notes = choose_swing(problem, law, options)
    try:
        motion = law(travel, amplitude)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"amplitude {amplitude:g} with travel {travel:g}"
            f" {ends.problem.system.coordinates[0].unit} does not determine the coefficients of the"
            " sinusoids",
            source=problem.source,
            advice="another method.sinusoid.amplitude",
        ) from None
    notes |= {
        "amplitude": amplitude,
        **motion.summary,
        "unit_period": {
            "a": [travel, 2 * np.pi * amplitude],
            "b": (motion.coefficients * ends.duration).tolist(),
        },
    }
    return finish(problem, SINUSOID, options, ends.trajectory(motion), notes, began)


def sinusoids(start: Array, goal: Array, amplitude: float | Array, duration: float) -> Motion:
    """Find the motion of z from start to goal by one period of sinusoids.

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,), or (C, N) of C candidates.
        amplitude: a₁/ω, not zero; shape (C,) for candidates.
        duration: T, seconds.

    Returns:
        The motion; its coefficients are b, the amplitudes of the cosines in v₂.

    Raises:
        numpy.linalg.LinAlgError: If z(T) of a single motion does not fix b (amplitude zero, or one
            of the few ratios of amplitude to travel for which the system is singular).
    """
    m, omega, goals = len(start) - 1, 2 * np.pi / duration, np.atleast_2d(goal)
    grid = period(0.0, duration, 2 * m - 2)
    t = grid.times[..., None]
    v1 = (goals[:, 0] - start[0]) / duration + amplitude * omega * np.sin(omega * t)
    basis = np.cos(omega * t * np.arange(m)) / duration
    # Column 0 is the drift from the start; the others are responses to one coefficient each.
    begin = np.concatenate([start[:, None], np.zeros((m + 1, m))], axis=1)[..., None]
    columns = propagate(grid, begin, v1, np.concatenate([0 * t, basis], axis=2)[..., None])
    ends = np.moveaxis(columns[-1, -1, 1:], -1, 0)
    b, condition = solve_conditions(ends[..., 1:], goals[:, 1:] - ends[..., 0])
    z = columns[:, :, :, 0] + np.einsum("pdnkc,ck->pdnc", columns[:, :, :, 1:], b)
    z[:, :, 0] = columns[:, :, 0, 0]
    v = np.stack([v1, basis @ b.T], axis=-1)
    curve = grid.curve(np.swapaxes(z, 2, 3))
    return Motion.of(curve, grid.curve(v), b / duration, condition, goal)


SINUSOID_STEPS = "sinusoid_steps"


def plan_sinusoid_steps(problem: Problem, options: SinusoidStepsOptions) -> Plan:
    """Plan in steps: first z₁ and z₂, then one further coordinate in each period of sinusoids.

    Raises:
        SingularError: If start and goal are not in one branch of the chart, or the best motion
            found leaves the chart's domain (unless `options.allow_singular`) at the times that
            the error gives.
        InputError: If `amplitude` is a list without one entry for each period, or `shares` lacks
            one entry for the first leg and each period.
    """
    began = time.perf_counter()
    ends = Ends.of(problem)
    periods = problem.system.size - 2
    shares = _shares(problem, options, periods)
    pattern = _pattern(problem, options, periods)

    def law(travel: float | Array, amplitude: float | Array) -> Motion:
        amplitudes = np.multiply.outer(pattern, amplitude)
        return steps(ends.start, ends.goal(travel), amplitudes, shares * ends.duration)

    travel, amplitude, notes = choose_swing(problem, law, options)
    motion = law(travel, amplitude)
    notes |= {
        "amplitudes": (amplitude * pattern).tolist(),
        "endpoint_residual": motion.summary["endpoint_residual"],
        "unit_betas": (motion.coefficients * ends.duration).tolist(),
    }
    return finish(problem, SINUSOID_STEPS, options, ends.trajectory(motion), notes, began)


def steps(start: Array, goal: Array, amplitudes: Array, durations: Array) -> Motion:
    """Find the motion of z from start to goal step by step, one coordinate in each period.

    Args:
        start: z(0), shape (N,).
        goal: z(T), shape (N,), or (C, N) of C candidates.
        amplitudes: α/ω of each period, shape (N−2,) or (N−2, C), all different from zero.
        durations: Seconds of the first leg and of each period, shape (N−1,).

    Returns:
        The motion; its coefficients are β of every period.
    """
    edges = np.concatenate([[0.0], np.cumsum(durations)])
    goals = np.atleast_2d(goal).T
    grid = Grid(edges[:2])
    v1, v2 = ((goals[:2] - start[:2, None]) / durations[0])[:, None, None] + 0 * grid.times[
        ..., None
    ]
    here, betas, z_curves, v_curves = start[:, None], [], [], []
    for k, amplitude in enumerate([None, *amplitudes]):
        if k:
            omega = 2 * np.pi / durations[k]
            grid = period(edges[k], edges[k + 1], 2 * len(start) - 4)
            phase = omega * (grid.times - edges[k])[..., None]
            v1 = amplitude * omega * np.sin(phase)
            per_beta = durations[k] * (amplitude / 2) ** k / factorial(k)
            betas.append((goals[k + 1] - here[k + 1]) / per_beta)
            v2 = betas[-1] * np.cos(k * phase)
        z = propagate(grid, here, v1, v2)
        here = z[-1, -1]
        z_curves.append(grid.curve(np.swapaxes(z, 2, 3)))
        v_curves.append(grid.curve(np.stack([v1, v2], axis=-1)))
    curves, none = (joined_curves(z_curves), joined_curves(v_curves)), np.zeros(goals.shape[1])
    return Motion.of(*curves, np.stack(betas, axis=-1), none, goal)


def _shares(problem: Problem, options: SinusoidStepsOptions, periods: int) -> Array:
    given = options.shares
    if given is not None and len(given) != periods + 1:
        raise InputError(
            f"method.sinusoid_steps.shares has {len(given)} parts; give"
            f" {periods + 1}: the first leg and {periods} periods",
            source=problem.source,
        )
    shares = np.ones(periods + 1) if given is None else np.array(given)
    return np.asarray(shares / np.sum(shares))


def _pattern(problem: Problem, options: SinusoidStepsOptions, periods: int) -> Array:
    """Return the ratio of each period's amplitude to the common amplitude, shape (N−2,)."""
    amplitude = options.amplitude
    if not isinstance(amplitude, list):
        return np.ones(periods)
    if len(amplitude) != periods:
        raise InputError(
            f"method.sinusoid_steps.amplitude has {len(amplitude)} values; give"
            f" one, or one for each of {periods} periods",
            source=problem.source,
        )
    return np.array(amplitude)


_PHASE = 2.4
"""Phase of the highest harmonic on one piece, rad: with h half of the phase, the interpolant of
degree 14 has a relative error of 2 (h/2)¹⁵/15! = 7e-16."""


def period(start: float, end: float, harmonics: int) -> Grid:
    """Return a grid of equal pieces over one period, fine enough for a number of harmonics."""
    pieces = max(4, int(np.ceil(2 * pi * harmonics / _PHASE)))
    return Grid(np.linspace(start, end, pieces + 1))


def propagate(grid: Grid, start: Array, v1: Array, v2: Array) -> Array:
    """Integrate the chained form under inputs v; return the values of z at the grid's points.

    Args:
        grid: P pieces of time with DEGREE+1 points each.
        start: z at the first break, shape (N, …, C).
        v1: Values of v₁ of C candidates, shape (P, DEGREE+1, C).
        v2: Values of v₂, shape (P, DEGREE+1, …, C).

    Returns:
        Values of z, shape (P, DEGREE+1, N, …, C).

    Raises:
        TimeUpError: If time is up.
    """
    first = v1.reshape(*v1.shape[:2], *[1] * (v2.ndim - 3), -1)
    columns = [start[0] + grid.integral(first), start[1] + grid.integral(v2)]
    for i in range(2, len(start)):
        deadline.check()
        columns.append(start[i] + grid.integral(columns[-1] * first))
    return np.stack(np.broadcast_arrays(*columns), axis=2)


def joined_curves(curves: list[Bernstein]) -> Bernstein:
    """Join curves of the same degree, each of which begins where the curve before ends in time."""
    breaks = np.concatenate([curves[0].x[:1], *(c.x[1:] for c in curves)])
    return Bernstein(np.concatenate([c.c for c in curves], axis=1), breaks)
