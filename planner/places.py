"""How a motion stands to waypoints and obstacles, over all time; the judge's own geometry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from planner.extrema import minimum
from planner.problem import Problem
from planner.systems.base import Array

Motion = Callable[[Array], Array]
"""Times (m,) to coordinates (m, N)."""


def passes(
    problem: Problem, motion: Motion, times: Array
) -> Iterator[tuple[str, float, float, str]]:
    """For each waypoint its label, the distance at which it is passed, when, and the unit.

    A waypoint without a time is passed where the motion comes nearest.
    """
    for point in problem.waypoints:
        fixed = np.flatnonzero(~np.isnan(point.q))
        units = {problem.system.coordinates[i].unit for i in fixed}
        unit = units.pop() if len(units) == 1 else ""
        if point.time_s is None:
            value, when = minimum(lambda t, p=point: p.distance(motion(t)), times, refine=20)  # type: ignore[misc]
        else:
            value, when = float(point.distance(motion(np.array([point.time_s])))[0]), point.time_s
        yield point.label, value, when, unit


def clearances(
    problem: Problem, motion: Motion, times: Array
) -> Iterator[tuple[str, float, float, float]]:
    """For each obstacle and link its label, the least clearance, when, and the disc's radius."""
    system: Any = problem.system
    for disc in problem.obstacles:
        for link in range(len(system.link_lengths)):
            value, when = minimum(
                lambda t, d=disc, k=link: d.clearances(system.arm_points(motion(t)[:, 1:]))[:, k],  # type: ignore[misc]
                times,
            )
            yield disc.label(link + 1), value, when, disc.radius
