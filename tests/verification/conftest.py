"""Plans that are judged, one of each kind of trajectory."""

from __future__ import annotations

import pytest

import planner


@pytest.fixture(scope="session")
def optimal(paper: planner.Problem) -> planner.Plan:
    """In coordinates and inputs."""
    return planner.solve(paper)


@pytest.fixture(scope="session")
def law(paper: planner.Problem) -> planner.Plan:
    """In chained coordinates, slow enough for the limits on inputs and joints."""
    slow = {"goal.duration": 40.0, "goal.travel": 0.8286}
    return planner.solve(paper.changed(slow), "polynomial")


@pytest.fixture(scope="session")
def retimed(optimal: planner.Plan) -> planner.Plan:
    return planner.retime(optimal)
