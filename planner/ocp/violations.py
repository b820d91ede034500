"""What an iterate breaks, in words: its rows evaluated anew, its limits judged by `verify`."""

from __future__ import annotations

import numpy as np

from planner.errors import Violation
from planner.ocp.solver import ACCEPTED_RESIDUAL, Solution, excess
from planner.ocp.task import Task
from planner.plan import Plan
from planner.verify import verify


def broken_rows(task: Task, solution: Solution) -> list[Violation]:
    """Labelled rows out of bounds, one violation a label at its worst time, worst first.

    The iterate may solve another task, which asks for less time.
    """
    data, made = task.bounds, task.made
    shape = (made.form.intervals, made.height)
    values = task.rows(solution.iterate)
    over = excess(values, data.row_lower, data.row_upper).reshape(shape)
    values, low = values.reshape(shape), data.row_lower.reshape(shape)
    high = data.row_upper.reshape(shape)
    out = []
    for rows in made.labels:
        k, j = np.unravel_index(np.argmax(over[:, rows.positions]), (shape[0], len(rows.tau)))
        at = (k, rows.first + j)
        if over[at] <= ACCEPTED_RESIDUAL:
            continue
        time = float(task.mesh.at(rows.tau)[k, j] * solution.iterate.duration)
        limit = low[at] if values[at] < low[at] else high[at]
        scaled = float(over[at]) / rows.scale
        out.append(Violation(rows.label, time, float(values[at]), float(limit), rows.unit, scaled))
    return sorted(out, key=lambda v: -v.scaled)


def broken_limits(task: Task, solution: Solution) -> list[Violation]:
    """Limits of the task's problem that an iterate's motion breaks, worst first, by `verify`.

    The iterate may solve another task: one without a limit, or one that takes more time.
    """
    motion = Plan(task.problem, "collocation", {}, task.curve(solution.iterate))
    return [v for v in verify(motion).violations if not v.label.startswith(NO_LIMITS)]


NO_LIMITS = ("start", "goal", "duration", "plan's")
"""What the labels of requirements that are no limits begin with."""
