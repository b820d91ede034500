"""Find a path first, then the timing of the path.

The systems are driftless, so the path and its speed can be found separately. The path problem is
smooth and has no limits on inputs: paths are found from several seeds, and the shortest are kept.
The timing problem, with the objective, the duration and the limits on inputs, then starts from a
motion that is feasible after stretching its time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import clears, inspect
from planner.methods.collocation.guesses import Seed, guess, sides, wander
from planner.methods.collocation.solvers import strategy
from planner.methods.collocation.task import Solution, Task, stretch_to, task, transfer
from planner.methods.collocation.transcription.form import Mesh, fastest, uniform
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.measures import Objective
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import MotionPoint
from planner.support import progress
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

INFEASIBLE = "Infeasible_Problem_Detected"

ALIKE, REPEATS, LEAST_PATHS = 5, 3, 9
"""Numbers of paths after which no seed follows: `ALIKE` paths if all are the same, by when the
straight line, and each first direction with each side, have been tried; else `REPEATS` times the
shortest path among at least `LEAST_PATHS`, by when each direction and side has been tried twice."""

SUFFIX, MOST_FAILURES = ", moved", 16
"""If the seeds lead to different paths, random loops about the shortest, named with `SUFFIX`, are
tried until `MOST_FAILURES` in a row find no shorter one. Of 34 pairs of four joints within 45
degrees 9 % then ended more than 1 % above the shortest path known; with 8 loops in all, 26 %."""

SURE_ONE_WAY = 4
"""Largest number of coordinates (three joints have four) at which a motion whose drive never
reverses ends the search. With more, one that reverses may be much shorter."""

STANDSTILL_SHARE = 1e-6
"""Share of the greatest input below which an input counts as zero."""


@dataclass(frozen=True, eq=False)
class SeedPath:
    """A path, the name of its seed, whether the links clear all discs between the nodes, and the
    stage of the search that found it."""

    seed: str
    solution: Solution
    clear: bool
    stage: str = "guesses"


@dataclass(frozen=True, eq=False)
class Paths:
    """The result of a search for paths.

    Attributes:
        solved: Paths in the order in which they were found.
        failure: The last solution that failed, or None.
        log: One entry per guess, JSON-ready.
    """

    solved: tuple[SeedPath, ...] = ()
    failure: Solution | None = None
    log: tuple[dict[str, Any], ...] = ()

    @property
    def distinct(self) -> list[SeedPath]:
        """The different paths: first the paths that clear all discs, then the others, by length."""
        distinct: list[SeedPath] = []
        for path in sorted(self.solved, key=lambda path: (not path.clear, path.solution.objective)):
            if not distinct or not same_path(path.solution.objective, distinct[-1]):
                distinct.append(path)
        return distinct

    @property
    def clear(self) -> list[SeedPath]:
        """The different paths that clear all discs, by length. The others are not worth timing: of
        30 beside a post, one led to a motion, which was not the best."""
        return [path for path in self.distinct if path.clear]

    def adding(self, path: SeedPath) -> Paths:
        """Return these paths and one more, or its failure."""
        solution, ok = path.solution, path.solution.ok
        effort = solution.objective if ok else None
        entry = {"start": path.seed, "status": solution.status, "path_effort": effort}
        log = *self.log, {**entry, "iterations": solution.iterations}
        if not ok:
            return Paths(self.solved, solution, log)
        return Paths((*self.solved, path), self.failure, log)


@dataclass(frozen=True)
class Enough:
    """The rules that end a search. It also ends if the first two thirds of the guesses fail.

    Attributes:
        clear: Number of paths that clear all discs.
        simple: Whether the first path whose drive never reverses is enough, and so is a path that
            is found repeatedly; then loops about the shortest path follow many different ones.
        longest: Number of intervals (`path_intervals`): `ALIKE` paths that all need more end a
            search that is `simple`.
    """

    clear: int
    simple: bool = False
    longest: float = math.inf

    def settles(self, job: Task, free: Task, paths: Paths, path: SeedPath, guesses: int) -> bool:
        """Return whether after this latest path neither guesses nor loops can help."""
        count = len(paths.log)
        if 3 * count >= 2 * guesses and all(e["status"] == INFEASIBLE for e in paths.log):
            return True
        if not (self.simple and path.solution.ok):
            return False
        one_way = job.problem.system.size <= SURE_ONE_WAY and never_reverses(path.solution.iterate)
        if one_way and count >= sides(job.problem):
            return True
        shortest = paths.distinct[0].solution.iterate
        return len(paths.solved) >= ALIKE and path_intervals(free, shortest) > self.longest

    def reached(self, paths: Paths, path: SeedPath) -> bool:
        """Return whether no further guess is needed after this latest path."""
        if self.simple and path.solution.ok and _repeats_shortest(paths.solved):
            return True
        return sum(each.clear for each in paths.solved) >= self.clear


Keep = Callable[[Task, Solution, str], object]
"""Receives each guess's result, its task and name: a failed path, or a motion of the job."""


