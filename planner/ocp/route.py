"""Waypoints on the way: in which order and when they are passed, and guesses that pass them.

A waypoint is an edge of the mesh at which some coordinates are fixed. One with a time has its place
in the mesh; the others are first placed by distance. The systems are driftless, so how long each
part of the way may take is settled afterwards: least effort moves at the same speed everywhere, and
so parts get time in proportion to their length (`rebalanced`), which is repeated until it settles.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.errors import InputError
from planner.ocp.guess import through_waypoints
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh, through, uniform
from planner.ocp.task import Task, task
from planner.problem import Problem
from planner.systems.base import Array
from planner.workspace import Waypoint

MOST_ORDERS = 6
"""Orders of waypoints without a time that are tried; the shortest by straight lines first."""

MOST_SORTED = 5040
"""Orders that are sorted: those of seven waypoints without a time, in about a second."""

LEAST_SHARE = 0.02
"""Least part of the duration between two waypoints where the planner chooses it."""


def routes(problem: Problem) -> list[Problem]:
    """The problem with its waypoints in each order worth trying, the shortest by straight lines
    first; itself where there is no choice.

    Raises:
        InputError: If there are too many orders.
    """
    if len(problem.waypoints) < 2:
        return [problem]
    count = len(problem.waypoints)
    free = sum(w.time_s is None for w in problem.waypoints)
    if (ways := math.perm(count, free)) > MOST_SORTED:
        raise InputError(
            f"{problem.source}: {count} waypoints, {free} of them without a time, may be passed in"
            f" {ways:.3g} orders; at most {MOST_SORTED} are looked at, so give more of them a time"
        )
    orders = sorted(_orders(problem), key=lambda order: _length(problem, order))
    return [replace(problem, waypoints=order) for order in orders[:MOST_ORDERS]]


def mesh_through(problem: Problem, intervals: int) -> Mesh:
    """About as many intervals, even between the waypoints, with an edge at each in their order."""
    if not problem.waypoints:
        return uniform(intervals)
    return through(intervals, _fractions(problem, problem.waypoints))


def rebalanced(job: Task, iterate: Iterate) -> tuple[Task, Iterate] | None:
    """The task and iterate with time shared out anew among the parts; None where it is settled."""
    old = job.mesh.knots
    new = _shared_out(job, iterate)
    if np.max(np.abs(new - old)) < 0.002:
        return None
    edges = np.interp(job.mesh.edges, old, new)
    mesh = Mesh(edges, job.mesh.marks)
    pace = np.diff(job.mesh.edges) / np.diff(edges)
    form = job.made.form
    factor = pace[:, None]
    if len(iterate.inputs) != len(pace):
        factor = np.append(pace, pace[-1])[:, None]
    moved = replace(iterate, inputs=iterate.inputs * factor)
    fresh = task(job.problem, job.objective, form, mesh, job.asked, job.settings)
    return fresh, moved


def _orders(problem: Problem) -> list[tuple[Waypoint, ...]]:
    """Every order of the waypoints in which those with a time follow their times."""
    timed = [w for w in problem.waypoints if w.time_s is not None]
    orders = [tuple(sorted(timed, key=lambda w: w.time_s or 0.0))]
    for free in (w for w in problem.waypoints if w.time_s is None):
        orders = [(*o[:k], free, *o[k:]) for o in orders for k in range(len(o) + 1)]
    return orders


def _length(problem: Problem, order: tuple[Waypoint, ...]) -> float:
    return float(np.sum(_steps(problem, order)))


def _steps(problem: Problem, order: tuple[Waypoint, ...]) -> Array:
    """Straight-line distances from each place to the next, in joint space without q₁."""
    places = np.linspace(0.0, 1.0, len(order) + 2)
    q = through_waypoints(replace(problem, waypoints=order), places, 0.0, places)
    return np.asarray(np.linalg.norm(np.diff(q[:, 1:], axis=0), axis=1))


def _fractions(problem: Problem, order: tuple[Waypoint, ...]) -> list[float]:
    """When each is passed: its time, or in proportion to distance between those that have one."""
    total = problem.duration or 1.0
    fixed = [0.0, *(np.nan if w.time_s is None else w.time_s / total for w in order), 1.0]
    return list(_between(np.array(fixed), _steps(problem, order) + 1e-3)[1:-1])


def _between(knots: Array, needs: Array) -> Array:
    """Knots with those that are NaN placed between their neighbours in proportion to needs."""
    covered = np.append(0.0, np.cumsum(needs))
    known = ~np.isnan(knots)
    out = np.interp(covered, covered[known], knots[known])
    return np.where(known, knots, out)


def _shared_out(job: Task, iterate: Iterate) -> Array:
    left, right = iterate.input_ends()
    weights = np.sqrt(job.objective.weights[1:3])
    if job.problem.duration is None or not np.any(weights):
        limit = job.problem.limits.input
        weights = np.where(np.isfinite(limit), 1 / limit, 1.0)
    speed = np.linalg.norm((left + right) / 2 * weights, axis=1) * job.mesh.widths
    needs = np.add.reduceat(speed, [0, *job.mesh.marks])
    needs = np.maximum(needs, LEAST_SHARE * np.sum(needs))
    timed = [w.time_s is not None for w in job.problem.waypoints]
    fixed = np.where([True, *timed, True], job.mesh.knots, np.nan)
    return _between(fixed, needs)
