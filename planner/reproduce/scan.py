"""Is there any travel and time at which the paper's singularity avoidance works on its example?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.chained import chained_form
from planner.domain import worst_margin
from planner.extrema import sample_times
from planner.methods.legs import Leg, Point, steer
from planner.reproduce.cases import POINT, paper_problem
from planner.trajectory import ChainedTrajectory, polynomial_roots


@dataclass(frozen=True)
class Scan:
    """What the scan over travels and point times finds.

    Attributes:
        tried: Pairs (travel, time) at which the free cubic crosses z₂ = 0.
        sign_kept: Those at which the point keeps z₂ < 0.
        inside: Those at which the path then lies inside the full domain.
    """

    tried: int
    sign_kept: int
    inside: int


def scan(travels: int = 61, times: int = 37) -> Scan:
    """Try the point's value at many times, over travels from 0.7 to 1.0 rad."""
    tried = kept = inside = 0
    for travel in np.linspace(0.70, 1.00, travels):
        if not polynomial_roots(_curve(float(travel), []).z_curve, 1):
            continue
        for time in np.linspace(0.5, 9.5, times):
            curve = _curve(float(travel), [Point(float(time), POINT[1])])
            tried += 1
            if polynomial_roots(curve.z_curve, 1):
                continue
            kept += 1
            margins = curve.margins(sample_times(curve.breaks, 200))
            inside += bool(np.all(worst_margin(margins) > 0))
    return Scan(tried, kept, inside)


def _curve(travel: float, points: list[Point]) -> ChainedTrajectory:
    problem = paper_problem(travel=travel)
    goal = problem.goal.copy()
    goal[0] = travel
    form = chained_form(problem.system)
    legs = [Leg(10.0, travel, 3 + len(points))]
    motion = steer(form.z(problem.start), form.z(goal), legs, points)
    return ChainedTrajectory(problem.system, motion.z, motion.v, problem.branch)
