"""What an iterate breaks, in words: computed from its rows, never taken from the solver."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.chained import chained_form
from planner.errors import Violation
from planner.ocp.solver import ACCEPTED_RESIDUAL, Solution, excess
from planner.ocp.stage import rate_unit
from planner.ocp.task import Task
from planner.systems.base import Array

MISSED = 1e-3
"""Distance between samples at which a waypoint counts as missed, in the coordinates' units."""


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
    """Limits of the task's problem that an iterate's motion breaks, worst first.

    The iterate may solve another task: one without a limit, or one that takes more time.
    """
    out = [
        *_inputs(task, solution),
        *_joints(task, solution),
        *_chart(task, solution),
        *_places(task, solution),
    ]
    return sorted(out, key=lambda v: -v.scaled)


def _inputs(task: Task, solution: Solution) -> list[Violation]:
    left, right = solution.iterate.input_ends()
    ends = np.stack([left, right], axis=1).reshape(-1, 2)
    edges = task.mesh.edges * solution.iterate.duration
    times = np.stack([edges[:-1], edges[1:]], axis=1).ravel()
    slopes = np.abs(right - left) / np.diff(edges)[:, None]
    limits, out = task.problem.limits, []
    for i, named in enumerate(task.problem.system.inputs):
        values = np.abs(ends[:, i])
        out += _worst(f"input {named.name}", times, values, limits.input[i], named.unit)
        label = f"rate of input {named.name}"
        out += _worst(label, edges[:-1], slopes[:, i], limits.input_rate[i], rate_unit(named.unit))
    return out


def _joints(task: Task, solution: Solution) -> list[Violation]:
    motion = task.motion(solution.iterate)
    times = motion.fractions.ravel() * solution.iterate.duration
    states = motion.states.reshape(len(times), -1)
    out = []
    for i in task.problem.system.limited:
        named = task.problem.system.coordinates[i]
        values, limit = np.abs(states[:, i]), task.problem.limits.joint[i]
        out += _worst(f"joint {named.name}", times, values, limit, named.unit)
    return out


def _chart(task: Task, solution: Solution) -> list[Violation]:
    margin = task.problem.limits.z2_margin
    if margin is None:
        return []
    motion = task.motion(solution.iterate)
    times = motion.fractions.ravel() * solution.iterate.duration
    z = chained_form(task.problem.system).z(motion.states)[:, :, 1].ravel()
    values = task.problem.z2_sign * z
    k = int(np.argmin(values))
    if values[k] >= margin - ACCEPTED_RESIDUAL:
        return []
    value, scale = float(values[k]), max(margin, 1e-3)
    return [Violation("z2 margin", float(times[k]), value, margin, "", (margin - value) / scale)]


def _places(task: Task, solution: Solution) -> list[Violation]:
    """Waypoints missed, and discs that links reach into."""
    system: Any = task.problem.system
    motion = task.motion(solution.iterate)
    times = motion.fractions.ravel() * solution.iterate.duration
    states = motion.states.reshape(len(times), -1)
    out = []
    for point in task.problem.waypoints:
        away = point.distance(states)
        if point.time_s is not None:
            away = np.where(
                np.arange(len(times)) == np.argmin(abs(times - point.time_s)), away, 9e9
            )
        k = int(np.argmin(away))
        if away[k] > MISSED:
            value = float(away[k])
            out.append(Violation(point.label, float(times[k]), value, 0.0, "rad", value))
    for disc in task.problem.obstacles:
        clear = disc.clearances(system.arm_points(states[:, 1:]))
        for link, values in enumerate(clear.T, 1):
            k = int(np.argmin(values))
            if values[k] < -ACCEPTED_RESIDUAL:
                value = float(values[k])
                scaled = -value / disc.radius
                out.append(Violation(disc.label(link), float(times[k]), value, 0.0, "m", scaled))
    return out


def _worst(label: str, times: Array, values: Array, limit: float, unit: str) -> list[Violation]:
    k = int(np.argmax(values))
    value = float(values[k])
    if not value > limit * (1 + ACCEPTED_RESIDUAL):
        return []
    return [Violation(label, float(times[k]), value, float(limit), unit, value / limit - 1)]
