"""Keep links from passing over thin discs between two nodes of the mesh.

Paths are first found with thickened discs, which then shrink: a path that clears a thick disc
also clears a thin disc at the same place. If a path would pass over a thinner disc, the previous
path is kept. A motion that clears all discs is solved again with discs that grow in each interval
up to a share of their distance from the links, so that the answer is on the same side.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.task import Solution, Task
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.problem import Problem
from planner.problem.requirements.places import Obstacle
from planner.support.arrays import Array
from planner.systems.triangular_system import PlanarArm

LEAST_THICKNESS = 0.025
"""Least radius of a disc, including its clearance, as a fraction of the arm's length. The tip moves
as far between two nodes of a search's mesh in a motion of about three radians."""

SHRINKING = 4.0
"""Factor by which the radii of thickened discs are divided at each step."""

KEPT = 0.5
"""Fraction of the distance between links and discs that a motion keeps when it is solved again."""

NEAREST_SHARE = 0.9
"""Fraction of the links' distance, at start, goal and waypoints, by which a disc may thicken."""


LEAST_SEARCHED = 3e-4
"""Radius of the thinnest discs with which a search is sure not to pass over one, in lengths of the
arm. A detour of this size costs a tenth of a percent at most."""


def searchable(problem: Problem) -> Problem:
    """Return the problem with discs of at least the radius `LEAST_SEARCHED`, as far as start, goal
    and waypoints allow; whoever clears them clears thinner ones. The problem itself if none is
    thinner."""
    if not problem.obstacles or not isinstance(problem.system, PlanarArm):
        return problem
    least = LEAST_SEARCHED * float(np.sum(problem.system.link_lengths))
    thin = any(disc.radius + disc.clearance < least for disc in problem.obstacles)
    return _thicken(problem, least) if thin else problem


def thicknesses(problem: Problem) -> Iterator[Problem]:
    """Yield the problem with thickened discs, from thick to thin, then the problem itself."""
    if problem.obstacles and isinstance(problem.system, PlanarArm):
        thickness = LEAST_THICKNESS * float(np.sum(problem.system.link_lengths))
        thinnest = min(disc.radius + disc.clearance for disc in problem.obstacles)
        while thickness > thinnest:
            yield _thicken(problem, thickness)
            thickness /= SHRINKING
    yield problem


def _thicken(problem: Problem, thickness: float) -> Problem:
    """Return the problem with thin discs thickened to a radius, m, as far as start, goal and
    waypoints allow."""
    places = (problem.start, problem.likely.goal, *(point.q for point in problem.waypoints))
    whole = np.array([q[1:] for q in places if not np.isnan(q[1:]).any()])
    points = problem.system.arm_points(whole)  # type: ignore[attr-defined]
    discs = []
    for disc in problem.obstacles:
        room = NEAREST_SHARE * (float(disc.clearances(points).min()) - disc.clearance)
        more = min(thickness - disc.radius - disc.clearance, room)
        discs.append(replace(disc, radius=disc.radius + max(0.0, more)))
    return replace(problem, obstacles=tuple(discs))


def keep_side(task: Task, start: Iterate, solution: Solution) -> Solution:
    """Return the solution, or a solution on the start's side of a disc that links passed over.

    If the solution passes over a disc but the start does not, the task is solved again with grown
    discs; if this fails, the first solution is returned.
    """
    if not solution.ok or clears(task, solution) or not clears(task, task.judge(start)):
        return solution
    grown = replace(task, inset=np.maximum(task.inset, growth(task, start)))
    kept = grown.solve(start, near=True)
    return kept if kept.ok and clears(task, kept) else solution


def growth(task: Task, start: Iterate) -> Array:
    """Return by how much discs may grow in each interval, (K, R), in the unit of the discs' rows.

    A disc grows by at most the fraction `KEPT` of its distance from the links.
    """
    system, curves, out = task.problem.system, task.motion_apart(start), []
    for required in task.requirements:
        amounts = np.zeros((len(curves), len(required.parts)))
        if isinstance(required, Obstacle) and isinstance(system, PlanarArm):
            room = required.clearances(system.arm_points(curves[..., 1:])).min(axis=1)
            most = LEAST_THICKNESS * float(np.sum(system.link_lengths))
            room = np.clip(KEPT * (room - required.clearance), 0.0, most)
            amounts = room + room**2 / (2 * required.thickness)
        out.append(amounts)
    return np.concatenate(out, axis=1)
