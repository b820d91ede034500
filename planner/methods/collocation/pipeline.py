"""The search for a motion in one loop: which stage is next, and what is kept.

    straight line -> paths -> timing -> refinement;  the ladder where no path is found

The systems are driftless: what a path looks like and how fast it is run are two questions. Paths of
least effort come from many first guesses (`candidates`, `path`); the shortest few get the duration,
the limits and the objective asked for (`solve_timing`), and the best of these a mesh on which it is
the machine's true motion (`refine`). A stage is tried only where those before it have no answer.

A stage yields what it finds, in the order in which it finds it. `Best` keeps the best of all that,
for when the search must end early (`planner.methods.collocation.best`).
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
"""Mesh intervals near a straight line in a given time, and for what may wind more than once."""

MOST_REBALANCINGS = 6
"""Times that the duration is shared out anew among the parts between waypoints."""

GAIN = 1e-3
"""Least share of the objective that another motion must save before it is refined too."""

LARGEST_ERROR = 1e-4
"""Difference at the end, rad, between a motion and its interpolant up to which it is believed."""

Tasks = Callable[[Problem, CollocationOptions, Mesh | int, bool], Task]
"""From a problem, options, a mesh or about how many intervals, and whether a straight line is to
lead to the answer soon or not at all, to the task."""


class Pipeline:
    """One search, and what it keeps.

    Attributes:
        log: One entry a start, JSON-ready.
        fastest: Where every motion found is too slow for the duration given: the fastest, refined.
        pathless: Whether no guess leads to a path that keeps clear of all discs.
        last: What is no answer, for want of one: the last, and its task.
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
            routes: The problem with its waypoints in each order worth trying.
            options: Of the method.
            make: The problem on a mesh.
            best: What is held, for the end of the time.
            paths: Of these routes, where another search has found them: they know no duration.
            near: Motions next to a plan that is there, the first stage.
            answers: Whether motions answer what is asked, so that `best` is to have them.
            rank: What the motion taken has least of, in place of the objective.
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
        """The best motion of the first stage that has one, on a mesh fine enough to believe it."""
        held: Motion | None = None  # the best of all that is no answer of its stage
        for stage in self._stages():
            motions = list[Motion]()
            with deadline.time_share(condition=self.best.holds):  # nothing held: nothing to refine
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
                held = None  # no true motion
        return None

    def _refined(self, motions: list[Motion]) -> tuple[Motion, PolishedMotion] | None:
        """The best of these motions once refined, or None where none is good.

        Refining seldom lowers an objective: those that are worse to begin with than one that is
        refined are left.
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
        """One stage after the other.

        Whoever has a motion has every slower one: where the paths lead to none in the duration
        given, the search without a duration is gone through, and its motion slowed down. Else the
        ladder is, which finds paths of long arms that no guess leads to.
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
        """From the straight line at once, where the motion can be one way in a given time.

        All routes or none; but of the branches of a goal that leaves joints free those that can,
        and the others along paths.
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
        """Motions of these routes along the paths that guesses lead to.

        Branches of one goal share the paths that are enough, and none is timed twice.
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
        """The paths of a route, the most promising of them refined."""
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
        """The motion along a path by way of shorter arms."""
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
        """The fastest motion, bettered in the duration given, or else as it is but slower."""
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
        """With the time shared out among the parts between waypoints as the objective wants it."""
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
    """Of a goal that leaves joints free, which one the search expects, in words."""
    if not problem.free:
        return ""
    if problem.system.has_user_coordinates:
        return ""  # one goal is expected
    angles = ", ".join(f"{angle:.3g}" for angle in np.rad2deg(problem.likely.goal[1:]))
    return f" towards ({angles}) deg"


def _can_go_one_way(problem: Problem) -> bool:
    if problem.free:
        return not problem.divided  # no window is known; whoever cannot soon says so
    window = travel_window(problem)
    if window is None or window.empty or problem.divided:
        return False
    return problem.travel is None or problem.travel in window
