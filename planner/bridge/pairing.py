"""Which motion from the start goes best with which motion to the goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from planner.bridge.piece import slopes
from planner.bridge.walks import Walks
from planner.systems.base import Array, TriangularSystem

NEIGHBOURS = 20
REGULARISATION = 1e-8


@dataclass(frozen=True, eq=False)
class Pair:
    """A motion from the start and one from the goal.

    Attributes:
        forth: Index of the walk from the start.
        back: Index of the walk from the goal.
        cost: Root of the least sum of squared changes of inputs that would close the gap, were
            everything linear.
    """

    forth: int
    back: int
    cost: float


def pairs(
    system: TriangularSystem, forth: Walks, back: Walks, travel: bool, count: int
) -> list[Pair]:
    """The `count` most promising pairs, no walk in two of them.

    The second coordinate is left out, since it can be turned by itself where the two motions meet,
    and the first unless the travel is given.
    """
    rows = [*range(2, system.size), *([0] if travel else [])]
    reach_forth = _reach(system, forth)[:, rows][:, :, rows]
    reach_back = _reach(system, back)[:, rows][:, :, rows]
    here, there = forth.q[-1][:, rows], back.q[-1][:, rows]
    white = _whitened(np.median(reach_forth, axis=0) + np.median(reach_back, axis=0))
    wanted = min(NEIGHBOURS, len(here))
    _, near = KDTree(here @ white).query(there @ white, k=wanted)
    i, j = near.ravel(), np.repeat(np.arange(len(there)), wanted)
    gap = (here[i] - there[j])[..., None]
    both = reach_forth[i] + reach_back[j]
    both = both + REGULARISATION * np.eye(len(rows))
    cost = np.sqrt(np.sum(gap * np.linalg.solve(both, gap), axis=(1, 2)))
    return _disjoint([Pair(int(i[k]), int(j[k]), float(cost[k])) for k in np.argsort(cost)], count)


def _reach(system: TriangularSystem, motion: Walks) -> Array:
    """Gramians Σ Φ B Bᵀ Φᵀ of the walks' ends with respect to their inputs, (M, N, N)."""
    size = system.size
    total = np.zeros((motion.q.shape[1], size, size))
    for q, u in zip(motion.q[:-1], motion.u, strict=True):
        by_q, by_u = slopes(system, q, u)
        total = by_q @ total @ by_q.swapaxes(1, 2) + by_u @ by_u.swapaxes(1, 2)
    return total


def _whitened(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh(gramian)
    return np.asarray(vectors / np.sqrt(np.maximum(values, REGULARISATION * values[-1])))


def _disjoint(ordered: list[Pair], count: int) -> list[Pair]:
    """The first pairs that share no walk, nor (walks are copied when selected) the same cost."""

    def differ(a: Pair, b: Pair) -> bool:
        return a.forth != b.forth and a.back != b.back and abs(a.cost - b.cost) > 1e-9 * b.cost

    kept: list[Pair] = []
    for pair in ordered:
        if all(differ(pair, other) for other in kept):
            kept.append(pair)
        if len(kept) == count:
            break
    return kept
