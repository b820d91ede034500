"""First the path, then its timing.

The systems are driftless, so what a path looks like and how fast it is run are two questions. The
first alone is smooth and has no bound on inputs to run into: paths come from several seeds, and the
shortest are kept. The second, with the objective, the duration and the limits on inputs, then
starts from a motion that is feasible after stretching.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import clears, inspect
from planner.methods.collocation.candidates import Excursion, Seed, guess, sides, wander
from planner.methods.collocation.solvers import strategy
from planner.methods.collocation.task import (
    Solution,
    Task,
    stretch_to,
    task,
    transfer,
)
from planner.methods.collocation.thin_discs import thicknesses
from planner.methods.collocation.transcription.form import (
    Mesh,
    fastest,
    shortest_path,
    uniform,
)
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import MotionPoint
from planner.support import progress
from planner.support.arrays import Array

INFEASIBLE = "Infeasible_Problem_Detected"

ALIKE, REPEATS, LEAST_PATHS = 5, 3, 9
"""Paths that end a search if all are the same: the line's, and one for each first direction and
side. Else times that the shortest is found, among at least so many: then each direction and side
has been tried twice."""

MOVED, MOVES, MOVE = ", moved", 8, 0.3
"""In their names, number, and size beside a seed's, of guesses about the shortest path where
the seeds do not agree on one. Each takes a fifth of a seed's time: most lead back to the path, some
to a shorter one."""

SURE_ONE_WAY = 4
"""Coordinates, those of an arm with three joints, up to which a motion whose drive never turns back
ends the search. With more there may be a far shorter one that does turn back."""

STANDSTILL_SHARE = 1e-6
"""Share of the greatest input that counts as none."""


@dataclass(frozen=True, eq=False)
class SeedPath:
    """A solution, the seed it grew from, and whether its links clear all discs between nodes."""

    seed: str
    solution: Solution
    clear: bool


@dataclass(eq=False)
class PathSearch:
    """What a search has come to.

    Attributes:
        solved: Paths in the order in which they were found.
        failure: The last solution that failed, or None.
        log: One entry a seed, JSON-ready.
        latest: What the last seed led to: a path that failed, and its task; or the path as a motion
            of the job, if there is no time for a better one. None where it leads to neither.
        clear: Paths whose links pass through no disc.
    """

    solved: list[SeedPath] = field(default_factory=list)
    failure: Solution | None = None
    log: list[dict[str, Any]] = field(default_factory=list)
    latest: tuple[Task, Solution] | None = None
    clear: int = 0

    @property
    def distinct(self) -> list[SeedPath]:
        """The paths that differ, those that clear all discs first, and of these the shortest."""
        distinct: list[SeedPath] = []
        for path in sorted(self.solved, key=lambda path: (not path.clear, path.solution.objective)):
            if not distinct or not same_path(path.solution.objective, distinct[-1]):
                distinct.append(path)
        return distinct


def search(
    job: Task,
    seeds: Sequence[Seed],
    enough: int,
    simple: bool = False,
) -> Iterator[PathSearch]:
    """Solve the task's path problem from one seed after the other until enough have converged.

    With `simple`, a path whose drive never turns back is enough by itself, and so is one that is
    found again and again.
    Two thirds of the seeds in a row found infeasible end the search too. A path whose links pass
    through a disc between two nodes may come clear once it is timed, but counts half.

    Where the seeds do not agree on a path, guesses about the shortest one follow.

    Yields:
        The one search, before the first seed and after each guess.
    """
    widths, state = [path_task(each) for each in _thicknesses(job)], PathSearch()
    free = widths[-1]
    yield state
    for count, seed in enumerate(seeds, 1):
        solution = _try(job, widths, state, seed)
        yield state
        hopeless = 3 * count >= 2 * len(seeds)
        if hopeless and all(entry["status"] == INFEASIBLE for entry in state.log):
            return
        if simple and solution.ok:
            one_way = is_sure(job.problem) and never_reverses(solution.iterate)
            if (one_way and count >= sides(job.problem)) or _repeats_shortest(state.solved):
                return
        if state.clear >= enough or len(state.solved) >= 2 * enough:
            break
    for number in range(MOVES if simple and len(state.solved) >= LEAST_PATHS else 0):
        best, seed = state.distinct[0], wander(number)
        name = f"{best.seed.removesuffix(MOVED)}{MOVED}"
        seed = Seed(name, _scaled(seed.path), _scaled(seed.driven))
        _try(job, widths, state, seed, free.curve(best.solution.iterate))
        yield state


def is_sure(problem: Problem) -> bool:
    """Whether a motion whose drive never turns back needs no search for a better one."""
    return problem.system.size <= SURE_ONE_WAY


def _scaled(excursion: Excursion) -> Excursion:
    return lambda s: MOVE * excursion(s)


def _try(
    job: Task,
    widths: list[Task],
    state: PathSearch,
    seed: Seed,
    about: StateTrajectory | None = None,
) -> Solution:
    """Solve the path problem from a first guess, and take down what becomes of it.

    Args:
        job: What is asked for.
        widths: Its path problem among thicker discs, thinner and thinner, and at last as it is.
        state: What the search has come to.
        seed: The first guess.
        about: The motion that it leads away from, a straight line when left out.
    """
    free = widths[-1]
    progress.tell(f"searching a path from the first guess '{seed.name}'")
    solution = _shrink(widths, guess(free.problem, free.made, free.mesh, seed, about))
    effort = solution.objective if solution.ok else None
    entry = {"start": seed.name, "status": solution.status, "path_effort": effort}
    state.log.append({**entry, "iterations": solution.iterations})
    state.latest = None
    is_clear = solution.ok and clears(free, solution)
    if solution.ok:
        state.solved.append(SeedPath(seed.name, solution, is_clear))
    else:
        state.failure, state.latest = solution, (free, solution)
    if is_clear:
        state.clear += 1
        needed = needed_duration(job.problem, job.mesh, solution.iterate)
        wanted = job.problem.duration
        if wanted is None or needed <= wanted:
            duration = wanted or needed or solution.iterate.duration
            motion = stretch_to(transfer(free, solution.iterate, job), duration)
            state.latest = job, job.judge(motion)
    return solution


def _thicknesses(job: Task) -> list[Task]:
    """The job among thickened discs, thinner and thinner, and at last the job itself."""
    *thick, _ = thicknesses(job.problem)
    return [*(job.for_problem(each, job.objective) for each in thick), job]


def _shrink(tasks: list[Task], start: Iterate) -> Solution:
    """Solve among the thickest discs, then from there among thinner ones.

    Where links would pass over a thinner disc, the path is kept as it was before.
    """
    *thick, last = tasks
    clear, near = None, False
    for each in thick:
        solution = each.solve(start, near=near)
        if solution.ok:
            start, near = solution.iterate, True
        if not (solution.ok and clears(each, solution)):
            break
        clear = solution.iterate
    solution = last.solve(start, near=near)
    if clear is None or (solution.ok and clears(last, solution)):
        return solution
    return last.judge(clear)


def path_task(job: Task) -> Task:
    """The path problem of a task: least effort, no limits on inputs, a reference duration.

    It is a function of system, ends and geometry alone: the same paths are found whatever the
    duration is, so that whoever has a motion finds every slower one.
    """
    unhurried = replace(job.problem, duration=strategy(job.made, job.settings).reference_s)
    demands = replace(job.demands, timeless=True)
    settings, effort = replace(job.settings, direct=False), shortest_path(job.problem)
    free = task(unhurried, effort, job.made.form, job.mesh, demands, settings)
    return replace(free, drawn=job.drawn)


MOST_INPUT_ANGLE, INTERVAL_STEP, MOST_INTERVALS = 0.5, 20, 400
"""A refined path's mesh: most that an input integrates to in an interval, rad, where joints have
80 degrees; intervals that it grows by, so that paths share their transcriptions; and the most."""

LEAST_FAST_INTERVALS, FAST_DENSITY = 100, 1.5
"""Fewest intervals of a motion as fast as can be: a linear input needs them to switch;
and how many more it has than the path."""

PATH_ERROR = 1e-4
"""Difference at the end, rad or m, between a path and its true motion up to which it counts as one:
what is left then is for the motion's own mesh."""


