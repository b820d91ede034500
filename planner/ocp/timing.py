"""From a path to the motion asked for: the objective, the duration and the limits on inputs."""

from __future__ import annotations

from dataclasses import replace

from planner.ocp.layout import Iterate
from planner.ocp.objective import fastest
from planner.ocp.search import needed_duration
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched

HASTE = 0.97
"""The shortest duration found includes a little effort; this share of it is still tried."""


class TooShortError(Exception):
    """The duration is shorter than the shortest found.

    Attributes:
        shortest: The fastest motion found.
    """

    def __init__(self, shortest: Solution) -> None:
        self.shortest = shortest
        super().__init__(f"the shortest duration found is {shortest.iterate.duration:g} s")


def timed(task: Task, path: Iterate) -> list[Solution]:
    """Solve the task from a path; the last solution is the answer, those before led to it.

    Raises:
        TooShortError: If the duration is fixed and no faster motion along such a path was found.
    """
    needed = needed_duration(task.problem, task.mesh, path)
    wanted = task.problem.duration
    if wanted is None:
        return [task.solve(stretched(path, 1.1 * needed) if needed > 0 else path)]
    if needed <= wanted:
        return [task.solve(stretched(path, wanted))]
    quick = shortest(task, path)
    if not quick.ok:
        return [quick]
    if quick.iterate.duration * HASTE > wanted:
        raise TooShortError(quick)
    return [quick, task.solve(stretched(quick.iterate, wanted))]


def shortest(task: Task, path: Iterate) -> Solution:
    """The fastest motion within the limits that is found from a path."""
    needed = needed_duration(task.problem, task.mesh, path)
    free = replace(task.problem, duration=None)
    return replace(task, problem=free, objective=fastest(free)).solve(stretched(path, 1.1 * needed))
