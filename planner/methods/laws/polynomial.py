"""The paper's polynomial law (section 4.2, eqs 25–28), for any n and any constraint points.

The program also does step 5, which is manual in the paper: it chooses constraint points and travel.
Each point adds one coefficient to v₂, which the value at the point determines; the family of
motions is the same for every time of the point. So k points are k free numbers, the values of z₂ at
k fixed times, and the search is over these numbers and the travel.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import (
    candidate_reaches,
    choose_reach,
    given_reach,
    one_way_or_back,
)
from planner.methods.laws.law import Ends, Motion, finish
from planner.methods.laws.legs import Leg, Point, even_legs, steer
from planner.methods.laws.scores import BestCandidate, Curves, search_candidates
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import PolynomialOptions
from planner.support.arrays import Array

NAME = "polynomial"


@one_way_or_back
def plan_polynomial(problem: Problem, options: PolynomialOptions) -> Plan:
    """Plan with v₁ constant and v₂ a polynomial, through given or chosen constraint points.

    With travel zero the motion has two legs (step 4 of the paper). The paper leaves z₂ … z_N at the
    turn open; this program chooses the values with the least ∫v₂².

    Raises:
        SingularError: If start and goal are not in one branch of the chart, or the best
            motion found leaves the chart's domain (unless `options.allow_singular`) at the times
            that the error gives; or if the points leave the coefficients undetermined.
        InputError: If a constraint point lies outside the motion or contradicts another.
    """
    began = time.perf_counter()
    given = _given_points(problem, options)
    ends = Ends.of(problem)
    if given is None:
        reach, points, notes = choose_points(ends, options)
    else:
        points = given
        reach, notes = choose_reach(ends, options, NAME, lambda reach: _motion(ends, reach, points))
    try:
        motion = _motion(ends, reach, points)
    except np.linalg.LinAlgError:
        # The travel only scales rows of the conditions, so the rank depends only on the times.
        times = " and ".join(f"{p.time_s:.4g} s" for p in points)
        raise SingularError(
            f"constraint points at {times} do not determine the coefficients of"
            " the polynomial, at any travel",
            source=problem.source,
            advice="constraint points at other times",
        ) from None
    plan = finish(problem, NAME, options, ends.trajectory(motion), notes | motion.summary, began)
    stretch = plan.duration / ends.duration
    used = [[p.time_s * stretch, p.value] for p in points]
    return replace(plan, notes={"points": used, **plan.notes})


def _given_points(problem: Problem, options: PolynomialOptions) -> tuple[Point, ...] | None:
    """Return the options' constraint points after checks; None if the program chooses points."""
    if options.points == "auto":
        return None
    points = tuple(Point(*p) for p in options.points)
    if points and problem.duration is None:
        raise InputError(
            "method.polynomial.points are times in seconds and need a fixed goal.duration",
            source=problem.source,
        )
    for p in points:
        if not 0 < p.time_s < (problem.duration or np.inf):
            raise InputError(
                f"method.polynomial.points: time {p.time_s:g} s is not inside the"
                f" motion (0, {problem.duration:g}) s",
                source=problem.source,
            )
    if len({p.time_s for p in points}) < len(points):
        raise InputError(
            "method.polynomial.points: two points at one time; give each its own",
            source=problem.source,
        )
    return points


def _motion(ends: Ends, reach: float | Array, points: tuple[Point, ...]) -> Motion:
    legs = even_legs(ends, reach, 1, len(ends.start) - 1 + len(points))
    return steer(ends.start, ends.goal_of(reach), legs, points)


MOST_POINTS = 2

_REACHES = (60, 30, 15)
"""Number of travels scanned with 0, 1 and 2 constraint points."""

_DEVIATIONS = (np.zeros(1), np.linspace(-1.5, 1.5, 13), np.linspace(-1.5, 1.5, 7))
"""Deviations of z₂ scanned at each point, with 0, 1 and 2 points: from the z₂ of the law without
points, relative to its largest |z₂|."""

_SHARES = np.arange(1, 12) / 12


