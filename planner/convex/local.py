"""A local optimum whose limits hold between the samples too: samples are added until they do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.convex.band import Band
from planner.convex.frame import Frame
from planner.convex.look import Samples
from planner.convex.sampled import Sampled
from planner.convex.successive import Aim, Local, Succession
from planner.problem import Limits, Problem
from planner.systems.base import Array

DENSE = 33
"""Samples a piece of the final check."""

SHRINK = 1e-5
"""Limits are first lowered by this fraction, to make room for the tolerance at the samples."""

ROUNDS = 5
"""Times that samples may be added and the limits lowered further (four times each)."""


@dataclass(frozen=True)
class Setting:
    """What every local optimum of one problem shares.

    Attributes:
        problem: Supplies system, branch and limits.
        band: The convex part of the domain.
        margin: Least chart margins where the band is not all of it, shape (M,), else None.
        duration: Seconds; any where the problem leaves it free, and then inputs have no limit.
        aim: "smooth", "peak" or "input".
        max_steps: Programmes allowed for one travel.
    """

    problem: Problem
    band: Band
    margin: Array | None
    duration: float
    aim: str
    max_steps: int

    @property
    def limits(self) -> Limits:
        """The problem's; none of inputs when the duration is free and no level is sought."""
        limits = self.problem.limits
        if self.aim == "input":
            wide = np.all(np.isinf(limits.input))
            return replace(limits, input=np.array([np.inf, 1.0])) if wide else limits
        if self.problem.duration is None:
            return replace(limits, input=np.full(2, np.inf))
        return limits

    def sampled(self, frame: Frame, samples: Samples, shrink: float = 0.0) -> Sampled:
        """The nonconvex requirements on paths of a frame, with limits lowered by a fraction."""
        system, branch, limits = self.problem.system, self.problem.branch, self.limits
        lowered = replace(
            limits, input=limits.input * (1 - shrink), joint=limits.joint * (1 - shrink)
        )
        return Sampled(system, branch, lowered, self.margin, frame, samples, self.duration)

    def judge(self, frame: Frame) -> Sampled:
        """The requirements finely sampled."""
        return self.sampled(frame, Samples.even(frame.shape.pieces, DENSE))


def improve(setting: Setting, frame: Frame, y: Array, value: float) -> Local:
    """A local optimum from the path of y.

    Args:
        setting: Requirements and aim.
        frame: The paths.
        y: A path inside the chart's domain.
        value: Scale of the aim: √∫ω² or max |ω| of a typical path; 1 for "input".

    Returns:
        The path; `kept` False if the requirements could not be met.

    Raises:
        StalledError: If y lies outside the domain.
    """
    shrink, judge = SHRINK, setting.judge(frame)
    samples = Samples.even(frame.shape.pieces)
    sampled = setting.sampled(frame, samples, shrink)
    run = Succession(sampled, setting.band, Aim(setting.aim, value), y)
    found = run.go(setting.max_steps)
    for _ in range(ROUNDS):
        if not found.kept:
            return found
        level = found.t * (1 + 1e-3) if setting.aim == "input" else 1.0
        h = judge.values(found.y, level)
        worst = np.inf if h is None else float(h.max(initial=-1.0))
        found = replace(found, worst=worst, kept=worst <= 0)
        if found.kept or h is None:
            return found
        extra = _worst_samples(judge.samples, h, frame.shape.pieces)
        samples, shrink = samples.plus(extra.piece, extra.local), 4 * shrink
        run.take(setting.sampled(frame, samples, shrink), len(extra.piece))
        found = run.go(setting.max_steps)
    return replace(found, kept=False)


def _worst_samples(samples: Samples, h: Array, pieces: int) -> Samples:
    """The worst sample of every piece that breaks a requirement."""
    worst = h.reshape(-1, len(samples.piece)).max(axis=0).reshape(pieces, -1)
    piece = np.flatnonzero(worst.max(axis=1) > 0)
    local = samples.local.reshape(pieces, -1)[piece, np.argmax(worst[piece], axis=1)]
    return Samples(piece, local)
