"""Local optima over travels: where to start from, and the search about the best of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from planner.chained import chained_form
from planner.convex.cuts import NO_TOUCH, Best
from planner.convex.frame import Frame
from planner.convex.quadratic import StalledError
from planner.convex.search import Found
from planner.convex.seed import seeds
from planner.convex.successive import Local
from planner.convex.task import Task
from planner.systems.base import Array

STARTS = 3
"""Travels a local optimum is sought at before the search about the best begins."""

HUMPS = np.array([0.0, 1.0, -1.0])
"""First guesses of the shooting that finds a path where the convex domain does not."""


@dataclass(frozen=True)
class Nearby:
    """What a local search finds.

    Attributes:
        frame: Class and travel of the path.
        local: The path; it may not keep everything.
        tried: Number of local optima sought.
    """

    frame: Frame
    local: Local
    tried: int


def local_best(task: Task, found: Found, travels: Array) -> Nearby | None:
    """The best local optimum, over travels too where there is more than one.

    Args:
        task: The problem.
        found: What the convex search found; its best path is a start.
        travels: Travels allowed, increasing; one where the travel is fixed.

    Returns:
        The best of those that keep everything, else the nearest to that; None without a start.
    """
    memory = _Memory(task)
    starts = _starts(task, found, travels)
    for frame, y in starts:
        memory.at(frame, y)
    if memory.best is None or len(travels) == 1:
        return memory.result()
    step = float(travels[1] - travels[0]) if found.best else 0.02 * abs(memory.best[0].travel)
    memory.refine(step, float(travels[0]), float(travels[-1]))
    return memory.result()


class _Memory:
    def __init__(self, task: Task) -> None:
        self.task, self.tried = task, 0
        self.best: tuple[Frame, Local] | None = None
        self.score = np.inf

    def at(self, frame: Frame, y: Array) -> float:
        """Score of the local optimum from y: its value, or beyond all values where it fails."""
        self.tried += 1
        try:
            local = self.task.improve(frame, y)
        except StalledError:
            return float(np.inf)
        score = self.task.value(frame, local) if local.kept else 1e6 * (1 + local.worst)
        if score < self.score:
            self.best, self.score = (frame, local), score
        return score

    def refine(self, step: float, low: float, high: float) -> None:
        assert self.best is not None
        centre = self.best[0].travel

        def score(travel: float) -> float:
            assert self.best is not None
            frame = self.task.frame.at(float(travel))
            return min(self.at(frame, self._start(frame)), 1e7)

        bounds = (max(centre - step, low), min(centre + step, high))
        options = {"maxiter": 12, "xatol": 1e-4 * step}
        minimize_scalar(score, bounds=bounds, method="bounded", options=options)

    def _start(self, frame: Frame) -> Array:
        """The best path so far, carried to another travel, or the convex optimum there."""
        assert self.best is not None
        carried = self.best[1].y
        if np.isfinite(self.task.complaint(frame, carried)):
            return carried
        answer = _optimum(self.task, frame.travel)
        return carried if answer is None else answer.y

    def result(self) -> Nearby | None:
        return None if self.best is None else Nearby(*self.best, self.tried)


def _starts(task: Task, found: Found, travels: Array) -> list[tuple[Frame, Array]]:
    if found.best is None:
        return _seeded(task, travels)
    answers = [found.best]
    if len(travels) > 1:
        spread = np.linspace(found.low, found.high, 9)
        answers += [a for d in spread if (a := _optimum(task, float(d))) is not None]
    answers.sort(key=lambda a: task.complaint(a.frame, a.y))
    inside = [a for a in answers if np.isfinite(task.complaint(a.frame, a.y))]
    return [(a.frame, a.y) for a in inside[:STARTS]] or _seeded(task, travels)


def _optimum(task: Task, travel: float) -> Best | None:
    try:
        answer = task.optimum(travel, NO_TOUCH, np.inf)
    except StalledError:
        return None
    return answer if isinstance(answer, Best) else None


def _seeded(task: Task, travels: Array) -> list[tuple[Frame, Array]]:
    guesses = travels[:: max(1, len(travels) // STARTS)][:STARTS]
    out = []
    for seed in seeds(task.problem, guesses, HUMPS):
        frame = task.frame.at(seed.travel)
        z2 = chained_form(task.problem.system).z(seed.q)[:, 1]
        out.append((frame, frame.y(seed.coefficients(frame.shape, z2))))
    return out
