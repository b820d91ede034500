"""The paper's polynomial law (section 4.2, eqs 25–28), for any n and any constraint points.

The program also does the paper's step 5, which is manual there: it chooses constraint points and
travel. A point at a given time adds one coefficient to v₂, and its value determines it; with
another time the family of motions is the same. So k points are k free numbers, their values at k
fixed times, and the search is over these and the travel.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import (
    candidate_travels,
    choose_offset,
    one_way_or_back,
    travel_of,
)
from planner.methods.laws.law import Ends, even_legs, finish, summary, trajectory_of
from planner.methods.laws.legs import LegMotion, Point, steer
from planner.methods.laws.scores import BestCandidate, search_candidates
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory
from planner.problem.problem import Problem
from planner.problem.tables.method_options import PolynomialOptions
from planner.support.arrays import Array

NAME = "polynomial"


@one_way_or_back
def plan_polynomial(problem: Problem, options: PolynomialOptions) -> Plan:
    """Steer with v₁ constant and v₂ a polynomial, through given or chosen constraint points.

    With travel zero the motion has two legs (step 4 of the paper). The paper does not give
    z₂ … z_N at the turn; we choose those with the least ∫v₂².

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times; or if it does so for every
            choice of points and travel tried.
        InputError: If a constraint point lies outside the motion or contradicts another.
    """
    began = time.perf_counter()
    points = _points_given(problem, options)
    ends = Ends.of(problem)
    offset, turn = choose_offset(
        ends,
        options,
        NAME,
        lambda offset: trajectory_of(problem, _motion(ends, offset, 0.0, points or ())),
    )

    def solve(travel: float, points: Sequence[Point]) -> LegMotion:
        return _motion(ends, offset, travel, points)

    notes: dict[str, Any]
    if points is None:
        travel, points, notes = choose_points(ends, solve, options)
    else:
        given = points
        choice = travel_of(problem, lambda d: trajectory_of(problem, solve(d, given)), options)
        travel = choice.travel
        notes = {"travel_ranges_in_domain": [list(r) for r in choice.ranges]}
    motion = solve(travel, points)
    notes = turn | notes | summary(motion)
    plan = finish(problem, NAME, options, trajectory_of(problem, motion), notes, began)
    stretch = plan.duration / ends.duration
    used = [[p.time_s * stretch, p.value] for p in points]
    return replace(plan, notes={"points": used, **plan.notes})


def _points_given(problem: Problem, options: PolynomialOptions) -> tuple[Point, ...] | None:
    """The constraint points of the options, checked; None if the program chooses them."""
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
        # The travel only scales rows of the conditions, so the rank depends only on the times.
        times = " and ".join(f"{p.time_s:.4g} s" for p in points)
        raise SingularError(
            f"{ends.problem.source}: constraint points at {times} leave the polynomial's"
            " coefficients undetermined, at every travel",
            advice="constraint points at other times",
        ) from None


Solve = Callable[[float, Sequence[Point]], LegMotion]

MOST_POINTS = 2

_TRAVELS = (60, 30, 15)
"""Travels scanned with 0, 1 and 2 points."""

_DEVIATIONS = (np.zeros(1), np.linspace(-1.5, 1.5, 13), np.linspace(-1.5, 1.5, 7))
"""Values scanned at each point: deviations from the z₂ of the law without points, relative to the
largest |z₂|."""

_SHARES = np.arange(1, 12) / 12


def choose_points(
    ends: Ends, solve: Solve, options: PolynomialOptions
) -> tuple[float, tuple[Point, ...], dict[str, Any]]:
    """Choose 0, 1 or 2 constraint points, and the travel if it is free.

    More points are used only if they lower the cost by more than one percent. If no choice keeps
    the motion inside the domain, the one that leaves it least is returned.

    Args:
        ends: Start and goal.
        solve: The law, as a function from travel and points to a motion.
        options: The options, for the criterion.

    Returns:
        The travel, the points, and notes for the plan: how many motions were tried, and the cost
        reached with 0, 1, 2 points.
    """
    best: BestCandidate | None = None
    known: LegMotion | None = None
    family, costs, tried = _PointFamily(ends, solve, 0), [], 0
    for count in range(MOST_POINTS + 1):
        wider = _PointFamily(ends, solve, count)
        if best is not None and best.inside:
            known = family.motion(best.x)
        found = wider.search(options, known)
        tried += found.tried
        costs.append(found.cost)
        if best is None or found.cost < 0.99 * best.cost:
            best, family = found, wider
    assert best is not None
    travel, points = family.read(best.x)
    notes = {
        "auto_motions_tried": tried,
        "auto_cost_with_0_1_2_points": costs,
        "auto_found_inside": best.inside,
    }
    return travel, points, notes


class _PointFamily:
    """All motions with a given number of points; free numbers: travel if it is free, values."""

    def __init__(self, ends: Ends, solve: Solve, count: int) -> None:
        self.ends, self.solve, self.count = ends, solve, count
        self.free = ends.problem.travel is None
        self.times = self._best_times()

    def read(self, x: Array) -> tuple[float, tuple[Point, ...]]:
        """Travel and points for free numbers x."""
        given = self.ends.problem.travel
        travel, values = (float(x[0]), x[1:]) if given is None else (given, x)
        return travel, tuple(Point(t, float(v)) for t, v in zip(self.times, values, strict=True))

    def motion(self, x: Array) -> LegMotion:
        """The motion for free numbers x."""
        return self.solve(*self.read(x))

    def make(self, x: Array) -> ChainedTrajectory | None:
        """The trajectory for free numbers x; None if the law has no solution."""
        if self.free and x[0] == 0:
            return None
        return trajectory_of(self.ends.problem, self.motion(x))

    def search(self, options: PolynomialOptions, known: LegMotion | None) -> BestCandidate:
        """The best of the family, found from a known motion inside the domain or from a scan."""
        travels = self._travels()
        width = np.ptp(travels) / len(travels) if self.free else 0.0
        if known is not None:
            travel = float(known.z.c[-1, -1, 0] - known.z.c[0, 0, 0])
            grid, size = self._around(known, travel, np.zeros(1))
        else:
            around = [
                self._around(self.solve(float(d), ()), float(d), _DEVIATIONS[self.count])
                for d in travels
            ]
            grid = np.concatenate([g for g, _ in around])
            size = float(np.median([s for _, s in around]))
        steps = np.full(grid.shape[1], 0.05 * size)
        if self.free:
            steps[0] = width
        starts = 2 if grid.shape[1] else 0  # where nothing is free there is one candidate
        given = self.ends.problem, self.make, grid, steps, options.criterion
        return search_candidates(*given, starts=starts)

    def _travels(self) -> Array:
        given = self.ends.problem.travel
        if given is None:
            return candidate_travels(self.ends.problem, _TRAVELS[self.count])
        return np.array([given])

    def _around(self, motion: LegMotion, travel: float, deviations: Array) -> tuple[Array, float]:
        """Free numbers whose values deviate from a motion's z₂, and the scale of that z₂."""
        z2 = motion.z(np.asarray(self.times, dtype=float))[:, 1]
        size = float(np.max(np.abs(motion.z(np.linspace(0, self.ends.duration, 50))[:, 1])))
        rows = [z2 + size * np.array(d) for d in product(deviations, repeat=self.count)]
        return np.array([[travel, *row] if self.free else row for row in rows]), size

    def _best_times(self) -> tuple[float, ...]:
        """Times at which the points' conditions are as independent of the others as possible."""
        if self.count == 0:
            return ()
        travel = float(self._travels()[0])

        def condition(times: tuple[float, ...]) -> float:
            try:
                return self.solve(travel, [Point(t, 0.0) for t in times]).condition
            except SingularError:
                return np.inf

        shares = (_SHARES * self.ends.duration).tolist()
        return min(combinations(shares, self.count), key=condition)
