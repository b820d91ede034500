"""The search for a motion in one loop: which stage is next, and what is kept.

    straight line -> paths -> timing -> refinement;  the ladder where no path is found

The systems are driftless: what a path looks like and how fast it is run are two questions. Paths of
least effort come from many first guesses (`candidates`, `path`); the shortest few get the duration,
the limits and the objective asked for (`timed`), and the best of these a mesh on which it is the
machine's true motion (`refine`). A stage is tried only where those before it have no answer.

`Best` is what the search holds at any time, for when it must end early. A search finds motions in
many places, and in most of them it does not choose its answer. So whatever solves a task offers
what it finds, and of that only motions of the problem in question, which is the same object, are
kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.candidates import guess, rebalanced, seeds
from planner.methods.collocation.long_arms.bridges import PieceChain
from planner.methods.collocation.long_arms.held import can_hold, chain_of, held
from planner.methods.collocation.long_arms.ladder import climbed
from planner.methods.collocation.path import FoundPath, one_way, same_path, search, timed
from planner.methods.collocation.refine import Polished, polish
from planner.methods.collocation.route_paths import HASTE, RoutePaths
from planner.methods.collocation.task import Solution, Task, stretched
from planner.methods.collocation.transcription.form import Mesh
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress

DIRECT, SEARCHED = 14, 40
"""Mesh intervals near a straight line in a given time, and for what may wind more than once."""

SHARINGS = 6
"""Times that the duration is shared out anew among the parts between waypoints."""

RESOLVED = 1e-4
"""Difference at the end, rad, between a motion and its interpolant up to which it is believed."""

Tasks = Callable[[Problem, CollocationOptions, Mesh | int, bool], Task]
"""From a problem, options, a mesh or about how many intervals, and whether a straight line is to
lead to the answer soon or not at all, to the task."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A motion, the task it solves, and how it was come by.

    Attributes:
        start: Name of the start it grew from.
        stage: Name of the stage that found it.
        task: What it solves.
        solution: It.
    """

    start: str
    stage: str
    task: Task
    solution: Solution


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
        paths: dict[int, RoutePaths] | None = None,
        near: Callable[[], list[Answer]] | None = None,
    ) -> None:
        """Set up a search.

        Args:
            routes: The problem with its waypoints in each order worth trying.
            options: Of the method.
            make: The problem on a mesh.
            paths: Of these routes, where another search has found them: they know no duration.
            near: Motions next to a plan that is there, the first stage.
        """
        self.routes, self.options, self.make = routes, options, make
        self.log: list[dict[str, Any]] = []
        self.fastest: Polished | None = None
        self.pathless = True
        self.last: tuple[Task, Solution] | None = None
        self._paths, self._near = {} if paths is None else paths, near
        self._free = options.start == "auto"

    def run(self, holds: Callable[[], bool]) -> tuple[Answer, Polished] | None:
        """The best motion of the first stage that has one, on a mesh fine enough to believe it.

        Args:
            holds: Whether anything is held by now; with nothing held there is nothing to refine.
        """
        stages, options = self._stages(holds), self.options
        while True:
            with deadline.time_share(condition=holds):
                motions = next(stages, None)
            if motions is None:
                return None
            for answer in sorted(motions, key=lambda each: each.solution.objective):
                done = polish(answer.task, answer.solution, options.accuracy, options.refinements)
                good = done.error <= RESOLVED and done.inside
                if good or not self._free or options.refinements == 0:
                    return answer, done
                self.last = done.task, done.solution

    def _stages(self, holds: Callable[[], bool]) -> Iterator[list[Answer]]:
        """The motions of one stage after the other; each is gone through only if it is asked for.

        Whoever has a motion has every slower one: where the paths lead to none in the duration
        given, the search without a duration is gone through, and its motion slowed down. Else the
        ladder is, which finds paths of long arms that no guess leads to.
        """
        if self._near is not None:
            motions = self._near()
            self.log += [
                {"start": m.start, "status": m.solution.status, "objective": m.solution.objective}
                for m in motions
            ]
            yield motions
        if self.options.start in ("auto", "straight"):
            found = self._straight()
            answered = [each.task.problem for each in found]
            left = [each for each in self.routes if not any(each is one for one in answered)]
            yield found + self._along(left if found else [])
        yield self._along(self.routes)
        if self.routes[0].duration is not None:
            yield self._slowed_down(holds)
        elif self._free:
            yield self._by_ladder()

    def _straight(self) -> list[Answer]:
        """From the straight line at once, where the motion can be one way in a given time.

        All routes or none; but of the branches of a goal that leaves joints free those that can.
        """
        out = []
        for problem in self.routes:
            if self._free and not _one_way(problem):
                return []
            plain = problem.duration is not None and self.options.input != "constant"
            few = DIRECT if plain else SEARCHED
            job, seed = self.make(problem, self.options, few, True), seeds("straight")[0]
            solution = job.solve(guess(job.problem, job.made, job.mesh, seed))
            if not solution.ok or (problem.duration is None and not one_way(solution.iterate)):
                if problem.free:
                    continue
                return []
            later, name = replace(job, settings=replace(job.settings, direct=False)), seed.name
            name += _towards(problem)
            entry = {"start": name, "status": solution.status}
            self.log.append(entry | {"objective": solution.objective})
            out.append(Answer(name, "straight line", later, solution))
        return [self._shared_out(answer) for answer in out]

    def _along(self, routes: list[Problem]) -> list[Answer]:
        """Motions of these routes along the paths that guesses lead to.

        Branches of one goal share the paths that are enough, and none is timed twice.
        """
        out, motions, known = list[Answer](), list[Solution](), list[FoundPath]()
        for problem in routes:
            job = self.make(problem, self.options, SEARCHED, False)
            paths = self._paths_of(problem, job)
            log = [dict(entry) for entry in paths.search.log]
            progress.tell("timing the most promising paths")
            for path, own, start in paths.starts(job, motions):
                if problem.free and any(same_path(path.solution.objective, one) for one in known):
                    continue
                known.append(path)
                solution = timed(own, start)
                answer = Answer(path.seed + _towards(problem), "guesses", own, solution)
                if solution.ok and clears(own, solution):
                    out.append(self._shared_out(answer))
                    motions.append(out[-1].solution)
                    self.pathless = False
                elif not solution.ok:
                    self.pathless, self.last = False, (own, solution)
                for entry in log:
                    effort = entry["path_effort"]
                    if effort is not None and same_path(effort, path):
                        entry["objective"] = solution.objective if solution.ok else None
            if self.pathless:
                failed = [paths.search.last, *(path.solution for path in paths.search.found)]
                self.last = next(((paths.free, last) for last in failed if last), self.last)
            self.log += [entry | {"start": entry["start"] + _towards(problem)} for entry in log]
        return out

    def _paths_of(self, problem: Problem, job: Task) -> RoutePaths:
        """The paths of a route, the most promising of them refined."""
        k = next(k for k, each in enumerate(self.routes) if each is problem)
        if k in self._paths:
            return self._paths[k]
        options = self.options
        enough = options.starts if options.start in ("auto", "wander") else 1
        enough = -(-enough // len(self.routes)) if problem.free else enough
        guesses = seeds(options.start, options.attempts)
        found = search(job, guesses, enough, self._free and not problem.divided)
        mesh_given = bool(job.mesh.marks) or options.intervals != "auto"
        self._paths[k] = RoutePaths.of(job, found, mesh_given)
        return self._paths[k]

    def _by_ladder(self) -> list[Answer]:
        """The motion along a path by way of shorter arms."""
        job = self.make(self.routes[0].likely, self.options, SEARCHED, False)
        found = climbed(job, self.options.accuracy) if can_hold(job) else None
        if found is None:
            return []
        solution = found.solution
        self.log.append(
            {"start": found.name, "status": solution.status, "objective": solution.objective}
        )
        return [Answer(found.name, "ladder", found.task, solution)]

    def _slowed_down(self, holds: Callable[[], bool]) -> list[Answer]:
        """The fastest motion, bettered in the duration given, or else as it is but slower."""
        wanted, limits = self.routes[0].duration, self.routes[0].limits
        passed = [point.time_s for point in self.routes[0].waypoints]
        if not np.isfinite(limits.input).all() or any(time_s is not None for time_s in passed):
            return []
        assert wanted is not None
        free = [replace(problem, duration=None) for problem in self.routes]
        options = self.options.model_copy(update={"objective": "time"})
        progress.tell("looking for the fastest motion")
        hasty = Pipeline(free, options, self.make, self._paths)
        found = hasty.run(holds)
        self.log += hasty.log
        if found is None:
            self.pathless, self.last = hasty.pathless and self.pathless, self.last or hasty.last
            return []
        answer, self.fastest = found
        self.last = self.fastest.task, self.fastest.solution
        motion = self.fastest.solution.iterate
        if motion.duration * HASTE > wanted:
            return []
        problem = self.routes[[each is answer.task.problem for each in free].index(True)]
        goal = self.make(problem, self.options, SEARCHED, False).objective
        own = self.fastest.task.asking(problem, goal)
        solution = own.solve(stretched(motion, wanted))
        if not solution.ok and motion.duration <= wanted:
            solution = own.judged(stretched(motion, wanted))
        return [Answer(answer.start, "slowed down", own, solution)][: solution.ok]

    def _shared_out(self, answer: Answer) -> Answer:
        """With the time shared out among the parts between waypoints as the objective wants it."""
        for _ in range(SHARINGS if answer.task.mesh.marks else 0):
            moved = rebalanced(answer.task, answer.solution.iterate)
            if moved is None:
                break
            solution = moved[0].solve(moved[1], near=True)
            if not solution.ok or solution.objective >= answer.solution.objective:
                break
            answer = replace(answer, task=moved[0], solution=solution)
        return answer


def _towards(problem: Problem) -> str:
    """Of a goal that leaves joints free, which one the search expects, in words."""
    if not problem.free:
        return ""
    angles = ", ".join(f"{angle:.3g}" for angle in np.rad2deg(problem.likely.goal[1:]))
    return f" towards ({angles}) deg"


def _one_way(problem: Problem) -> bool:
    if problem.free:
        return not problem.divided  # no window is known; whoever cannot soon says so
    window = travel_window(problem)
    if window is None or window.empty or problem.divided:
        return False
    return problem.travel is None or problem.travel in window


class Best:
    """What a search holds.

    Attributes:
        motion: The best solution of the problem, and its task; None while there is none.
        kept: A motion found that is one to the accuracy asked for; likewise. Only looked for where
            time is limited, since it takes about a second.
        chain: A path that was not timed yet, and what it is asked for; likewise.
        nearest: Of what failed that which came closest to a path, and its task; likewise.
        iterations: Iterations of the solvers until now.
    """

    def __init__(self, problems: Sequence[Problem], accuracy: float) -> None:
        self._problems, self._accuracy = problems, accuracy
        self.kept: tuple[Task, Solution] | None = None
        self.motion: tuple[Task, Solution] | None = None
        self.chain: tuple[Task, PieceChain] | None = None
        self.nearest: tuple[Task, Solution] | None = None
        self.iterations = 0

    def holds(self) -> bool:
        """Whether there is anything of which a plan may come."""
        return self.motion is not None or self.chain is not None

    def take(self, task: Task, solution: Solution) -> None:
        """Keep a solution if it is better than what there is."""
        self.iterations += solution.iterations
        if not solution.ok:
            close = self.nearest is None or solution.residual < self.nearest[1].residual
            if close and task.problem.system is self._problems[0].system:
                self.nearest = task, solution
            return
        better = self.motion is None or solution.objective < self.motion[1].objective
        if better and self._asked(task) and clears(task, solution):
            self.motion = task, solution
            kind = task.objective.name.partition(":")[0]
            progress.report_motion(f"{kind} {solution.objective:.4g}")
            if self.kept is None and deadline.remaining() < math.inf:
                self.keep()

    def keep(self) -> None:
        """Make what is held a motion to the accuracy asked for, where that needs no solver."""
        of = self.chain
        if self.motion is not None:
            of = self.motion[0], chain_of(*self.motion)
        found = held(*of, self._accuracy) if of is not None and can_hold(of[0]) else None
        if found and (self.kept is None or found[1].objective < self.kept[1].objective):
            self.kept = found

    def take_chain(self, task: Task, chain: PieceChain) -> None:
        """Keep a path."""
        if self._asked(task):
            self.chain = task, chain
            if self.kept is None and deadline.remaining() < math.inf:
                self.keep()

    def _asked(self, task: Task) -> bool:
        return any(task.problem is problem for problem in self._problems)
