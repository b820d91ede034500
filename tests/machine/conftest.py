"""The plan that the prototype is calibrated on."""

from __future__ import annotations

import pytest
from handmade import arm_problem, smooth_plan_of

from planner.plan import Plan
from planner.problem import Problem


@pytest.fixture(scope="session")
def arm() -> Problem:
    """The paper's boundary values."""
    return arm_problem([1, 1, 1], goal=[30, 30, 30])


@pytest.fixture(scope="session")
def smooth_plan(arm: Problem) -> Plan:
    """A smooth polynomial plan from (1, 1, 1) to (30, 30, 30) degrees in 10 s, |u| < 0.25 rad/s."""
    return smooth_plan_of(arm)