def search(job: Task, seeds: Sequence[Seed], enough: Enough, keep: Keep | None = None) -> Paths:
    """Solve the task's path problem from one guess after the other until there are enough paths."""
    free, paths = path_task(job), Paths()
    for seed in seeds:
        path = _try(job, free, seed, keep)
        paths = paths.adding(path)
        if enough.settles(job, free, paths, path, len(seeds)):
            return paths
        if enough.reached(paths, path):
            break
    if enough.simple and len(paths.solved) >= LEAST_PATHS:
        return _shorten(job, free, paths, keep)
    return paths


def _shorten(job: Task, free: Task, paths: Paths, keep: Keep | None) -> Paths:
    """Return the paths and the shortest one that random loops about the shortest path lead to."""
    first, failures = paths.solved, 0
    for loop in map(wander, itertools.count()):
        best = paths.distinct[0]
        seed = replace(loop, name=f"{best.seed.removesuffix(SUFFIX)}{SUFFIX}")
        path = _try(job, free, seed, keep, free.curve(best.solution.iterate))
        paths = paths.adding(path)
        shortest = paths.distinct[0]  # the only one of these to keep, so that others are timed too
        paths = replace(paths, solved=first if shortest in first else (*first, shortest))
        failures = failures + 1 if same_path(shortest.solution.objective, best) else 0
        if failures == MOST_FAILURES:
            break
    return paths


def _try(
    job: Task, free: Task, seed: Seed, keep: Keep | None, about: StateTrajectory | None = None
) -> SeedPath:
    """Solve the path problem `free` of a job from a guess, added to a straight line or `about`."""
    progress.tell(f"searching a path from the first guess '{seed.name}'")
    solution = free.solve(guess(free.problem, free.nlp, free.mesh, seed, about))
    path = SeedPath(seed.name, solution, solution.ok and clears(free, solution))
    if keep and not solution.ok:
        keep(free, solution, seed.name)
    elif keep and path.clear and (motion := at_constant_speed(job, free, solution)):
        keep(job, motion, seed.name)
    return path


def at_constant_speed(job: Task, free: Task, path: Solution) -> Solution | None:
    """Return a path, of the task `free`, as a motion of a job on the same mesh, only slowed down;
    None if the duration is too short for that."""
    needed = needed_duration(job.problem, job.mesh, path.iterate)
    wanted = job.problem.duration
    if wanted is not None and needed > wanted:
        return None
    duration = wanted or needed or path.iterate.duration
    return job.judge(stretch_to(transfer(free, path.iterate, job), duration))


def path_task(job: Task) -> Task:
    """Return the path problem of a task: least effort, no limits on inputs, a reference duration.

    Effort is in units of the inputs' limits. For driftless systems, at a fixed duration without
    limits on inputs, least effort gives the path of least length in the metric of the inputs,
    whatever the duration.

    The path problem depends only on system, ends and geometry, so the same paths are found for
    every duration: if a motion is found, every slower motion is found too.
    """
    unhurried = replace(job.problem, duration=strategy(job.nlp, job.settings).reference_s)
    demands = replace(job.demands, timeless=True)
    inputs = 1 / job.problem.limits.input_scale**2
    u1, u2 = (inputs / np.mean(inputs)).tolist()
    settings, effort = replace(job.settings, direct=False), {"effort u1": u1, "effort u2": u2}
    form = replace(job.nlp.form, soft_goal=_may_miss(job))
    free = task(unhurried, Objective("effort", effort), form, job.mesh, demands, settings)
    return replace(free, inset=job.inset)


