"""One plan and its tracker, for all tests of feedback."""

from __future__ import annotations

from pathlib import Path

import pytest

import planner
from planner import Machine, Plan
from planner.machine.feedback.tracker import TrackerDesign, design
from planner.machine.feedforward.follow import follow
from planner.problem.tables.problem_file import CompensationTable, FeedbackTable


@pytest.fixture(scope="session")
def smooth(paper: planner.Problem) -> Plan:
    """The polynomial close to its best travel; its peak input is 0.58 rad/s."""
    limits = {"input_rad_s": [0.6, 0.6], "joint_deg": 80}
    return planner.solve(paper.changed({"goal.travel": 0.8287, "limits": limits}), "polynomial")


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The prototype with fine encoders, in coarse steps."""
    return Machine.prototype(encoder_resolution_deg=0.02, step_s=0.005)


@pytest.fixture(scope="session")
def plain(smooth: Plan, machine: Machine) -> TrackerDesign:
    """Its tracker without a run-up."""
    return design(smooth, machine, FeedbackTable(run_up=False))


@pytest.fixture(scope="session")
def parked(machine: Machine) -> Plan:
    """A compensated plan whose drive turns back three times, without the correction."""
    problem = planner.load_problem(Path(__file__).parents[3] / "problems/parking.toml")
    plan = planner.solve(problem, "collocation")
    return follow(plan, machine, CompensationTable(correction=False))
