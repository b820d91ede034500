"""Free travel: a scan of the window, then a bounded search about the best travel.

At each travel the class is convex, but its optimum as a function of the travel need not be: the
scan may miss a dip narrower than its step. The result is the best of the travels tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

from planner.methods.convex.global_optimum import NO_TOUCH, Above, Best, Impossible, Touch
from planner.methods.convex.programme import StalledError
from planner.support.arrays import Array

Solve = Callable[[float, Touch, float], Best | Impossible | Above]
"""The optimum at one travel: (travel, rows of a neighbour, ceiling as in `cut`)."""


@dataclass
class Found:
    """What a search over travels finds.

    Attributes:
        best: The best plan found, or None when no travel tried has one.
        refusals: Certificates of the travels that have none.
        tried: Number of travels tried.
        kept: Travels from which a plan was had or not ruled out.
    """

    best: Best | None = None
    refusals: list[Impossible] = field(default_factory=list)
    tried: int = 0
    kept: list[float] = field(default_factory=list)

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest of the travels kept; NaN if there are none."""
        return (min(self.kept), max(self.kept)) if self.kept else (np.nan, np.nan)


def search(solve: Solve, travels: Array, prune: bool = True) -> Found:
    """Scan the travels given from the middle outwards, then refine about the best.

    Args:
        solve: The optimum at one travel.
        travels: Increasing; a single one is all that is tried.
        prune: Give up at a travel as soon as its bound exceeds the best value so far.
    """
    found, touch = Found(), NO_TOUCH

    def at(travel: float, prune: bool = False) -> float:
        nonlocal touch
        found.tried += 1
        ceiling = found.best.value if prune and found.best else np.inf
        try:
            answer = solve(float(travel), touch, ceiling)
        except StalledError:
            return float(np.inf)
        if isinstance(answer, Impossible):
            found.refusals.append(answer)
            return float(np.inf)
        found.kept.append(float(travel))
        if isinstance(answer, Above):
            return answer.bound
        touch = answer.touch
        if found.best is None or answer.value < found.best.value:
            found.best = answer
        return answer.value

    for k in np.argsort(np.abs(np.arange(len(travels)) - len(travels) // 2), kind="stable"):
        at(travels[k], prune)
    if len(travels) > 1 and found.best is None and found.refusals:
        _approach(at, found)
    if len(travels) > 1 and found.best is not None:
        _refine(at, found.best, travels)
    return found


def _refine(at: Callable[[float], float], best: Best, travels: Array) -> None:
    centre = best.frame.travel
    worse = 1e3 * abs(best.value) + 1.0
    step = min(float(travels[1] - travels[0]), 0.999 * abs(centre))  # zero is another class
    bounds = (max(centre - step, float(travels[0])), min(centre + step, float(travels[-1])))
    tolerance = {"xatol": 1e-5 * (bounds[1] - bounds[0])}
    minimize_scalar(lambda d: min(at(d), worse), bounds=bounds, method="bounded", options=tolerance)


def _approach(at: Callable[[float], float], found: Found) -> None:
    """Between the travels tried, seek one with a plan where the certificates are weakest."""
    found.refusals.sort(key=lambda r: r.frame.travel)
    k = int(np.argmin([r.proof.margin for r in found.refusals]))
    ends = (found.refusals[max(k - 1, 0)], found.refusals[min(k + 1, len(found.refusals) - 1)])

    def margin(travel: float) -> float:
        return -1.0 if np.isfinite(at(travel)) else found.refusals[-1].proof.margin

    bounds = (ends[0].frame.travel, ends[1].frame.travel)
    minimize_scalar(margin, bounds=bounds, method="bounded", options={"maxiter": 24})
