"""Direct collocation in the coordinates themselves: optimal plans that need no chart."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.errors import InputError, NotConvergedError
from planner.methods.collocation_refusals import NAME, no_path, not_converged, too_short
from planner.methods.collocation_seeds import NAMES, planned_seeds
from planner.ocp.backends import SHORT_CHAIN, Settings
from planner.ocp.bridged import crossings
from planner.ocp.form import Form, InputKind
from planner.ocp.guess import Seed, guess, seeds
from planner.ocp.look import clears
from planner.ocp.objective import objective
from planner.ocp.polish import Polished, polish
from planner.ocp.route import mesh_through, rebalanced, routes
from planner.ocp.search import Found, Search, same_path, search
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched, task
from planner.ocp.timing import HASTE, hasty, timed
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import travel_window
from planner.schema.methods import CollocationOptions

DIRECT, DIRECT_LONG, SEARCHED = 14, 20, 40
"""Mesh intervals near a straight line in a given time, up to four joints and beyond, and for what
may wind more than once."""

SHARINGS = 6
"""Times that the duration is shared out anew among the parts between waypoints."""

GUESSES, LONG_CHAIN_GUESSES = 16, 2
"""Guesses tried before random paths are, up to four joints and beyond."""

BRIDGES = 4
"""Random paths tried."""

RESOLVED = 1e-4
"""Difference at the end, rad, between a motion and its interpolant up to which it is believed."""

DIRECT_ITERATIONS = 50
"""Iterations granted to the straight line when the motion can be one way; most need about 10."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A solution, the task it belongs to, and how it was come by.

    Attributes:
        start: Name of the start it grew from.
        task: What it solves.
        solution: The answer.
        log: One entry a start, JSON-ready.
        iterations: Iterations of the solver, over all starts.
    """

    start: str
    task: Task
    solution: Solution
    log: list[dict[str, Any]]
    iterations: int


def plan_collocation(problem: Problem, options: CollocationOptions) -> Plan:
    """Minimise effort or time over motions that keep every limit.

    The plan's q(t) is the scheme's own polynomial, its u(t) constant or linear in each interval.
    Where one way suffices the straight line is the first guess; otherwise several seeds are tried
    and the best kept (`notes["start"]`, `notes["tried"]`).

    Raises:
        InputError: If the options contradict each other or the problem.
        NotConvergedError: If no motion is found; it names what stands in the way where that could
            be found out, with a change that was tried.
    """
    began = time.perf_counter()
    answer = _best_route(problem, options)
    done = polish(answer.task, answer.solution, options.accuracy, options.refinements)
    return replace(finished(done, answer, options, began), problem=problem)


def _best_route(problem: Problem, options: CollocationOptions) -> Answer:
    """The best over the orders in which waypoints may be passed."""
    answers, refusals = [], []
    for way in routes(problem):
        try:
            answers.append(_settled(_answer(way, options)))
        except NotConvergedError as error:
            refusals.append(error)
    if not answers:
        raise refusals[0]
    return min(answers, key=lambda answer: answer.solution.objective)


def _answer(problem: Problem, options: CollocationOptions) -> Answer:
    return _direct(problem, options) or _searched(
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


def collocation_task(problem: Problem, options: CollocationOptions, intervals: int) -> Task:
    """The problem on a mesh of about so many intervals; waypoints lie on edges."""
    goal = objective(problem, options)
    kind = _input_kind(problem, options, goal.smooth)
    mesh = mesh_through(problem, intervals if options.intervals == "auto" else options.intervals)
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
    return task(problem, goal, form, mesh, options.rest, settings)


def _input_kind(problem: Problem, options: CollocationOptions, slopes: bool) -> InputKind:
    """`slopes`: whether the objective reads the inputs' rates."""
    smooth = slopes or options.rest or bool(np.any(np.isfinite(problem.limits.input_rate)))
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
    job = collocation_task(problem, options, intervals if options.input != "constant" else SEARCHED)
    if long:
        return _by_path(job)
    quick = replace(job.settings, max_iterations=min(options.max_iterations, DIRECT_ITERATIONS))
    seed = seeds("straight")[0]
    start = guess(job.problem, job.made, job.mesh, seed)
    solution = replace(job, settings=quick).solve(start)
    if not solution.ok:
        return None
    log = [{"start": seed.name, "status": solution.status, "objective": solution.objective}]
    return Answer(seed.name, job, solution, log, solution.iterations)


def _by_path(job: Task) -> Answer | None:
    """A long chain's straight line: as in a search first its path, then its timing."""
    paths = search(job, seeds("straight")[:1], 1)
    if not paths.found:
        return None
    outcome, log = timed(job, paths.found[0].solution.iterate), [*paths.log]
    _note(log, paths.found[0], outcome.solution)
    iterations = paths.iterations + outcome.iterations
    if not outcome.solution.ok or not clears(job, outcome.solution):
        return None
    return Answer(paths.found[0].seed, job, outcome.solution, log, iterations)


