"""Paths from start to goal: random motions from both, and the gap between two of them closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.bridge.closing import Chain, Ends, closed, finer
from planner.bridge.pairing import Pair, pairs
from planner.bridge.walks import Room, Walks, room, walks
from planner.problem import Problem
from planner.systems.base import TriangularSystem

WALKS = 400
PIECES = 60
PAIRS = 2
"""Pairs tried of one set of walks."""

HOPELESS = 2.0
"""Cost of a pair (see `Pair`) from which on it is not worth its time."""

TURN = 0.6
"""Most that a limited coordinate turns in a piece of the answer, rad."""


@dataclass(frozen=True, eq=False)
class Bridge:
    """A path that obeys the kinematics to the accuracy of coarse Runge-Kutta steps.

    Attributes:
        name: For reports.
        chain: Its pieces, without gaps.
        iterations: Iterations of the solver up to here, failed attempts included.
    """

    name: str
    chain: Chain
    iterations: int


def bridges(problem: Problem, attempts: int, seed: int = 0) -> Iterator[Bridge]:
    """Paths within the joint limits, as they are found in `attempts` attempts.

    Limits on inputs are left to the timing, z₂ is not looked at.
    """
    system, space, ends = problem.system, room(problem), Ends.of(problem)
    iterations = 0
    for number in range(attempts):
        chain, made = _long_pieces(system, space, ends, np.random.default_rng((seed, number)))
        iterations += made
        if chain is None:
            continue
        fine, made = closed(system, finer(system, chain, list(system.limited), TURN), ends)
        iterations += made
        if fine is not None:
            yield Bridge(f"bridge {number + 1}", fine, iterations)


def _long_pieces(
    system: TriangularSystem, space: Room, ends: Ends, rng: np.random.Generator
) -> tuple[Chain | None, int]:
    """A path of one set of walks, or None; and iterations made."""
    forth = walks(system, ends.start, space, WALKS, PIECES, rng)
    back = walks(system, np.nan_to_num(ends.goal), space, WALKS, PIECES, rng)
    iterations = 0
    for pair in pairs(system, forth, back, not np.isnan(ends.goal[0]), PAIRS):
        if pair.cost > HOPELESS:
            break
        chain, made = closed(system, _joined(forth, back, pair), ends)
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
