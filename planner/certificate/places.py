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
from planner.certificate.cells import Cells, joined, joined_models
from planner.certificate.evaluate import Evaluator
from planner.certificate.least import least
from planner.certificate.model import UNIT, Model
from planner.certificate.motion import Motion
from planner.certificate.requirements import Requirement, claim
from planner.claims import Claim
from planner.problem import Problem
from planner.systems.base import Array, TriangularSystem
from planner.verify import GOAL_TOLERANCE
from planner.workspace import Obstacle, Waypoint

HALVINGS = 10


def obstacles(problem: Problem, motion: Motion) -> list[Claim]:
    """The clearance of every link from every disc, in metres."""
    out = []
    for disc in problem.obstacles:
        values = iter(_links(problem.system)(motion.states, _constants(disc, motion)))
        lengths = problem.system.link_lengths  # type: ignore[attr-defined]
        for link, length in enumerate(lengths, 1):
            square, cells = _square(next(values), next(values), float(length), motion.cells)
            of = Requirement(disc.label(link), [], disc.radius, "m")
            (found,) = least([square], cells, np.array([disc.radius**2]))
            bounds = [_clearance(x, disc) for x in (found.guaranteed, found.attained)]
            out.append(claim(of, bounds[0], bounds[1], found.time_s))
    return out


def waypoints(problem: Problem, motion: Motion, own: Callable[[float], float]) -> list[Claim]:
    """Every waypoint passed, within `verify`'s tolerance: at its time, or at some time.

    Args:
        problem: Has the waypoints.
        motion: The motion, in the path's own time.
        own: From the plan's time to the path's.
    """
    out = []
    for point in problem.waypoints:
        if point.time_s is None:
            time, nowhere = _nearest(motion, point)
        else:
            time, nowhere = own(point.time_s), True
        low, high = _distance(motion, point, time)
        best = GOAL_TOLERANCE - low if nowhere else np.nan
        of = Requirement(point.label, [], GOAL_TOLERANCE, "")
        out.append(claim(of, GOAL_TOLERANCE - high, best, time))
    return out


@lru_cache(maxsize=32)
def _links(system: TriangularSystem) -> Evaluator:
    """|P − C|² and a of each link, of (q, C)."""
    arm: Any = system
    q, centre = ca.SX.sym("q", system.size), ca.SX.sym("C", 2)
    offset, heading, out = -centre, ca.SX(0), []
    for i, length in enumerate(arm.link_lengths, 1):
        heading = heading + q[i]
        direction = ca.vertcat(ca.cos(heading), ca.sin(heading))
        out += [ca.sumsqr(offset), ca.dot(offset, direction)]
        offset = offset + length * direction
    return Evaluator([q, centre], ca.vertcat(*out))


def _constants(disc: Obstacle, motion: Motion) -> list[Model]:
    return [Model.constant(x, len(motion.cells.piece)) for x in disc.centre]


def _square(square: Model, along: Model, length: float, cells: Cells) -> tuple[Model, Cells]:
    """A model that is nowhere above the squared distance, close to it, and its cells."""
    done: list[tuple[Cells, Model]] = []
    for step in range(HALVINGS + 1):
        behind, beyond = along.low >= 0, along.high <= -length
        beside = (along.high <= 0) & (along.low >= -length)
        settled = behind | beyond | beside | (step == HALVINGS) | ~np.isfinite(along.r)
        if np.any(settled):
            parts = [x.only(settled) for x in (square, along)]
            which = np.array([behind, beyond, beside])[:, settled]
            done.append((cells.only(settled), _lower(parts[0], parts[1], length, which)))
        if np.all(settled):
            break
        square, along = (_halved(x.only(~settled)) for x in (square, along))
        cells = cells.only(~settled).halved()
    return joined_models([m for _, m in done]), joined([c for c, _ in done])


def _lower(square: Model, along: Model, length: float, which: Array) -> Model:
    """|P − C|² + m(a), or with the chord of m where none of the three cases holds."""
    behind, beyond, beside = which
    low, high = np.clip(along.low, -1e6, 1e6), np.clip(along.high, -1e6, 1e6)
    at_low, at_high = _least_of(low, length), _least_of(high, length)
    slope = np.divide(at_high - at_low, high - low, out=np.zeros_like(low), where=high > low)
    slope = np.where(behind | beside, 0.0, np.where(beyond, 2 * length, slope))
    level = np.where(behind | beside, 0.0, np.where(beyond, length**2, at_low - slope * low))
    doubt = 16 * UNIT * (np.abs(slope * low) + np.abs(level) + np.abs(at_low) + np.abs(at_high))
    straight = along.scaled(slope) + Model(level[:, None], doubt)
    bent = (along * along).scaled(np.where(beside, -1.0, 0.0))
    return square + straight + bent


def _least_of(a: Array, length: float) -> Array:
    t = np.clip(-a, 0.0, length)
    return np.asarray(2 * a * t + t**2)


def _clearance(square: float, disc: Obstacle) -> float:
    return float(np.sqrt(max(square, 0.0)) - disc.radius) if np.isfinite(square) else square


def _halved(model: Model) -> Model:
    """The model on the left halves of its cells, then on the right halves."""
    width = model.c.shape[1]
    to, back = series.to_bernstein(width), series.from_bernstein(width)
    row = model.c @ to.T
    size = np.max(np.abs(model.c) @ np.abs(to).T, axis=1)
    left, right = [row[:, 0]], [row[:, -1]]
    while row.shape[1] > 1:
        row = (row[:, 1:] + row[:, :-1]) / 2
        left.append(row[:, 0])
        right.append(row[:, -1])
    b = np.concatenate([np.stack(left, 1), np.stack(right[::-1], 1)])
    slip = 5 * (width + 2) * UNIT * np.sum(np.abs(back)) * size
    return Model.cut(b @ back.T, np.tile(model.r + slip, 2))


def _nearest(motion: Motion, point: Waypoint) -> tuple[float, bool]:
    """A time at which the motion is near a waypoint, and whether it provably is nowhere near."""
    places = np.array([-1.0, *series.nodes(), 1.0])
    basis = np.polynomial.chebyshev.chebvander(places, series.DEGREE)
    q = np.stack([p.c @ basis[:, : p.c.shape[1]].T for p in motion.p], axis=-1)
    cell, place = np.unravel_index(np.argmin(point.distance(q)), q.shape[:2])
    time = float(motion.cells.times(places)[cell, place])
    fixed = np.flatnonzero(~np.isnan(point.q))
    states = [motion.states[i] - float(point.q[i]) for i in fixed]
    away = np.max([np.maximum(s.low, -s.high) for s in states], axis=0)
    return time, bool(np.all(away > GOAL_TOLERANCE))


def _distance(motion: Motion, point: Waypoint, time: float) -> tuple[float, float]:
    """Bounds of the distance at a time."""
    ends = motion.cells.times(np.array([-1.0, 1.0]))
    k = int(np.clip(np.searchsorted(ends[:, 0], time, side="right") - 1, 0, len(ends) - 1))
    tau = 2 * (time - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
    low, high = 0.0, 0.0
    for i in np.flatnonzero(~np.isnan(point.q)):
        c = motion.p[i].c[k]
        value = abs(np.polynomial.chebyshev.chebval(tau, c) - point.q[i])
        doubt = motion.radius[i, k] + 1e-14 * len(c) ** 2 * float(np.sum(np.abs(c)))
        low, high = max(low, value - doubt), max(high, value + doubt)
    return low, high
