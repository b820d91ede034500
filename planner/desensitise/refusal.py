"""What is refused before the search, and what an iterate breaks after it, in words."""

from __future__ import annotations

import numpy as np

from planner.chained import chained_form
from planner.desensitise.augmented import DEGREES
from planner.desensitise.bounds import row_bounds
from planner.desensitise.task import ACCEPTED_RESIDUAL, Solution, Task
from planner.errors import InfeasibleError, NotConvergedError, Violation
from planner.problem import Problem
from planner.reachability import travel_window


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


def refuse_waypoints(problem: Problem) -> None:
    """Raise NotConvergedError for a problem with waypoints, unknown to the programme."""
    if problem.waypoints:
        raise NotConvergedError(
            f"{problem.source}: desensitised plans do not pass waypoints",
            advice="the method 'collocation', which does; or leave out the waypoints",
        )


def refuse_one_way(problem: Problem) -> None:
    """Raise InfeasibleError where no one-way motion exists."""
    window = travel_window(problem)
    if window is None:
        return
    if window.empty:
        reason = window.reason
    elif problem.travel is not None and problem.travel not in window:
        reason = (
            f"one-way motions travel between {window.low:.5g} and {window.high:.5g} rad, not"
            f" {problem.travel:.5g}"
        )
    else:
        return
    raise InfeasibleError(
        f"{problem.source}: no one-way motion exists: {reason}",
        advice="method.desensitised.reversal = true",
    )


def refuse_no_room(task: Task) -> None:
    """Raise InfeasibleError where the start has no room to back off.

    There the spread is the design's own, so that no path helps.
    """
    if not task.backoff:
        return
    problem, N = task.problem, task.problem.system.size
    q0, sigma = problem.start, task.sigma
    x = np.concatenate([q0, np.asarray(task.program.made.initial(sigma)).ravel()])
    W = np.asarray(task.program.made.response(x, 0.0, sigma, q0)) / DEGREES
    rooms = [
        (problem.system.coordinates[i].name, problem.limits.joint[i] - abs(q0[i]), W[i])
        for i in problem.system.limited
    ]
    if problem.limits.z2_margin is not None:
        form, h = chained_form(problem.system), 1e-6
        slope = np.array([form.z(q0 + h * e)[1] - form.z(q0 - h * e)[1] for e in np.eye(N)])
        z2 = problem.z2_sign * form.z(q0)[1]
        rooms.append(("z2", float(z2) - problem.limits.z2_margin, slope / (2 * h) @ W))
    for name, room, response in rooms:
        needed = task.backoff * float(np.linalg.norm(response))
        if needed > room:
            raise InfeasibleError(
                f"{problem.source}: method.desensitised.backoff = {task.backoff:g} needs"
                f" {needed:.4g} of room to the limit on {name} and the start has {room:.4g}",
                advice=f"method.desensitised.backoff = {task.backoff * room / needed * 0.99:.3g}"
                f" or less, or a wider limit on {name}",
            )
