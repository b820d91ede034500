"""The joint space of an arm among discs: find a way from start to goal, or prove that none exists.

If joint i turns by an angle a, each point of the links moves by at most a times the length of the
arm from that joint to its tip. This bound decides whether a segment between two poses is clear of
all discs: the segment is halved again and again until the clearance in the middle of each part
exceeds the bound.

For the proof the joint space is a grid. A cell is free if the clearance at its centre exceeds the
bound for half its width, and blocked if links reach into a disc by more than the bound. All other
cells are mixed and are divided. If blocked cells separate start and goal, no motion exists. The
same holds for the first links alone, whose fewer joints allow a finer grid.

Sources: Kuffner and LaValle, RRT-Connect (IEEE International Conference on Robotics and Automation,
2000), for the search; Zhu and Latombe, New heuristic algorithms for efficient hierarchical path
planning (IEEE Transactions on Robotics and Automation 7, 1991), for the three kinds of cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, reduce

import numpy as np
from numpy.typing import NDArray

from planner.problem.problem import Problem
from planner.support import deadline
from planner.support.arrays import Array

FREE, MIXED, BLOCKED = 0, 1, 2

COARSEST, MOST_CELLS = 8, 2**20
"""Number of cells per joint of the first grid; and total number of cells of the finest grid: 1024
per joint for two joints, 64 for three, 32 for four. Of more than six links nothing is proven."""

TOLERANCE = 1e-6
"""Extra depth that a cell needs to count as blocked, as a share of the arm's length: the tolerance
of verification."""

WIDEST_RAD = 1.5
"""Angle up to which a path is searched if a joint has no limit."""

STEP_RAD, SHORTCUTS = 0.35, 60
"""Longest step of a tree from one pose to the next, and number of shortcuts that are tried."""

MOST_SAMPLES, FEW_SAMPLES = 5000, 3000
"""Largest number of poses drawn in a search for a way: in the first, which draws twice as many for
three joints and more; and in each further one. Of 100 posts in the way of three joints two leave
only ways so narrow that 5,200 and 9,800 poses were drawn."""

MOST_PARTS = 20_000
"""Largest number of parts of a segment; a segment that needs more counts as touching a disc."""


def clearance(problem: Problem, theta: Array) -> Array:
    """Return the least distance between links and discs minus the required distance, shape (…), m,
    at the angles `theta` (…, k) of all joints or of the first k links alone."""
    points = problem.system.arm_points(theta)  # type: ignore[attr-defined]
    every = (disc.clearances(points).min(axis=-1) - disc.clearance for disc in problem.obstacles)
    return np.asarray(reduce(np.minimum, every))


@lru_cache(maxsize=8)
def blocked_links(problem: Problem) -> int:
    """Return the least number of first links whose way from start to goal discs and joint limits
    provably block; 0 without such a proof."""
    counts = range(1, problem.system.size if problem.obstacles else 1)
    return next((links for links in counts if _are_blocked(problem, links)), 0)


def _are_blocked(problem: Problem, links: int) -> bool:
    # A cell can be blocked only if the bound for half its width is less than a disc's radius.
    widths = 2 * _box(problem)[:links] / MOST_CELLS ** (1 / links)
    hopeless = _beyond(problem, links) @ widths / 2 >= max(d.thickness for d in problem.obstacles)
    if hopeless or not np.isfinite(problem.limits.joint[1 : links + 1]).all():
        return False
    start = problem.start[1 : links + 1]
    for grid in _grids(problem, links):
        goal = grid.goal_cells(problem)
        if grid.connects(start, goal, grid.cells == FREE, corners=False):
            return False
        if not grid.connects(start, goal, grid.cells != BLOCKED, corners=True):
            return True
    return False


def why_blocked(problem: Problem) -> str | None:
    """Describe why no motion exists; None if that is not proven."""
    links = blocked_links(problem)
    if not links:
        return None
    few, whole = len(problem.obstacles) == 1, links == problem.system.size - 1
    of = "" if whole else f" of the first {links} links" if links > 1 else " of the first link"
    return (
        f"no plan of any kind exists: the {'obstacle blocks' if few else 'obstacles block'} every"
        f" way{of} from start to goal within the joint limits (a grid of joint angles proves it)"
    )


def find_way(problem: Problem, seed: int = 0) -> Array | None:
    """Return a short path of joint angles from start to goal that is clear of all discs.

    Two trees of poses grow from start and goal towards poses drawn at random, until they meet. The
    path ignores the kinematics.

    Args:
        problem: The problem.
        seed: Seed of the poses. The first search, with 0, draws most.

    Returns:
        Corners of the path, shape (M, n), radians; None if there are no discs or no path is found.

    Raises:
        TimeUpError: If no time is left.
    """
    if not problem.obstacles:
        return None
    start, goal, rng = problem.start[1:], problem.likely.goal[1:], np.random.default_rng(seed)
    box, trees = _box(problem), (_Tree(problem, start), _Tree(problem, goal))
    for k in range(FEW_SAMPLES if seed else MOST_SAMPLES * min(len(start) - 1, 2)):
        deadline.check()
        tree, other = trees[k % 2], trees[1 - k % 2]
        new = tree.grow(rng.uniform(-box, box))
        while new is not None and (met := other.grow(new)) is not None:
            if met is new:
                way, back = (each.branch() for each in trees)
                return _shorten(problem, [*way, *back[-2::-1]], rng)
    return None


class _Tree:
    """A search tree: poses, and for each the number of the pose from which it was reached."""

    def __init__(self, problem: Problem, root: Array) -> None:
        self._problem, self._origins = problem, [-1]
        self._poses = np.tile(root, (64, 1))

    def grow(self, towards: Array) -> Array | None:
        """Add the pose one step from the nearest pose in the direction of `towards`.

        Returns:
            The new pose: `towards` itself if within one step; None if a disc is in the way.
        """
        count = len(self._origins)
        steps = towards - self._poses[:count]
        k = int(np.argmin(np.linalg.norm(steps, axis=1)))
        here, length = self._poses[k].copy(), float(np.linalg.norm(steps[k]))
        new = towards if length <= STEP_RAD else here + steps[k] * (STEP_RAD / length)
        if not is_clear(self._problem, here, new):
            return None
        if count == len(self._poses):
            self._poses = np.concatenate([self._poses, self._poses])
        self._poses[count] = new
        self._origins.append(k)
        return new

    def branch(self) -> list[Array]:
        """Return the poses on the way from the root to the pose added last."""
        out, k = list[Array](), len(self._origins) - 1
        while k >= 0:
            out.append(self._poses[k])
            k = self._origins[k]
        return out[::-1]


def _shorten(problem: Problem, way: list[Array], rng: np.random.Generator) -> Array:
    """Return a path (M, n) in which clear straight segments replace parts of the path `way`."""
    for _ in range(SHORTCUTS):
        one, other = sorted(rng.integers(len(way), size=2))
        if other - one > 1 and is_clear(problem, way[one], way[other]):
            way = way[: one + 1] + way[other:]
    return np.array(way)


def is_clear(problem: Problem, one: Array, other: Array) -> bool:
    """Return whether links clear all discs on the straight segment between two poses (n,)."""
    beyond, ends = _beyond(problem), np.stack([one, other])[None]
    while len(ends):
        least = clearance(problem, ends.mean(axis=1))
        if np.any(least <= 0) or len(ends) > MOST_PARTS:
            return False
        ends = ends[np.abs(ends[:, 1] - ends[:, 0]) @ beyond / 2 > least]
        middle = ends.mean(axis=1)
        halves = np.stack([ends[:, 0], middle]), np.stack([middle, ends[:, 1]])
        ends = np.concatenate(halves, axis=1).swapaxes(0, 1)
    return True


@dataclass(frozen=True, eq=False)
class JointGrid:
    """Grid of equal cells that divide the box of joint angles.

    Attributes:
        low: Least angles of the box, shape (n,).
        widths: Widths of a cell, shape (n,).
        cells: FREE, MIXED or BLOCKED, with one axis per joint.
    """

    low: Array
    widths: Array
    cells: NDArray[np.int8]

    def centres(self, index: NDArray[np.int64]) -> Array:
        """Return the joint angles at the centres of the cells `index` (…, n)."""
        return np.asarray(self.low + (index + 0.5) * self.widths)

    def index(self, theta: Array) -> tuple[int, ...]:
        """Return the index of the cell that contains angles (n,)."""
        cell = np.floor((theta - self.low) / self.widths).astype(int)
        return tuple(np.clip(cell, 0, np.array(self.cells.shape) - 1).tolist())

    def goal_cells(self, problem: Problem) -> NDArray[np.bool_]:
        """Return whether each cell may contain a goal: true for several cells if the goal leaves
        joints free."""
        links = self.cells.ndim
        goal, tip = problem.goal[1 : links + 1], problem.tip
        mask = np.zeros(self.cells.shape, dtype=bool)
        index = zip(self.index(np.nan_to_num(goal)), np.isnan(goal), strict=True)
        mask[tuple(slice(None) if free else k for k, free in index)] = True
        if tip is not None and links == problem.system.size - 1:
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
        """Return whether a chain of cells that `may_pass` marks leads from start to goal.

        Consecutive cells share a face or, if `corners`, at least a corner.
        """
        from scipy import ndimage

        shape = ndimage.generate_binary_structure(may_pass.ndim, may_pass.ndim if corners else 1)
        parts, _ = ndimage.label(may_pass, shape)
        part = parts[self.index(start)]
        return bool(part and (parts[goal] == part).any())


def _grids(problem: Problem, links: int) -> Iterator[JointGrid]:
    """Yield finer and finer grids for the first links; only the mixed cells of the previous grid
    are tested again."""
    limit, beyond = _box(problem)[:links], _beyond(problem, links)
    cells = np.full((COARSEST,) * links, MIXED, dtype=np.int8)
    while cells.size <= MOST_CELLS:
        grid = JointGrid(-limit, 2 * limit / cells.shape[0], cells)
        mixed = np.argwhere(cells == MIXED)
        bound = float(beyond @ grid.widths) / 2
        least = clearance(problem, grid.centres(mixed))
        surely = [least > bound, least < -bound - TOLERANCE * _beyond(problem)[0]]
        cells[tuple(mixed.T)] = np.select(surely, [FREE, BLOCKED], MIXED)
        yield grid
        for axis in range(links):
            cells = np.repeat(cells, 2, axis)


def _box(problem: Problem) -> Array:
    """Return the largest angle of each joint in the search, shape (n,), rad."""
    ends = np.fmax(np.abs(problem.start[1:]), np.nan_to_num(np.abs(problem.likely.goal[1:])))
    limit = problem.limits.joint[1:]
    return np.where(np.isfinite(limit), limit, np.fmax(WIDEST_RAD, ends))


def _beyond(problem: Problem, links: int | None = None) -> Array:
    """Return the length from each joint to the end of the first `links` links, shape (links,), m;
    by default to the tip."""
    lengths = problem.system.link_lengths[:links]  # type: ignore[attr-defined]
    return np.cumsum(lengths[::-1])[::-1]
