"""Shared code of all laws of the chained form: timing, refusal, and the plan of a motion.

It also has the first checks of every method that plans in the chart, and their refusals.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.legs import Leg, LegMotion
from planner.methods.refusal import BY_COLLOCATION
from planner.plan.measures import EFFORT, effort, slowing_factor
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory, Trajectory
from planner.problem.problem import Problem
from planner.problem.tables.method_options import LawOptions
from planner.support.arrays import Array
from planner.systems.chained_form import chained_form


@dataclass(frozen=True)
class Ends:
    """Start and goal in chained coordinates, checked once for every travel a law may try.

    Attributes:
        problem: The problem.
        start: z(0), shape (N,).
    """

    problem: Problem
    start: Array
    _goal: Array

    @classmethod
    def of(cls, problem: Problem) -> Ends:
        """The ends of a problem.

        Raises:
            SingularError: See `chart_ends`.
        """
        return cls(problem, *chart_ends(problem, 0.0))

    def goal(self, travel: float) -> Array:
        """z(T), shape (N,), for a travel; only z₁ depends on it."""
        goal = self._goal.copy()
        goal[0] = self.start[0] + travel
        return goal

    @property
    def duration(self) -> float:
        """Duration, s; 1 s if it is free, since the path does not depend on it."""
        return self.problem.duration or 1.0


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
        problem: The problem; a free duration is fitted to the input limits.
        name: The method's name.
        options: The options used.
        trajectory: The motion, over the problem's duration (one second if it is free).
        notes: Notes of the method.
        began: Time at which the method began, by `time.perf_counter`.

    Raises:
        SingularError: If the motion leaves the chart's domain, unless `options.allow_singular`.
    """
    plan = Plan(
        problem=problem,
        method=name,
        options=options.model_dump(),
        trajectory=trajectory,
        objective_name=f"effort: {EFFORT} (not minimised by this method)",
        solve_time_s=time.perf_counter() - began,
        notes=notes,
    )
    if not plan.domain.ok:
        if options.allow_singular:
            return replace(plan, status="singular")
        _refuse_outside(plan)
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
    """Residual and condition of a motion's linear system, for a plan's notes."""
    return {"endpoint_residual": motion.residual, "condition_number": motion.condition}


def chart_ends(problem: Problem, travel: float) -> tuple[Array, Array]:
    """z(0) and z(T), shape (N,) each, of a problem that methods in the chart can solve.

    Raises:
        SingularError: If the start or goal lies on a singularity of the chart, or the goal lies on
            another branch than the start.
    """
    goal = problem.goal.copy()
    goal[0] = problem.start[0] + travel
    for name, q in (("start", problem.start), ("goal", goal)):
        if why := problem.chart.contradiction(name, q, problem.system):
            raise SingularError(f"{problem.source}: {why}", changes=[BY_COLLOCATION])
    form = chained_form(problem.system)
    return form.z(problem.start), form.z(goal)


def fit_duration(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """If the duration is free, scale the time of a path to the fastest within the input limits.

    Raises:
        InputError: If the duration is free and no input has a limit.
    """
    if problem.duration is not None:
        return trajectory
    if not any(required.speed_power for required in problem.requirements):
        raise InputError(
            f"{problem.source}: goal.duration is free but [limits] holds no limit of an input;"
            " set one of them"
        )
    factor = slowing_factor(problem.requirements, trajectory)
    if not np.isfinite(factor):  # outside the domain; the caller refuses it
        return trajectory
    return trajectory.slowed(factor * (1 + 1e-9))


def _refuse_outside(plan: Plan) -> NoReturn:
    """Refuse a plan that leaves the chart's domain.

    Raises:
        SingularError: With the times at which it leaves and re-enters.
    """
    report = plan.domain
    exits = ", ".join(f"{t:.4f}" for t in report.exits_s) or f"{report.time_s:.4f}"
    crossings = ", ".join(f"{t:.4f}" for t in report.z2_crossings_s)
    zero = (
        f"; z2 = 0 at t = {crossings} s"
        if crossings
        else "; z2 keeps its sign, yet no real angle exists there"
    )
    tried = plan.notes.get("auto_motions_tried")
    which = (
        f"the {plan.method} plan" if tried is None else f"the best {plan.method} plan of {tried}"
    )
    travel = plan.problem.travel_key
    point = " or constraint point" if "points" in plan.options else ""
    free = plan.problem.travel is None
    raise SingularError(
        f"{plan.problem.source}: {which} leaves the domain of the chained-form chart"
        f" at t = {exits} s (worst margin {report.margin:.4g} at t = {report.time_s:.4f} s:"
        f" {report.label}){zero}",
        times_s=report.singular_times_s,
        plan=plan,
        advice=None if free else f"another {travel} (or 'free'){point}",
        changes=[BY_COLLOCATION],
    )
