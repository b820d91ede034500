"""What an iterate breaks, in words: from its rows, evaluated anew."""

from __future__ import annotations

import numpy as np

from planner.desensitise.bounds import row_bounds
from planner.desensitise.task import ACCEPTED_RESIDUAL, Solution, Task
from planner.errors import Violation


def broken(task: Task, solution: Solution) -> list[Violation]:
    """Rows out of their bounds, the worst of each kind, worst first by relative excess."""
    low, high = row_bounds(task)
    values = np.asarray(task.program.rows(solution.vector, task.parameters)).ravel()
    over = np.nan_to_num(np.maximum(low - values, values - high), nan=np.inf)
    kinds = task.program.kinds
    height = (len(kinds) - 1) // len(task.mesh.widths)
    out = []
    for kind in dict.fromkeys(kinds.tolist()):
        rows = np.flatnonzero(kinds == kind)
        k = int(rows[np.argmax(over[rows])])
        if over[k] <= ACCEPTED_RESIDUAL:
            continue
        time = None
        if kind != "effort":
            time = float(task.mesh.edges[k // height] * solution.vector[0])
        limit = float(low[k] if values[k] < low[k] else high[k])
        scaled = float(over[k]) / max(abs(limit), 1e-2)
        label, unit = _words(task, kind)
        out.append(Violation(label, time, float(values[k]), limit, unit, scaled))
    return sorted(out, key=lambda v: -v.scaled)


def _words(task: Task, kind: str) -> tuple[str, str]:
    system = task.problem.system
    word, _, index = kind.partition(" ")
    backed = f" with {task.backoff:g} standard deviations of back-off" if task.backoff else ""
    if word.startswith("joint"):
        coordinate = system.coordinates[int(index)]
        return f"joint {coordinate.name}{backed}", coordinate.unit
    if word == "obstacle":
        disc, link = (int(k) for k in index.split("."))
        return task.problem.obstacles[disc].label(link), "m"
    if word == "rate":
        return f"rate of input {system.inputs[int(index)].name}", ""
    return {"motion": "motion", "z2": f"z2 margin{backed}", "effort": "effort"}[word], ""
