"""The paper's polynomial law (section 4.2, eqs 25–28), for any n and any constraint points."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from planner.errors import InputError, SingularError
from planner.measures import effort
from planner.methods.chart import chart_ends, fit_duration, refuse_outside
from planner.methods.legs import Leg, LegMotion, Point, steer
from planner.methods.travel import Choice, choose_travel
from planner.plan import Plan
from planner.problem import Problem
from planner.schema import PolynomialOptions
from planner.trajectory import ChainedTrajectory

NAME = "polynomial"


def plan_polynomial(problem: Problem, options: PolynomialOptions) -> Plan:
    """Steer with v₁ constant and v₂ a polynomial, through the given constraint points.

    With travel zero the motion has two legs (step 4 of the paper). The paper does not say which
    z₂ … z_N to pass at the turn; the one that makes ∫v₂² least is taken.

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times.
        InfeasibleError: If the travel is free and no one-way motion exists.
        InputError: If a constraint point lies outside the motion or contradicts another.
    """
    began = time.perf_counter()
    points = _points(problem, options)
    choice = _travel(problem, options, points)
    motion = _motion(problem, options, points, choice.travel)
    trajectory = fit_duration(problem, _trajectory(problem, motion))
    plan = Plan(
        problem=problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=trajectory,
        objective_name="effort: integral of u1^2 + u2^2 dt (not minimised by this law)",
        solve_time_s=time.perf_counter() - began,
        notes={
            "travel_ranges_in_domain": [list(r) for r in choice.ranges],
            "endpoint_residual": motion.residual,
            "condition_number": motion.condition,
        },
    )
    if options.allow_singular and not plan.domain.ok:
        return replace(plan, status="singular")
    refuse_outside(plan)
    return replace(plan, objective=effort(trajectory))


def _points(problem: Problem, options: PolynomialOptions) -> list[Point]:
    points = [Point(*p) for p in options.points]
    if points and problem.duration is None:
        raise InputError(
            f"{problem.source}: method.polynomial.points are times in seconds and need a fixed"
            " goal.duration"
        )
    for p in points:
        if not 0 < p.time_s < (problem.duration or np.inf):
            raise InputError(
                f"{problem.source}: method.polynomial.points: time {p.time_s:g} s is not inside the"
                f" motion (0, {problem.duration:g}) s"
            )
    if len({p.time_s for p in points}) < len(points):
        raise InputError(f"{problem.source}: method.polynomial.points: two points at one time")
    return points


def _travel(problem: Problem, options: PolynomialOptions, points: list[Point]) -> Choice:
    if problem.travel is not None:
        return Choice(problem.travel, ())
    chart_ends(problem, 0.0)  # refuse a start or goal off the chart before the scan does

    def make(travel: float) -> ChainedTrajectory:
        return _trajectory(problem, _motion(problem, options, points, travel))

    return choose_travel(problem, make, options.travel)


def _motion(
    problem: Problem, options: PolynomialOptions, points: list[Point], travel: float
) -> LegMotion:
    start, goal = chart_ends(problem, travel)
    duration = problem.duration or 1.0
    terms = len(start) - 1 + len(points)
    legs = [Leg(duration, travel, terms)]
    if travel == 0:
        offset = float(np.mean(start)) if options.offset is None else options.offset
        if offset == 0:
            raise InputError(
                f"{problem.source}: the two-leg rule needs an offset that is not zero; set"
                " method.polynomial.offset (radians)"
            )
        legs = [Leg(duration / 2, offset, terms), Leg(duration / 2, -offset, terms)]
    try:
        return steer(start, goal, legs, points)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{problem.source}: travel {travel:g} rad with these constraint points leaves the"
            " polynomial's coefficients undetermined",
            advice="move the constraint points apart, or change goal.travel",
        ) from None


def _trajectory(problem: Problem, motion: LegMotion) -> ChainedTrajectory:
    return ChainedTrajectory(problem.system, motion.z, motion.v, problem.branch)
