"""Keep links from passing over thin discs between two nodes of the mesh.

Motions are first searched with thickened discs and then solved with thinner ones: a motion that
clears a thick disc also clears a thin disc at the same place. A motion that clears all discs is
solved again with discs that grow in each interval up to a share of their distance from the links,
so that the answer is on the same side.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.task import Solution, Task
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.problem import Problem
from planner.problem.requirements.places import Obstacle
from planner.support.arrays import Array
from planner.systems.triangular_system import PlanarArm

THICKNESSES = 0.025 / 2.0 ** np.arange(7)
"""Radii of thickened discs, with their clearance, as fractions of the arm's length. The tip moves
as far as the first between two nodes of a search's mesh in a motion of about three radians. Links
are sure not to pass unseen over a disc of the last, whose detour costs a tenth of a percent."""

SEARCH_EVERY = 4
"""Motions are searched with the first of every so many thicknesses."""

KEPT = 0.5
"""Fraction of the distance between links and discs that a motion keeps when it is solved again."""

NEAREST_SHARE = 0.9
"""Fraction of the links' distance, at start, goal and waypoints, by which a disc may thicken."""


def thicknesses(problem: Problem) -> list[tuple[Problem, bool]]:
    """Return the problem with thickened discs, from thick to thin, and the problem itself.

    Each comes with whether motions are searched in it. The discs' radii are `THICKNESSES`, as far
    as discs are thinner and as they do not grow together. The problem itself is left out if its
    discs are too thin to be seen, and the list is empty if no disc is thickened.
    """
    if not problem.obstacles or not isinstance(problem.system, PlanarArm):
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
            most = THICKNESSES[0] * required.reach
            room = np.clip(KEPT * (room - required.clearance), 0.0, most)
            amounts = room + room**2 / (2 * required.thickness)
        out.append(amounts)
    return np.concatenate(out, axis=1)
