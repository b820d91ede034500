"""Bounds on distances of the true motion: of an arm's links from a point, and from waypoints.

The squared distance of a point C from a link that starts at P with direction e and length l is

    |P − C|² + m(a),   a = (P − C)·e,   m(a) = min over t in [0, l] of 2at + t²

where m is 0 for a ≥ 0, −a² for −l ≤ a ≤ 0, and linear below. On a cell within one of these ranges
the distance is a model. On a cell across two of them the concave m is replaced by its chord, and
the cell is halved until the chord is as good as m.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.polynomial.chebyshev import chebval

from planner.plan.curves import Cells, join_cells
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import Trajectory
from planner.problem.requirements.places import Waypoint
from planner.support import deadline
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem, arm_points_expr
from planner.verification.balls import Ball
from planner.verification.enclosure import Enclosure
from planner.verification.functions import Expression
from planner.verification.models import (
    ROUNDING_UNIT,
    Index,
    LeastValue,
    Model,
    halves,
    join_models,
    least_values,
    nodes,
)

MOST_HALVINGS = 10

SEARCH_ROUNDS = 7
"""Number of rounds of `nearest_time`. Each round narrows a dip by a factor of eight, all rounds to
a millionth of the distance between two samples."""

MOST_CELLS = 20_000
"""Number of cells above which halving stops. Most plans need a handful; a motion that passes a disc
a thousand times would need millions."""


def clearances(
    system: TriangularSystem,
    motion: Enclosure,
    centre: Sequence[Ball],
    links: list[int],
    radius: float,
) -> Iterator[LeastValue]:
    """Bound the least distance of each link from a point, minus `radius`, in metres.

    Args:
        system: An arm.
        motion: The enclosed motion.
        centre: x and y of the point, which may move.
        links: Indices of the links, counted from 0.
        radius: Subtracted from each distance, m.
    """
    balls = _links(system)(motion.q, centre)
    lengths = system.link_lengths  # type: ignore[attr-defined]
    values = motion.models(*(balls[3 * link + k] for link in links for k in range(3)))
    for k, link in enumerate(links):
        of_link, length = values[3 * k : 3 * k + 3], float(lengths[link])
        square, cells = _squared_distance(of_link, length, motion.cells)
        (bounds,) = least_values([(1.0, square, 0.0)], cells, np.array([radius**2]))
        both = bounds.guaranteed, bounds.attained
        low, high = (float(np.sqrt(max(x, 0.0)) - radius) if np.isfinite(x) else x for x in both)
        yield LeastValue(low, high, bounds.time_s)


def joints(system: TriangularSystem, motion: Enclosure) -> list[Ball]:
    """Return balls of x and y of an arm's base, joints and tip, in this order."""
    return _points(system)(motion.q)


@lru_cache(maxsize=32)
def _links(system: TriangularSystem) -> Expression:
    """Return |P − C|², a and a² of each link, as at the file's start, as expressions in (q, C)."""
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


@lru_cache(maxsize=32)
def _points(system: TriangularSystem) -> Expression:
    """Return x and y of an arm's base, joints and tip as an expression in q for balls."""
    q, arm = ca.SX.sym("q", system.size), cast("Any", system)
    points = arm_points_expr([q[i] for i in range(1, system.size)], arm.link_lengths)
    return Expression([q], ca.vertcat(*(x for point in points for x in point)))


def _squared_distance(values: list[Model], length: float, cells: Cells) -> tuple[Model, Cells]:
    """Return a lower bound of a link's squared distance from a point as a model, and its cells.

    The bound is tight where the distance may be least.

    Args:
        values: Models of |P − C|², a and a² of a link.
        length: Length of the link, m.
        cells: Cells of `values`.
    """
    proofs: list[tuple[Cells, list[Model]]] = []
    best = np.inf
    for step in range(MOST_HALVINGS + 1):
        deadline.check_stopped()
        square, along, _ = values
        low, high = along.low, along.high
        best = np.fmin(best, np.fmin.reduce(square.high + _least_quadratic(high, length)))
        far = square.low + _least_quadratic(low, length) > best
        one = (low >= 0) | (high <= -length) | ((high <= 0) & (low >= -length))
        last = step == MOST_HALVINGS or len(low) > MOST_CELLS
        settled = one | far | last | ~np.isfinite(along.r)
        proofs.append((cells.select(settled), [x.select(settled) for x in values]))
        if np.all(settled):
            break
        values = [Model(*halves(x.c[~settled], x.r[~settled])) for x in values]
        cells = cells.select(~settled).halves()
    square, along, twice = (join_models([m[k] for _, m in proofs]) for k in range(3))
    return lower_model(square, along, twice, length), join_cells([c for c, _ in proofs])


