"""How a motion stands to waypoints and obstacles, over all time; the judge's own geometry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from planner.problem import Problem
from planner.quadrature import Motion
from planner.systems.base import Array
from planner.workspace import Obstacle

_ROUNDS = 11
"""Rounds that each narrow a dip eight times: to 1e-10 of the distance between samples."""


def passes(problem: Problem, motion: Motion) -> Iterator[tuple[str, float, float, str]]:
    """For each waypoint its label, the distance at which it is passed, when, and the unit.

    A waypoint without a time is passed where the motion comes nearest.
    """
    for point in problem.waypoints:
        fixed = np.flatnonzero(~np.isnan(point.q))
        units = {problem.system.coordinates[i].unit for i in fixed}
        unit = units.pop() if len(units) == 1 else ""
        if point.time_s is None:
            values, times = _least(motion, lambda q, p=point: p.distance(q)[..., None])  # type: ignore[misc]
            value, when = float(values[0]), float(times[0])
        else:
            value, when = float(point.distance(motion.at_time(point.time_s))), point.time_s
        yield point.label, value, when, unit


def clearances(problem: Problem, motion: Motion) -> Iterator[tuple[str, float, float, float]]:
    """For each obstacle and link its label, the least clearance, when, and the disc's radius.

    Of a disc that no link can touch the clearance is that of the stretched arm, at no time less.
    """
    system: Any = problem.system
    near = problem.within_reach().obstacles
    for disc in problem.obstacles:
        if disc not in near:
            least = float(np.hypot(*disc.centre)) - disc.radius - np.sum(system.link_lengths)
            for link in range(len(system.link_lengths)):
                yield disc.label(link + 1), float(least), 0.0, disc.radius
            continue

        def links(q: Array, disc: Obstacle = disc) -> Array:
            return disc.clearances(system.arm_points(q[..., 1:]))

        values, times = _least(motion, links)
        for link, (value, when) in enumerate(zip(values.tolist(), times.tolist(), strict=True)):
            yield disc.label(link + 1), value, when, disc.radius


def _least(motion: Motion, function: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Least values of functions (…, F) of q (…, N) over all time, and when, both (F,).

    They have corners, so dips between samples are narrowed without derivatives, those of all
    functions together; a dip that would have to fall by more than twice its sides is left out.
    """
    grid, q = motion.samples()
    values = function(q)
    walls = np.full((1, *values.shape[1:]), np.inf)
    before, after = np.concatenate([walls, values[:-1]]), np.concatenate([values[1:], walls])
    sides = [np.where(np.isfinite(side), side - values, 0.0) for side in (before, after)]
    lowest = values - 2 * np.maximum(*sides)
    dips = (values <= before) & (values <= after) & (lowest <= np.min(values, axis=(0, 1)))
    sample, cell, which = np.nonzero(dips)
    low, high = grid[np.maximum(sample - 1, 0)], grid[np.minimum(sample + 1, len(grid) - 1)]
    share, row = np.linspace(0.0, 1.0, 17)[:, None], np.arange(len(cell))
    for _ in range(_ROUNDS):
        x = low + (high - low) * share
        found = function(motion.at(cell, x))[:, row, which]
        k = np.argmin(found, axis=0)
        best, at = found[k, row], x[k, row]
        low, high = x[np.maximum(k - 1, 0), row], x[np.minimum(k + 1, 16), row]
    out = np.full(values.shape[-1], np.nan), np.full(values.shape[-1], np.nan)
    for f in range(values.shape[-1]):
        own = np.flatnonzero(which == f)
        if len(own):  # none where the motion is not a number
            k = own[np.argmin(best[own])]
            out[0][f], out[1][f] = best[k], motion.cells.time(cell[k], at[k])
    return out
