"""Motions among discs: found leg by leg, or among thickened discs.

A way through the free joint space, which ignores the kinematics, leads from corner to corner with
room around each (`find_way`). From each corner to the next a path is found from the usual first
guesses; the first path that clears all discs is enough. The legs are joined and shortened.
Meanwhile, and when a path is timed, discs grow in each interval of the mesh up to a share of their
distance from the links, at first also only up to the greatest thickness. Once a link has passed
over a disc, that bound falls, and the interval is halved. So links stay on their side.

Links could pass over thin discs between two nodes. So motions are searched with thick discs
(`thicknesses`) and then solved with thinner and thinner ones: a motion that clears a thick disc
also clears a thin disc at the same place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from planner.methods.collocation.between_nodes import clears, inspect
from planner.methods.collocation.guesses import seeds
from planner.methods.collocation.path import Enough, needed_duration, path_task, search
from planner.methods.collocation.task import Solution, Task, stretch_to, transfer
from planner.methods.collocation.transcription.form import Mesh, fastest
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.free_space import find_way
from planner.problem.problem import Problem
from planner.problem.requirements.places import Obstacle
from planner.support import progress
from planner.support.arrays import Array
from planner.systems.triangular_system import PlanarArm

THICKNESSES = 0.025 / 2.0 ** np.arange(7)
"""Radii of thickened discs, clearance included, in lengths of the arm. The tip moves by the first
between two nodes of a search; no link passes unseen over the last, a detour of 0.1 %."""

SEARCH_EVERY = 4
"""Motions are searched with the first of every so many thicknesses."""

NEAREST_SHARE = 0.9
"""Fraction of the links' distance, at start, goal and waypoints, by which a disc may thicken."""

KEPT = 0.5
"""Fraction of the distance between links and discs that a motion keeps when it is solved again."""

WAYS, MOST_WAYS, LEG_SEEDS = 8, 4, 12
"""Number of ways to find; number of the shortest ways to try until one leads to a motion; and of
first guesses for a leg: nearly always the first works."""

ROUNDS, GAIN = 10, 0.01
"""Largest number of solves of a path, and least gain that justifies another solve."""


def paths_by_legs(job: Task) -> Iterator[tuple[Task, Solution]]:
    """Yield paths that clear all discs, found leg by leg, each with its task, from the shortest way
    on; none if the straight line clears all discs already."""
    ways = list[Array]()
    while len(ways) < WAYS and (way := find_way(job.problem, len(ways))) is not None:
        ways.append(way)
    ways.sort(key=lambda way: float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()))
    for way in ways[:MOST_WAYS]:
        if len(way) < 3:
            return
        progress.tell(f"passing the discs in {len(way) - 1} legs")
        legs = _find_legs(job, way[1:])
        if legs and (path := _solve_clear(*_join(job, legs))):
            yield path


def time_clear(job: Task, start: Iterate) -> tuple[Task, Solution]:
    """Time a path that clears all discs, as `solve_timing` elsewhere; return the motion after its
    own task."""
    needed, wanted = 1.1 * needed_duration(job.problem, job.mesh, start), job.problem.duration
    if wanted and needed > wanted:
        free = replace(job.problem, duration=None)
        quick = _solve_clear(job.for_problem(free, fastest(free)), stretch_to(start, needed))
        if quick is None or quick[1].iterate.duration > wanted:
            return job, replace(job.judge(start), ok=False)
        job, start = job.on_mesh(quick[0].mesh), quick[1].iterate
    start = stretch_to(start, wanted or needed)
    return _solve_clear(job, start) or (job, job.judge(start))


def _find_legs(job: Task, corners: Array) -> list[tuple[Task, Solution]]:
    """Find the path to each corner in turn, with its task; return [] if a path is not found."""
    problem, legs, here = job.problem, list[tuple[Task, Solution]](), job.problem.start
    for k, corner in enumerate(corners):
        end = problem.goal[0] if k == len(corners) - 1 else np.nan
        part = replace(problem.likely, start=here, user_goal=np.append(end, corner))
        own = job.for_problem(part, job.objective)
        found = search(own, seeds("auto", LEG_SEEDS), Enough(1)).clear
        if not found:
            return []
        path = found[0]
        legs.append((path_task(own), path.solution))
        here = path.solution.iterate.nodes[-1, : problem.system.size]
    return legs


def _join(job: Task, legs: Sequence[tuple[Task, Solution]]) -> tuple[Task, Iterate]:
    """Join legs to one path of constant speed; return the task of the path, and the path."""
    lengths = np.sqrt([path.objective for _, path in legs])
    shares = lengths / np.sum(lengths)
    widths = np.concatenate([w * leg.mesh.widths for w, (leg, _) in zip(shares, legs, strict=True)])
    free = path_task(job.on_mesh(_mesh(widths)))
    paths = [path.iterate for _, path in legs]
    inputs = [path.inputs / share for path, share in zip(paths, shares, strict=True)]
    if len(inputs[0]) > len(paths[0].points):  # at edges, two of which coincide
        inputs[1:] = [each[1:] for each in inputs[1:]]
    return free, Iterate(
        duration=paths[0].duration,
        nodes=np.concatenate([paths[0].nodes[:1], *(path.nodes[1:] for path in paths)]),
        points=np.concatenate([path.points for path in paths]),
        inputs=np.concatenate(inputs),
    )


