"""Problems with thickened discs, so that links do not pass over thin discs between two nodes.

Motions are searched with thick discs and then solved with thinner and thinner ones: a motion that
clears a thick disc also clears a thin disc at the same place.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from planner.problem.problem import Problem
from planner.systems.triangular_system import PlanarArm

THICKNESSES = 0.025 / 2.0 ** np.arange(7)
"""Radii of thickened discs, with their clearance, as fractions of the arm's length. The tip moves
as far as the first between two nodes of a search's mesh in a motion of about three radians. Links
are sure not to pass unseen over a disc of the last, whose detour costs a tenth of a percent."""

SEARCH_EVERY = 4
"""Motions are searched with the first of every so many thicknesses."""

NEAREST_SHARE = 0.9
"""Fraction of the links' distance, at start, goal and waypoints, by which a disc may thicken."""


def thicknesses(problem: Problem) -> list[tuple[Problem, bool]]:
    """Return pairs of a problem and whether to search motions in it, in the order of trial.

    The problems have discs thickened to the radii `THICKNESSES`, from thick to thin, unless discs
    would then touch that are apart. The last is the problem itself, if the least of these radii is
    not thicker than its discs. The list is empty if no disc is thickened.
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
