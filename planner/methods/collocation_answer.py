"""The answer of collocation's search, and how the best motion along paths found becomes one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from planner.ocp.search import Found, Search, same_path
from planner.ocp.solver import Solution
from planner.ocp.task import Task
from planner.ocp.timing import Timed, timed


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


def best_along(job: Task, paths: Search) -> Answer | None:
    """The best motion along these paths."""
    outcomes, log, iterations = along(job, paths)
    solved = [k for k, outcome in enumerate(outcomes) if outcome.solution.ok]
    if not solved:
        return None
    k = min(solved, key=lambda k: outcomes[k].solution.objective)
    return Answer(paths.found[k].seed, job, outcomes[k].solution, log, iterations)


def along(job: Task, paths: Search) -> tuple[list[Timed], list[dict[str, Any]], int]:
    """What the timing makes of each path, the search's log with it, and iterations of both."""
    outcomes = [timed(job, path.solution.iterate) for path in paths.found]
    log = [*paths.log]
    for path, outcome in zip(paths.found, outcomes, strict=True):
        _note(log, path, outcome.solution)
    return outcomes, log, paths.iterations + sum(outcome.iterations for outcome in outcomes)


def _note(log: list[dict[str, Any]], path: Found, solution: Solution) -> None:
    """Enter the outcome for every start that led to this path."""
    for entry in log:
        if entry["path_effort"] is not None and same_path(entry["path_effort"], path):
            entry["objective"] = solution.objective if solution.ok else None
