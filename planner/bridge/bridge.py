"""Paths from start to goal, one random attempt after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.bridge.closing import Chain, Ends, closed, finer
from planner.bridge.pairing import Pair, pairs
from planner.bridge.walks import Room, Walks, room, walks
from planner.problem import Problem
from planner.systems.base import Array

WALKS = 400
PIECES = 60
PAIRS = 3
"""Pairs tried of one set of walks."""

TURN = 0.6
"""Most that a limited coordinate turns in a piece of the answer, rad."""


@dataclass(frozen=True, eq=False)
class Bridge:
    """A path that obeys the kinematics to the accuracy of coarse Runge-Kutta steps.

    Attributes:
        q: Coordinates between its K pieces, shape (K+1, N).
        u: Integrals of the inputs over each piece, shape (K, 2).
        iterations: Iterations of the solver up to here, failed attempts included.
        attempt: Which attempt it was, from 1.
    """

    q: Array
    u: Array
    iterations: int
    attempt: int


def bridges(problem: Problem, attempts: int, seed: int = 0) -> Iterator[Bridge]:
    """Paths within the joint limits, as they are found in `attempts` attempts.

    Limits on inputs are left to the timing, z₂ is not looked at.
    """
    space = room(problem)
    ends = Ends(problem.start, problem.target, problem.limits.joint)
    iterations = 0
    for number in range(attempts):
        if number % PAIRS == 0:
            rng = np.random.default_rng((seed, number))
            forth, back, chosen = _met(problem, space, rng)
        chain, made = _closed(problem, _joined(forth, back, chosen[number % PAIRS]), ends)
        iterations += made
        if chain is not None:
            yield Bridge(chain.q, chain.u, iterations, number + 1)


def _closed(problem: Problem, chain: Chain, ends: Ends) -> tuple[Chain | None, int]:
    """Closed on long pieces first, then on short ones."""
    coarse, made = closed(problem.system, chain, ends)
    if coarse is None:
        return None, made
    fine, more = closed(
        problem.system, finer(problem.system, coarse, list(problem.system.limited), TURN), ends
    )
    return fine, made + more


def _met(
    problem: Problem, space: Room, rng: np.random.Generator
) -> tuple[Walks, Walks, list[Pair]]:
    system = problem.system
    goal = np.nan_to_num(problem.target)
    forth = walks(system, problem.start, space, WALKS, PIECES, rng)
    back = walks(system, goal, space, WALKS, PIECES, rng)
    return forth, back, pairs(system, forth, back, problem.travel is not None, PAIRS)


def _joined(forth: Walks, back: Walks, pair: Pair) -> Chain:
    """Forth, then the second coordinate turned alone, then the other way back."""
    first, last = forth.q[:, pair.forth], back.q[::-1, pair.back].copy()
    turn = np.array([[0.0, last[0, 1] - first[-1, 1]]])
    u = np.concatenate([forth.u[:, pair.forth], turn, -back.u[::-1, pair.back]])
    gap = np.zeros((len(u), first.shape[1]))
    gap[len(forth.u)] = last[0] - first[-1]
    gap[:, 1] = 0.0
    return Chain(np.concatenate([first, last]), u, gap)
