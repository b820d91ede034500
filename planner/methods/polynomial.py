"""The paper's polynomial law (section 4.2, eqs 25–28), for any n and any constraint points."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.autopoints import choose_points
from planner.methods.law import Ends, even_legs, finish, summary, trajectory_of
from planner.methods.legs import LegMotion, Point, steer
from planner.methods.travel import travel_of
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import PolynomialOptions

NAME = "polynomial"


def plan_polynomial(problem: Problem, options: PolynomialOptions) -> Plan:
    """Steer with v₁ constant and v₂ a polynomial, through given or chosen constraint points.

    With travel zero the motion has two legs (step 4 of the paper). The paper does not say which
    z₂ … z_N to pass at the turn; the one that makes ∫v₂² least is taken.

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times; or if it does so for every
            choice of points and travel tried.
        InfeasibleError: If the travel is free and no one-way motion exists.
        InputError: If a constraint point lies outside the motion or contradicts another.
    """
    began = time.perf_counter()
    points = _given(problem, options)
    ends = Ends.of(problem)
    offset = ends.offset(options.offset, NAME) if problem.travel == 0 else 0.0

    def solve(travel: float, points: Sequence[Point]) -> LegMotion:
        return _motion(ends, offset, travel, points)

    notes: dict[str, Any]
    if points is None:
        chosen = choose_points(ends, solve, options)
        travel, points, notes = chosen.travel, chosen.points, chosen.notes
    else:
        given = points
        choice = travel_of(problem, lambda d: trajectory_of(problem, solve(d, given)), options)
        travel = choice.travel
        notes = {"travel_ranges_in_domain": [list(r) for r in choice.ranges]}
    motion = solve(travel, points)
    notes |= summary(motion)
    plan = finish(problem, NAME, options, trajectory_of(problem, motion), notes, began)
    stretch = plan.duration / ends.duration
    used = [[p.time_s * stretch, p.value] for p in points]
    return replace(plan, notes={"points": used, **plan.notes})


def _given(problem: Problem, options: PolynomialOptions) -> tuple[Point, ...] | None:
    """The constraint points of the options, checked; None when they are to be chosen."""
    if options.points == "auto":
        return None
    points = tuple(Point(*p) for p in options.points)
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


def _motion(ends: Ends, offset: float, travel: float, points: Sequence[Point]) -> LegMotion:
    terms = len(ends.start) - 1 + len(points)
    legs = even_legs(ends.duration, travel, offset, 1, terms)
    try:
        return steer(ends.start, ends.goal(travel), legs, points)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{ends.problem.source}: travel {travel:g} with these constraint points leaves the"
            " polynomial's coefficients undetermined",
            advice=f"move the constraint points apart, or change {ends.problem.travel_key}",
        ) from None
