"""First the path, then its timing.

The path comes from several seeds, without limits on speed; the shortest is kept.

The systems are driftless, so what a path looks like and how fast it is run are two questions. The
first alone is smooth and has no bound on inputs to run into; the second then starts from a motion
that is feasible after stretching.

Timing goes from the path to the motion asked for: objective, duration, limits on inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.candidates import Seed, guess
from planner.methods.collocation.solvers import way
from planner.methods.collocation.task import Solution, Task, offer, stretched
from planner.methods.collocation.transcription.form import Mesh, fastest, shortest_path
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import At
from planner.support import progress

INFEASIBLE = "Infeasible_Problem_Detected"

OFTEN, AMONG = 3, 6
"""Times that the shortest path is found, among at least so many, that end a search: so far from
chance others are seldom shorter."""

STANDSTILL = 1e-6
"""Share of the greatest input that counts as none."""


@dataclass(frozen=True, eq=False)
class Found:
    """A solution and the seed it grew from."""

    seed: str
    solution: Solution


@dataclass(frozen=True, eq=False)
class Search:
    """What a search leaves.

    Attributes:
        found: Paths, shortest first.
        last: The last solution that failed, or None.
        log: One entry a seed, JSON-ready.
    """

    found: list[Found]
    last: Solution | None
    log: list[dict[str, Any]]


def search(
    task: Task,
    seeds: Sequence[Seed],
    enough: int,
    simple: bool = False,
) -> Search:
    """Solve the task's path problem from one seed after the other until enough have converged.

    With `simple`, a path whose drive never turns back is enough by itself, and so is one that is
    found again and again.
    Two thirds of the seeds in a row found infeasible end the search too. A path whose links pass
    through a disc between two nodes may come clear once it is timed, but counts half.
    """
    free = path_task(task)
    result, clear = Search([], None, []), 0
    for k, seed in enumerate(seeds):
        progress.tell(f"searching a path from the first guess '{seed.name}'")
        start = guess(free.problem, task.made, task.mesh, seed)
        solution = free.solve(start)
        if solution.ok and clears(free, solution):
            clear += 1
            _offered(task, solution.iterate)
        result = _with(result, seed, solution)
        hopeless = 3 * (k + 1) >= 2 * len(seeds) and all(
            entry["status"] == INFEASIBLE for entry in result.log
        )
        found = simple and solution.ok and (one_way(solution.iterate) or _again(result))
        if hopeless or found or clear >= enough or len(result.found) >= 2 * enough:
            break
    return replace(result, found=_distinct(result.found))


def _again(result: Search) -> bool:
    """Whether the shortest path comes back."""
    if len(result.found) < AMONG:
        return False
    shortest = min(path.solution.objective for path in result.found)
    return sum(same_path(shortest, path) for path in result.found) >= OFTEN


def path_task(task: Task) -> Task:
    """The path problem of a task: least effort, no limits on inputs, a reference duration."""
    unhurried = replace(task.problem, duration=way(task.made, task.settings).reference_s)
    asked = replace(task.asked, timeless=True)
    return replace(task, problem=unhurried, asked=asked, objective=shortest_path(task.objective))


def needed_duration(problem: Problem, mesh: Mesh, iterate: Iterate) -> float:
    """Seconds this path takes, all of it stretched alike, within what a slower motion keeps."""
    u = np.stack(iterate.input_ends())
    slope = (u[1] - u[0]) / (mesh.widths[:, None] * iterate.duration)
    q = np.stack([iterate.nodes[:-1], iterate.nodes[1:]])[..., : problem.system.size]
    at, factors = At.of(problem.system, q, u, np.stack([slope, slope])), [0.0]
    for required in problem.requirements:
        if required.speed:
            values = np.stack([np.ravel(value) for value in required.values(at)])
            factors += required.slower(values.min(axis=1), values.max(axis=1)).tolist()
    return iterate.duration * float(np.max(factors))


def _offered(task: Task, path: Iterate) -> None:
    """Offer the path at one pace as a motion, in case there is no time for a better one."""
    needed, wanted = needed_duration(task.problem, task.mesh, path), task.problem.duration
    if wanted is None or needed <= wanted:
        offer(task, task.judged(stretched(path, wanted or needed or path.duration)))


def one_way(iterate: Iterate) -> bool:
    """Whether the drive never turns back."""
    drive = iterate.inputs[:, 0]
    slack = STANDSTILL * np.max(np.abs(drive))
    return bool(np.all(drive >= -slack) or np.all(drive <= slack))


def _with(result: Search, seed: Seed, solution: Solution) -> Search:
    entry = {
        "start": seed.name,
        "status": solution.status,
        "path_effort": solution.objective if solution.ok else None,
        "iterations": solution.iterations,
    }
    return Search(
        found=[*result.found, Found(seed.name, solution)] if solution.ok else result.found,
        last=result.last if solution.ok else solution,
        log=[*result.log, entry],
    )


def same_path(effort: float, path: Found) -> bool:
    """Whether a path of that effort is taken for the same as another."""
    return abs(effort - path.solution.objective) <= 1e-6 * path.solution.objective


def _distinct(found: Sequence[Found]) -> list[Found]:
    """Shortest first, without repetitions of the same path."""
    kept: list[Found] = []
    for candidate in sorted(found, key=lambda f: f.solution.objective):
        if not kept or not same_path(candidate.solution.objective, kept[-1]):
            kept.append(candidate)
    return kept


HASTE = 0.97
"""The shortest duration found includes a little effort; this share of it is still tried."""


@dataclass(frozen=True, eq=False)
class Timed:
    """What came of a path.

    Attributes:
        solution: The task's solution, or the last one on the way to it (then not ok).
        quick: The fastest motion, when it had to be found first.
    """

    solution: Solution
    quick: Solution | None


def timed(task: Task, path: Iterate) -> Timed:
    """Solve a task from a path.

    A path that fits the duration, all of it stretched alike, is a motion to start from. One that
    does not is first made as fast as it can be.
    """
    needed = needed_duration(task.problem, task.mesh, path)
    wanted = task.problem.duration
    if wanted is None:
        return _single(task.solve(stretched(path, 1.1 * needed) if needed > 0 else path))
    if needed <= wanted:
        return _leisurely(task, stretched(path, wanted))
    quick = hasty(task).solve(stretched(path, 1.1 * needed))
    if not quick.ok or quick.iterate.duration * HASTE > wanted:
        return Timed(replace(quick, ok=False), quick)
    solution = task.solve(stretched(quick.iterate, wanted))
    return Timed(solution, quick)


def _leisurely(task: Task, motion: Iterate) -> Timed:
    """From a motion within the limits: the path of least effort is that of any duration.

    Among discs, where there are many such paths, a start from farther off may find a shorter one.
    """
    found = task.objective.kind == "effort" and not task.problem.divided
    near = task.solve(motion, near=found)
    if near.ok:
        return _single(near)
    last = task.solve(motion)
    return Timed(last, None)


def hasty(task: Task) -> Task:
    """The task with a free duration, to be made least."""
    free = replace(task.problem, duration=None)
    return task.asking(free, fastest(free))


def _single(solution: Solution) -> Timed:
    return Timed(solution, None)
