"""The search for a motion: a few stages, each of which returns its motions.

    plan to start from -> straight line -> paths -> slower motions, or ladder

The systems are driftless, so a path and its speed can be found separately. The stages:

- *Straight line*: the whole problem is solved directly from a straight line, where that may do.
- *Paths*: paths of least effort are found from many first guesses (`guesses`, `path`). The
  shortest few (`route_paths`) are then solved with the duration, the limits and the objective of
  the problem (`solve_timing`). Among discs some are found leg by leg, and are timed so that links
  stay on their side of each disc (`discs`).
- *Slower motions*: if none of the paths fits into the given duration, the fastest motion is found
  by a search with a free duration; it tells how much is missing, or is slowed down.
- *Ladder*: with a free duration, a path of a long arm is built from that of a shorter one.

After each stage its answers are refined, the best first: each gets a mesh on which it is the true
motion, and limits are kept between the nodes (`polish`). If an intermediate result is better than
all answers, it is refined too. The best accepted one is the answer of the search; without one the
next stage follows. Whatever is found on the way goes into the `Record` at once (`best`). If time is
up, the best candidates there are refined instead, so that the result is never worse than the best
motion held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from planner.errors import InputError
from planner.methods.collocation.best import Candidate, Exactness, Record, polish
from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.discs import time_clear
from planner.methods.collocation.guesses import guess, mesh_through, rebalance, seeds, sides
from planner.methods.collocation.long_arms.exact_motion import exact_motion
from planner.methods.collocation.long_arms.ladder import find_arm_path, has_ladder, time_arm_path
from planner.methods.collocation.path import (
    SURE_ONE_WAY,
    Enough,
    SeedPath,
    at_constant_speed,
    never_reverses,
    same_path,
    search,
    solve_timing,
)
from planner.methods.collocation.route_paths import (
    LADDER_INTERVALS,
    LEAST_TIME_RATIO,
    RefinedPath,
    RoutePaths,
    paths_of_legs,
)
from planner.methods.collocation.solvers import Settings
from planner.methods.collocation.task import Solution, Task, stretch_to, task
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.follower import Follower
from planner.methods.collocation.transcription.form import Form, InputKind, Mesh, objective
from planner.problem.feasibility import travel_window, why_too_short
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions, DesensitisedOptions
from planner.support import deadline, progress

DIRECT_INTERVALS, SEARCH_INTERVALS, LONG_ARM_INTERVALS = 14, 40, 80
"""Mesh intervals for motions near a straight line in a given time, for all other searches, and for
those of more than four joints. On 40 the shortest path of five joints often ends 1 rad from its
true motion: on 80, plans of 16 pairs within 30 degrees took up to 23 % less effort."""

MOST_REBALANCINGS = 6
"""Largest number of redistributions of the duration among the parts between waypoints."""

GAIN = 1e-3
"""A further motion is refined only if it saves at least this share of the objective."""


Stages = Literal["all", "first", "last"]


@dataclass(frozen=True, eq=False)
class Pipeline:
    """One search.

    Attributes:
        routes: Variants of the problem, see `routes` of `guesses`.
        options: Options of the method.
        record: Keeps what is found on the way.
        near: Candidates near an existing plan, the first stage.
        stages: Which stages to run: those before slower motions and ladder come first. Motions
            through waypoints with times cannot be slowed, so the last stages are then all.
        paths: Paths by route, found so far; they do not depend on the duration.
    """

    routes: list[Problem]
    options: CollocationOptions
    record: Record
    near: Iterable[Candidate] = ()
    stages: Stages = "all"
    paths: dict[int, RoutePaths] = field(default_factory=dict)

    @property
    def _free(self) -> bool:
        return self.options.start == "auto"

    def run(self) -> list[Candidate]:
        """Run the stages until one has refined answers; return all of these, or an empty list."""
        tried = set[Solution]()
        for stage in self._stages():
            with deadline.time_share(condition=self.record.holds):  # keep time to refine a result
                answers = [each for each in stage() if each.solution.ok]
            least = min((each.solution.objective for each in answers), default=-math.inf)
            top = self.record.candidates.get(Exactness.SOLVED)
            if top and top.solution not in tried and top.solution.objective < least * (1 - GAIN):
                answers.append(top)
            if refined := self._refine(answers):
                return refined
            tried |= {each.solution for each in answers}
        return []

    def _refine(self, candidates: list[Candidate]) -> list[Candidate]:
        """Refine these candidates; return those that are then accepted.

        All are accepted if the options give a start or no refinements. Refinement seldom lowers an
        objective, so candidates that are worse than a refined one are left out.
        """
        options, least, refined = self.options, math.inf, list[Candidate]()
        for candidate in sorted(candidates, key=lambda each: each.solution.objective):
            if candidate.solution.objective > least * (1 - GAIN):
                break
            done = polish(candidate, options.accuracy, options.refinements)
            good = done.exactness >= Exactness.ACCEPTED
            if good or not self._free or options.refinements == 0:
                refined.append(done)
                least = min(least, done.solution.objective) if good else -math.inf
            else:
                self.record.last = done
        return refined

    def _stages(self) -> Iterator[Callable[[], list[Candidate]]]:
        """Yield the stages in turn.

        Any motion can be slowed down. So if the paths lead to no motion in the given duration, the
        search is repeated with a free duration, and its motion is slowed down. With a free duration
        the ladder follows, which finds paths of long arms where all guesses fail.
        """
        timed = any(point.time_s is not None for point in self.routes[0].waypoints)
        if self.stages != "last" or timed:
            yield self._near_motions
            if self.options.start in ("auto", "straight"):
                yield self._straight_motions
            yield self._path_motions
        if self.stages == "first":
            return
        if self.routes[0].duration is None:
            if self._free:
                yield self._ladder_motions
        elif not timed:
            yield self._slower_motions

    def _near_motions(self) -> list[Candidate]:
        """Return the motions near an existing plan."""
        noted = (self.record.note(each) if each.solution.ok else each for each in self.near)
        return [self.record.take(each) for each in noted]

    def _straight_motions(self) -> list[Candidate]:
        """Return motions solved directly from the straight line.

        With the start "auto", there are none if a route cannot be one-way. With a free duration
        only motions without reversal count. If the goal is given, every order of waypoints must
        have such a motion, or none is an answer. Afterwards paths are searched for the routes
        without such a motion, or for all routes if the system is long.
        """
        motions = list[Candidate]()
        for k, problem in enumerate(self.routes):
            if self._free and not _can_go_one_way(problem):
                return []
            plain = problem.duration is not None and self.options.input != "constant"
            few = DIRECT_INTERVALS if plain else search_intervals(problem)
            job, solutions = collocation_task(problem, self.options, few, True), list[Candidate]()
            later = replace(job, settings=replace(job.settings, direct=False))
            for seed in seeds("straight", sides=sides(problem)):
                solution = job.solve(guess(job.problem, job.nlp, job.mesh, seed))
                name = seed.name + _goal_words(problem)
                motion = self.record.take(Candidate(later, solution, name, "straight line", k))
                if solution.ok and (problem.duration or never_reverses(solution.iterate)):
                    solutions.append(self.record.note(motion))
            if not solutions and not problem.free:
                return []
            motions += solutions
        if not motions:
            return []
        sure = self.routes[0].system.size <= SURE_ONE_WAY
        straight = {motion.route for motion in motions if sure}
        others = [k for k in range(len(self.routes)) if k not in straight]
        return [self._share_time(motion) for motion in motions] + self._path_motions(others)

    def _path_motions(self, routes: Sequence[int] | None = None) -> list[Candidate]:
        """Return motions of these routes, or of all, along the most promising paths.

        The branches of one goal share the usual number of paths, and no path is timed twice.
        """
        motions, timed, record = list[Candidate](), list[SeedPath](), self.record
        for k in range(len(self.routes)) if routes is None else routes:
            problem = self.routes[k]
            job = collocation_task(problem, self.options, search_intervals(problem))
            paths = self._find_paths(k, job)
            log = [dict(entry) for entry in paths.search.log]
            progress.tell("timing the most promising paths")
            words, found = _goal_words(problem), [each.solution for each in motions]
            for path, path_job, start in paths.starts(job, found):
                if problem.free and any(same_path(path.solution.objective, one) for one in timed):
                    continue
                timed.append(path)
                if problem.divided:
                    path_job, solution = time_clear(path_job, start)
                else:
                    solution = solve_timing(path_job, start)
                name = path.seed + words
                motion = record.take(Candidate(path_job, solution, name, path.stage, k))
                if solution.ok and clears(path_job, solution):
                    motions.append(self._share_time(motion))
                    found.append(motions[-1].solution)
                    record.pathless = False
                elif not solution.ok:
                    record.pathless, record.last = False, motion
                for entry in log:
                    effort = entry["path_effort"]
                    if effort is not None and same_path(effort, path):
                        entry["objective"] = solution.objective if solution.ok else None
            if record.pathless:
                failed = [paths.search.failure, *(path.solution for path in paths.search.distinct)]
                failures = (Candidate(paths.free, one) for one in failed if one)
                record.last = next(failures, record.last)
            record.log += [entry | {"start": entry["start"] + words} for entry in log]
        return motions

    def _find_paths(self, k: int, job: Task) -> RoutePaths:
        """Search the paths of route `k`, and refine the most promising; beside a path found leg by
        leg, half of the guesses will do."""
        if k in self.paths:
            return self.paths[k]
        problem, options = self.routes[k], self.options
        quick = why_too_short(problem) is not None  # any motion will do, to name its duration
        enough = options.starts if options.start in ("auto", "wander") and not quick else 1
        enough = -(-enough // len(self.routes)) if problem.free else enough
        legs = list[RefinedPath]()

        def keep(task: Task, solution: Solution, name: str) -> None:
            self.record.take(Candidate(task, solution, name, "guesses", k))

        if self._free and problem.obstacles and not problem.waypoints:
            for path in paths_of_legs(job):
                legs.append(path)
                own, found = job.on_mesh(path.free.mesh), path.origin
                if motion := at_constant_speed(own, path.free, path.solution):
                    candidate = Candidate(own, motion, found.seed, found.stage, k)
                    self.record.take(self.record.note(candidate))
        guesses = seeds(options.start, options.attempts // (2 if legs else 1), sides(problem))
        ladder = self._free and has_ladder(job)
        most = LADDER_INTERVALS["soon" if quick else "best"] if ladder else math.inf
        rules = Enough(enough, self._free and not problem.divided, most)
        result = search(job, guesses, rules, keep)
        mesh_given = bool(job.mesh.marks) or options.intervals != "auto"
        self.paths[k] = RoutePaths.of(job, result, mesh_given, most, legs)
        return self.paths[k]

    def _ladder_motions(self) -> list[Candidate]:
        """Return the motion along a path found by the ladder; keep the path itself first."""
        problem = self.routes[0].likely
        job = collocation_task(problem, self.options, search_intervals(problem))
        path = find_arm_path(job)
        if path is None:
            return []
        chain, joints = path
        exact = exact_motion(job, chain, self.options.accuracy)
        origin = f"lifted from {joints} joints", "ladder"
        if exact:
            self.record.take(Candidate(*exact, *origin, checked=Exactness.EXACT))
        pair = time_arm_path(job, chain) or exact
        return [self.record.take(self.record.note(Candidate(*pair, *origin)))] if pair else []

    def _slower_motions(self) -> list[Candidate]:
        """Return the fastest motion, slowed to the given duration: only slowed, and optimised."""
        target, limits = self.routes[0].duration, self.routes[0].limits
        assert target is not None
        free = [replace(problem, duration=None) for problem in self.routes]
        kind = "time" if np.isfinite(limits.input).all() else "mixed"
        options = self.options.model_copy(update={"objective": kind})
        progress.tell("looking for the fastest motion")
        record, hasty = self.record, Record(None)  # its motions are too slow to be answers
        found = Pipeline(free, options, hasty, paths=self.paths).run()
        fastest = max(found, key=lambda each: each.rank, default=None)
        record.log += hasty.log
        if fastest is None:
            record.pathless &= hasty.pathless
            record.last = record.last or hasty.last
            return []
        record.fastest = record.last = fastest
        iterate = fastest.solution.iterate
        if iterate.duration * LEAST_TIME_RATIO > target:
            return []
        problem = self.routes[fastest.route]
        goal = objective(problem, self.options)
        goal_job = fastest.task.for_problem(problem, goal)
        slowed, origin = stretch_to(iterate, target), (fastest.start, "slowed down", fastest.route)
        rates = [goal_job.judge] * (iterate.duration <= target) + [goal_job.solve]
        return [self.record.take(Candidate(goal_job, rate(slowed), *origin)) for rate in rates]

    def _share_time(self, motion: Candidate) -> Candidate:
        """Return the motion with the best times of the parts between waypoints."""
        for _ in range(MOST_REBALANCINGS if motion.task.mesh.marks else 0):
            pair = rebalance(motion.task, motion.solution.iterate)
            if pair is None:
                break
            solution = pair[0].solve(pair[1], near=True)
            if not solution.ok or solution.objective >= motion.solution.objective:
                break
            motion = replace(motion, task=pair[0], solution=solution)
        return self.record.take(motion)


def _goal_words(problem: Problem) -> str:
    """Return the expected goal of the search in words, if the goal leaves joints free; else ""."""
    if not problem.free or problem.system.has_user_coordinates:  # then there is only one goal
        return ""
    angles = ", ".join(f"{angle:.3g}" for angle in np.rad2deg(problem.likely.goal[1:]))
    return f" towards ({angles}) deg"


def _can_go_one_way(problem: Problem) -> bool:
    if problem.free:
        return not problem.divided  # no window of travels is known; a wrong guess fails quickly
    window = travel_window(problem)
    if window is None or window.empty or problem.divided:
        return False
    return problem.travel is None or problem.travel in window


def search_intervals(problem: Problem) -> int:
    """Return the number of mesh intervals on which motions and paths are searched."""
    return SEARCH_INTERVALS if problem.system.size <= 5 else LONG_ARM_INTERVALS


def collocation_task(
    problem: Problem,
    options: CollocationOptions,
    mesh: Mesh | int,
    direct: bool = False,
    follower: Follower | None = None,
) -> Task:
    """Make the task of a problem on a mesh with waypoints on edges.

    Args:
        problem: The problem.
        options: The options of the method.
        mesh: The mesh, or its approximate number of intervals if the options do not give one.
        direct: Whether to solve from a straight line, in few iterations or not at all.
        follower: The joints of the nominal machine, if their motion is transcribed too.
    """
    goal = objective(problem, options)
    kind = input_kind(problem, "collocation", options, bool(goal.weights[3]))
    if isinstance(mesh, int):
        mesh = mesh_through(problem, mesh if options.intervals == "auto" else options.intervals)
    form = Form(
        intervals=len(mesh.widths),
        scheme_kind=options.scheme,
        degree=options.degree,
        input=kind,
        inner=problem.divided,  # else links could pass through a disc between two edges
        edge="closeness" in goal.terms,
        follower=follower,
    )
    settings = Settings(options.tolerance, options.max_iterations, solver=options.solver)
    return task(
        problem,
        goal,
        form,
        mesh,
        InputDemands(problem.rests(options.rest)),
        replace(settings, direct=direct),
    )


def input_kind(
    problem: Problem,
    method: str,
    options: CollocationOptions | DesensitisedOptions,
    slopes: bool = False,
    auto: InputKind = "linear",
) -> InputKind:
    """Return the kind of input to use.

    Args:
        problem: The problem.
        method: Name of the method.
        options: Its options.
        slopes: Whether the objective depends on the inputs' rates.
        auto: The kind to use if nothing requires inputs without jumps.

    Raises:
        InputError: If inputs without jumps are required but the options give constant ones.
    """
    smooth = slopes or options.rest is True or problem.reads("du")
    if options.input == "auto":
        return "linear" if smooth else auto
    if options.input == "constant" and smooth:
        what = "rest = true" if options.rest is True else "the limit on input rates"
        what = "an objective that reads the inputs' rates" if slopes else what
        raise InputError(
            f"method.{method}.input = 'constant' jumps between intervals,"
            f" which contradicts {what}; use 'linear' or 'auto'",
            source=problem.source,
        )
    return options.input
