"""The search for a motion: one loop over stages.

    straight line -> paths -> timing -> refinement;  the ladder if no path is found

The systems are driftless, so the path and its speed can be found separately. Paths of least effort
are found from many first guesses (`candidates`, `path`). The shortest few are then solved with the
duration, the limits and the objective of the problem (`solve_timing`), and the best of these gets a
mesh on which it is the true motion (`refine`). A stage is tried only if the stages before it have
no answer. A stage yields its motions as it finds them. `Best` keeps the best of them, for the case
that the search must end early (`planner.methods.collocation.best`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.methods.collocation.best import Best, Motion
from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.candidates import (
    guess,
    rebalance,
    seeds,
    sides,
    way_between_discs,
)
from planner.methods.collocation.long_arms.ladder import find_arm_path, time_arm_path
from planner.methods.collocation.path import (
    SeedPath,
    is_sure,
    never_reverses,
    same_path,
    search,
    solve_timing,
)
from planner.methods.collocation.refine import PolishedMotion, polish
from planner.methods.collocation.route_paths import LEAST_TIME_RATIO, RoutePaths
from planner.methods.collocation.task import Solution, Task, stretch_to
from planner.methods.collocation.transcription.form import Mesh
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress

DIRECT_INTERVALS, SEARCH_INTERVALS = 14, 40
"""Mesh intervals for motions near a straight line in a given time, and for all other searches."""

MOST_REBALANCINGS = 6
"""Largest number of redistributions of the duration among the parts between waypoints."""

GAIN = 1e-3
"""Another motion is refined too only if it saves at least this share of the objective."""

LARGEST_ERROR = 1e-4
"""Largest difference at the end, rad, between a motion and its interpolant to accept it."""

Tasks = Callable[[Problem, CollocationOptions, Mesh | int, bool], Task]
"""Makes a task from a problem, options, a mesh or an approximate number of intervals, and whether
to solve from a straight line in few iterations or not at all."""


class Pipeline:
    """One search and its results.

    Attributes:
        log: One entry per start, JSON-ready.
        fastest: The fastest motion found, refined, if all are too slow for the given duration.
        pathless: Whether no guess leads to a path that clears all discs.
        last: The last failed solution with its task, for a refusal.
    """

    def __init__(
        self,
        routes: list[Problem],
        options: CollocationOptions,
        make: Tasks,
        best: Best,
        paths: dict[int, RoutePaths] | None = None,
        near: Callable[[], Iterator[Motion]] | None = None,
        answers: bool = True,
        rank: Callable[[Motion, PolishedMotion], float] | None = None,
    ) -> None:
        """Set up a search.

        Args:
            routes: Variants of the problem, see `routes` of `candidates`.
            options: Options of the method.
            make: Makes the task of a problem on a mesh.
            best: Keeps the best results, for the case that time is up.
            paths: Paths of these routes from another search, if any; they do not depend on the
                duration.
            near: Yields motions near an existing plan, as the first stage.
            answers: Whether the motions answer the problem, so that `best` keeps them.
            rank: Measure to minimise instead of the objective when choosing among motions.
        """
        self._rank = rank
        self.routes, self.options, self.make, self.best = routes, options, make, best
        self.log: list[dict[str, Any]] = []
        self.fastest: PolishedMotion | None = None
        self.pathless = True
        self.last: tuple[Task, Solution] | None = None
        self._paths, self._near, self._answers = {} if paths is None else paths, near, answers
        self._free = options.start == "auto"

    def run(self) -> tuple[Motion, PolishedMotion] | None:
        """The best motion of the first stage that has one, on a mesh that makes it accurate."""
        held: Motion | None = None  # the best intermediate result of all stages
        for stage in self._stages():
            motions = list[Motion]()
            with deadline.time_share(condition=self.best.holds):  # keep time to refine a result
                for motion in stage:
                    if self._answers:
                        self.best.take(motion.task, motion.solution)
                    if motion.final and motion.solution.ok:
                        motions.append(motion)
                    elif self.best.keeps(motion.solution):
                        held = motion
            least = min((motion.solution.objective for motion in motions), default=-math.inf)
            if held and held.solution.objective < least * (1 - GAIN):
                motions.append(held)
            if answer := self._refined(motions):
                return answer
            if held and any(held.solution is each.solution for each in motions):
                held = None  # it could not be refined
        return None

    def _refined(self, motions: list[Motion]) -> tuple[Motion, PolishedMotion] | None:
        """The best of these motions after refinement, or None if none is good.

        Refinement seldom lowers an objective, so motions that are worse than a refined one are not
        refined.
        """
        options, rank, least = self.options, self._rank, math.inf
        answers = list[tuple[Motion, PolishedMotion]]()
        for motion in sorted(motions, key=lambda each: each.solution.objective):
            if motion.solution.objective > least * (1 - GAIN):
                break
            done = polish(motion.task, motion.solution, options.accuracy, options.refinements)
            good = done.error <= LARGEST_ERROR and done.inside
            if good or not self._free or options.refinements == 0:
                answers.append((motion, done))
                if rank is None:
                    least = min(least, done.solution.objective) if good else -math.inf
            else:
                self.last = done.task, done.solution
        value = _objective if rank is None else lambda pair: rank(*pair)
        return min(answers, key=value, default=None)

    def _stages(self) -> Iterator[Iterator[Motion]]:
        """Yield the stages in turn.

        Any motion can be slowed down. So if the paths lead to no motion in the given duration, the
        search is repeated with a free duration, and its motion is slowed down. With a free duration
        the ladder follows, which finds paths of long arms where all guesses fail.
        """
        if self._near is not None:
            yield self._near_motions(self._near)
        if self.options.start in ("auto", "straight"):
            yield self._straight_motions()
        yield self._path_motions(range(len(self.routes)))
        if self.routes[0].duration is not None:
            yield self._slower_motions()
        elif self._free:
            yield self._ladder_motions()

    def _near_motions(self, near: Callable[[], Iterator[Motion]]) -> Iterator[Motion]:
        for motion in near():
            if motion.solution.ok:
                self._log_motion(motion)
            yield motion

    def _log_motion(self, motion: Motion) -> None:
        solution = motion.solution
        entry = {"start": motion.start, "status": solution.status}
        self.log.append({**entry, "objective": solution.objective})

    def _straight_motions(self) -> Iterator[Motion]:
        """Motions solved directly from the straight line, if they can be one-way in a given time.

        It is tried for all orders of waypoints or for none. If the goal leaves joints free, it is
        tried for the branches that allow it; the others follow from paths.
        """
        motions = list[Motion]()
        for k, problem in enumerate(self.routes):
            if self._free and not _can_go_one_way(problem):
                return
            plain = problem.duration is not None and self.options.input != "constant"
            few = DIRECT_INTERVALS if plain else SEARCH_INTERVALS
            job, found = self.make(problem, self.options, few, True), list[Motion]()
            later = replace(job, settings=replace(job.settings, direct=False))
            for seed in seeds("straight", sides=sides(problem)):
                solution = job.solve(guess(job.problem, job.made, job.mesh, seed))
                name = seed.name + _goal_words(problem)
                motion = Motion(name, "straight line", later, solution, k, False)
                yield motion
                if solution.ok and (problem.duration or never_reverses(solution.iterate)):
                    self._log_motion(motion)
                    found.append(motion)
            if not found and not problem.free:
                return
            motions += found
        for motion in motions:
            yield from self._share_time(motion)
        if motions:
            straight = {motion.route for motion in motions if is_sure(motion.task.problem)}
            yield from self._path_motions([k for k in range(len(self.routes)) if k not in straight])

    def _path_motions(self, routes: Sequence[int]) -> Iterator[Motion]:
        """Motions of these routes along the paths found from guesses.

        The branches of one goal together need only the usual number of paths, and no path is timed
        twice.
        """
        motions, known = list[Solution](), list[SeedPath]()
        for k in routes:
            problem = self.routes[k]
            job = self.make(problem, self.options, SEARCH_INTERVALS, False)
            paths = yield from self._find_paths(k, job)
            log = [dict(entry) for entry in paths.search.log]
            progress.tell("timing the most promising paths")
            for path, own, start in paths.starts(job, motions):
                if problem.free and any(same_path(path.solution.objective, one) for one in known):
                    continue
                known.append(path)
                solution = solve_timing(own, start)
                name = path.seed + _goal_words(problem)
                motion = Motion(name, "guesses", own, solution, k, final=False)
                yield motion
                if solution.ok and clears(own, solution):
                    motion = yield from self._share_time(motion)
                    motions.append(motion.solution)
                    self.pathless = False
                elif not solution.ok:
                    self.pathless, self.last = False, (own, solution)
                for entry in log:
                    effort = entry["path_effort"]
                    if effort is not None and same_path(effort, path):
                        entry["objective"] = solution.objective if solution.ok else None
            if self.pathless:
                failed = [paths.search.failure, *(path.solution for path in paths.search.distinct)]
                self.last = next(((paths.free, last) for last in failed if last), self.last)
            self.log += [entry | {"start": entry["start"] + _goal_words(problem)} for entry in log]

    def _find_paths(self, k: int, job: Task) -> Generator[Motion, None, RoutePaths]:
        """Find the paths of a route, and refine the most promising."""
        if k in self._paths:
            return self._paths[k]
        problem, options = self.routes[k], self.options
        enough = options.starts if options.start in ("auto", "wander") else 1
        enough = -(-enough // len(self.routes)) if problem.free else enough
        guesses = seeds(options.start, options.attempts, sides(problem))
        simple = self._free and not problem.divided
        if not simple and self._free and (way := way_between_discs(problem)):
            guesses.insert(0 if problem.system.size == 3 else len(guesses), way)
        for found in search(job, guesses, enough, simple):
            if found.latest:
                yield Motion(found.log[-1]["start"], "guesses", *found.latest, k, final=False)
        mesh_given = bool(job.mesh.marks) or options.intervals != "auto"
        self._paths[k] = RoutePaths.of(job, found, mesh_given)
        return self._paths[k]

    def _ladder_motions(self) -> Iterator[Motion]:
        """The motion along a path found by the ladder."""
        job = self.make(self.routes[0].likely, self.options, SEARCH_INTERVALS, False)
        path = find_arm_path(job)
        if path is None:
            return
        chain, joints = path
        if self._answers:
            self.best.take_chain(job, chain)
        found = time_arm_path(job, chain, self.options.accuracy)
        if found is not None:
            motion = Motion(f"lifted from {joints} joints", "ladder", *found)
            self._log_motion(motion)
            yield motion

    def _slower_motions(self) -> Iterator[Motion]:
        """The fastest motion, slowed to the given duration and optimised there, or only slowed."""
        wanted, limits = self.routes[0].duration, self.routes[0].limits
        if any(point.time_s is not None for point in self.routes[0].waypoints):
            return
        assert wanted is not None
        free = [replace(problem, duration=None) for problem in self.routes]
        kind = "time" if np.isfinite(limits.input).all() else "mixed"
        options = self.options.model_copy(update={"objective": kind})
        progress.tell("looking for the fastest motion")
        hasty = Pipeline(free, options, self.make, self.best, self._paths, answers=False)
        found = hasty.run()
        self.log += hasty.log
        if found is None:
            self.pathless, self.last = hasty.pathless and self.pathless, self.last or hasty.last
            return
        motion, self.fastest = found
        self.last = self.fastest.task, self.fastest.solution
        iterate = self.fastest.solution.iterate
        if iterate.duration * LEAST_TIME_RATIO > wanted:
            return
        problem = self.routes[motion.route]
        goal = self.make(problem, self.options, SEARCH_INTERVALS, False).objective
        own = self.fastest.task.for_problem(problem, goal)
        slowed = stretch_to(iterate, wanted)
        if iterate.duration <= wanted:
            yield Motion(motion.start, "slowed down", own, own.judge(slowed), motion.route)
        yield Motion(motion.start, "slowed down", own, own.solve(slowed), motion.route)

    def _share_time(self, motion: Motion) -> Generator[Motion, None, Motion]:
        """The motion with the best distribution of time among the parts between waypoints."""
        for _ in range(MOST_REBALANCINGS if motion.task.mesh.marks else 0):
            moved = rebalance(motion.task, motion.solution.iterate)
            if moved is None:
                break
            solution = moved[0].solve(moved[1], near=True)
            if not solution.ok or solution.objective >= motion.solution.objective:
                break
            motion = replace(motion, task=moved[0], solution=solution)
        motion = replace(motion, final=True)
        yield motion
        return motion


def _objective(pair: tuple[Motion, PolishedMotion]) -> float:
    return pair[1].solution.objective


def _goal_words(problem: Problem) -> str:
    """The expected goal of the search in words, if the goal leaves joints free; else ""."""
    if not problem.free:
        return ""
    if problem.system.has_user_coordinates:
        return ""  # only one goal
    angles = ", ".join(f"{angle:.3g}" for angle in np.rad2deg(problem.likely.goal[1:]))
    return f" towards ({angles}) deg"


def _can_go_one_way(problem: Problem) -> bool:
    if problem.free:
        return not problem.divided  # no window is known; a wrong guess fails quickly
    window = travel_window(problem)
    if window is None or window.empty or problem.divided:
        return False
    return problem.travel is None or problem.travel in window
