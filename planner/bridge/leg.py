"""One leg: random motions from both its ends, and the gap between two of them closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.bridge.closing import Chain, Ends, closed
from planner.bridge.pairing import Pair, pairs
from planner.bridge.walks import Room, Walks, walks
from planner.systems.base import Array, TriangularSystem

WALKS = 400
PIECES = 60
PAIRS = 2
"""Pairs tried of one set of walks."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Where legs are made.

    Attributes:
        system: What moves.
        space: Where walks may go.
        limit: Largest |q|, shape (N,).
        rng: Of the walks.
    """

    system: TriangularSystem
    space: Room
    limit: Array
    rng: np.random.Generator


def leg(ground: Ground, start: Array, goal: Array, affordable: float) -> tuple[Chain | None, int]:
    """A path on long pieces, or None; and iterations made.

    Args:
        ground: Where.
        start: Shape (N,).
        goal: Shape (N,); the first coordinate may be NaN: free.
        affordable: Largest cost of a pair that is tried.
    """
    free = bool(np.isnan(goal[0]))
    forth = walks(ground.system, start, ground.space, WALKS, PIECES, ground.rng)
    back = walks(ground.system, np.nan_to_num(goal), ground.space, WALKS, PIECES, ground.rng)
    iterations = 0
    for pair in pairs(ground.system, forth, back, not free, PAIRS):
        if pair.cost > affordable:
            break
        ends = Ends(start, goal, ground.limit)
        chain, made = closed(ground.system, _joined(forth, back, pair), ends)
        iterations += made
        if chain is not None:
            return chain, iterations
    return None, iterations


def _joined(forth: Walks, back: Walks, pair: Pair) -> Chain:
    """Forth, then the second coordinate turned alone, then the other way back."""
    first, last = forth.q[:, pair.forth], back.q[::-1, pair.back].copy()
    turn = np.array([[0.0, last[0, 1] - first[-1, 1]]])
    u = np.concatenate([forth.u[:, pair.forth], turn, -back.u[::-1, pair.back]])
    gap = np.zeros((len(u), first.shape[1]))
    gap[len(forth.u)] = last[0] - first[-1]
    gap[:, 1] = 0.0
    return Chain(np.concatenate([first, last]), u, gap)