def _mesh(widths: Array) -> Mesh:
    edges = np.append(0.0, np.cumsum(widths))
    return Mesh(edges / edges[-1])


def _solve_clear(job: Task, start: Iterate) -> tuple[Task, Solution] | None:
    """Solve from a start that clears all discs, with links kept on the same side of each disc."""
    best, most = None, float(THICKNESSES[0])
    for _ in range(ROUNDS):
        solution = replace(job, inset=_growth(job, start, most)).solve(start, near=True)
        if not solution.ok:
            break
        if clears(job, solution):
            before = best[1].objective if best else np.inf
            best, start = (job, job.judge(solution.iterate)), solution.iterate
            if solution.objective > (1 - GAIN) * before:
                break
        else:
            passed = inspect(job, solution).excess.any(axis=1)
            halved = np.convolve(passed, np.ones(3), mode="same") > 0  # with their neighbours
            finer = job.on_mesh(_mesh(np.repeat(job.mesh.widths / (1 + halved), 1 + halved)))
            job, start, most = finer, transfer(job, start, finer), math.inf
    if best and (last := best[0].solve(best[1].iterate, near=True)).ok:
        return (best[0], last) if clears(best[0], last) else best
    return best


def _growth(task: Task, start: Iterate, most: float) -> Array:
    """Return by how much discs may grow in each interval, (K, R), in the unit of the discs' rows.

    A disc grows by at most the fraction `KEPT` of its distance from the links, and by at most
    `most` lengths of the arm.
    """
    system, curves, out = task.problem.system, task.motion_apart(start), []
    for required in task.requirements:
        amounts = np.zeros((len(curves), len(required.parts)))
        if isinstance(required, Obstacle) and isinstance(system, PlanarArm):
            room = required.clearances(system.arm_points(curves[..., 1:])).min(axis=1)
            room = np.clip(KEPT * (room - required.clearance), 0.0, most * required.reach)
            amounts = room + room**2 / (2 * required.thickness)
        out.append(amounts)
    return np.concatenate(out, axis=1)


def uncovered(discs: Sequence[Obstacle]) -> tuple[Obstacle, ...]:
    """Return the discs without those that lie within another, of equal ones the first."""

    def covers(a: Obstacle, b: Obstacle) -> bool:
        return math.dist(a.centre, b.centre) + b.thickness <= a.thickness

    return tuple(
        disc
        for k, disc in enumerate(discs)
        if not any(covers(a, disc) for a in discs[:k])
        and not any(covers(a, disc) and not covers(disc, a) for a in discs[k + 1 :])
    )


def thicknesses(problem: Problem) -> list[tuple[Problem, bool]]:
    """Return pairs of a problem and whether to search motions in it, in the order of trial.

    The problems have discs thickened to the radii `THICKNESSES`, from thick to thin, unless discs
    would then touch that are apart. The last is the problem itself, if the least of these radii is
    not thicker than its discs. The list is empty if no disc is thickened.
    """
    if not isinstance(problem.system, PlanarArm):
        return []
    thinnest = min(disc.thickness for disc in problem.obstacles) / problem.obstacles[0].reach
    out = []
    for k, thickness in enumerate(THICKNESSES[thinnest < THICKNESSES]):
        thick = _thicken(problem, float(thickness) * problem.obstacles[0].reach)
        if _contacts(thick) == _contacts(problem):
            out.append((thick, k % SEARCH_EVERY == 0))
    return [*out, (problem, False)] if thinnest >= THICKNESSES[-1] and out else out


def _contacts(problem: Problem) -> int:
    """Return the number of pairs of discs that overlap, their clearances included."""
    pairs = itertools.combinations(problem.obstacles, 2)
    return sum(math.dist(a.centre, b.centre) <= a.thickness + b.thickness for a, b in pairs)


def _thicken(problem: Problem, thickness: float) -> Problem:
    """Return the problem with thin discs thickened to a radius, m, as far as start, goal and
    waypoints allow."""
    places = (problem.start, problem.likely.goal, *(point.q for point in problem.waypoints))
    whole = np.array([q[1:] for q in places if not np.isnan(q[1:]).any()])
    points = problem.system.arm_points(whole)  # type: ignore[attr-defined]
    discs = []
    for disc in problem.obstacles:
        room = NEAREST_SHARE * (float(disc.clearances(points).min()) - disc.clearance)
        more = min(thickness - disc.thickness, room)
        discs.append(replace(disc, radius=disc.radius + max(0.0, more)))
    return replace(problem, obstacles=tuple(discs))
