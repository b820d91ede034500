"""From a path to the motion asked for: the objective, the duration and the limits on inputs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from planner.methods.collocation.path import needed_duration
from planner.methods.collocation.solvers.solver import Solution
from planner.methods.collocation.task import Task, stretched
from planner.methods.collocation.transcription.objective import fastest
from planner.methods.collocation.transcription.unknowns import Iterate

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
