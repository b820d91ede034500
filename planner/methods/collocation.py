"""Direct collocation in the coordinates themselves: optimal plans that need no chart."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from planner.errors import InputError, NoPlanError
from planner.methods.collocation_answer import Answer
from planner.methods.collocation_refusals import NAME
from planner.methods.collocation_search import by_path, resolved, searched
from planner.methods.remedies import UnexplainedError
from planner.ocp.backends import SHORT_CHAIN, Settings
from planner.ocp.form import Form, InputKind
from planner.ocp.guess import guess, seeds
from planner.ocp.mesh import Mesh
from planner.ocp.objective import objective
from planner.ocp.polish import Polished
from planner.ocp.route import mesh_through, rebalanced, routes
from planner.ocp.task import Task, task
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import travel_window
from planner.schema.methods import CollocationOptions

DIRECT, DIRECT_LONG, SEARCHED = 14, 20, 40
"""Mesh intervals near a straight line in a given time, up to four joints and beyond, and for what
may wind more than once."""

SHARINGS = 6
"""Times that the duration is shared out anew among the parts between waypoints."""

DIRECT_ITERATIONS = 50
"""Iterations granted to the straight line when the motion can be one way; most need about 10."""


def plan_collocation(problem: Problem, options: CollocationOptions) -> Plan:
    """Minimise effort or time over motions that keep every limit.

    The plan's q(t) is the scheme's own polynomial, its u(t) constant or linear in each interval.
    Where one way suffices the straight line is the first guess; otherwise several seeds are tried
    and the best kept (`notes["start"]`, `notes["tried"]`).

    Raises:
        InputError: If the options contradict each other or the problem.
        InfeasibleError: If the duration is shorter than any motion can be; it names the shortest
            one found.
        NotConvergedError: If no motion is found, or none as short as the duration; it names what
            stands in the way where that could be found out, with a change that was tried.
    """
    try:
        return planned(problem, options)
    except UnexplainedError as refusal:
        raise refusal.explained(planned) from None


def planned(problem: Problem, options: CollocationOptions) -> Plan:
    """As `plan_collocation`, but its refusals are not explained yet.

    Raises:
        UnexplainedError: In place of `plan_collocation`'s refusals.
    """
    began = time.perf_counter()
    answer, done = resolved(_best_route(problem, options), options)
    return replace(finished(done, answer, options, began), problem=problem)


def _best_route(problem: Problem, options: CollocationOptions) -> Answer:
    """The best over the orders in which waypoints may be passed."""
    answers, refusals = [], []
    for way in routes(problem):
        try:
            answers.append(_settled(_answer(way, options)))
        except NoPlanError as error:
            refusals.append(error)
    if not answers:
        raise refusals[0]
    return min(answers, key=lambda answer: answer.solution.objective)


def _answer(problem: Problem, options: CollocationOptions) -> Answer:
    return _direct(problem, options) or searched(
        collocation_task(problem, options, SEARCHED), options
    )


def _settled(answer: Answer) -> Answer:
    """With the time shared out among the parts between waypoints as the objective wants it."""
    for _ in range(SHARINGS if answer.task.mesh.marks else 0):
        moved = rebalanced(answer.task, answer.solution.iterate)
        if moved is None:
            break
        solution = moved[0].solve(moved[1], near=True)
        better = solution.ok and solution.objective < answer.solution.objective
        if not better:
            break
        iterations = answer.iterations + solution.iterations
        answer = replace(answer, task=moved[0], solution=solution, iterations=iterations)
    return answer


def collocation_task(
    problem: Problem, options: CollocationOptions, mesh: Mesh | int, direct: bool = False
) -> Task:
    """The problem on a mesh, or on one of about so many intervals; waypoints lie on edges.

    A direct one is to be solved from a straight line, soon or not at all.
    """
    goal = objective(problem, options)
    kind = _input_kind(problem, options, goal.smooth)
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
    if direct:
        few = min(options.max_iterations, DIRECT_ITERATIONS)
        settings = replace(settings, max_iterations=few, direct=True)
    return task(problem, goal, form, mesh, options.rest, settings)


def _input_kind(problem: Problem, options: CollocationOptions, slopes: bool) -> InputKind:
    """`slopes`: whether the objective reads the inputs' rates."""
    smooth = slopes or options.rest or bool(np.isfinite(problem.limits.input_rate).any())
    if options.input == "auto":
        return "linear" if smooth or problem.duration is not None else "constant"
    if options.input == "constant" and smooth:
        what = "rest = true" if options.rest else "the limit on input rates"
        what = "an objective that reads the inputs' rates" if slopes else what
        raise InputError(
            f"{problem.source}: method.collocation.input = 'constant' jumps between intervals,"
            f" which contradicts {what}; use 'linear' or 'auto'"
        )
    return options.input


def _one_way(problem: Problem) -> bool:
    window = travel_window(problem)
    if window is None or window.empty:
        return False
    return problem.travel is None or problem.travel in window


def _direct(problem: Problem, options: CollocationOptions) -> Answer | None:
    """The straight line alone: where asked for, or the motion can be one way in a given time."""
    if problem.duration is None or options.start not in ("auto", "straight"):
        return None
    if options.start == "auto" and (problem.obstacles or not _one_way(problem)):
        return None
    long = problem.system.size > SHORT_CHAIN
    intervals = DIRECT_LONG if long else DIRECT
    intervals = intervals if options.input != "constant" else SEARCHED
    job = collocation_task(problem, options, intervals, direct=not long)
    if long:
        return by_path(job)
    seed = seeds("straight")[0]
    solution = job.solve(guess(job.problem, job.made, job.mesh, seed))
    if not solution.ok:
        return None
    later = replace(job.settings, max_iterations=options.max_iterations, direct=False)
    job = replace(job, settings=later)
    log = [{"start": seed.name, "status": solution.status, "objective": solution.objective}]
    return Answer(seed.name, job, solution, log, solution.iterations)


def finished(done: Polished, answer: Answer, options: CollocationOptions, began: float) -> Plan:
    """The plan of an answer polished, with how it was come by; `began` by the clock of `time`."""
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
        iterations=answer.iterations + done.iterations,
        notes={
            "start": answer.start,
            "tried": answer.log,
            "largest_residual": solution.residual,
            "resimulated_end_error": done.error,
            **done.notes,
        },
    )
