"""The least time a problem's input limits allow: a bound that no plan of any method can beat.

Every joint's rate is its gear constant times cosines times an input, so |θ̇₁| ≤ max|u₂|,
|θ̇ᵢ| ≤ k_g Kᵢ max|u₁| and |φ̇| ≤ k_g max|u₁| (eq. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InfeasibleError
from planner.problem import Problem
from planner.systems.manipulator import Manipulator


@dataclass(frozen=True)
class DurationBound:
    """Seconds below which no plan exists, and why; zero when nothing bounds it."""

    seconds: float
    reason: str


def least_duration(problem: Problem) -> DurationBound:
    """The bound, from the coordinate that needs the most time at its top rate.

    It is necessary, not sufficient: a plan may need longer.
    """
    distance = np.abs(problem.goal - problem.start)
    distance[0] = abs(problem.travel or 0.0)
    rates = _top_rates(problem)
    needed = distance / rates
    i = int(np.argmax(needed))
    coordinate, unit = problem.system.coordinates[i], problem.system.coordinates[i].unit
    reason = (
        f"{coordinate.name} must move {_shown(distance[i], unit)} and moves at most"
        f" {_shown(rates[i], unit)}/s within the input limits"
    )
    return DurationBound(float(needed[i]), reason if needed[i] > 0 else "")


def why_too_short(problem: Problem) -> str | None:
    """Why no plan of any kind keeps the duration, in words; None where nothing shows that."""
    bound = least_duration(problem)
    if problem.duration is None or problem.duration >= bound.seconds * (1 - 1e-9):
        return None
    return (
        f"no plan of any kind exists: {bound.reason}, which takes {bound.seconds:.4g} s;"
        f" goal.duration is {problem.duration:.4g} s"
    )


def refuse_too_short(problem: Problem) -> None:
    """Refuse a duration that no plan can keep, before any method tries.

    Raises:
        InfeasibleError: With the coordinate that proves it.
    """
    if why := why_too_short(problem):
        raise InfeasibleError(
            f"{problem.source}: {why}",
            advice='goal.duration = "free", which finds the time needed; or wider input limits',
        )


def _top_rates(problem: Problem) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Largest |q̇|, shape (N,), infinite where unknown."""
    rates = np.full(problem.system.size, np.inf)
    u1, u2 = problem.limits.input
    rates[1] = u2
    if isinstance(problem.system, Manipulator):
        rates[0] = problem.system.k_g * u1
        rates[2:] = problem.system.k_g * problem.system.K * u1
    return rates


def _shown(value: float, unit: str) -> str:
    return f"{np.rad2deg(value):.4g} deg" if unit == "rad" else f"{value:.4g} {unit}"
