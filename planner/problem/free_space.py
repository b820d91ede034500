"""Search the joint space of an arm among discs on a grid for a path from start to goal.

If joint i turns by an angle a, each point of the links moves by at most a times the length of the
arm from that joint to its tip. So a cell of the grid is free if the clearance at its centre exceeds
this bound for half its width, and blocked if links reach into a disc by more than the bound. All
other cells are mixed and are divided. If blocked cells separate start and goal, this proves that no
motion exists. If free cells connect them, the path through them is a first guess.

Source: Zhu and Latombe, New heuristic algorithms for efficient hierarchical path planning (IEEE
Transactions on Robotics and Automation 7, 1991), for the three kinds of cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.problem.problem import Problem
from planner.support.arrays import Array

FREE, MIXED, BLOCKED = 0, 1, 2

COARSEST, MOST_CELLS = 8, 2**20
"""Cells per joint of the first grid, and all cells of the finest grid: 1024 per joint for two
joints, 64 for three, 32 for four."""

MOST_WAY_CELLS = 2**18
"""Cells of the finest grid on which a path is searched; the shortest path then takes a second."""

TOLERANCE = 1e-6
"""Extra depth for a blocked cell, as a share of the arm's length; larger than the tolerance of
verification."""

WIDEST_RAD = 1.5
"""Angle up to which a path is searched if a joint has no limit."""

MIXED_COST, TOUCHING_COST = 100.0, 10000.0
"""Cost of a step into a mixed cell, and into a cell whose centre lies in a disc; a free cell costs
1. They are finite because start and goal may lie in such cells."""

SAMPLE_SHARE, MOST_SAMPLES = 0.5, 2000
"""Largest motion of the links between two samples of a straight segment, in radii of the smallest
disc; and the maximum number of samples."""


def clearance(problem: Problem, theta: Array) -> Array:
    """Least distance between links and discs less the required one, shape (…), at θ (…, n), m."""
    points = problem.system.arm_points(theta)  # type: ignore[attr-defined]
    every = (disc.clearances(points).min(axis=-1) - disc.clearance for disc in problem.obstacles)
    least = next(every)
    for one in every:
        least = np.minimum(least, one)
    return np.asarray(least)


@lru_cache(maxsize=8)
def is_blocked(problem: Problem) -> bool:
    """Whether discs and joint limits provably separate the goal from the start."""
    if not has_free_space(problem) or not np.isfinite(problem.limits.joint[1:]).all():
        return False
    start = problem.start[1:]
    for grid in _grids(problem):
        goal = grid.goal_cells(problem)
        if grid.connects(start, goal, grid.cells == FREE, corners=False):
            return False
        if not grid.connects(start, goal, grid.cells != BLOCKED, corners=True):
            return True
    return False


def why_blocked(problem: Problem) -> str | None:
    """Describe why no motion exists; None if that is not proven."""
    if not is_blocked(problem):
        return None
    few = len(problem.obstacles) == 1
    return (
        f"no plan of any kind exists: the {'obstacle blocks' if few else 'obstacles block'} every"
        " way from start to goal within the joint limits (a grid of all joint angles proves it)"
    )


def find_way(problem: Problem) -> Array | None:
    """Find a short path from start to goal clear of all discs; corners (M, n) in radians.

    The path ignores the kinematics. None if there is no grid, or no path on it.
    """
    if not has_free_space(problem):
        return None
    *_, grid = (g for g in _grids(problem) if g.cells.size <= MOST_WAY_CELLS)
    return _shorten(problem, grid.shortest(problem, problem.start[1:], problem.likely.goal[1:]))


def has_free_space(problem: Problem) -> bool:
    """Whether the problem has discs, and an arm with few enough joints for a grid."""
    return bool(problem.obstacles) and COARSEST ** (problem.system.size - 1) <= MOST_WAY_CELLS


@dataclass(frozen=True, eq=False)
class Grid:
    """The box of joint angles, divided into equal cells.

    Attributes:
        low: Least angles of the box, shape (n,).
        widths: Widths of a cell, shape (n,).
        cells: FREE, MIXED or BLOCKED, with one axis per joint.
    """

    low: Array
    widths: Array
    cells: NDArray[np.int8]

    def centres(self, index: NDArray[np.int64]) -> Array:
        """Angles at the centres of cells (…, n)."""
        return np.asarray(self.low + (index + 0.5) * self.widths)

    def index(self, theta: Array) -> tuple[int, ...]:
        """Index of the cell that contains angles (n,)."""
        cell = np.floor((theta - self.low) / self.widths).astype(int)
        return tuple(np.clip(cell, 0, np.array(self.cells.shape) - 1).tolist())

    def goal_cells(self, problem: Problem) -> NDArray[np.bool_]:
        """Mask of cells that may contain a goal: several if the goal leaves joints free."""
        goal, tip = problem.goal[1:], problem.tip
        mask = np.zeros(self.cells.shape, dtype=bool)
        index = zip(self.index(np.nan_to_num(goal)), np.isnan(goal), strict=True)
        mask[tuple(slice(None) if free else k for k, free in index)] = True
        if tip is not None:
            where = np.argwhere(mask)
            theta, beyond = self.centres(where), _beyond(problem)
            near = np.ones(len(where), dtype=bool)
            if tip.place is not None:
                places = problem.system.arm_points(theta)[:, -1]  # type: ignore[attr-defined]
                off = np.linalg.norm(places - tip.place, axis=-1)
                near &= off <= float(beyond @ self.widths) / 2
            if tip.angle is not None:
                off = np.abs(np.sum(theta, axis=1) - tip.angle)
                near &= off <= float(np.sum(self.widths)) / 2
            mask[tuple(where.T)] = near
        return mask

    def connects(
        self, start: Array, goal: NDArray[np.bool_], may_pass: NDArray[np.bool_], corners: bool
    ) -> bool:
        """Whether passable cells connect the start with the goal, by faces or also by corners."""
        from scipy import ndimage

        shape = ndimage.generate_binary_structure(may_pass.ndim, may_pass.ndim if corners else 1)
        parts, _ = ndimage.label(may_pass, shape)
        part = parts[self.index(start)]
        return bool(part and (parts[goal] == part).any())

    def shortest(self, problem: Problem, start: Array, goal: Array) -> Array:
        """The cheapest path through the centres of cells that are not blocked, shape (M, n)."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        inside = clearance(problem, self.centres(np.moveaxis(np.indices(self.cells.shape), 0, -1)))
        cost = np.where(self.cells == MIXED, MIXED_COST, 1.0)
        cost[inside <= 0] = TOUCHING_COST
        number = np.arange(self.cells.size).reshape(self.cells.shape)
        edges = []
        for axis, width in enumerate(self.widths):
            before, after = (
                np.take(number, np.arange(k, self.cells.shape[axis] - 1 + k), axis).ravel()
                for k in (0, 1)
            )
            weight = np.maximum(cost.flat[before], cost.flat[after]) * width
            edges.append((before, after, weight))
        rows, columns, weights = (np.concatenate(each) for each in zip(*edges, strict=True))
        graph = csr_array((weights, (rows, columns)), shape=(number.size, number.size))
        first, last = number[self.index(start)], number[self.index(goal)]
        _, origin = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
        way = [last]
        while way[-1] != first:
            way.append(origin[way[-1]])
        places = self.centres(np.stack(np.unravel_index(way[::-1], self.cells.shape), axis=-1))
        return np.vstack([start, places, goal])


