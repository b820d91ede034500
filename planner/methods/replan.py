"""Collocation once more, for a neighbouring problem: the plan at hand is the first guess."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from planner import deadline
from planner.errors import InputError
from planner.methods.collocation import (
    SEARCHED,
    collocation_task,
    finished,
    plan_collocation,
)
from planner.methods.collocation_early import ended_early
from planner.methods.collocation_refusals import NAME
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.ocp.polish import polish
from planner.ocp.solver import Solution
from planner.ocp.task import Task
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import CollocationOptions


def replan_collocation(problem: Problem, options: CollocationOptions, warm: Plan) -> Plan:
    """As `plan_collocation`, from a plan of another problem of the same system.

    The plan may come from any method and any start, goal, duration and limits; the nearer it is,
    the sooner this is done. The answer is the optimum next to it: no other starts are tried unless
    it leads nowhere. A plan of collocation also passes on its mesh.

    Raises:
        InputError: If the plan belongs to another system or cannot be executed.
        NotConvergedError: As for `plan_collocation`.
    """
    began = time.perf_counter()
    _refuse(problem, warm)
    with deadline.limited(options.time_limit_s) as span:
        found = _next_to(problem.within_reach(), options, warm)
        if found is None:
            return plan_collocation(problem, options)
        job, solution = found
        done = polish(job, solution, options.accuracy, options.refinements)
        log = [{"start": "warm", "status": solution.status, "objective": solution.objective}]
        notes = {"stage": "warm start", "tried": log}
        iterations = solution.iterations + done.iterations
        plan = finished(done, "warm", notes, iterations, options, began)
        plan = replace(plan, problem=problem)
        return ended_early(plan, span) if span.reached else plan


def _refuse(problem: Problem, warm: Plan) -> None:
    if warm.problem.system != problem.system:
        raise InputError(
            f"{problem.source}: warm is a plan of another system ({warm.problem.source}); a start"
            " must belong to the same one"
        )
    if not warm.executable:
        raise InputError(
            f"{problem.source}: warm is a path that leaves the chart's domain ({warm.status});"
            " it has no coordinates to start from"
        )


def _next_to(
    problem: Problem, options: CollocationOptions, warm: Plan
) -> tuple[Task, Solution] | None:
    job = _prepared(problem, options, warm)
    start = _resampled(job, warm)
    solution = job.solve(start, near=True)
    if not solution.ok:
        solution = job.solve(start)
    return (job, solution) if solution.ok else None


def _prepared(problem: Problem, options: CollocationOptions, warm: Plan) -> Task:
    """On the plan's own mesh where it has one and the problem or options ask for no other."""
    own = warm.method == NAME and options.intervals == "auto" and not problem.waypoints
    if not own:
        return collocation_task(problem, options, SEARCHED)
    job = collocation_task(problem, options, Mesh(warm.t / warm.duration))
    return job.inside() if warm.notes.get("limits_inside", False) else job


def _resampled(job: Task, warm: Plan) -> Iterate:
    """The plan's motion on the task's mesh, its ends moved to start and goal, and all with them."""
    problem, mesh, T = job.problem, job.mesh, warm.duration
    duration = problem.duration or T
    inside = mesh.at(job.made.form.scheme.points)
    s = np.append(mesh.edges, inside)
    states, last = warm.q(s * T), len(mesh.edges) - 1
    first, final = problem.start - states[0], problem.target - states[last]
    final[np.isnan(final)] = 0.0
    moved = states + first + s[:, None] * (final - first)
    nodes, points = moved[: last + 1], moved[last + 1 :]
    return Iterate(
        duration=duration,
        nodes=nodes,
        points=points.reshape(*inside.shape, -1),
        inputs=warm.u(job.made.form.input_places(mesh) * T) * (T / duration),
    )
