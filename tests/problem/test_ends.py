import numpy as np
import pytest

import planner
from planner.problem.feasibility import chart_ends_report


def test_ends_of_the_paper_example_are_the_printed_ones(paper: planner.Problem) -> None:
    start, goal = chart_ends_report(paper)
    np.testing.assert_allclose(start.z[1:], [-0.0324, 0.7113, 0.0175], atol=5e-5)
    np.testing.assert_allclose(goal.z[1:], [-0.5225, 0.4622, 0.5236], atol=5e-5)
    assert np.isnan(goal.z[0])
    assert start.in_chart
    assert goal.in_chart
    assert min(start.margins.values()) == pytest.approx(np.sin(np.deg2rad(1)) ** 2)
    assert min(goal.margins.values()) == pytest.approx(0.25)


def test_a_joint_on_a_singularity_is_named(unlimited: planner.Problem) -> None:
    start, goal = chart_ends_report(unlimited.changed({"start.theta_deg": [1, 0, 1]}))
    assert start.singular == ("theta2",)
    assert not start.in_chart
    assert goal.singular == ()


def test_a_joint_on_another_branch_is_named(unlimited: planner.Problem) -> None:
    start, goal = chart_ends_report(unlimited.changed({"goal.theta_deg": [-30, 30, 30]}))
    assert start.in_chart
    assert goal.crossed == ("theta1",)
    assert min(goal.margins.values()) < 0


def test_a_given_travel_is_part_of_the_goal(paper: planner.Problem) -> None:
    _, goal = chart_ends_report(paper.changed({"goal.travel": 0.8, "start.phi_rad": 0.1}))
    assert goal.z[0] == pytest.approx(0.9)
    assert goal.to_dict()["z"][0] == pytest.approx(0.9)