def _grids(problem: Problem) -> Iterator[Grid]:
    """Yield finer and finer grids; only the mixed cells of the one before are tested again."""
    ends = np.fmax(np.abs(problem.start[1:]), np.nan_to_num(np.abs(problem.goal[1:])))
    limit = problem.limits.joint[1:]
    limit = np.where(np.isfinite(limit), limit, np.fmax(WIDEST_RAD, ends))
    size = len(limit)
    beyond = _beyond(problem)
    cells = np.full((COARSEST,) * size, MIXED, dtype=np.int8)
    while cells.size <= MOST_CELLS:
        grid = Grid(-limit, 2 * limit / cells.shape[0], cells)
        mixed = np.argwhere(cells == MIXED)
        bound = float(beyond @ grid.widths) / 2
        least = clearance(problem, grid.centres(mixed))
        surely = [least > bound, least < -bound - TOLERANCE * beyond[0]]
        cells[tuple(mixed.T)] = np.select(surely, [FREE, BLOCKED], MIXED)
        yield grid
        for axis in range(size):
            cells = np.repeat(cells, 2, axis)


def _beyond(problem: Problem) -> Array:
    """Length of the arm from each joint to its tip, shape (n,), m."""
    return np.cumsum(problem.system.link_lengths[::-1])[::-1]  # type: ignore[attr-defined]


def _shorten(problem: Problem, way: Array) -> Array:
    """Replace detours of the path by straight segments if these have as much clearance."""
    room, corners, i = clearance(problem, way), [0], 0
    while i < len(way) - 1:
        for j in range(len(way) - 1, i, -1):
            least = min(float(room[i : j + 1].min()), 0.5 * float(room[1:-1].max()))
            if j == i + 1 or clearance_between(problem, way[i], way[j]) >= least:
                break
        corners.append(j)
        i = j
    return np.asarray(way[corners])


def clearance_between(problem: Problem, one: Array, other: Array) -> float:
    """Least clearance on the straight segment between two configurations (n,), by sampling."""
    reach = float(np.abs(other - one) @ _beyond(problem))
    thinnest = min(disc.radius + disc.clearance for disc in problem.obstacles)
    count = 2 + int(min(reach / (SAMPLE_SHARE * thinnest), MOST_SAMPLES))
    return float(clearance(problem, np.linspace(one, other, count)).min())
