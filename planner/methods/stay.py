"""The plan of a problem whose goal is its start: the system stays there.

Staying is the cheapest and shortest motion, so no method needs to search.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.plan.measures import Objective
from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.support.calculus.bernstein import Bernstein
from planner.verification.verify import GOAL_TOLERANCE, verify

SHORTEST_S = 1e-3
"""Duration, s, of a plan that stays at the start if the duration is free. Collocation uses the same
number, in its natural unit of time, as the least duration."""

SAME_PLACE = GOAL_TOLERANCE / 20 * (1 + 1e-6)
"""Largest distance between goal and start, in radians or metres, at which both count as equal,
since verification could not distinguish the two."""


def plan_stay(problem: Problem, method: str, options: Any) -> Plan | None:
    """Return a plan that stays at the start if staying solves the problem, else None.

    Args:
        problem: The problem.
        method: Name of the method that the plan reports.
        options: Options that the plan reports.

    Returns:
        A plan with zero inputs over the given duration, or over `SHORTEST_S` (at most
        `duration_max`) if the duration is free. None if the goal is elsewhere, or staying breaks a
        requirement such as a waypoint.
    """
    away = np.abs(problem.goal - problem.start)
    if np.any(away > SAME_PLACE):  # NaN for a coordinate that the goal leaves free
        return None
    shortest = min(SHORTEST_S, problem.duration_max or SHORTEST_S)
    free, seconds = problem.duration is None, problem.duration or shortest
    breaks = np.array([0.0, seconds])
    q_curve = Bernstein(problem.start[None, None], breaks)
    still = StateTrajectory(problem.system, q_curve, Bernstein(np.zeros((1, 1, 2)), breaks))
    plan = Plan(
        problem=problem,
        method=method,
        options=options.model_dump(),
        trajectory=still,
        objective=seconds if free else 0.0,
        aim=Objective("time", {"duration": 1.0}) if free else Objective("effort", {"effort": 1.0}),
        notes={"start": "none: the start is the goal, and the plan stays there"},
    )
    return plan if verify(plan).ok else None