def lower_model(square: Model, along: Model, twice: Model, length: float) -> Model:
    """Return a model from below of the squared distance of a link from a disc's centre C.

    The squared distance is |P − C|² + m(a), with the joint P, a = (P − C)·e, and the least value m
    of 2at + t² over the link, 0 ≤ t ≤ l. The formula of m depends on the range of a; on cells that
    reach into two ranges, m is replaced by its chord.

    Args:
        square: Model of |P − C|².
        along: Model of a.
        twice: Model of a².
        length: Length l of the link.
    """
    low, high = np.clip(along.low, -1e6, 1e6), np.clip(along.high, -1e6, 1e6)
    behind, beyond, beside = low >= 0, high <= -length, (high <= 0) & (low >= -length)
    at_low, at_high = _least_quadratic(low, length), _least_quadratic(high, length)
    slope = np.divide(at_high - at_low, high - low, out=np.zeros_like(low), where=high > low)
    slope = np.where(behind | beside, 0.0, np.where(beyond, 2 * length, slope))
    level = np.where(behind | beside, 0.0, np.where(beyond, length**2, at_low - slope * low))
    size = np.abs(slope * low) + np.abs(level) + np.abs(at_low) + np.abs(at_high)
    straight = along.scaled(slope) + Model(level[:, None], 16 * ROUNDING_UNIT * size)
    return square + straight + twice.scaled(np.where(beside, -1.0, 0.0))


def _least_quadratic(a: Array, length: float) -> Array:
    t = np.clip(-a, 0.0, length)
    return np.asarray(2 * a * t + t**2)


def user_models(system: TriangularSystem, motion: Enclosure) -> list[Model]:
    """Return models of the user coordinates of an enclosed motion.

    Raises:
        UnboundedError: If the map to user coordinates uses an operation without a bound.
    """
    if not system.has_user_coordinates:
        return motion.states
    return motion.models(*_user(system)(motion.q))


@lru_cache(maxsize=32)
def _user(system: TriangularSystem) -> Expression:
    """Return a system's user coordinates as an expression in q for balls."""
    q = ca.SX.sym("q", system.size)
    return Expression([q], ca.vertcat(*system.user_expr(q)))


def nearest_time(
    cells: Cells, states: Sequence[Model], point: Waypoint, tolerance: float
) -> tuple[float, bool]:
    """Return the time when the motion is nearest to a waypoint, and whether it provably misses it.

    A miss is proven if the distance is above `tolerance` at all times. `states` are models of the
    user coordinates on the cells. The time needs no proof, so samples are used to find it.
    """
    places, fixed = np.array([-1.0, *nodes(), 1.0]), np.flatnonzero(~np.isnan(point.user)).tolist()
    coordinates = [(states[i], float(point.user[i])) for i in fixed]

    def distances(cell: Index, x: Array) -> Array:
        """Return upper bounds of the distance to `point` at places x (R, M) in cells (R,)."""
        values = [chebval(x, p.c[cell].T[..., None], tensor=False) - at for p, at in coordinates]
        doubts = [p.r[cell, None] for p, _ in coordinates]
        return np.asarray(np.max(np.abs(values) + np.array(doubts), axis=0))

    sampled = distances(np.arange(len(cells.piece)), np.tile(places, (len(cells.piece), 1)))
    side = np.pad(sampled, ((0, 0), (1, 1)), constant_values=np.inf)
    cell, place = np.nonzero((sampled <= side[:, :-2]) & (sampled <= side[:, 2:]))
    low, high = places[np.maximum(place - 1, 0)], places[np.minimum(place + 1, len(places) - 1)]
    row = np.arange(len(cell))
    for _ in range(SEARCH_ROUNDS):
        x = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, 17)
        distances_there = distances(cell, x)
        k = np.argmin(distances_there, axis=1)
        low, high = x[row, np.maximum(k - 1, 0)], x[row, np.minimum(k + 1, 16)]
    best = int(np.argmin(distances_there[row, k]))
    time = float(cells.time(cell[best], x[best, k[best]]))
    off = [p - value for p, value in coordinates]
    far = np.max([np.maximum(p.low, -p.high) for p in off], axis=0)
    return time, bool(np.all(far > tolerance))


def distance_bounds(
    cells: Cells, states: Sequence[Model], point: Waypoint, time: float, slip: float
) -> tuple[float, float]:
    """Return a lower and an upper bound of the motion's distance from a waypoint at a given time.

    The time may be wrong by up to `slip`, s. The distance is the largest difference of a fixed user
    coordinate.
    """
    ends = cells.times(np.array([-1.0, 1.0]))
    k = int(np.clip(np.searchsorted(ends[:, 0], time, side="right") - 1, 0, len(ends) - 1))
    tau = 2 * (time - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
    low, high = 0.0, 0.0
    for i in np.flatnonzero(~np.isnan(point.user)).tolist():
        c = states[i].c[k]
        value = abs(chebval(tau, c) - point.user[i])
        doubt = float(states[i].r[k]) + 1e-14 * len(c) ** 2 * float(np.sum(np.abs(c)))
        steepest = float(np.arange(len(c)) ** 2 @ np.abs(c))  # |Tₖ'| ≤ k²
        doubt += 2 * slip / (ends[k, 1] - ends[k, 0]) * steepest
        low, high = max(low, value - doubt), max(high, value + doubt)
    return low, high


def path_time(trajectory: Trajectory, time_s: float) -> tuple[float, float]:
    """Return the path's own time at a time of the plan, and a bound of the error of this time, s.

    The bound is infinite outside the plan, or if the error cannot be bounded.
    """
    if not 0 <= time_s <= trajectory.duration:
        return time_s, np.inf
    if not isinstance(trajectory, RetimedTrajectory):
        return time_s, 0.0
    length, s, sigma = trajectory.length, trajectory.clock(time_s), float(trajectory.sigma(time_s))
    off = 1e-9 * length.x[-1]
    low, high = max(sigma - off, 0.0), min(sigma + off, length.x[-1])
    return sigma, off if length(low) <= s <= length(high) else np.inf