def _searched(job: Task, options: CollocationOptions) -> Answer:
    """Paths from several seeds, each then timed; the best of them."""
    job = _by_ipopt(job)
    enough = options.starts if options.start in ("auto", "wander") else 1
    simple = options.start == "auto" and not job.problem.obstacles
    guesses = _seeds(job.problem, options)[: _guesses(job, options)]
    paths = search(job, guesses, enough, simple)
    if not paths.found:
        return _bridged(job, paths, None, options)
    outcomes = [timed(job, path.solution.iterate) for path in paths.found]
    log = [*paths.log]
    iterations = paths.iterations + sum(outcome.iterations for outcome in outcomes)
    for path, outcome in zip(paths.found, outcomes, strict=True):
        _note(log, path, outcome.solution)
    solved = [k for k, outcome in enumerate(outcomes) if outcome.solution.ok]
    clear = [k for k in solved if clears(job, outcomes[k].solution)]
    if solved and not clear:
        raise no_path(job, paths, options)
    if solved:
        k = min(clear, key=lambda k: outcomes[k].solution.objective)
        return Answer(paths.found[k].seed, job, outcomes[k].solution, log, iterations)
    k = int(np.argmin([outcome.shortest_s for outcome in outcomes]))
    quick = outcomes[k].quick
    if quick is None or not quick.ok:
        return _bridged(job, paths, outcomes[k].solution, options)
    return _hurried(job, quick, Answer(paths.found[k].seed, job, quick, log, iterations), options)


def _by_ipopt(job: Task) -> Task:
    """With a free duration, searches meet iterates from which Fatrop may never return.

    It is hardly faster there, and finds no path that IPOPT does not.
    """
    if job.settings.solver != "auto" or job.problem.duration is not None or job.problem.obstacles:
        return job
    return replace(job, settings=replace(job.settings, solver="ipopt"))


def _seeds(problem: Problem, options: CollocationOptions) -> list[Seed]:
    """First guesses in the order in which they are tried: a line, others' plans, the rest."""
    start = options.start
    planned = planned_seeds(problem, start) if start in ("auto", *NAMES) else []
    if start in NAMES and planned:
        return planned
    first, *others = seeds("auto" if start in NAMES else start, options.attempts)
    return [first, *planned, *others]


def _guesses(job: Task, options: CollocationOptions) -> int:
    """Guesses worth trying: for long chains few lead anywhere, and each takes long to fail."""
    if options.start != "auto" or not _bridgeable(job.problem):
        return options.attempts
    return min(options.attempts, GUESSES if job.problem.system.size <= 5 else LONG_CHAIN_GUESSES)


def _bridgeable(problem: Problem) -> bool:
    """Whether random paths are of use; they know nothing of z2, discs and waypoints."""
    return not (problem.obstacles or problem.waypoints) and problem.limits.z2_margin is None


def _bridged(
    job: Task, paths: Search, last: Solution | None, options: CollocationOptions
) -> Answer:
    """Where no guess leads to a motion: from random motions of both ends."""
    log, shortest = [*paths.log], None
    wanted = options.start == "auto" and _bridgeable(job.problem)
    for found in crossings(job, BRIDGES, options.accuracy) if wanted else ():
        solution, iterations = found.timed.solution, paths.iterations + found.iterations
        objective = solution.objective if solution.ok else None
        log.append({"start": found.name, "status": solution.status, "objective": objective})
        if solution.ok:
            return Answer(found.name, found.task, solution, log, iterations)
        if shortest is None or found.timed.shortest_s < shortest.timed.shortest_s:
            shortest = found
    quick = shortest.timed.quick if shortest else None
    if shortest is None or quick is None or not quick.ok:
        if last is not None:
            raise not_converged(job, last, options, "the paths found")
        raise no_path(job, paths, options)
    answer = Answer(shortest.name, shortest.task, quick, log, paths.iterations)
    return _hurried(shortest.task, quick, answer, options)


def _hurried(job: Task, quick: Solution, answer: Answer, options: CollocationOptions) -> Answer:
    """The fastest motion on a mesh fine enough to believe it: the answer's start, or a refusal."""
    free = hasty(job)
    done = polish(free, quick, options.accuracy, options.refinements)
    wanted = job.problem.duration
    assert wanted is not None
    if done.error > RESOLVED:
        raise not_converged(job, quick, options, "the paths found")
    if done.solution.iterate.duration * HASTE > wanted:
        raise too_short(job, done, options)
    finer = job.on(done.task.mesh)
    solution = finer.solve(stretched(done.solution.iterate, wanted))
    if not solution.ok:
        raise too_short(job, done, options)
    return replace(answer, task=finer, solution=solution)


def _note(log: list[dict[str, Any]], path: Found, solution: Solution) -> None:
    """Enter the outcome for every start that led to this path."""
    for entry in log:
        if entry["path_effort"] is not None and same_path(entry["path_effort"], path):
            entry["objective"] = solution.objective if solution.ok else None


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