def _may_miss(job: Task) -> bool:
    """Return whether the goal of a path may be soft at first: it is a long arm's, and no more."""
    system, form, problem = job.problem.system, job.nlp.form, job.problem
    long = isinstance(system, Manipulator) and system.size > SURE_ONE_WAY
    plain = not (problem.divided or problem.waypoints or form.augmented or form.follower)
    free = job.settings.solver == "auto" and form.intervals <= MOST_INTERVALS
    return long and plain and free


MOST_INPUT_ANGLE, INTERVAL_STEP, MOST_INTERVALS = 0.5, 20, 400
"""The mesh of a refined path: largest integral of an input over an interval, rad, if joints are
limited to 80 degrees; divisor of the number of intervals, for few transcriptions; and the most."""

LEAST_FAST_INTERVALS, FAST_DENSITY = 100, 1.5
"""Least number of intervals of a fastest motion, which switches; and its ratio to the path's."""

PATH_ERROR = 1e-4
"""Largest difference at the end, rad or m, between a path and its true motion, before timing."""


def refine_path(free: Task, path: Solution) -> tuple[Task, Solution] | None:
    """Solve a path on a mesh fine enough for its length, with limits kept inside intervals too.

    On few intervals a path is shorter than any motion: it exceeds joint limits between the nodes,
    limits of 40 degrees by half a radian. So the path first gets more nodes, then tighter limits,
    and is timed only afterwards, since a path has no limits on inputs.

    The result, the path's task and the path, is None if a solve fails.
    """
    inspection = inspect(free, path)
    if inspection.end_error <= PATH_ERROR and not inspection.excess.any():
        return free, path
    fine = free.on_mesh(uniform(path_intervals(free, path.iterate)))
    for new in (fine, fine.with_inner_rows()):
        if new.nlp.form != free.nlp.form:
            path, free = new.solve(transfer(free, path.iterate, new)), new
            if not path.ok:
                return None
    return free, path


def halve_mesh(free: Task, path: Solution) -> tuple[Task, Solution]:
    """Solve a refined path again on intervals half as wide, if it differs from its true motion."""
    count = len(free.mesh.widths)
    if inspect(free, path).end_error <= PATH_ERROR or count >= MOST_INTERVALS:
        return free, path
    new = free.on_mesh(uniform(min(2 * count, MOST_INTERVALS)))
    better = new.solve(transfer(free, path.iterate, new), near=free.problem.divided)
    return (new, better) if better.ok else (free, path)


def path_intervals(free: Task, path: Iterate) -> int:
    """Return the number of mesh intervals to refine a path on, from the integrals of its inputs."""
    left, right = path.input_ends()
    steps = np.abs(left + right) / 2 * (free.mesh.widths * path.duration)[:, None]
    limit = free.problem.limits.input
    steps = steps / (limit / np.max(limit) if np.isfinite(limit).all() else 1.0)
    joints = free.problem.limits.joint[list(free.problem.system.limited)]
    room = min(1.0, float(np.min(joints, initial=1.4)) / 1.4)
    count = int(np.sum(np.max(steps, axis=1)) / (MOST_INPUT_ANGLE * room))
    return int(np.clip(_round_up(count), len(free.mesh.widths), MOST_INTERVALS))


def _round_up(count: float) -> int:
    """Round a number of intervals up to a multiple of `INTERVAL_STEP`, as other meshes have."""
    return INTERVAL_STEP * int(np.ceil(count / INTERVAL_STEP))


