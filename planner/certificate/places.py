"""Waypoints and obstacles, proven.

A link from P in direction e of length l has from a disc's centre C the squared distance

    |P − C|² + m(a),   a = (P − C)·e,   m(a) = min over t in [0, l] of 2at + t²

where m is 0 for a ≥ 0, −a² for −l ≤ a ≤ 0, and linear below. On a cell within one of these ranges
the distance is a model. On one across two of them m, being concave, is replaced by its chord, and
such cells are halved until the chord is as good as m.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.certificate import series
from planner.certificate.balls import Ball
from planner.certificate.cells import Cells, joined, joined_models
from planner.certificate.evaluate import Expression
from planner.certificate.least import halved, least
from planner.certificate.model import UNIT, Model
from planner.certificate.motion import Motion
from planner.certificate.requirements import Requirement, claim
from planner.claims import Claim, undecided
from planner.problem import Problem
from planner.systems.base import Array, TriangularSystem
from planner.verify import GOAL_TOLERANCE
from planner.workspace import Obstacle, Waypoint

HALVINGS = 10


def obstacles(problem: Problem, motion: Motion) -> list[Claim]:
    """The clearance of every link from every disc, in metres."""
    out = []
    for disc in problem.obstacles:
        centre = [Ball.constant(x) for x in disc.centre]
        values = motion.models(*_links(problem.system)(motion.q, centre))
        lengths = problem.system.link_lengths  # type: ignore[attr-defined]
        for link, length in enumerate(lengths, 1):
            own = values[3 * link - 3 : 3 * link]
            square, cells = _square(own, float(length), motion.cells)
            of = Requirement(disc.label(link), [], disc.radius, "m")
            (found,) = least([(1.0, square, 0.0)], cells, np.array([disc.radius**2]))
            bounds = [_clearance(x, disc) for x in (found.guaranteed, found.attained)]
            out.append(claim(of, bounds[0], bounds[1], found.time_s))
    return out


def waypoints(
    problem: Problem, motion: Motion, own: Callable[[float], tuple[float, float]]
) -> list[Claim]:
    """Every waypoint passed, within `verify`'s tolerance: at its time, or at some time.

    Args:
        problem: Has the waypoints.
        motion: The motion, in the path's own time.
        own: From the plan's time to the path's and its uncertainty, which is infinite for a time
            that the motion does not reach.
    """
    out = []
    for point in problem.waypoints:
        if point.time_s is None:
            (time, nowhere), doubt = _nearest(motion, point), 0.0
        else:
            (time, doubt), nowhere = own(point.time_s), True
        if not np.isfinite(doubt):
            why = f"where the motion is at t = {point.time_s:.6g} s is not known"
            out.append(undecided(point.label, "", why))
            continue
        low, high = _distance(motion, point, time, doubt)
        best = GOAL_TOLERANCE - low if nowhere else np.nan
        of = Requirement(point.label, [], GOAL_TOLERANCE, "")
        out.append(claim(of, GOAL_TOLERANCE - high, best, time))
    return out


@lru_cache(maxsize=32)
def _links(system: TriangularSystem) -> Expression:
    """|P − C|², a and a² of each link, of (q, C)."""
    arm: Any = system
    q, centre = ca.SX.sym("q", system.size), ca.SX.sym("C", 2)
    offset, heading, out = -centre, ca.SX(0), []
    for i, length in enumerate(arm.link_lengths, 1):
        heading = heading + q[i]
        direction = ca.vertcat(ca.cos(heading), ca.sin(heading))
        along = ca.dot(offset, direction)
        out += [ca.sumsqr(offset), along, along**2]
        offset = offset + length * direction
    return Expression([q, centre], ca.vertcat(*out))


def _square(values: list[Model], length: float, cells: Cells) -> tuple[Model, Cells]:
    """A model that is nowhere above the squared distance, close to it where it may be least, and
    its cells."""
    kept: list[tuple[Cells, list[Model]]] = []
    best = np.inf
    for step in range(HALVINGS + 1):
        square, along, _ = values
        low, high = along.low, along.high
        best = np.fmin(best, np.fmin.reduce(square.high + _least_of(high, length)))
        far = square.low + _least_of(low, length) > best
        one = (low >= 0) | (high <= -length) | ((high <= 0) & (low >= -length))
        settled = one | far | (step == HALVINGS) | ~np.isfinite(along.r)
        kept.append((cells.only(settled), [x.only(settled) for x in values]))
        if np.all(settled):
            break
        values = [Model(*halved(x.c[~settled], x.r[~settled])) for x in values]
        cells = cells.only(~settled).halved()
    square, along, twice = (joined_models([m[k] for _, m in kept]) for k in range(3))
    return _lower(square, along, twice, length), joined([c for c, _ in kept])


def _lower(square: Model, along: Model, twice: Model, length: float) -> Model:
    """|P − C|² + m(a), or with the chord of m on cells across two of its ranges."""
    low, high = np.clip(along.low, -1e6, 1e6), np.clip(along.high, -1e6, 1e6)
    behind, beyond, beside = low >= 0, high <= -length, (high <= 0) & (low >= -length)
    at_low, at_high = _least_of(low, length), _least_of(high, length)
    slope = np.divide(at_high - at_low, high - low, out=np.zeros_like(low), where=high > low)
    slope = np.where(behind | beside, 0.0, np.where(beyond, 2 * length, slope))
    level = np.where(behind | beside, 0.0, np.where(beyond, length**2, at_low - slope * low))
    doubt = 16 * UNIT * (np.abs(slope * low) + np.abs(level) + np.abs(at_low) + np.abs(at_high))
    straight = along.scaled(slope) + Model(level[:, None], doubt)
    return square + straight + twice.scaled(np.where(beside, -1.0, 0.0))


def _least_of(a: Array, length: float) -> Array:
    t = np.clip(-a, 0.0, length)
    return np.asarray(2 * a * t + t**2)


def _clearance(square: float, disc: Obstacle) -> float:
    return float(np.sqrt(max(square, 0.0)) - disc.radius) if np.isfinite(square) else square


def _nearest(motion: Motion, point: Waypoint) -> tuple[float, bool]:
    """A time at which the motion is near a waypoint, and whether it provably is nowhere near."""
    places = np.array([-1.0, *series.nodes(), 1.0])
    basis = np.polynomial.chebyshev.chebvander(places, series.POINTS - 1)
    q = np.stack([p.c @ basis[:, : p.c.shape[1]].T for p in motion.states], axis=-1)
    cell, place = np.unravel_index(np.argmin(point.distance(q)), q.shape[:2])
    time = float(motion.cells.times(places)[cell, place])
    fixed = np.flatnonzero(~np.isnan(point.q))
    states = [motion.states[i] - float(point.q[i]) for i in fixed]
    away = np.max([np.maximum(s.low, -s.high) for s in states], axis=0)
    return time, bool(np.all(away > GOAL_TOLERANCE))


def _distance(motion: Motion, point: Waypoint, time: float, slip: float) -> tuple[float, float]:
    """Bounds of the distance at a time that is known to within `slip`."""
    ends = motion.cells.times(np.array([-1.0, 1.0]))
    k = int(np.clip(np.searchsorted(ends[:, 0], time, side="right") - 1, 0, len(ends) - 1))
    tau = 2 * (time - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
    low, high = 0.0, 0.0
    for i in np.flatnonzero(~np.isnan(point.q)):
        c = motion.states[i].c[k]
        value = abs(np.polynomial.chebyshev.chebval(tau, c) - point.q[i])
        doubt = float(motion.states[i].r[k]) + 1e-14 * len(c) ** 2 * float(np.sum(np.abs(c)))
        steepest = float(np.arange(len(c)) ** 2 @ np.abs(c))  # |Tₖ'| ≤ k²
        doubt += 2 * slip / (ends[k, 1] - ends[k, 0]) * steepest
        low, high = max(low, value - doubt), max(high, value + doubt)
    return low, high
