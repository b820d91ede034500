"""Local optima over travels: where to start from, and the search about the best of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

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

FAILED = 1e6
"""Score of a travel where the limits cannot be kept, and more by how much they are broken."""

HUMPS = np.array([0.0, 1.0, -1.0])
"""First guesses of the shooting that finds a path where the convex domain does not."""


@dataclass(frozen=True)
class Nearby:
    """What a local search finds.

    Attributes:
        frame: Class and travel of the path.
        local: The path; it may not keep everything.
        tried: Number of local optima sought.
        eased: Whether, no path being found that keeps the input limits, this is the one of least
            peak input, see `Task.eased` and `Task.level`.
    """

    frame: Frame
    local: Local
    tried: int
    eased: bool = False


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
    for frame, y in _starts(task, found, travels):
        memory.at(frame, y)
    if memory.best is None:
        return None
    eased = None
    if memory.score >= FAILED and task.aim != "input" and task.setting.limits_inputs:
        eased = local_best(task.eased(), found, travels)
    if eased is not None and eased.local.kept:
        if task.eased().level(eased.local) > 1:
            return replace(eased, eased=True)
        memory.at(eased.frame, eased.local.y)
    if memory.score < FAILED and len(travels) > 1:
        step = float(travels[1] - travels[0]) if found.best else 0.01 * abs(memory.travel)
        memory.descend(step, float(travels[0]), float(travels[-1]))
    return memory.result()


class _Memory:
    """Local optima at the first samples only; the best is then made to keep them everywhere."""

    def __init__(self, task: Task) -> None:
        self.task, self.tried = task, 0
        self.best: tuple[Frame, Local] | None = None
        self.score = np.inf

    @property
    def travel(self) -> float:
        """Of the best so far."""
        assert self.best is not None
        return self.best[0].travel

    def at(self, frame: Frame, y: Array) -> float:
        """Score of the local optimum from y: its value, or beyond all values where it fails."""
        self.tried += 1
        warm = self.best[1] if self.best is not None and self.best[1].kept else None
        try:
            local = self.task.improve(frame, y, warm, rounds=0)
        except StalledError:
            return FAILED
        score = self.task.value(frame, local) if local.kept else FAILED * (1 + local.worst)
        if score < self.score:
            self.best, self.score = (frame, local), score
        return score

    def descend(self, step: float, low: float, high: float) -> None:
        """Walk downhill by steps, then search the bracket."""

        def score(travel: float) -> float:
            frame = self.task.frame.at(float(travel))
            return self.at(frame, self._start(frame))

        for side in (step, -step):
            while low <= self.travel + side <= high:
                before = self.score
                if score(self.travel + side) >= before:
                    break
        bounds = (max(self.travel - step, low), min(self.travel + step, high))
        options = {"maxiter": 10, "xatol": 1e-3 * step}
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
        """The best path, its limits now kept between the samples too."""
        assert self.best is not None
        frame, local = self.best
        if local.kept:
            local = self.task.improve(frame, local.y, local)
        return Nearby(frame, local, self.tried)


def _starts(task: Task, found: Found, travels: Array) -> list[tuple[Frame, Array]]:
    if found.best is None:
        return _seeded(task, travels)
    answers = [found.best]
    if len(travels) > 1:
        spread = np.linspace(found.low, found.high, 9)
        answers += [a for d in spread if (a := _optimum(task, float(d))) is not None]
    judged = [(task.complaint(a.frame, a.y), k) for k, a in enumerate(answers)]
    inside = [k for worst, k in sorted(judged) if np.isfinite(worst)][:STARTS]
    return [(answers[k].frame, answers[k].y) for k in inside] or _seeded(task, travels)


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
