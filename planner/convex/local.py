"""A local optimum whose limits hold between the samples too: samples are added until they do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.convex.band import Band
from planner.convex.frame import Frame
from planner.convex.judge import Verdict, judge
from planner.convex.look import Samples
from planner.convex.sampled import Sampled
from planner.convex.successive import Aim, Local, Succession
from planner.problem import Limits, Problem
from planner.systems.base import Array

LEVEL_SLACK = 1e-3
"""Fraction by which the least peak input may be exceeded between the samples."""

SHRINK = 1e-5
"""Limits are first lowered by this fraction, to make room for the tolerance at the samples."""

EDGE_SAMPLES = 7
"""First samples a piece where the chart's domain is among the requirements."""

ROUNDS = 10
"""Times that samples may be added, or the limits lowered further (four times each)."""


@dataclass(frozen=True)
class Setting:
    """What every local optimum of one problem shares.

    Attributes:
        problem: Supplies system, branch and limits.
        band: The convex part of the domain.
        margin: Least chart margins where the band is not all of it, shape (m,), else None.
        nearest: The lesser of start's and goal's chart margins, shape (m,).
        duration: Seconds; any where the problem leaves it free, or for the aim "input".
        aim: "smooth", "peak" or "input".
        max_steps: Programmes allowed for one travel.
    """

    problem: Problem
    band: Band
    margin: Array | None
    nearest: Array
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

    @property
    def limits_inputs(self) -> bool:
        """Whether an input has a limit that a path may break."""
        return bool(np.any(np.isfinite(self.limits.input)))

    def sampled(self, frame: Frame, samples: Samples, shrink: float = 0.0) -> Sampled:
        """The nonconvex requirements on paths of a frame, with limits lowered by a fraction."""
        system, branch, limits = self.problem.system, self.problem.branch, self.limits
        lowered = replace(
            limits, input=limits.input * (1 - shrink), joint=limits.joint * (1 - shrink)
        )
        margin = self.margin
        if margin is not None:
            margin = margin + np.minimum(shrink, self.nearest / 4)
        return Sampled(system, branch, lowered, margin, frame, samples, self.duration)

    def judge(self, frame: Frame, y: Array, t: float = 1.0) -> Verdict:
        """The requirements over the whole path; see `judge`."""
        return judge(lambda samples: self.sampled(frame, samples), frame.shape.pieces, y, t)


def improve(
    setting: Setting,
    frame: Frame,
    y: Array,
    value: float,
    warm: Local | None = None,
    rounds: int = ROUNDS,
) -> Local:
    """A local optimum from the path of y.

    Args:
        setting: Requirements and aim.
        frame: The paths.
        y: A path inside the chart's domain.
        value: Scale of the aim: √∫ω² or max |ω| of a typical path; 1 for "input".
        warm: A local optimum of a neighbour, whose multipliers are a start.
        rounds: Times that samples may be added; with 0 only the first ones are kept to.

    Returns:
        The path; `kept` False if the requirements could not be met.

    Raises:
        StalledError: If y lies outside the domain.
    """
    shrink = SHRINK
    samples = Samples.sparse(frame.shape)
    if setting.margin is not None:  # the domain itself is kept at the samples only
        samples = Samples.dense(frame.shape.pieces, EDGE_SAMPLES)
    sampled = setting.sampled(frame, samples, shrink)
    run = Succession(sampled, setting.band, Aim(setting.aim, value), y, warm)
    level = setting.aim == "input"
    found = run.go(setting.max_steps)
    for _ in range(rounds):
        if not found.kept:
            return found
        verdict = setting.judge(frame, found.y, found.t * (1 + LEVEL_SLACK) if level else 1.0)
        found = replace(found, worst=verdict.worst, kept=verdict.worst <= 0)
        if found.kept:
            return found
        if np.isinf(verdict.worst):
            run.y = y  # the new samples are outside along the last path, not along the first
        extra = verdict.breaches
        samples = samples.plus(extra.piece, extra.local)
        if verdict.worst < 10 * shrink:  # more samples alone would gain little
            shrink *= 4
        run.take(setting.sampled(frame, samples, shrink), len(extra.piece))
        found = run.go(setting.max_steps)
    return replace(found, kept=found.kept and rounds == 0)
