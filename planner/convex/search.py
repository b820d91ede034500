"""Free travel: a scan of the window, then a bounded search about the best travel.

At each travel the class is convex, but its optimum as a function of the travel need not be: the
scan may miss a dip narrower than its step. The result is the best of the travels tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from planner.convex.cuts import NO_TOUCH, Above, Best, Impossible, Touch
from planner.convex.quadratic import StalledError
from planner.systems.base import Array

Solve = Callable[[float, Touch, float], Best | Impossible | Above]
"""The optimum at one travel: (travel, rows of a neighbour, ceiling as in `cut`)."""


@dataclass(frozen=True)
class Found:
    """What a search over travels finds.

    Attributes:
        best: The best plan found, or None when no travel tried has one.
        refusals: Certificates of the travels that have none.
        tried: Number of travels tried.
        low: Least travel of the scan from which a plan was had or not ruled out; NaN if none.
        high: Greatest such travel.
        bound: What no plan at a travel tried can be below.
    """

    best: Best | None
    refusals: tuple[Impossible, ...]
    tried: int
    low: float
    high: float
    bound: float


def search_one(solve: Solve, travel: float) -> Found:
    """One travel."""
    memory = _Memory(solve)
    memory.at(travel)
    return memory.result()


def search(solve: Solve, travels: Array, prune: bool = True) -> Found:
    """Scan the travels given from the middle outwards, then refine about the best.

    Args:
        solve: The optimum at one travel.
        travels: Increasing.
        prune: Give up at a travel as soon as its bound exceeds the best value so far.
    """
    memory = _Memory(solve)
    for k in np.argsort(np.abs(np.arange(len(travels)) - len(travels) // 2), kind="stable"):
        memory.at(float(travels[k]), prune)
    if memory.best is None and memory.refusals:
        memory.approach()
    if memory.best is not None:
        memory.refine(travels)
    return memory.result()


class _Memory:
    """Calls `solve`, keeps the best and hands each solution's rows to the next."""

    def __init__(self, solve: Solve) -> None:
        self.solve = solve
        self.best: Best | None = None
        self.bound = np.inf
        self.refusals: list[Impossible] = []
        self.kept: list[float] = []
        self.tried = 0
        self._touch = NO_TOUCH

    def at(self, travel: float, prune: bool = False) -> float:
        self.tried += 1
        ceiling = self.best.value if prune and self.best else np.inf
        try:
            answer = self.solve(travel, self._touch, ceiling)
        except StalledError:
            return float(np.inf)
        if isinstance(answer, Impossible):
            self.refusals.append(answer)
            return float(np.inf)
        self.kept.append(travel)
        self.bound = min(self.bound, answer.bound)
        if isinstance(answer, Above):
            return answer.bound
        self._touch = answer.touch
        if self.best is None or answer.value < self.best.value:
            self.best = answer
        return answer.value

    def result(self) -> Found:
        ends = (min(self.kept), max(self.kept)) if self.kept else (np.nan, np.nan)
        return Found(self.best, tuple(self.refusals), self.tried, *ends, self.bound)

    def refine(self, travels: Array) -> None:
        assert self.best is not None
        centre, step = self.best.frame.travel, float(travels[1] - travels[0])
        worse = 1e3 * abs(self.best.value) + 1.0
        step = min(step, 0.999 * abs(centre))  # travel zero is another class
        bounds = (max(centre - step, float(travels[0])), min(centre + step, float(travels[-1])))

        def finite(travel: float) -> float:
            return min(self.at(float(travel)), worse)

        tolerance = {"xatol": 1e-5 * (bounds[1] - bounds[0])}
        minimize_scalar(finite, bounds=bounds, method="bounded", options=tolerance)

    def approach(self) -> None:
        """Between the travels tried, seek one with a plan where the certificates are weakest."""
        self.refusals.sort(key=lambda r: r.frame.travel)
        k = int(np.argmin([r.proof.margin for r in self.refusals]))
        low = self.refusals[max(k - 1, 0)].frame.travel
        high = self.refusals[min(k + 1, len(self.refusals) - 1)].frame.travel

        def margin(travel: float) -> float:
            if np.isfinite(self.at(float(travel))):
                return -1.0
            return self.refusals[-1].proof.margin

        minimize_scalar(margin, bounds=(low, high), method="bounded", options={"maxiter": 24})
