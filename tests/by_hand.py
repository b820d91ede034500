"""Plans whose coordinates and inputs are given as curves, without a method."""

from __future__ import annotations

from scipy.interpolate import BPoly

import planner
from planner.plan.trajectory import StateTrajectory


def by_hand(problem: planner.Problem, q: BPoly, u: BPoly) -> planner.Plan:
    """The plan with the curves q(t), values (N,), and u(t), values (2,)."""
    return planner.Plan(problem, "by hand", {}, StateTrajectory(problem.system, q, u))
