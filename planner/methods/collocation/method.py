"""Direct collocation in joint coordinates: optimal plans that need no chart.

The file turns options into a plan, plans a neighbouring problem with an existing plan as the first
guess, and answers with the best motion if time is up before the search has ended.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from planner.errors import InputError, TimeLimitError, Violation
from planner.methods.collocation.best import Best, Motion
from planner.methods.collocation.between_nodes import clears, inspect
from planner.methods.collocation.candidates import mesh_through, routes
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    has_only_limits,
)
from planner.methods.collocation.pipeline import SEARCH_INTERVALS, Pipeline
from planner.methods.collocation.refine import PolishedMotion, polish
from planner.methods.collocation.refusals import NAME, iterate_plan, no_goal, refusal
from planner.methods.collocation.solvers import Settings
from planner.methods.collocation.task import Solution, Task, task
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.form import Form, InputKind, Mesh, objective
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.methods.ranking import MEASURES
from planner.plan.measures import objective_of
from planner.plan.plan import Plan, mark_cut_short
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions, DesensitisedOptions, rests
from planner.support import deadline, progress
from planner.support.deadline import Span, TimeUpError, time_advice
from planner.systems.manipulator import Manipulator

CUT_SHORT = "ended the search; this is the best motion found so far"


def plan_collocation(problem: Problem, options: CollocationOptions) -> Plan:
    """Minimise effort or time over motions that keep every limit.

    The plan's q(t) is the scheme's polynomial; its u(t) is linear or constant in each interval. For
    the search see `planner.methods.collocation.pipeline`. `notes["stage"]` names the stage that
    found the plan, `notes["start"]` its first guess, `notes["tried"]` the result of each guess. If
    time is up before the search has ended, the best motion so far is refined: its status is
    "time_limit", or "interrupted" after Ctrl-C, and `notes["ended_early"]` says so.

    Raises:
        InputError: If the options contradict each other or the problem.
        TimeLimitError: If time is up before a motion is found.
        InfeasibleError: If the duration is shorter than any motion can be; it gives the shortest
            one found.
        NotConvergedError: If no motion is found, or none as short as the duration.
    """
    return _plan_from(problem, options, None)


def _plan_from(problem: Problem, options: CollocationOptions, warm: Plan | None) -> Plan:
    began, reached = time.perf_counter(), problem.within_reach()
    ways = routes(reached)
    if not ways:
        raise no_goal(problem)
    near = None if warm is None else partial(_near_motions, reached, options, warm)
    best = Best(options.accuracy)
    errors: list[dict[str, Any]] = []
    rank = partial(_machine_error, problem, options, errors)
    by_machine = options.criterion == "machine"
    if by_machine:
        _expect_arm(problem)
    search = Pipeline(
        ways, options, collocation_task, best, near=near, rank=rank if by_machine else None
    )
    with (
        deadline.time_limit(options.time_limit_s),
        progress.progress_listener(None),
        deadline.time_limit(None, has_answer=best.holds) as span,
    ):
        try:
            found = search.run()
        except deadline.TimeUpError:
            if warm is not None and not best.holds():
                raise
            found = _finish_best(best, span, problem, options)
        if found is None:
            raise refusal(problem, search)
        motion, done = found
        notes = {"stage": motion.stage, "tried": search.log}
        if errors:
            notes["criterion"] = errors
        made = _plan(problem, done, motion.start, notes, options, began)
        return mark_cut_short(made, span, CUT_SHORT) if span.was_reached else made


def _expect_arm(problem: Problem) -> None:
    """Refuse to rank paths by the machine for systems without compensation."""
    if not isinstance(problem.system, Manipulator):
        raise InputError(
            f"{problem.source}: method.{NAME}.criterion = 'machine' is for arms with friction disks"
            " (system.kind = 'manipulator'); use 'objective'"
        )


def _machine_error(
    problem: Problem,
    options: CollocationOptions,
    errors: list[dict[str, Any]],
    motion: Motion,
    done: PolishedMotion,
) -> float:
    """95th percentile of E of a motion's compensated plan on the problem's machines, degrees."""
    plan = _plan(problem, done, motion.start, {}, options, time.perf_counter())
    error = MEASURES[options.criterion](plan)
    errors.append({"start": motion.start, "E_p95_deg": error})
    return error


def _finish_best(
    best: Best, span: Span, problem: Problem, options: CollocationOptions
) -> tuple[Motion, PolishedMotion]:
    """The best motion so far when time is up, refined in the remaining time.

    Raises:
        TimeLimitError: If there is none.
    """
    with suppress(TimeUpError):
        best.make_exact()
    both = []
    for motion in (best.exact, best.motion):
        if motion is not None:
            done = polish(*motion, options.accuracy, options.refinements)
            both.append((Motion("the best found by then", "time limit", *motion), done))
    if both:
        accuracy = options.accuracy
        return min(
            both, key=lambda b: (not is_true_motion(b[1], accuracy), b[1].solution.objective)
        )
    far, last, broken = progress.current_progress(), None, list[Violation]()
    if best.nearest is not None:
        last, broken = iterate_plan(problem, *best.nearest, options)
    came = "" if far is None else f" after {far.solves} solves (it was {far.doing})"
    nearest = "; the closest attempt breaks:" if broken else ""
    raise TimeLimitError(
        f"{problem.source}: {span.why} ended the search before it had found a motion{came}"
        f"{nearest}",
        plan=last,
        violations=broken,
        advice=time_advice(),
    )


def is_true_motion(done: PolishedMotion, accuracy: float) -> bool:
    """Whether a motion is accurate and keeps its limits between the nodes."""
    inspection = inspect(done.task, done.solution)
    return inspection.fine(accuracy) and not inspection.excess.any()


def _plan(
    problem: Problem,
    done: PolishedMotion,
    start: str,
    notes: dict[str, Any],
    options: CollocationOptions,
    began: float,
) -> Plan:
    """The plan of a refined motion; `began` is the time at which the search began."""
    job, solution, search = done.task, done.solution, progress.current_progress()
    assert search is not None
    wall, trajectory = time.perf_counter() - began, job.curve(solution.iterate)
    value, name = solution.objective, job.objective.name
    if job.objective.edge:  # of which the transcription knows a mean at its points alone
        value = objective_of(trajectory, name) or value
    return Plan(
        problem=problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=trajectory,
        objective=value,
        objective_name=name,
        solve_time_s=wall - job.build_time_s,
        build_time_s=job.build_time_s,
        iterations=search.iterations,
        notes={
            "start": start,
            **notes,
            **chosen_goal(job.problem, solution.iterate),
            "largest_residual": solution.residual,
            "resimulated_end_error": done.error,
            **done.notes,
        },
    )


def chosen_goal(problem: Problem, iterate: Iterate) -> dict[str, Any]:
    """The end of a plan with a goal that leaves coordinates free, for the plan's notes.

    It has all joints in degrees, or user coordinates by name in their units.
    """
    if not problem.free:
        return {}
    system = problem.system
    if system.has_user_coordinates:
        end = system.user(iterate.nodes[-1, : system.size]).tolist()
        return {"goal": {c.name: x for c, x in zip(system.user_coordinates, end, strict=True)}}
    return {"goal_theta_deg": np.rad2deg(iterate.nodes[-1, 1 : problem.system.size]).tolist()}


def collocation_task(
    problem: Problem, options: CollocationOptions, mesh: Mesh | int, direct: bool = False
) -> Task:
    """The problem on a mesh, or on one of about `mesh` intervals; waypoints lie on edges.

    With `direct` it is to be solved from a straight line in few iterations or not at all.
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
        inner=problem.divided,  # or links pass through a disc between two edges
        edge=goal.edge,
    )
    settings = Settings(options.tolerance, options.max_iterations, solver=options.solver)
    return task(
        problem,
        goal,
        form,
        mesh,
        InputDemands(rests(options.rest, problem.limits.input_rate)),
        replace(settings, direct=direct),
    )