def clock(job: Task, free: Task, path: Iterate) -> tuple[Task, Iterate]:
    """Time a refined path so that at every time one of its inputs is at its limit.

    The motion's mesh is even in time; the path's mesh is even in length. Other limits on speed are
    ignored. The result is the motion's task, and the motion.

    Args:
        job: The task.
        free: The path's own task.
        path: The path.
    """
    times, slower = clock_times(job.problem, free.mesh, path)
    fast = free.on_mesh(Mesh(times / times[-1]))
    motion = replace(path, duration=float(times[-1]), inputs=path.inputs / slower[:, None])
    intervals = len(free.mesh.widths)
    fine = on_mesh(
        job, free, uniform(_round_up(max(FAST_DENSITY * intervals, LEAST_FAST_INTERVALS)))
    )
    return fine, transfer(fast, motion, fine)


def clock_times(problem: Problem, mesh: Mesh, path: Iterate) -> tuple[Array, Array]:
    """Return the times at the edges, (K+1,), s, of a path timed by `clock`, and input divisors."""
    left, right = (end / problem.limits.input for end in path.input_ends())
    least = STANDSTILL_SHARE * float(np.max(np.abs([left, right])))
    first, middle, last = (
        np.maximum(np.max(np.abs(u), axis=1), least) for u in (left, (left + right) / 2, right)
    )
    mean = (first + 4 * middle + last) / 6  # Simpson's rule
    slower = first if len(first) == len(path.inputs) else np.append(first, last[-1])
    return np.append(0.0, np.cumsum(mesh.widths * path.duration * mean)), slower


def on_mesh(job: Task, free: Task, mesh: Mesh) -> Task:
    """Return the task on a mesh, with limits kept inside intervals if they are so in `free`."""
    fine = job.on_mesh(mesh)
    return fine.with_inner_rows() if free.nlp.form.inner and not fine.nlp.form.inner else fine


def _repeats_shortest(paths: Sequence[SeedPath]) -> bool:
    """Return whether the shortest path has been found often enough to end the search."""
    shortest = min(path.solution.objective for path in paths)
    again = sum(same_path(shortest, path) for path in paths)
    if len(paths) < LEAST_PATHS:
        return again == len(paths) >= ALIKE
    return again >= REPEATS


def same_path(effort: float, path: SeedPath) -> bool:
    """Return whether a path of the given effort counts as the same path as `path`."""
    return abs(effort - path.solution.objective) <= 1e-6 * path.solution.objective


def never_reverses(iterate: Iterate) -> bool:
    """Return whether the drive u₁ of an iterate keeps its sign."""
    drive = iterate.inputs[:, 0]
    slack = STANDSTILL_SHARE * np.max(np.abs(drive))
    return bool(np.all(drive >= -slack) or np.all(drive <= slack))


def solve_timing(job: Task, start: Iterate) -> Solution:
    """Solve a task for its motion, starting from a path at any speed.

    If the path, with its time scaled uniformly, fits into the duration, it is a feasible start. A
    slower path is first made as fast as possible.
    """
    needed, duration = needed_duration(job.problem, job.mesh, start), job.problem.duration
    if duration is None:
        return job.solve(stretch_to(start, 1.1 * needed) if needed > 0 else start)
    if needed > duration:
        free = replace(job.problem, duration=None)
        quick = job.for_problem(free, fastest(free)).solve(stretch_to(start, 1.1 * needed))
        if not quick.ok or quick.iterate.duration > duration:
            return replace(quick, ok=False)
        return job.solve(stretch_to(quick.iterate, duration))
    motion = stretch_to(start, duration)  # the path of least effort is the same for every duration
    return job.solve_near(motion) if job.objective.kind == "effort" else job.solve(motion)


def needed_duration(problem: Problem, mesh: Mesh, iterate: Iterate) -> float:
    """Return the duration of a path, s, scaled uniformly in time to keep all limits on speed."""
    u = np.stack(iterate.input_ends())
    slope = (u[1] - u[0]) / (mesh.widths[:, None] * iterate.duration)
    q = np.stack([iterate.nodes[:-1], iterate.nodes[1:]])[..., : problem.system.size]
    point, factors = MotionPoint.of(problem.system, q, u, np.stack([slope, slope])), [0.0]
    for requirement in problem.requirements:
        if requirement.speed_power:
            values = np.stack([np.ravel(value) for value in requirement.values(point)])
            factors += requirement.slowing_factor(values.min(axis=1), values.max(axis=1)).tolist()
    return iterate.duration * float(np.max(factors))
