"""What is made least: a weighted sum of the duration and of each input's square integral."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.problem import Problem
from planner.schema.methods import CollocationOptions
from planner.systems.base import Array

TIME_REGULARISATION = 0.01
"""Weight of the scaled effort beside the duration when time is the objective. The scaled effort is
at most twice the duration, so the duration found is within 2 % of the least."""


@dataclass(frozen=True, eq=False)
class Objective:
    """A weighted sum.

    Attributes:
        kind: "effort", "time" or "mixed".
        name: In words.
        weights: Of T and of each ∫uᵢ² dt, shape (3,).
    """

    kind: str
    name: str
    weights: Array


def objective(problem: Problem, options: CollocationOptions) -> Objective:
    """The objective asked for, or the one that suits the problem.

    Raises:
        InputError: If effort alone is to be least with a free duration (its least value is reached
            by no finite duration), or time alone with an input that has no limit.
    """
    kind: str = options.objective
    limited = bool(np.all(np.isfinite(problem.limits.input)))
    if kind == "auto":
        free = "time" if limited else "mixed"
        kind = "effort" if problem.duration is not None else free
    if kind == "effort":
        if problem.duration is None:
            raise InputError(
                f"{problem.source}: objective 'effort' with goal.duration = \"free\" has no least"
                " value (slower is always less effort); use objective 'time' or 'mixed', or give"
                " goal.duration"
            )
        return Objective("effort", "effort: integral of u1^2 + u2^2 dt", np.array([0.0, 1.0, 1.0]))
    if kind == "time":
        if not limited:
            raise InputError(
                f"{problem.source}: objective 'time' needs a limit on both inputs, but the [limits]"
                " table has none; without one the least duration is zero"
            )
        return fastest(problem)
    weight = options.effort_weight
    return Objective(
        "mixed",
        f"mixed: duration + {weight:g} x integral of u1^2 + u2^2 dt",
        np.array([1.0, weight, weight]),
    )


def fastest(problem: Problem) -> Objective:
    """Least duration, with a small weight on the effort, which settles what time leaves open."""
    limit = problem.limits.input
    weights = TIME_REGULARISATION / np.where(np.isfinite(limit), limit, 1.0) ** 2
    return Objective(
        "time",
        f"time: duration + {weights[0]:.4g} x integral of u1^2 dt"
        f" + {weights[1]:.4g} x integral of u2^2 dt",
        np.array([1.0, *weights]),
    )


def shortest_path(objective: Objective) -> Objective:
    """What a path is judged by before its timing: the effort, inputs weighed as the objective does.

    The systems are driftless. At a fixed duration without limits on inputs, least effort gives the
    path of least length in the metric of the inputs, whatever the duration is.
    """
    inputs = objective.weights[1:]
    return Objective("effort", "effort", np.array([0.0, *(inputs / np.mean(inputs))]))
