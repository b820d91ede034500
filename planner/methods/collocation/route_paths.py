"""The paths of a route: the most promising are refined, ranked and used as starts of motions.

The duration of a refined path predicts that of its motion well, so only one or two are timed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from planner.methods.collocation.path import (
    Paths,
    SeedPath,
    clock,
    clock_times,
    halve_mesh,
    needed_duration,
    on_mesh,
    path_intervals,
    path_task,
    refine_path,
)
from planner.methods.collocation.task import Solution, Task, transfer
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.support import progress

MAX_PATHS, REFINED_INTERVALS = 2, 200
"""Largest number of paths to time; largest total number of mesh intervals of the paths to refine.
Long paths take long to refine, and if the first failed, so did all others (6 of 6 among 22 random
pairs of four joints within 40 degrees; the ladder then had the answer)."""

LADDER_INTERVALS = {"best": 220, "soon": 80}
"""Largest number of intervals of a path to refine if the ladder can find another path: for the best
motion, and for any motion soon. Of six paths of more than 220 intervals, of four joints within 40
degrees, one could be refined, and its motion was 5 % faster than the ladder's. With 80, the motion
that a refusal names takes up to 1.4 times as long (13 refusals; six the same), in a third of the
processor time."""

MAX_COARSE_PATHS = 6
"""Largest number of paths to time on a given mesh, for which the fastest path is unknown."""

LEAST_TIME_RATIO = 0.95
"""Least expected ratio of a motion's duration to the duration of its path by `clock`: timing saves
a few hundredths."""


@dataclass(frozen=True, eq=False)
class RefinedPath:
    """A path after refinement, with its origin.

    Attributes:
        origin: The path as it was found from its seed.
        free: The path task on the refined mesh.
        solution: The refined path.
    """

    origin: SeedPath
    free: Task
    solution: Solution

    def duration(self, job: Task) -> float:
        """Return the duration of the path, s, scaled uniformly in time to keep limits on speed."""
        return needed_duration(job.problem, self.free.mesh, self.solution.iterate)

    def clock_s(self, job: Task) -> float:
        """Return the duration of the path, s, if at every time one input is at its limit."""
        return float(clock_times(job.problem, self.free.mesh, self.solution.iterate)[0][-1])


@dataclass(frozen=True, eq=False)
class RoutePaths:
    """The paths of a route, which depend only on the system, the ends and the geometry.

    Attributes:
        free: The path task on the coarse mesh of the search.
        search: The finished search.
        refined: The most promising paths, refined; None if the mesh is given, on which coarse paths
            are timed.
    """

    free: Task
    search: Paths
    refined: list[RefinedPath] | None

    @classmethod
    def of(cls, job: Task, paths: Paths, mesh_given: bool, most: float = math.inf) -> RoutePaths:
        """Refine the most promising paths of a search, unless the user gives the mesh.

        Paths that need more than `most` intervals are left to the ladder.
        """
        free, refined, spent = path_task(job), list[RefinedPath](), 0
        if mesh_given:
            return cls(free, paths, None)
        for path in paths.distinct:
            count = path_intervals(free, path.solution.iterate)
            if count > most or (spent and spent + count > REFINED_INTERVALS):
                break
            progress.tell(f"refining the path of '{path.seed}'")
            spent += count
            if both := refine_path(free, path.solution):
                refined.append(RefinedPath(path, *both))
        return cls(free, paths, refined)

    def starts(
        self, job: Task, motions: Sequence[Solution]
    ) -> Iterator[tuple[SeedPath, Task, Iterate]]:
        """Yield the most promising paths, each with a task on its own mesh and a start of the task.

        Paths that fit into the given duration come first, by effort, then the other paths, by their
        duration. In both groups paths that clear all discs come first. A path that takes longer
        than a motion already found is left out.

        Args:
            job: The task.
            motions: The motions found so far; the list may grow between two starts.
        """
        if self.refined is None:
            for one in self.search.distinct[:MAX_COARSE_PATHS]:
                yield one, job, transfer(self.free, one.solution.iterate, job)
            return
        duration, limited = job.problem.duration, bool(np.isfinite(job.problem.limits.input).all())
        slow = [each for each in self.refined if each.duration(job) <= (duration or 0.0)]
        slow.sort(key=lambda each: (not each.origin.clear, each.solution.objective))
        for path in slow[:MAX_PATHS]:
            yield _start_at_own_speed(path, job)
        if duration and motions:
            return
        seconds = RefinedPath.clock_s if limited else RefinedPath.duration
        most = duration / LEAST_TIME_RATIO if duration else math.inf
        fast = [(seconds(each, job), each) for each in self.refined if each not in slow]
        fast.sort(key=lambda each: (not each[1].origin.clear, each[0]))
        for needed, path in fast[:MAX_PATHS]:
            if needed > min([most, *(each.iterate.duration for each in motions)]):
                return
            if limited:
                free, solution = halve_mesh(path.free, path.solution)
                yield path.origin, *clock(job, free, solution.iterate)
            else:
                yield _start_at_own_speed(path, job)


def _start_at_own_speed(path: RefinedPath, job: Task) -> tuple[SeedPath, Task, Iterate]:
    """Return a path, the task on the path's own mesh, and the path at its own speed as a start."""
    free, solution = halve_mesh(path.free, path.solution)
    fine = on_mesh(job, free, free.mesh)
    return path.origin, fine, transfer(free, solution.iterate, fine)
