"""Travels and constraint points with which the paper's singularity avoidance works.

A constraint point prescribes z₂ at one time, eq. (28).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np

from planner.errors import SingularError
from planner.methods.laws.law import Ends, Motion
from planner.methods.laws.legs import Leg, Point, steer
from planner.methods.laws.scores import score
from planner.paper.cases import POINT, paper_problem
from planner.plan.measures import peak_inputs
from planner.plan.plan import Plan
from planner.solve import solve
from planner.support.arrays import Array
from planner.support.calculus.extremes import sample_times

Points = list[list[float]] | Literal["auto"]

CROSSING_DETOURS: tuple[tuple[float, Points], ...] = (
    (0.7935, [[4.0, POINT[1]]]),
    (0.7932, "auto"),
    (0.7925, "auto"),
)
"""Travels at which the plain cubic crosses z₂ = 0, each with points that avoid the crossing."""

MISSING_ANGLE_DETOURS: tuple[tuple[float, Points], ...] = (
    (0.85, [[0.5, -0.0946]]),
    (0.85, "auto"),
    (0.87, "auto"),
)
"""Travels at which the plain cubic keeps z₂ < 0 but lacks a real θ₁, with points that give one."""


def detour(travel: float, points: Points) -> Plan:
    """Return a plan of the paper's example by the polynomial law with constraint points.

    Raises:
        SingularError: If the path still leaves the domain.
    """
    return solve(paper_problem(travel=travel), "polynomial", points=points)


def detours() -> str:
    """Return in words at which travels which constraint points lead around singularities."""
    margins, counts = margins_at_paper_point(), scan()
    low, high = np.min(counts.inside[:, 0]), np.max(counts.inside[:, 0])
    crossings, angles = (
        "; ".join(_detour_text(detour(*case)) for case in ways)
        for ways in (CROSSING_DETOURS, MISSING_ANGLE_DETOURS)
    )
    return (
        f"the paper's point ({POINT[0]:g}, {POINT[1]:g}) does not: at all of {len(margins)} travels"
        f" from 0.7 to 1 rad the path leaves the domain, at best by {-np.max(margins):.1g}. If the"
        f" cubic crosses zero, the value {POINT[1]:g} at another time works only at travels from"
        f" {low:.4f} to {high:.4f} rad ({counts.trials} pairs of travel and time tried); points"
        f" that work: {crossings}. If the cubic keeps z2 < 0 but has no real theta1: {angles}"
    )


def _detour_text(plan: Plan) -> str:
    """Travel, points and peak input; the points as printed give this peak input, too."""
    travel, peak = f"{plan.travel:.4g}", _peak_text(plan)
    for digits in range(3, 17):
        points = [[float(f"{x:.{digits}g}") for x in point] for point in plan.notes["points"]]
        with suppress(SingularError):
            if _peak_text(detour(float(travel), points)) == peak:
                break
    by = " and ".join(f"({t:.{digits}g}, {value:.{digits}g})" for t, value in points)
    return f"travel {travel} by {by}, {peak} rad/s"


def _peak_text(plan: Plan) -> str:
    return f"{np.max(peak_inputs(plan.trajectory)):.3g}"


def margins_at_paper_point(travels: int = 301) -> Array:
    """Return the margins by which polynomial plans through the paper's point keep in the domain.

    There is one for each of `travels` travels from 0.7 to 1 rad; it is negative if the path leaves
    the domain.
    """
    motions = _motions(np.linspace(0.70, 1.00, travels), [Point(*POINT)])
    return score(paper_problem(), motions.curves).margin


@dataclass(frozen=True)
class Scan:
    """Result of `scan`: constraint points at the paper's z₂ that keep the path inside the domain.

    Only travels are tried at which the plain cubic, without a constraint point, crosses z₂ = 0.

    Attributes:
        trials: Number of pairs of travel and time tried.
        inside: Pairs of travel (rad) and time (s) with a path inside the domain, shape (m, 2).
    """

    trials: int
    inside: Array


def scan() -> Scan:
    """Try the paper's value of z₂ at many times and travels, densely where paths stay inside."""
    travels = np.concatenate([np.linspace(0.70, 1.00, 61), np.linspace(0.7929, 0.7936, 8)])
    times = np.concatenate([np.linspace(0.5, 9.5, 37), np.linspace(3.8, 4.2, 9)])
    plain = _motions(travels, []).z
    signs = np.sign(plain(sample_times(plain.x))[..., 1])
    crossing = travels[np.ptp(signs, axis=0) > 0]
    inside = []
    for time in times.tolist():
        motions = _motions(crossing, [Point(time, POINT[1])])
        good = score(paper_problem(), motions.curves).inside
        inside += [(travel, time) for travel in crossing[good].tolist()]
    return Scan(len(crossing) * len(times), np.array(inside).reshape(-1, 2))


def _motions(travels: Array, points: list[Point]) -> Motion:
    ends = Ends.of(paper_problem())  # the travel of its goal is free
    return steer(ends.start, ends.goal(travels), [Leg(10.0, travels, 3 + len(points))], points)
