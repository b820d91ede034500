"""The plan of a problem whose start is its goal: it stays.

No motion costs less and none is shorter, so that no method needs to search for one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.support.calculus.bernstein import Bernstein
from planner.verification.verify import GOAL_TOLERANCE, verify

SHORTEST_S = 1e-3
"""Duration of a plan that stays where the problem leaves the duration free, seconds; in its natural
units the least that collocation plans with, too."""

SAME_PLACE = GOAL_TOLERANCE / 20 * (1 + 1e-6)
"""Largest distance of a goal from the start, in radians or metres, that asks for no motion: the
judge could not tell the two apart."""


def plan_stay(problem: Problem, method: str, options: Any) -> Plan | None:
    """A plan that stays at the start; None where that is not what the problem asks for.

    Args:
        problem: What is asked.
        method: The name of the method whose plan it is.
        options: Its options.

    Returns:
        A plan with zero inputs, for the duration given, or for the least where it is free. None if
        the goal is elsewhere, or staying breaks something, such as a waypoint elsewhere.
    """
    away = np.abs(problem.target - problem.start)
    if np.any(away > SAME_PLACE):  # NaN where the goal leaves a coordinate free
        return None
    free, seconds = problem.duration is None, problem.duration or SHORTEST_S
    breaks = np.array([0.0, seconds])
    still = StateTrajectory(
        problem.system,
        Bernstein(problem.start[None, None], breaks),
        Bernstein(np.zeros((1, 1, 2)), breaks),
    )
    plan = Plan(
        problem=problem,
        method=method,
        options=options.model_dump(),
        trajectory=still,
        objective=seconds if free else 0.0,
        objective_name="time: duration" if free else "effort: integral of u1^2 + u2^2 dt",
        notes={"start": "none: the start is the goal, and the plan stays there"},
    )
    return plan if verify(plan).ok else None
