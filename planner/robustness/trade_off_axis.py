"""The quantity that a trade-off curve limits: effort, duration or peak of the inputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from planner.errors import InputError
from planner.methods.collocation.method import plan_collocation
from planner.methods.desensitised.method import plan_desensitised
from planner.methods.judgement import judge_plan
from planner.plan.measures import effort, peak_inputs
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions, DesensitisedOptions
from planner.support.arrays import Array

Kind = Literal["effort", "duration", "peak"]
KINDS: tuple[Kind, ...] = ("effort", "duration", "peak")

CURVE_EFFORT_WEIGHT = 1e-4
"""Largest weight of the effort at a point of the curve, which makes the optimum unique."""

END_EFFORT_WEIGHT = 1e-3
"""Weight of the effort at the costly end, where more effort hardly reduces the response."""

LEAST_FACTOR = 1.02
"""Ratio of a curve's first limit to the least possible limit, which would leave only one plan."""

LONGEST_RATIO = 4.0
"""Ratio of the last duration limit to the least duration, unless the problem's is longer."""


@dataclass(frozen=True, eq=False)
class Axis:
    """The quantity that a trade-off curve limits, and its limits at the m points of the curve.

    Attributes:
        kind: The limited quantity.
        limits: Increasing limits, shape (m,): effort, seconds, or shares of `base` ("peak").
        base: Input limits of which the limits of "peak" are shares, shape (2,).
        least: Plan at the lower end, from which the first point starts.
    """

    kind: Kind
    limits: Array
    base: Array
    least: Plan

    def task_at(
        self, problem: Problem, options: DesensitisedOptions, limit: float
    ) -> tuple[Problem, DesensitisedOptions]:
        """Return the problem and the options for planning the point with this limit."""
        calm = options.model_copy(update={"effort": min(options.effort, CURVE_EFFORT_WEIGHT)})
        if self.kind == "effort":
            return problem, calm.model_copy(update={"effort_limit": limit})
        if self.kind == "duration":
            return problem.changed({"goal.duration": float(limit)}), calm
        return with_input_limits(problem, limit * self.base), calm


def axis(problem: Problem, options: DesensitisedOptions, kind: Kind, points: int) -> Axis:
    """Find the range of a curve's limits, and divide this range into geometric steps.

    Raises:
        InputError: If the duration is free but needed, or a limit on inputs is needed but missing.
        NoPlanError: If the problem has no plan.
    """
    easy = CollocationOptions(rest=options.rest, intervals=options.intervals)
    if kind == "duration":
        return _durations(problem, easy, points)
    if problem.duration is None:
        raise InputError(
            f"{problem.source}: a trade-off against {kind} needs goal.duration in seconds; or trade"
            " against duration"
        )
    least = judge_plan(plan_collocation(problem, easy))[0]  # refuses a problem without a plan
    if kind == "effort":
        low, high = (effort(p.trajectory) for p in (least, _costly_end(problem, options)))
        limits = np.geomspace(LEAST_FACTOR * low, max(high, 1.1 * low), points)
        return Axis(kind, limits, problem.limits.input, least)
    return _peaks(problem, options, easy, points)


def _costly_end(problem: Problem, options: DesensitisedOptions) -> Plan:
    """Return the plan at the end of the curve where the effort hardly counts."""
    calm = options.model_copy(update={"effort": END_EFFORT_WEIGHT})
    return judge_plan(plan_desensitised(problem, calm))[0]


def _durations(problem: Problem, easy: CollocationOptions, points: int) -> Axis:
    quickest = _quickest(problem, easy)
    longest = max(LONGEST_RATIO * quickest.duration, problem.duration or 0.0)
    limits = np.geomspace(LEAST_FACTOR * quickest.duration, longest, points)
    return Axis("duration", limits, problem.limits.input, quickest)


def _quickest(problem: Problem, easy: CollocationOptions) -> Plan:
    if not np.all(np.isfinite(problem.limits.input)):
        raise InputError(
            f"{problem.source}: a trade-off against duration needs limits on both inputs: without"
            " them no path has a least duration, and the response depends only on the path"
        )
    fast = easy.model_copy(update={"objective": "time"})
    return judge_plan(plan_collocation(problem.changed({"goal.duration": "free"}), fast))[0]


def _peaks(
    problem: Problem, options: DesensitisedOptions, easy: CollocationOptions, points: int
) -> Axis:
    """Return the axis of a curve that limits the peaks of the inputs.

    The base of an input is its limit, or without a limit its peak in the plan of `_costly_end`.
    """
    base = problem.limits.input
    if not np.all(np.isfinite(base)):
        peaks = peak_inputs(_costly_end(problem, options).trajectory)
        base = np.where(np.isfinite(base), base, peaks)
    quickest = _quickest(with_input_limits(problem, base), easy)
    assert problem.duration is not None
    lowest = LEAST_FACTOR * quickest.duration / problem.duration  # the systems are driftless
    if lowest >= 1:
        raise InputError(
            f"{problem.source}: goal.duration = {problem.duration:g} s does not allow lower peaks:"
            f" the fastest motion takes {quickest.duration:.4g} s; give more time"
        )
    slow = quickest.trajectory.slowed(problem.duration / quickest.duration)
    guess = replace(quickest, problem=with_input_limits(problem, lowest * base), trajectory=slow)
    return Axis("peak", np.geomspace(lowest, 1.0, points), base, guess)


def with_input_limits(problem: Problem, inputs: Array) -> Problem:
    """Return the problem with other limits on the magnitudes of the inputs."""
    one, other = problem.limits.input_keys
    first, second = map(float, inputs)
    return problem.changed({one: [first, second]} if one == other else {one: first, other: second})
