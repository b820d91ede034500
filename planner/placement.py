"""Waypoints and obstacles of a problem file that no plan could meet, refused before any tries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.schema import ProblemFile
from planner.systems.base import TriangularSystem
from planner.workspace import Obstacle, Waypoint

if TYPE_CHECKING:
    from planner.problem import Problem

APART_S = 1e-6
"""Least time between two waypoints, relative to the duration."""


def waypoints_of(tables: ProblemFile, system: TriangularSystem, source: str) -> list[Waypoint]:
    """The waypoints of a problem file.

    Raises:
        InputError: If one names a coordinate that there is not.
    """
    try:
        states = tables.waypoint_states([c.name for c in system.coordinates])
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None
    pairs = zip(tables.waypoints, states, strict=True)
    return [Waypoint(k, q, table.time) for k, (table, q) in enumerate(pairs, 1)]


def obstacles_of(tables: ProblemFile) -> list[Obstacle]:
    """The obstacles of a problem file."""
    discs = enumerate(tables.discs(), 1)
    return [Obstacle(k, np.array(disc.centre_m), disc.radius_m) for k, disc in discs]


def refuse_misplaced(problem: Problem) -> None:
    """Refuse waypoints and obstacles that contradict the rest.

    Raises:
        InputError: Names the waypoint or obstacle, and the way out.
    """
    for point in problem.waypoints:
        _refuse_outside(problem, point)
    _refuse_times(problem)
    for name, q in (("start", problem.start), ("goal", problem.goal)):
        _refuse_touching(problem, name, q)
    for point in problem.waypoints:
        if not np.any(np.isnan(point.q[1:])):
            _refuse_touching(problem, f"waypoint {point.number}", point.q)


def _refuse_outside(problem: Problem, point: Waypoint) -> None:
    for i in problem.system.limited:
        if abs(point.q[i]) > problem.limits.joint[i]:
            named = problem.system.coordinates[i]
            factor, unit = (180 / np.pi, "deg") if named.unit == "rad" else (1.0, named.unit)
            raise InputError(
                f"{problem.source}: contradiction: waypoint {point.number} has {named.name} ="
                f" {point.q[i] * factor:.6g} {unit}, outside its limit of"
                f" {problem.limits.joint[i] * factor:.6g} {unit}; move it or widen the limit"
            )


def _refuse_times(problem: Problem) -> None:
    timed = sorted((p.time_s, p.number) for p in problem.waypoints if p.time_s is not None)
    if not timed:
        return
    if problem.duration is None:
        raise InputError(
            f"{problem.source}: waypoints[{timed[0][1] - 1}].time needs a fixed goal.duration;"
            " give one or leave out the time"
        )
    before = [(0.0, 0), *timed]
    for (earlier, first), (later, second) in zip(
        before, [*timed, (problem.duration, 0)], strict=True
    ):
        if later - earlier > APART_S * problem.duration:
            continue
        if first and second:
            raise InputError(
                f"{problem.source}: waypoints {first} and {second} have the same time {later:g} s;"
                " make them one or set them apart"
            )
        number, time = (second, later) if second else (first, earlier)
        raise InputError(
            f"{problem.source}: waypoints[{number - 1}].time = {time:g} s must lie inside the"
            f" motion, between 0 and goal.duration = {problem.duration:g} s"
        )


def _refuse_touching(problem: Problem, name: str, q: Any) -> None:
    if not problem.obstacles:
        return
    points = problem.system.arm_points(q[1:])  # type: ignore[attr-defined]
    for disc in problem.obstacles:
        clearances = disc.clearances(points)
        link = int(np.argmin(clearances))
        if clearances[link] < 0:
            raise InputError(
                f"{problem.source}: contradiction: at the {name} link {link + 1} reaches"
                f" {-clearances[link]:.3g} m into obstacle {disc.number}; move one of them"
            )
