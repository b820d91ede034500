"""What all laws of the chained form share once their motion is made: timing, refusal, the Plan."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.measures import effort
from planner.methods.chart import chart_ends, fit_duration, refuse_outside
from planner.methods.legs import Leg, LegMotion
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import LawOptions
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory


@dataclass(frozen=True)
class Ends:
    """Start and goal in chained coordinates, checked once for every travel a law may try.

    Attributes:
        problem: Whose they are.
        start: z(0), shape (N,).
    """

    problem: Problem
    start: Array
    _goal: Array

    @classmethod
    def of(cls, problem: Problem) -> Ends:
        """The ends of a problem.

        Raises:
            SingularError: As `chart_ends`.
        """
        return cls(problem, *chart_ends(problem, 0.0))

    def goal(self, travel: float) -> Array:
        """z(T), shape (N,): no other chained coordinate depends on q₁."""
        goal = self._goal.copy()
        goal[0] = self.start[0] + travel
        return goal

    @property
    def duration(self) -> float:
        """Seconds; one where the problem leaves it free, since the path does not depend on it."""
        return self.problem.duration or 1.0

    def offset(self, given: float | None, method: str) -> float:
        """Travel of the first of the two legs of step 4: the given one, or the mean of z(0).

        The paper writes offset = Σzᵢ/n; z has n+1 coordinates, over which the mean is taken here.

        Raises:
            InputError: If it is zero.
        """
        chosen = float(np.mean(self.start)) if given is None else given
        if chosen == 0:
            raise InputError(
                f"{self.problem.source}: the two-leg rule needs an offset that is not zero; set"
                f" method.{method}.offset (radians)"
            )
        return chosen


def finish(
    problem: Problem,
    name: str,
    options: LawOptions,
    trajectory: ChainedTrajectory,
    notes: Mapping[str, Any],
    began: float,
) -> Plan:
    """The plan of a law's motion.

    Args:
        problem: What it solves; a free duration is fitted to the input limits.
        name: The method's name.
        options: As used.
        trajectory: The motion, over the problem's duration (one second where that is free).
        notes: Facts of the method.
        began: When the method began, by `time.perf_counter`.

    Raises:
        SingularError: If the motion leaves the chart's domain, unless `options.allow_singular`.
    """
    plan = Plan(
        problem=problem,
        method=name,
        options=options.model_dump(),
        trajectory=trajectory,
        objective_name="effort: integral of u1^2 + u2^2 dt (not minimised by this law)",
        solve_time_s=time.perf_counter() - began,
        notes=notes,
    )
    if not plan.domain.ok:
        if options.allow_singular:
            return replace(plan, status="singular")
        refuse_outside(plan)
    fitted = fit_duration(problem, trajectory)
    return replace(plan, trajectory=fitted, objective=effort(fitted))


def even_legs(duration: float, travel: float, offset: float, count: int, terms: int) -> list[Leg]:
    """`count` equal legs over the travel; with travel zero, `count` out by offset and back."""
    if travel != 0:
        return [Leg(duration / count, travel / count, terms)] * count
    out = Leg(duration / 2 / count, offset / count, terms)
    back = Leg(duration / 2 / count, -offset / count, terms)
    return [out] * count + [back] * count


def trajectory_of(problem: Problem, motion: LegMotion) -> ChainedTrajectory:
    """The trajectory of a motion made of legs."""
    return ChainedTrajectory(problem.system, motion.z, motion.v, problem.branch)


def summary(motion: LegMotion) -> dict[str, float]:
    """How well a motion's linear system was solved, for a plan's notes."""
    return {"endpoint_residual": motion.residual, "condition_number": motion.condition}
