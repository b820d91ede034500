"""The free numbers of the sinusoidal laws: how far z₁ swings, and how far it travels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.errors import SingularError
from planner.methods.search import search
from planner.methods.travel import candidate_travels
from planner.problem import Problem
from planner.schema.methods import SinusoidOptions, SinusoidStepsOptions
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory

_SIZES = np.geomspace(0.02, 4.0, 12)
"""Amplitudes scanned, over the size of the travel (over 1 where that is zero), with both signs."""

_TRAVELS = 24


@dataclass(frozen=True)
class Swing:
    """Free numbers of a sinusoidal law.

    Attributes:
        travel: z₁(T) − z₁(0).
        amplitude: a₁/ω or α/ω, in the unit of z₁; a common factor where steps have their own.
    """

    travel: float
    amplitude: float


def choose_swing(
    problem: Problem,
    make: Callable[[Swing], ChainedTrajectory],
    options: SinusoidOptions | SinusoidStepsOptions,
) -> tuple[Swing, dict[str, Any]]:
    """Travel and amplitude: the given ones, and the best by the criterion for what is left free.

    Where no choice stays inside the domain, the one that leaves it least is returned.

    Returns:
        The choice, and notes for the plan.

    Raises:
        InfeasibleError: If the travel is free and no one-way motion exists.
    """
    given = _given_amplitude(options)
    if problem.travel is not None and given is not None:
        return Swing(problem.travel, given), {}

    def read(x: Array) -> Swing:
        rest = iter(x.tolist())
        travel = next(rest) if problem.travel is None else problem.travel
        return Swing(travel, next(rest) if given is None else given)

    def attempt(x: Array) -> ChainedTrajectory | None:
        swing = read(x)
        if swing.amplitude == 0:
            return None
        try:
            return make(swing)
        except SingularError:
            return None

    grid, sizes = _grid(problem, given)
    found = search(problem, attempt, grid, sizes, options.criterion, starts=3)
    notes = {"auto_motions_tried": found.tried, "auto_found_inside": found.inside}
    return read(found.x), notes


def _given_amplitude(options: SinusoidOptions | SinusoidStepsOptions) -> float | None:
    if options.amplitude == "auto":
        return None
    return 1.0 if isinstance(options.amplitude, list) else float(options.amplitude)


def _grid(problem: Problem, given: float | None) -> tuple[Array, Array]:
    """Candidates (C, d) and the size of a first step from each."""
    if problem.travel is None:
        travels = candidate_travels(problem, _TRAVELS)
    else:
        travels = np.array([problem.travel])
    width = np.ptp(travels) / len(travels)
    rows, steps = [], []
    for travel in travels:
        sizes = _SIZES * (abs(travel) or 1.0)
        amplitudes = np.concatenate([-sizes, sizes]) if given is None else np.array([given])
        for amplitude in amplitudes:
            row = [travel] if problem.travel is None else []
            step = [width] if problem.travel is None else []
            rows.append(row + ([amplitude] if given is None else []))
            steps.append(step + ([0.3 * amplitude] if given is None else []))
    return np.array(rows), np.array(steps)
