"""The answer of collocation's search, and how the best motion along paths found becomes one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from planner.ocp.search import Found, Search, same_path
from planner.ocp.solver import Solution
from planner.ocp.task import Task
from planner.ocp.timing import timed


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
    outcomes = [timed(job, path.solution.iterate) for path in paths.found]
    log = [*paths.log]
    for path, outcome in zip(paths.found, outcomes, strict=True):
        noted(log, path, outcome.solution)
    iterations = paths.iterations + sum(outcome.iterations for outcome in outcomes)
    solved = [k for k, outcome in enumerate(outcomes) if outcome.solution.ok]
    if not solved:
        return None
    k = min(solved, key=lambda k: outcomes[k].solution.objective)
    return Answer(paths.found[k].seed, job, outcomes[k].solution, log, iterations)


def noted(log: list[dict[str, Any]], path: Found, solution: Solution) -> None:
    """Enter the outcome for every start that led to this path."""
    for entry in log:
        if entry["path_effort"] is not None and same_path(entry["path_effort"], path):
            entry["objective"] = solution.objective if solution.ok else None