def refine_path(free: Task, path: Solution) -> tuple[Task, Solution] | None:
    """A path on a mesh as fine as its length wants, its limits kept inside the intervals too.

    On few intervals a path is shorter than any motion: it leaves the joint limits between the
    nodes, by half a radian where joints have 40 degrees. So it is first put on more nodes, then
    drawn inside, and only then timed: as a path it has no bound on inputs to run into.
    """
    inspection = inspect(free, path)
    if inspection.end_error <= PATH_ERROR and not inspection.excess.any():
        return free, path
    fine = free.on_mesh(uniform(path_intervals(free, path.iterate)))
    for new in (fine, fine.with_inner_rows()):
        if new.made.form != free.made.form:
            path, free = new.solve(transfer(free, path.iterate, new)), new
            if not path.ok:
                return None
    return free, path


def halve_mesh(free: Task, path: Solution) -> tuple[Task, Solution]:
    """A refined path on intervals half as wide, where it is not its true motion yet."""
    count = len(free.mesh.widths)
    if inspect(free, path).end_error <= PATH_ERROR or count >= MOST_INTERVALS:
        return free, path
    new = free.on_mesh(uniform(min(2 * count, MOST_INTERVALS)))
    better = new.solve(transfer(free, path.iterate, new))
    return (new, better) if better.ok else (free, path)


def path_intervals(free: Task, path: Iterate) -> int:
    """Intervals that a path wants at least."""
    left, right = path.input_ends()
    steps = np.abs(left + right) / 2 * (free.mesh.widths * path.duration)[:, None]
    limit = free.problem.limits.input
    steps = steps / (limit / np.max(limit) if np.isfinite(limit).all() else 1.0)
    joints = free.problem.limits.joint[list(free.problem.system.limited)]
    room = min(1.0, float(np.min(joints, initial=1.4)) / 1.4)
    count = int(np.sum(np.max(steps, axis=1)) / (MOST_INPUT_ANGLE * room))
    return int(np.clip(_round_up(count), len(free.mesh.widths), MOST_INTERVALS))


