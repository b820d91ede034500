"""Direct collocation in the coordinates themselves: optimal plans that need no chart."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from planner import deadline
from planner.errors import InputError
from planner.methods.collocation_early import ended_early, in_hand
from planner.methods.collocation_refusals import NAME, refusal
from planner.ocp.backends import Settings
from planner.ocp.best import holding
from planner.ocp.bounds import Asked
from planner.ocp.form import Form, InputKind
from planner.ocp.mesh import Mesh
from planner.ocp.objective import objective
from planner.ocp.pipeline import SEARCHED, Pipeline
from planner.ocp.polish import Polished
from planner.ocp.route import mesh_through, routes
from planner.ocp.task import Task, task
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.desensitised import DesensitisedOptions
from planner.schema.methods import CollocationOptions

__all__ = ["SEARCHED", "collocation_task", "finished", "plan_collocation"]


def plan_collocation(problem: Problem, options: CollocationOptions) -> Plan:
    """Minimise effort or time over motions that keep every limit.

    The plan's q(t) is the scheme's own polynomial, its u(t) linear or constant in each interval.
    How it is searched for is `planner.ocp.pipeline`; `notes["stage"]` says what found it,
    `notes["start"]` from which first guess, `notes["tried"]` what became of each. Where time is up
    before the search has ended, the best found by then is refined: its status is "time_limit", or
    "interrupted" after Ctrl-C, and `notes["ended_early"]` says so.

    Raises:
        InputError: If the options contradict each other or the problem.
        TimeLimitError: If time was up before there was a motion.
        InfeasibleError: If the duration is shorter than any motion can be; it names the shortest
            one found.
        NotConvergedError: If no motion is found, or none as short as the duration.
    """
    began = time.perf_counter()

    def make(route: Problem, mesh: Mesh | int, direct: bool) -> Task:
        return collocation_task(route, options, mesh, direct)

    ways = routes(problem.within_reach())
    search = Pipeline(ways, options, make)
    limit = deadline.limited(options.time_limit_s)
    with (
        limit,
        holding(ways, options.accuracy) as best,
        deadline.limited(None, holds=best.holds) as span,
    ):
        try:
            found = search.run(best.holds)
        except deadline.TimeUpError:
            found = in_hand(best, span, problem, options)
        if found is None:
            raise refusal(problem, search)
        answer, done = found
        notes = {"stage": answer.stage, "tried": search.log}
        plan = finished(done, answer.start, notes, best.iterations, options, began)
        plan = replace(plan, problem=problem)
        return ended_early(plan, span) if span.reached else plan


def collocation_task(
    problem: Problem, options: CollocationOptions, mesh: Mesh | int, direct: bool = False
) -> Task:
    """The problem on a mesh, or on one of about so many intervals; waypoints lie on edges.

    A direct one is to be solved from a straight line, soon or not at all.
    """
    goal = objective(problem, options)
    kind = input_kind(problem, NAME, options, goal.smooth)
    if isinstance(mesh, int):
        mesh = mesh_through(problem, mesh if options.intervals == "auto" else options.intervals)
    form = Form(
        intervals=len(mesh.widths),
        scheme_kind=options.scheme,
        degree=options.degree,
        input=kind,
        chart=problem.limits.z2_margin is not None,
        inner=bool(problem.obstacles),  # or links pass through a disc between two edges
        compiled=options.compile,
        obstacles=len(problem.obstacles),
        edge=goal.edge,
    )
    settings = Settings(options.tolerance, options.max_iterations, solver=options.solver)
    return task(problem, goal, form, mesh, Asked(options.rest), replace(settings, direct=direct))


def input_kind(
    problem: Problem,
    method: str,
    options: CollocationOptions | DesensitisedOptions,
    slopes: bool = False,
    auto: InputKind = "linear",
) -> InputKind:
    """The input asked for; `auto` where the choice is free.

    Args:
        problem: What is planned.
        method: Whose options they are.
        options: Its options.
        slopes: Whether the objective reads the inputs' rates.
        auto: What is chosen where nothing asks for inputs without jumps.

    Raises:
        InputError: If something asks for inputs without jumps and the options for such.
    """
    smooth = slopes or options.rest or bool(np.isfinite(problem.limits.input_rate).any())
    if options.input == "auto":
        return "linear" if smooth else auto
    if options.input == "constant" and smooth:
        what = "rest = true" if options.rest else "the limit on input rates"
        what = "an objective that reads the inputs' rates" if slopes else what
        raise InputError(
            f"{problem.source}: method.{method}.input = 'constant' jumps between intervals,"
            f" which contradicts {what}; use 'linear' or 'auto'"
        )
    return options.input


def finished(
    done: Polished,
    start: str,
    notes: dict[str, Any],
    iterations: int,
    options: CollocationOptions,
    began: float,
) -> Plan:
    """The plan of a motion refined, with how it was come by; `began` by the clock of `time`."""
    job, solution = done.task, done.solution
    wall = time.perf_counter() - began
    return Plan(
        problem=job.problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=job.curve(solution.iterate),
        objective=solution.objective,
        objective_name=job.objective.name,
        solve_time_s=wall - job.build_time_s,
        build_time_s=job.build_time_s,
        iterations=iterations,
        notes={
            "start": start,
            **notes,
            "largest_residual": solution.residual,
            "resimulated_end_error": done.error,
            **done.notes,
        },
    )
