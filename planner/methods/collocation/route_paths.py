"""The paths of a route: the most promising are refined, ranked and used as starts of motions.

The objective of a refined path at constant speed predicts which motion is best, so only one or two
are timed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from planner.methods.collocation.discs import paths_by_legs
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
"""Largest number of paths to time; and of mesh intervals of the paths to refine, in all. Where the
first long path of four joints failed, so did all others (6 of 6 among 22 random pairs)."""

LADDER_INTERVALS = {"best": 220, "soon": 80}
"""Largest number of intervals of a path to refine if the ladder can find another path: for the best
motion, and for any motion soon. Of six paths of more than 220, of four joints, one could be
refined. With 80, the motion that a refusal names takes up to 1.4 times as long, found in a third of
the time (13 refusals)."""

TIMES = np.geomspace(1e-3, 1e3, 49)
"""Durations tried for a path, relative to its own, to find the best roughly."""

MAX_COARSE_PATHS = 6
"""Largest number of paths to time on a given mesh, for which the fastest path is unknown."""

LEAST_TIME_RATIO = 0.95
"""Least expected ratio of a motion's duration to its path's by `clock`."""


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

    def least_duration(self, job: Task) -> float:
        """Return the duration of the path, s, timed by `clock` if both inputs have limits."""
        if not np.isfinite(job.problem.limits.input).all():
            return self.duration(job)
        return float(clock_times(job.problem, self.free.mesh, self.solution.iterate)[0][-1])

    def value(self, job: Task) -> float:
        """Return the job's objective of the path at constant speed, in the given duration, or in
        the best."""
        curve, given = self.free.curve(self.solution.iterate), job.problem.duration
        times = [given] if given else np.maximum(curve.duration * TIMES, self.least_duration(job))
        return min(job.objective.value(curve.slowed(t / curve.duration)) or 0.0 for t in times)


@dataclass(frozen=True, eq=False)
class RoutePaths:
    """The paths of a route, which depend only on the system, the ends and the geometry.

    Attributes:
        free: The path task on the coarse mesh of the search.
        search: The finished search.
        refined: The most promising paths, refined, and those found leg by leg.
        coarse: The most promising paths if the mesh is given, on which they are timed; else none.
    """

    free: Task
    search: Paths
    refined: list[RefinedPath]
    coarse: list[SeedPath]

    @classmethod
    def of(
        cls,
        job: Task,
        paths: Paths,
        mesh_given: bool,
        most: float = math.inf,
        legs: Sequence[RefinedPath] = (),
    ) -> RoutePaths:
        """Refine the most promising paths of a search, unless the user gives the mesh.

        Paths that need more than `most` intervals are left to the ladder. `legs` are the paths
        found leg by leg.
        """
        free, refined, spent = path_task(job), [*legs], 0
        if mesh_given:
            return cls(free, paths, refined, paths.clear[:MAX_COARSE_PATHS])
        for path in paths.clear:
            count = path_intervals(free, path.solution.iterate)
            if count > most or (spent and spent + count > REFINED_INTERVALS):
                break
            progress.tell(f"refining the path of '{path.seed}'")
            spent += count
            if both := refine_path(free, path.solution):
                refined.append(RefinedPath(path, *both))
        return cls(free, paths, refined, [])

    def starts(
        self, job: Task, motions: Sequence[Solution]
    ) -> Iterator[tuple[SeedPath, Task, Iterate]]:
        """Yield the most promising paths, each with a task on its own mesh and a start of the task.

        Paths that fit into the given duration at constant speed come first, by their value. The
        others follow: by their duration if none fits, else those of less value than all that fit.
        A path that takes longer than a motion already found is left out.

        Args:
            job: The task.
            motions: The motions found so far; the list may grow between two starts.
        """
        for one in self.coarse:
            yield one, job, transfer(self.free, one.solution.iterate, job)
        duration, limited = job.problem.duration, bool(np.isfinite(job.problem.limits.input).all())
        most = duration / LEAST_TIME_RATIO if duration else math.inf
        seconds = {each: each.least_duration(job) for each in self.refined}
        able = [each for each in self.refined if seconds[each] <= most]
        values = {each: each.value(job) for each in able}
        slow = [each for each in able if each.duration(job) <= (duration or 0.0)]
        slow.sort(key=lambda each: values[each])
        for path in slow[:MAX_PATHS]:
            yield _start_at_own_speed(path, job)
        known = [values[each] for each in slow] or [each.objective for each in motions]
        least = min(known) if duration and motions else math.inf
        order = seconds if duration and not motions else values
        fast = [each for each in able if each not in slow and values[each] < least]
        fast.sort(key=lambda each: order[each])
        for path in fast[:MAX_PATHS]:
            if seconds[path] > min((m.iterate.duration for m in motions), default=most):
                continue
            if limited:
                free, solution = halve_mesh(path.free, path.solution)
                yield path.origin, *clock(job, free, solution.iterate)
            else:
                yield _start_at_own_speed(path, job)


def paths_of_legs(job: Task) -> Iterator[RefinedPath]:
    """Yield paths between discs, found leg by leg, until one fits into the duration."""
    for free, solution in paths_by_legs(job):
        path = RefinedPath(SeedPath("legs between discs", solution, True, "legs"), free, solution)
        yield path
        if path.least_duration(job) <= (job.problem.duration or math.inf):
            return


def _start_at_own_speed(path: RefinedPath, job: Task) -> tuple[SeedPath, Task, Iterate]:
    """Return a path, the task on the path's own mesh, and the path at its own speed as a start."""
    free, solution = halve_mesh(path.free, path.solution)
    fine = on_mesh(job, free, free.mesh)
    return path.origin, fine, transfer(free, solution.iterate, fine)