def _round_up(count: float) -> int:
    """The count of intervals, or a few more that other meshes have too."""
    return INTERVAL_STEP * int(np.ceil(count / INTERVAL_STEP))


def clock(job: Task, free: Task, path: Iterate) -> tuple[Task, Iterate]:
    """A refined path run so fast that at every time one of its inputs is at its limit.

    The mesh is even in time, where a path's is even in length. Other limits on speed are not looked
    at.

    Args:
        job: What is asked for.
        free: The path's own task.
        path: The path.
    """
    times, slower = clock_times(job.problem, free.mesh, path)
    fast = free.on_mesh(Mesh(times / times[-1]))
    motion = replace(path, duration=float(times[-1]), inputs=path.inputs / slower[:, None])
    intervals = len(free.mesh.widths)
    own = on_mesh(
        job, free, uniform(_round_up(max(FAST_DENSITY * intervals, LEAST_FAST_INTERVALS)))
    )
    return own, transfer(fast, motion, own)


def clock_times(problem: Problem, mesh: Mesh, path: Iterate) -> tuple[Array, Array]:
    """Seconds of the clock at the path's edges, (K+1,), and what divides the path's inputs."""
    left, right = (end / problem.limits.input for end in path.input_ends())
    least = STANDSTILL_SHARE * float(np.max(np.abs([left, right])))
    first, middle, last = (
        np.maximum(np.max(np.abs(u), axis=1), least) for u in (left, (left + right) / 2, right)
    )
    mean = (first + 4 * middle + last) / 6  # Simpson's rule
    slower = first if len(first) == len(path.inputs) else np.append(first, last[-1])
    return np.append(0.0, np.cumsum(mesh.widths * path.duration * mean)), slower


def on_mesh(job: Task, free: Task, mesh: Mesh) -> Task:
    """The job on a mesh, limits kept inside the intervals where the path's task has to."""
    own = job.on_mesh(mesh)
    return own.with_inner_rows() if free.made.form.inner and not own.made.form.inner else own


def _repeats_shortest(found: Sequence[SeedPath]) -> bool:
    """Whether the shortest path comes back."""
    shortest = min(path.solution.objective for path in found)
    again = sum(same_path(shortest, path) for path in found)
    if len(found) < LEAST_PATHS:
        return again == len(found) >= ALIKE
    return again >= REPEATS


def same_path(effort: float, path: SeedPath) -> bool:
    """Whether a path of that effort is taken for the same as another."""
    return abs(effort - path.solution.objective) <= 1e-6 * path.solution.objective


def never_reverses(iterate: Iterate) -> bool:
    """Whether the drive never turns back."""
    drive = iterate.inputs[:, 0]
    slack = STANDSTILL_SHARE * np.max(np.abs(drive))
    return bool(np.all(drive >= -slack) or np.all(drive <= slack))


def solve_timing(job: Task, start: Iterate) -> Solution:
    """The job solved from a path at some speed.

    All of it slowed or hastened alike, it is a motion to start from where it fits the duration. One
    that does not is first made as fast as it can be.
    """
    needed, wanted = needed_duration(job.problem, job.mesh, start), job.problem.duration
    if wanted is None:
        return job.solve(stretch_to(start, 1.1 * needed) if needed > 0 else start)
    if needed > wanted:
        free = replace(job.problem, duration=None)
        quick = job.for_problem(free, fastest(free)).solve(stretch_to(start, 1.1 * needed))
        if not quick.ok or quick.iterate.duration > wanted:
            return replace(quick, ok=False)
        return job.solve(stretch_to(quick.iterate, wanted))
    # The path of least effort is that of any duration. Among discs, where there are many such
    # paths, a start from farther off may find a shorter one.
    near = job.objective.kind == "effort" and not job.problem.divided
    motion = stretch_to(start, wanted)
    return job.solve_near(motion) if near else job.solve(motion)


def needed_duration(problem: Problem, mesh: Mesh, iterate: Iterate) -> float:
    """Seconds this path takes, all of it stretched alike, within what a slower motion keeps."""
    u = np.stack(iterate.input_ends())
    slope = (u[1] - u[0]) / (mesh.widths[:, None] * iterate.duration)
    q = np.stack([iterate.nodes[:-1], iterate.nodes[1:]])[..., : problem.system.size]
    at, factors = MotionPoint.of(problem.system, q, u, np.stack([slope, slope])), [0.0]
    for required in problem.requirements:
        if required.speed:
            values = np.stack([np.ravel(value) for value in required.values(at)])
            factors += required.slowing_factor(values.min(axis=1), values.max(axis=1)).tolist()
    return iterate.duration * float(np.max(factors))
