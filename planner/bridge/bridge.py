"""Paths from start to goal, one random attempt after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.bridge.closing import Chain, Ends, closed, finer
from planner.bridge.leg import Ground, leg
from planner.bridge.legs import by_legs
from planner.bridge.walks import room
from planner.problem import Problem

DIRECT = 2
"""Attempts in one go before the way is cut into legs."""

HOPELESS = 2.0
"""Cost of the best pair (see `Pair`) from which on no attempt in one go is worth its time."""

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

    First in one go, from start to goal; then leg by leg. Limits on inputs are left to the timing,
    z₂ is not looked at.
    """
    system, space = problem.system, room(problem)
    start, goal, limit = problem.start, problem.target, problem.limits.joint
    iterations = 0
    for number in range(attempts):
        rng = np.random.default_rng((seed, number))
        ground = Ground(system, space, limit, rng)
        if number < DIRECT:
            name, (chain, made) = f"bridge {number + 1}", leg(ground, start, goal, HOPELESS)
        else:
            name, (chain, made) = f"legs {number + 1 - DIRECT}", by_legs(ground, start, goal)
        iterations += made
        if chain is None:
            continue
        cut = finer(system, chain, list(system.limited), TURN)
        fine, made = closed(system, cut, Ends(start, goal, limit))
        iterations += made
        if fine is not None:
            yield Bridge(name, fine, iterations)
