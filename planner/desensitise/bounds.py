"""A task's numbers in the shape of its programme: bounds on unknowns and rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.systems.base import Array

if TYPE_CHECKING:
    from planner.desensitise.task import Task

SHORTEST_S = 1e-3
"""Least duration that a free one may take, in seconds."""

MOST_DRAWN_IN = 0.1
"""Largest share of a joint limit by which it is drawn in between the nodes."""


def unknown_bounds(task: Task) -> tuple[Array, Array]:
    """Lower and upper bounds of the unknowns; ends, and a given duration, are fixed."""
    p, problem, N = task.program, task.problem, task.problem.system.size
    upper = np.full(p.size, np.inf)
    upper[p.inputs] = problem.limits.input
    limited = np.isin(np.arange(N), problem.system.limited)
    upper[p.points[:, :, :N]] = np.where(limited, _joint_limits(task), np.inf)
    lower = -upper
    lower[0] = SHORTEST_S
    if task.direction:
        (lower if task.direction > 0 else upper)[p.inputs[:, 0]] = 0.0
    first = np.asarray(p.made.initial(task.sigma), dtype=float).ravel()
    fixed = [(p.states[0], np.concatenate([problem.start, first]))]
    fixed += [(p.states[-1, :N], problem.target)]
    fixed += [(np.zeros(1, int), np.array([problem.duration or np.nan]))]
    fixed += [(p.inputs[[0, -1]].ravel(), np.zeros(4))] if task.rest else []
    for where, values in fixed:
        known = ~np.isnan(values)
        lower[where[known]] = upper[where[known]] = values[known]
    return lower, upper


def row_bounds(task: Task) -> tuple[Array, Array]:
    """Lower and upper bounds of the rows; those of the motion itself are zero."""
    kinds, limits = task.program.kinds, task.problem.limits
    low, high = np.zeros(len(kinds)), np.zeros(len(kinds))
    low[-1], high[-1] = -np.inf, task.effort_limit
    for i in range(2):
        rows = kinds == f"rate {i}"
        low[rows], high[rows] = -limits.input_rate[i], limits.input_rate[i]
    rows = np.flatnonzero(kinds == "z2")
    low[rows], high[rows] = (limits.z2_margin or 0.0) + task.drawn.z2, np.inf
    if len(rows) and not task.backoff:
        low[rows[-1]] = -np.inf  # the goal itself, which the problem's check has judged
    rows = np.char.startswith(kinds, "obstacle")
    low[rows], high[rows] = task.drawn.obstacle, np.inf
    joint = _joint_limits(task)
    for i in task.program.shape.joints:
        above, below = kinds == f"joint+ {i}", kinds == f"joint- {i}"
        low[above], high[above] = -np.inf, joint[i]
        low[below], high[below] = -joint[i], np.inf
    return low, high


def _joint_limits(task: Task) -> Array:
    joint = task.problem.limits.joint
    drawn = np.array(task.drawn.joint or np.zeros(len(joint)))
    return np.asarray(joint - np.minimum(drawn, MOST_DRAWN_IN * joint))
