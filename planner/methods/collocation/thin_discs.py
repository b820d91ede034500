"""Thin discs, which links could pass over between two nodes of the mesh.

So paths are first found with thickened discs, which then shrink: a path that clears a thick disc
also clears a thin one at the same place. If a path would pass over a thinner disc, the previous
path is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from planner.problem.problem import Problem
from planner.systems.triangular_system import PlanarArm

LEAST_THICKNESS = 0.025
"""Least radius of a disc, including its clearance, in lengths of the arm. The tip moves by this
much between two nodes of a search's mesh in a motion of about three radians."""

SHRINKING = 4.0
"""Factor by which discs get thinner at each step."""

NEAREST_SHARE = 0.9
"""Share of the links' distance at start and goal by which a disc may grow."""


def thicknesses(problem: Problem) -> Iterator[Problem]:
    """The problem with thickened discs, from thick to thin, then the problem itself."""
    if problem.obstacles and isinstance(problem.system, PlanarArm):
        thickness = LEAST_THICKNESS * float(np.sum(problem.system.link_lengths))
        thinnest = min(disc.radius + disc.clearance for disc in problem.obstacles)
        while thickness > thinnest:
            yield _thicken(problem, thickness)
            thickness /= SHRINKING
    yield problem


def _thicken(problem: Problem, thickness: float) -> Problem:
    """The problem with thin discs thickened to `thickness`, as far as start, goal and waypoints
    allow."""
    places = (problem.start, problem.likely.goal, *(point.q for point in problem.waypoints))
    whole = np.array([q[1:] for q in places if not np.isnan(q[1:]).any()])
    points = problem.system.arm_points(whole)  # type: ignore[attr-defined]
    discs = []
    for disc in problem.obstacles:
        room = NEAREST_SHARE * (float(disc.clearances(points).min()) - disc.clearance)
        more = min(thickness - disc.radius - disc.clearance, room)
        discs.append(replace(disc, radius=disc.radius + max(0.0, more)))
    return replace(problem, obstacles=tuple(discs))