def input_kind(
    problem: Problem,
    method: str,
    options: CollocationOptions | DesensitisedOptions,
    slopes: bool = False,
    auto: InputKind = "linear",
) -> InputKind:
    """The kind of input to use.

    Args:
        problem: The problem.
        method: Name of the method.
        options: Its options.
        slopes: Whether the objective depends on the inputs' rates.
        auto: The kind to use if nothing requires inputs without jumps.

    Raises:
        InputError: If inputs without jumps are required but the options give constant ones.
    """
    smooth = slopes or options.rest is True or problem.reads("du")
    if options.input == "auto":
        return "linear" if smooth else auto
    if options.input == "constant" and smooth:
        what = "rest = true" if options.rest is True else "the limit on input rates"
        what = "an objective that reads the inputs' rates" if slopes else what
        raise InputError(
            f"{problem.source}: method.{method}.input = 'constant' jumps between intervals,"
            f" which contradicts {what}; use 'linear' or 'auto'"
        )
    return options.input


def replan_collocation(problem: Problem, options: CollocationOptions, warm: Plan) -> Plan:
    """As `plan_collocation`, but starting from a plan of another problem of the same system.

    The plan may come from any method and have any start, goal, duration and limits; the nearer it
    is, the faster the search. The answer is the optimum near it: other first guesses are tried only
    if this fails. A plan of collocation also supplies its mesh. If the plan has the same ends, its
    own motion at the required speed is the first result, so the answer is at least as good.

    Raises:
        InputError: If the plan belongs to another system or cannot be executed.
        TimeLimitError, InfeasibleError, NotConvergedError: As for `plan_collocation`.
    """
    refuse_start(problem, warm)
    return _plan_from(problem, options, warm)


