"""What is made least: a weighted sum of duration, effort, smoothness and closeness to edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support.arrays import Array

TIME_REGULARISATION = 0.01
"""Weight of the scaled effort beside the duration when time is the objective. The scaled effort is
at most twice the duration, so the duration found is within 2 % of the least."""


EDGE_REGULARISATION = 0.01
"""Weight of the effort beside the closeness to the domain's edge when that is the objective; the
closeness alone would be left at infinite speed."""


@dataclass(frozen=True, eq=False)
class Objective:
    """A weighted sum.

    Attributes:
        kind: "effort", "smooth", "edge", "time" or "mixed".
        name: In words.
        weights: Of T, of each ∫uᵢ² dt, of each ∫(duᵢ/dt)² dt, and of the mean closeness to the
            domain's edge (see `edges`), shape (6,).
    """

    kind: str
    name: str
    weights: Array

    @property
    def smooth(self) -> bool:
        """Whether it needs inputs without jumps."""
        return bool(self.weights[3:5].any())

    @property
    def edge(self) -> bool:
        """Whether the closeness to the domain's edge is part of it."""
        return bool(self.weights[5])


def objective(problem: Problem, options: CollocationOptions) -> Objective:
    """The objective asked for, or the one that suits the problem.

    Raises:
        InputError: If what is to be least has no least value with a free duration (slower is always
            better), or time is to be least with an input that has no limit.
    """
    kind: str = options.objective
    limited = bool(np.all(np.isfinite(problem.limits.input)))
    if kind == "auto":
        free = "time" if limited else "mixed"
        kind = "effort" if problem.duration is not None else free
    if kind in _FIXED_TIME:
        name, weights, why = _FIXED_TIME[kind]
        if problem.duration is None:
            raise InputError(
                f"{problem.source}: objective '{kind}' with goal.duration = \"free\" has no least"
                f" value ({why}); use objective 'time' or 'mixed', or give goal.duration"
            )
        return Objective(kind, name, np.array(weights))
    if kind == "time":
        if not limited:
            raise InputError(
                f"{problem.source}: objective 'time' needs a limit on both inputs, but the [limits]"
                " table has none; without one the least duration is zero"
            )
        return fastest(problem)
    return _mixed(options)


_EFFORT, _SMOOTH = "integral of u1^2 + u2^2 dt", "integral of (du1/dt)^2 + (du2/dt)^2 dt"
_EDGE = "mean closeness to the domain's edge"
_SLOWER = "slower is always less"
_FIXED_TIME: dict[str, tuple[str, list[float], str]] = {
    "effort": (f"effort: {_EFFORT}", [0.0, 1.0, 1.0, 0.0, 0.0, 0.0], _SLOWER),
    "smooth": (f"smooth: {_SMOOTH}", [0.0, 0.0, 0.0, 1.0, 1.0, 0.0], _SLOWER),
    "edge": (
        f"edge: {_EDGE} + {EDGE_REGULARISATION:g} x {_EFFORT}",
        [0.0, EDGE_REGULARISATION, EDGE_REGULARISATION, 0.0, 0.0, 1.0],
        "a long stay far from the edge is always less",
    ),
}


def _mixed(options: CollocationOptions) -> Objective:
    parts = [
        (options.effort_weight, _EFFORT, [0.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
        (options.smoothness_weight, _SMOOTH, [0.0, 0.0, 0.0, 1.0, 1.0, 0.0]),
        (options.edge_weight, _EDGE, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    ]
    terms = [f"{weight:g} x {name}" for weight, name, _ in parts if weight > 0]
    weights = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    weights += sum(weight * np.array(which) for weight, _, which in parts)
    return Objective("mixed", "mixed: duration + " + " + ".join(terms), weights)


def fastest(problem: Problem) -> Objective:
    """Least duration, with a small weight on the effort, which settles what time leaves open."""
    weights = TIME_REGULARISATION / problem.limits.input_scale**2
    return Objective(
        "time",
        f"time: duration + {weights[0]:.4g} x integral of u1^2 dt"
        f" + {weights[1]:.4g} x integral of u2^2 dt",
        np.array([1.0, *weights, 0.0, 0.0, 0.0]),
    )


def shortest_path(objective: Objective) -> Objective:
    """What a path is judged by before its timing: the effort, inputs weighed as the objective does.

    The systems are driftless. At a fixed duration without limits on inputs, least effort gives the
    path of least length in the metric of the inputs, whatever the duration is.
    """
    inputs = objective.weights[1:3]
    inputs = inputs / np.mean(inputs) if np.any(inputs) else np.ones(2)
    return Objective("effort", "effort", np.array([0.0, *inputs, 0.0, 0.0, 0.0]))
