"""Random motions that keep the limits: many at once, in pieces of constant input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.bridge.piece import ends
from planner.problem import Problem
from planner.systems.base import Array, TriangularSystem

LARGEST_ANGLE = 1.4
"""Taken for the limit of an angle that has none, rad."""

SHORTEST, LONGEST = 0.35, 1.4
"""Length of a piece: how far the fastest coordinate would turn in it, rad."""

LONGEST_RUN = 12
"""Most pieces that the path coordinate runs one way."""

SELECTED_EVERY = 12
"""Pieces after which the half of the walks that is nearer to a limit gives way to the other half:
without it, a start in a corner is left by very few, and the two ends' walks hardly come close."""

_RETREATS = ((1.0, 1.0), (1.0, 0.3), (-1.0, 1.0), (-1.0, 0.3), (0.0, 0.0))
"""What is tried for the first input, as direction and share, until the limits are kept."""


@dataclass(frozen=True, eq=False)
class Walks:
    """M motions from one place.

    Attributes:
        q: Coordinates between the P pieces, shape (P+1, M, N).
        u: Integrals of the inputs over each piece, shape (P, M, 2).
    """

    q: Array
    u: Array


@dataclass(frozen=True, eq=False)
class Room:
    """Where walks may go, and in what steps.

    Attributes:
        limit: Largest |q|, shape (N,).
        unit: Integrals of both inputs in which the fastest coordinate turns by about one rad, (2,).
    """

    limit: Array
    unit: Array


def room(problem: Problem) -> Room:
    """The room of a problem; a little less than its limits, so that the paths keep some slack."""
    system = problem.system
    limit = np.full(system.size, np.inf)
    for i in system.limited:
        own = problem.limits.joint[i]
        angle = system.coordinates[i].unit == "rad"
        limit[i] = 0.99 * own if np.isfinite(own) else (LARGEST_ANGLE if angle else np.inf)
    given = problem.limits.input
    box = given / np.max(given) if np.all(np.isfinite(given)) else np.ones(2)
    return Room(limit, box / _pace(system, limit, box))


def walks(
    system: TriangularSystem,
    start: Array,
    space: Room,
    count: int,
    pieces: int,
    rng: np.random.Generator,
) -> Walks:
    """Random motions from `start` (N,): runs of the path coordinate one way and the other, while
    the driven coordinate heads for one random place after the other.
    """
    limit = np.maximum(space.limit, np.abs(start) + 1e-6)
    far = np.where(np.isfinite(limit[1]), limit[1], 1.0)
    length = np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST), count))[:, None] * space.unit
    way, left = rng.choice([-1.0, 1.0], count), rng.integers(1, LONGEST_RUN, count)
    target = rng.uniform(-far, far, count)
    q, u = np.empty((pieces + 1, count, system.size)), np.empty((pieces, count, 2))
    q[0] = start
    for k in range(pieces):
        over = left <= 0
        way, left = np.where(over, -way, way), np.where(over, _runs(rng, count), left)
        goes_on = rng.random(count) < 0.7
        target = np.where(goes_on, target, np.clip(rng.uniform(-1.15, 1.15, count), -1, 1) * far)
        second = np.clip(target - q[k, :, 1], -length[:, 1], length[:, 1])
        u[k], q[k + 1], sign = _kept(system, q[k], way * length[:, 0], second, limit)
        turned = sign < 0
        way, left = np.where(turned, -way, way), np.where(turned, _runs(rng, count), left) - 1
        if (k + 1) % SELECTED_EVERY == 0:
            best = np.resize(np.argsort(-_clearance(q[k + 1], limit))[: count // 2], count)
            q[: k + 2], u[: k + 1] = q[: k + 2, best], u[: k + 1, best]
            length, way, left, target = length[best], way[best], left[best], target[best]
    return Walks(q, u)


def _clearance(q: Array, limit: Array) -> Array:
    """How far the coordinates after the second are from their limits, as a sum of logarithms."""
    near = np.where(np.isfinite(limit), q / limit, 0.0)[:, 2:]
    return np.asarray(np.sum(np.log(np.maximum(1 - near**2, 1e-6)), axis=1))


def _runs(rng: np.random.Generator, count: int) -> NDArray[np.int64]:
    return rng.integers(1, LONGEST_RUN, count)


def _kept(
    system: TriangularSystem, q: Array, first: Array, second: Array, limit: Array
) -> tuple[Array, Array, Array]:
    """A piece for each walk that keeps the limits: its inputs, its end, the sign of its way."""
    u, end, sign = np.empty((len(q), 2)), q.copy(), np.zeros(len(q))
    open_ = np.ones(len(q), dtype=bool)
    for direction, share in _RETREATS:
        tried = np.stack([direction * share * first, second], axis=-1)
        reached = ends(system, q, tried)
        ok = np.all(np.abs(reached) <= limit, axis=1) | (direction == 0)
        take = open_ & ok
        u[take], end[take], sign[take] = tried[take], reached[take], direction
        open_ &= ~take
        if not np.any(open_):
            break
    return u, end, sign


def _pace(system: TriangularSystem, limit: Array, box: Array) -> float:
    """Typical rate of the fastest coordinate after the second, under the whole first input."""
    bound = np.where(np.isfinite(limit), limit, 0.0)
    q = np.random.default_rng(0).uniform(-bound / 2, bound / 2, (200, system.size))
    u = np.broadcast_to([box[0], 0.0], (len(q), 2))
    rates = np.abs(system.rates(q, u))[:, 2:]
    return float(np.median(np.max(rates, axis=1)))
