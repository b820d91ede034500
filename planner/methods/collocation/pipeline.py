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
from planner.methods.collocation.candidates import Seed, guess, rebalanced, seeds
from planner.methods.collocation.long_arms.bridges import PieceChain
from planner.methods.collocation.long_arms.held import can_hold, chain_of, held
from planner.methods.collocation.long_arms.ladder import climbed
from planner.methods.collocation.path import (
    HASTE,
    FoundPath,
    Timed,
    hasty,
    needed_duration,
    one_way,
    same_path,
    search,
    timed,
)
from planner.methods.collocation.refine import Polished, polish
from planner.methods.collocation.task import Solution, Task, stretched, transferred
from planner.methods.collocation.transcription.form import Mesh, uniform
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress

DIRECT, SEARCHED = 14, 40
"""Mesh intervals near a straight line in a given time, and for what may wind more than once."""

REACH, FAST, LONGEST = 0.5, 80, 400
"""A timed path's mesh: most that an input integrates to in an interval, rad; the fewest intervals
where the duration is free or short, since a linear input needs them to switch; and the most."""

TIMED, TIMED_INTERVALS = 6, 800
"""Paths that are timed, the shortest first, and intervals of all their meshes after which no more
are: most often the best is among them, and for long paths each takes long."""

MORE = 3
"""Times as many guesses again where every motion found is too slow for the duration given."""

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

    def __init__(self, routes: list[Problem], options: CollocationOptions, make: Tasks) -> None:
        """Set up a search.

        Args:
            routes: The problem with its waypoints in each order worth trying.
            options: Of the method.
            make: The problem on a mesh.
        """
        self.routes, self.options, self.make = routes, options, make
        self.log: list[dict[str, Any]] = []
        self.fastest: Polished | None = None
        self.pathless = True
        self.last: tuple[Task, Solution] | None = None
        self._slow: list[Answer] = []
        self._free = options.start == "auto"

    def run(self, holds: Callable[[], bool]) -> tuple[Answer, Polished] | None:
        """The best motion of the first stage that has one, on a mesh fine enough to believe it.

        Args:
            holds: Whether anything is held by now; with nothing held there is nothing to refine.
        """
        stages, options = self._stages(), self.options
        while True:
            with deadline.share(once=holds):
                motions = next(stages, None)
            if motions is None:
                return None
            for answer in sorted(motions, key=lambda each: each.solution.objective):
                done = polish(answer.task, answer.solution, options.accuracy, options.refinements)
                good = done.error <= RESOLVED and done.inside
                if good or not self._free or options.refinements == 0:
                    return answer, done
                self.last = done.task, done.solution

    def _stages(self) -> Iterator[list[Answer]]:
        """The motions of one stage after the other; each is gone through only if it is asked for.

        Where all paths found are too slow for the duration given more guesses are worth their time;
        else the ladder is, which finds paths of long arms that no guess leads to.
        """
        every, few = _guesses(self.options), self.options.attempts
        if self.options.start in ("auto", "straight"):
            found = self._straight()
            answered = [each.task.problem for each in found]
            left = [each for each in self.routes if not any(each is one for one in answered)]
            yield found + self._along("guesses", every[:few], left if found else [])
        yield self._along("guesses", every[:few], self.routes)
        if self._slow and self._free:
            yield self._along("more guesses", every[few : (1 + MORE) * few], self.routes)
        elif self._free:
            yield self._by_ladder()
        if self._slow:
            yield self._slowed_down()

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

    def _along(self, stage: str, guesses: list[Seed], routes: list[Problem]) -> list[Answer]:
        """Motions of these routes along the paths that guesses lead to.

        Branches of one goal share the paths that are enough, and none is timed twice.
        """
        out, known = [], list[FoundPath]()
        for problem in routes:
            job = self.make(problem, self.options, SEARCHED, False)
            enough = self.options.starts if self.options.start in ("auto", "wander") else 1
            enough = -(-enough // len(routes)) if problem.free else enough
            paths = search(job, guesses, enough, self._free and not problem.divided)
            log = paths.log
            progress.tell(f"timing {min(TIMED, len(paths.found))} paths")
            spent = 0
            for path in paths.found[:TIMED]:
                if spent > TIMED_INTERVALS:
                    break
                if problem.free and any(same_path(path.solution.objective, one) for one in known):
                    continue
                known.append(path)
                own, iterate = self._meshed(job, path.solution.iterate)
                spent += len(own.mesh.widths)
                outcome = timed(own, iterate)
                answer = Answer(path.seed + _towards(problem), stage, own, outcome.solution)
                if outcome.solution.ok and clears(own, outcome.solution):
                    out.append(self._shared_out(answer))
                    self.pathless = False
                elif not outcome.solution.ok:
                    self._note_slow(answer, outcome)
                for entry in log:
                    effort = entry["path_effort"]
                    if effort is not None and same_path(effort, path):
                        found = outcome.solution.objective if outcome.solution.ok else None
                        entry["objective"] = found
            if self.pathless:
                failed = [paths.last, *(path.solution for path in paths.found)]
                self.last = next(((job, last) for last in failed if last), self.last)
            self.log += [entry | {"start": entry["start"] + _towards(problem)} for entry in log]
        return out

    def _by_ladder(self) -> list[Answer]:
        """The motion along a path by way of shorter arms."""
        job = self.make(self.routes[0].likely, self.options, SEARCHED, False)
        found = climbed(job, self.options.accuracy) if can_hold(job) else None
        if found is None:
            return []
        solution = found.timed.solution
        objective = solution.objective if solution.ok else None
        entry = {"start": found.name, "status": solution.status, "objective": objective}
        self.log.append(entry)
        answer = Answer(found.name, "ladder", found.task, solution)
        if solution.ok:
            return [answer]
        self._note_slow(answer, found.timed)
        return []

    def _slowed_down(self) -> list[Answer]:
        """The fastest motion found, bettered in the duration given, or else as it is but slower."""
        fastest = min(self._slow, key=lambda each: each.solution.iterate.duration)
        job, wanted = fastest.task, self.routes[0].duration
        assert wanted is not None
        options = self.options
        done = polish(hasty(job), fastest.solution, options.accuracy, options.refinements)
        if done.error > RESOLVED:
            return []
        self.fastest = done
        motion = done.solution.iterate
        if motion.duration * HASTE > wanted:
            return []
        own = done.task.asking(job.problem, job.objective)
        solution = own.solve(stretched(motion, wanted))
        if not solution.ok and motion.duration <= wanted:
            solution = own.judged(stretched(motion, wanted))
        return [replace(fastest, stage="slowed down", task=own, solution=solution)][: solution.ok]

    def _meshed(self, job: Task, path: Any) -> tuple[Task, Any]:
        """A path on a mesh as fine as its length wants; waypoints keep theirs."""
        if job.mesh.marks or self.options.intervals != "auto":
            return job, path
        left, right = path.input_ends()
        steps = np.abs(left + right) / 2 * (job.mesh.widths * path.duration)[:, None]
        limit = job.problem.limits.input
        steps = steps / (limit / np.max(limit) if np.isfinite(limit).all() else 1.0)
        joints = job.problem.limits.joint[list(job.problem.system.limited)]
        room = min(1.0, float(np.min(joints, initial=1.4)) / 1.4)
        wanted = job.problem.duration
        hurried = wanted is None or needed_duration(job.problem, job.mesh, path) > wanted
        least = FAST if hurried else len(job.mesh.widths)
        count = int(np.sum(np.max(steps, axis=1)) / (REACH * room))
        own = job.on(uniform(int(np.clip(count, least, LONGEST))))
        return own, transferred(job, path, own)

    def _note_slow(self, answer: Answer, outcome: Timed) -> None:
        self.pathless, self.last = False, (answer.task, outcome.solution)
        if outcome.quick is not None and outcome.quick.ok:
            self._slow.append(replace(answer, solution=outcome.quick))

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


def _guesses(options: CollocationOptions) -> list[Seed]:
    if options.start == "auto":
        return seeds("auto", (1 + MORE) * options.attempts)
    return seeds(options.start, options.attempts)


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
            progress.found(f"{solution.objective:.4g} ({kind})")
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
