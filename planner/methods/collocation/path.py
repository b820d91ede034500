"""First the path, then its timing.

The systems are driftless, so what a path looks like and how fast it is run are two questions. The
first alone is smooth and has no bound on inputs to run into: paths come from several seeds, and the
shortest are kept. The second, with the objective, the duration and the limits on inputs, then
starts from a motion that is feasible after stretching.
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
class FoundPath:
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

    found: list[FoundPath]
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
    free, clear = path_task(task), 0
    found, last, log = list[FoundPath](), None, list[dict[str, Any]]()
    for count, seed in enumerate(seeds, 1):
        progress.tell(f"searching a path from the first guess '{seed.name}'")
        solution = free.solve(guess(free.problem, task.made, task.mesh, seed))
        effort = solution.objective if solution.ok else None
        entry = {"start": seed.name, "status": solution.status, "path_effort": effort}
        log.append({**entry, "iterations": solution.iterations})
        if solution.ok:
            found.append(FoundPath(seed.name, solution))
        else:
            last = solution
        if solution.ok and clears(free, solution):
            clear += 1
            needed = needed_duration(task.problem, task.mesh, solution.iterate)
            wanted = task.problem.duration
            if wanted is None or needed <= wanted:  # a motion, if there is no time for a better one
                duration = wanted or needed or solution.iterate.duration
                offer(task, task.judged(stretched(solution.iterate, duration)))
        hopeless = 3 * count >= 2 * len(seeds) and all(e["status"] == INFEASIBLE for e in log)
        plain = simple and solution.ok and (one_way(solution.iterate) or _again(found))
        if hopeless or plain or clear >= enough or len(found) >= 2 * enough:
            break
    distinct: list[FoundPath] = []
    for path in sorted(found, key=lambda path: path.solution.objective):
        if not distinct or not same_path(path.solution.objective, distinct[-1]):
            distinct.append(path)
    return Search(distinct, last, log)


def path_task(task: Task) -> Task:
    """The path problem of a task: least effort, no limits on inputs, a reference duration."""
    unhurried = replace(task.problem, duration=way(task.made, task.settings).reference_s)
    asked = replace(task.asked, timeless=True)
    return replace(task, problem=unhurried, asked=asked, objective=shortest_path(task.objective))


def _again(found: Sequence[FoundPath]) -> bool:
    """Whether the shortest path comes back."""
    if len(found) < AMONG:
        return False
    shortest = min(path.solution.objective for path in found)
    return sum(same_path(shortest, path) for path in found) >= OFTEN


def same_path(effort: float, path: FoundPath) -> bool:
    """Whether a path of that effort is taken for the same as another."""
    return abs(effort - path.solution.objective) <= 1e-6 * path.solution.objective


def one_way(iterate: Iterate) -> bool:
    """Whether the drive never turns back."""
    drive = iterate.inputs[:, 0]
    slack = STANDSTILL * np.max(np.abs(drive))
    return bool(np.all(drive >= -slack) or np.all(drive <= slack))


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
    quick: Solution | None = None


def timed(task: Task, path: Iterate) -> Timed:
    """Solve a task from a path.

    A path that fits the duration, all of it stretched alike, is a motion to start from. One that
    does not is first made as fast as it can be.
    """
    needed = needed_duration(task.problem, task.mesh, path)
    wanted = task.problem.duration
    if wanted is None:
        return Timed(task.solve(stretched(path, 1.1 * needed) if needed > 0 else path))
    if needed <= wanted:
        motion = stretched(path, wanted)
        # The path of least effort is that of any duration. Among discs, where there are many such
        # paths, a start from farther off may find a shorter one.
        near = task.objective.kind == "effort" and not task.problem.divided
        return Timed(task.solve_near(motion) if near else task.solve(motion))
    quick = hasty(task).solve(stretched(path, 1.1 * needed))
    if not quick.ok or quick.iterate.duration * HASTE > wanted:
        return Timed(replace(quick, ok=False), quick)
    solution = task.solve(stretched(quick.iterate, wanted))
    return Timed(solution, quick)


def hasty(task: Task) -> Task:
    """The task with a free duration, to be made least."""
    free = replace(task.problem, duration=None)
    return task.asking(free, fastest(free))


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
