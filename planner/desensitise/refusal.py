"""What is refused before the search, and what an iterate breaks after it, in words."""

from __future__ import annotations

import numpy as np

from planner.chained import chained_form
from planner.errors import InfeasibleError, NotConvergedError
from planner.ocp.task import Task
from planner.problem import Problem
from planner.reachability import travel_window


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


def refuse_no_room(job: Task) -> None:
    """Raise InfeasibleError where the start has no room to back off.

    There the spread is the design's own, so that no path helps.
    """
    problem, moved = job.problem, job.made.form.augmented
    if moved is None or not moved.backoff:
        return
    start, N = job.made.start(problem), problem.system.size
    W = moved.response(start)
    rooms = [
        (problem.system.coordinates[i].name, problem.limits.joint[i] - abs(start[i]), W[i])
        for i in problem.system.limited
    ]
    if problem.limits.z2_margin is not None:
        form, q, h = chained_form(problem.system), problem.start, 1e-6
        slope = (form.z(q + h * np.eye(N)) - form.z(q - h * np.eye(N)))[:, 1] / (2 * h)
        z2 = problem.z2_sign * form.z(q)[1]
        rooms.append(("z2", float(z2) - problem.limits.z2_margin, slope @ W))
    for name, room, response in rooms:
        needed = moved.backoff * float(np.linalg.norm(response))
        if needed > room:
            raise InfeasibleError(
                f"{problem.source}: method.desensitised.backoff = {moved.backoff:g} needs"
                f" {needed:.4g} of room to the limit on {name} and the start has {room:.4g}",
                advice=f"method.desensitised.backoff = {moved.backoff * room / needed * 0.99:.3g}"
                f" or less, or a wider limit on {name}",
            )
