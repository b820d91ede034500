"""Thin discs: links pass over them between two places at which they are looked at.

So paths are looked for among thicker discs, which then shrink: whoever clears a thick disc clears a
thin one at the same place. A path that would pass over a thinner disc stays as it was before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from planner.problem.problem import Problem
from planner.systems.triangular_system import PlanarArm

LEAST_THICKNESS = 0.025
"""Least radius of a disc, with its clearance, in lengths of the arm: as far as the tip moves
between two places of a search's mesh in a motion of about three radians."""

SHRINKING = 4.0
"""Times that discs get thinner at each step."""

NEAREST_SHARE = 0.9
"""Share of the links' distance at start and goal that a disc may grow by."""


def thicknesses(problem: Problem) -> Iterator[Problem]:
    """The problem with thin discs thickened, less and less, and at last as it is."""
    if problem.obstacles and isinstance(problem.system, PlanarArm):
        thickness = LEAST_THICKNESS * float(np.sum(problem.system.link_lengths))
        thinnest = min(disc.radius + disc.clearance for disc in problem.obstacles)
        while thickness > thinnest:
            yield _thickened(problem, thickness)
            thickness /= SHRINKING
    yield problem


def _thickened(problem: Problem, thickness: float) -> Problem:
    """Thin discs as thick as this, or as start, goal and waypoints allow."""
    places = (problem.start, problem.likely.goal, *(point.q for point in problem.waypoints))
    whole = np.array([q[1:] for q in places if not np.isnan(q[1:]).any()])
    points = problem.system.arm_points(whole)  # type: ignore[attr-defined]
    discs = []
    for disc in problem.obstacles:
        room = NEAREST_SHARE * (float(disc.clearances(points).min()) - disc.clearance)
        more = min(thickness - disc.radius - disc.clearance, room)
        discs.append(replace(disc, radius=disc.radius + max(0.0, more)))
    return replace(problem, obstacles=tuple(discs))