def refuse_start(problem: Problem, warm: Plan) -> None:
    """Raise InputError for a plan that cannot serve as a start."""
    if warm.problem.system != problem.system:
        raise InputError(
            f"{problem.source}: warm is a plan of another system ({warm.problem.source}); it"
            " must be of the same system"
        )
    if not warm.executable:
        raise InputError(
            f"{problem.source}: warm is a path that leaves the chart's domain ({warm.status});"
            " it has no coordinates to start from"
        )


def _near_motions(problem: Problem, options: CollocationOptions, warm: Plan) -> Iterator[Motion]:
    """The plan's own motion, if the problem has the same ends, and the optimum near the plan."""
    own = warm.method == NAME and options.intervals == "auto" and not problem.waypoints
    mesh = Mesh(warm.t / warm.duration) if own else SEARCH_INTERVALS
    job = collocation_task(problem, options, mesh)
    if own and warm.notes.get("limits_inside", False):
        job = job.with_inner_rows()
    start = _resample(job, warm)
    same = warm.problem.start.tolist() == problem.start.tolist()
    same = same and np.array_equal(warm.problem.target, problem.target, equal_nan=True)
    if same and (kept := _own_motion(job, start, options.accuracy)):
        yield Motion("warm", "warm start", *kept)
    yield Motion("warm", "warm start", job, job.solve_near(start))


def _own_motion(job: Task, start: Iterate, accuracy: float) -> tuple[Task, Solution] | None:
    """A plan's motion on the job's mesh, or else on a mesh of its own."""
    motion = job.judge(start)
    if motion.ok:
        return (job, motion) if clears(job, motion) else None
    return exact_motion(job, chain_of(job, motion), accuracy) if has_only_limits(job) else None


def _resample(job: Task, warm: Plan) -> Iterate:
    """The plan's motion on the task's mesh, shifted linearly so that it ends at start and goal."""
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