def choose_points(
    ends: Ends, options: PolynomialOptions
) -> tuple[float, tuple[Point, ...], dict[str, Any]]:
    """Choose 0, 1 or 2 constraint points, and a travel (or offset) that is free.

    A further point is used only if it lowers the cost by more than one percent. If every motion
    leaves the domain, the motion that leaves it least is returned.

    Args:
        ends: Start and goal.
        options: Supplies the criterion.

    Returns:
        The travel, or with travel zero the offset; the points; and notes for the plan: how many
        motions were tried, and the cost reached with 0, 1, 2 points.
    """
    given, costs, tried = given_reach(ends, options, NAME), [], 0
    best: BestCandidate | None = None
    known = _PointFamily(ends, given, 0)
    for count in range(MOST_POINTS + 1):
        family = _PointFamily(ends, given, count)
        start = None if best is None or not best.inside else known.read(best.x[None])
        grid, steps = family.candidates(start)
        search = search_candidates(ends.problem, family.make, grid, steps, options.criterion)
        tried += search.tried
        costs.append(search.cost)
        if best is None or search.cost < 0.99 * best.cost:
            best, known = search, family
    assert best is not None
    reach, points = known.read(best.x)
    notes = {**best.notes, "auto_motions_tried": tried, "auto_cost_with_0_1_2_points": costs}
    if ends.problem.travel == 0:
        notes["offset"] = float(reach)
    return float(reach), tuple(Point(p.time_s, float(p.value)) for p in points), notes


class _PointFamily:
    """The family of polynomial motions with a given number of constraint points at fixed times.

    The free numbers of a motion are the reach (unless given), then z₂ at each point.
    """

    def __init__(self, ends: Ends, given: float | None, count: int) -> None:
        self.ends, self.given, self.count = ends, given, count
        self.reaches, self.widths = candidate_reaches(ends, _REACHES[count])
        if given is not None:
            self.reaches, self.widths = np.array([given]), np.zeros(1)
        shares = _best_shares(len(ends.start), ends.problem.travel == 0, count)
        self.times = tuple(share * ends.duration for share in shares)

    def read(self, x: Array) -> tuple[Array, tuple[Point, ...]]:
        """Split free numbers x (…, d) into travels (or offsets), (…), and constraint points."""
        values = np.moveaxis(x, -1, 0)
        if self.given is None:
            reach, values = values[0], values[1:]
        else:
            reach = np.full(x.shape[:-1], self.given)
        return reach, tuple(Point(t, v) for t, v in zip(self.times, values, strict=True))

    def make(self, x: Array) -> Curves:
        """Return the curves z and v of the C motions with free numbers x (C, d)."""
        return _motion(self.ends, *self.read(x)).curves

    def candidates(self, known: tuple[Array, tuple[Point, ...]] | None) -> tuple[Array, Array]:
        """Return candidates to scan, as free numbers (C, d), and the search's first steps (C, d).

        For each travel to scan (offset if the travel is zero), z₂ at the times of the points is
        read from the motion without constraint points, and varied by `_DEVIATIONS`. With a known
        motion the only candidate is that motion, read at these times.
        """
        reaches, deviations, widths = self.reaches, _DEVIATIONS[self.count], self.widths
        if known is not None:
            reaches, deviations, widths = known[0], np.zeros(1), widths[:1]
        motion = _motion(self.ends, reaches, known[1] if known else ())
        z2 = motion.z(np.array(self.times, dtype=float))[..., 1].T
        size = np.max(np.abs(motion.z(np.linspace(0, self.ends.duration, 50))[..., 1]), axis=0)
        off = np.array(list(product(deviations, repeat=self.count)))
        values = z2[:, None] + size[:, None, None] * off
        steps = np.broadcast_to(0.05 * size[:, None, None], values.shape)
        if self.given is None:
            columns = np.broadcast_to([reaches, widths], (2, len(reaches)))[..., None, None]
            columns = np.broadcast_to(columns, (2, len(reaches), len(off), 1))
            values = np.concatenate([columns[0], values], axis=-1)
            steps = np.concatenate([columns[1], steps], axis=-1)
        shape = len(reaches) * len(off), values.shape[-1]
        return values.reshape(shape), steps.reshape(shape)


@lru_cache(maxsize=32)
def _best_shares(size: int, turns: bool, count: int) -> tuple[float, ...]:
    """Return the times of `count` points, as shares of the duration, that give the least condition
    number of the conditions.

    The number depends neither on the duration nor on the ends and the travel, which only scale or
    shift the conditions of `size` coordinates.
    """
    terms, halves = size - 1 + count, (1.0, -1.0) if turns else (1.0,)
    legs = [Leg(1 / len(halves), travel, terms) for travel in halves]

    def condition(shares: tuple[float, ...]) -> float:
        points = [Point(share, 0.0) for share in shares]
        found = steer(np.zeros(size), np.eye(1, size), legs, points).condition
        return float(np.nan_to_num(found[0], nan=np.inf))

    return min(combinations(_SHARES.tolist(), count), key=condition)
