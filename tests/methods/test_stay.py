"""A start that is the goal: the plan stays, whatever the system, the method and the duration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planner import METHODS, Problem, check, load_plan, load_problem, solve

KINDS = ("crossing", "four-joint", "unicycle", "car", "trailers", "custom", "coin")


def resting(kind: str, duration: float | str, **goal: Any) -> Problem:
    """The problem of that file with its start as the goal."""
    tables = load_problem(f"problems/{kind}.toml").to_dict()
    tables.pop("waypoints", None)
    start = {key: dict(v) if isinstance(v, dict) else v for key, v in tables["start"].items()}
    if "q" in start:  # of the path coordinate the travel speaks
        start["q"] = {name: start["q"][name] for name in tables["goal"]["q"]}
    return Problem.from_dict({**tables, "goal": {**start, "duration": duration, **goal}})


@pytest.mark.parametrize("duration", ["free", 5.0])
@pytest.mark.parametrize("kind", KINDS)
def test_every_method_stays_where_the_start_is_the_goal(kind: str, duration: float | str) -> None:
    problem = resting(kind, duration)
    for method in METHODS:
        plan = solve(problem, method)
        assert plan.verified, method
        assert plan.method == method
        assert plan.duration == pytest.approx(1e-3 if duration == "free" else 5.0)
        times = np.linspace(0.0, plan.duration, 7)
        np.testing.assert_array_equal(plan.u(times), np.zeros((7, 2)))
        np.testing.assert_array_equal(plan.q(times), np.tile(problem.start, (7, 1)))
        assert plan.objective == (plan.duration if duration == "free" else 0.0)


LIMITED = {
    "limits.input_rad_s": [0.5, 0.5],
    "limits.input_rate_rad_s2": [5.0, 5.0],
    "method.collocation.rest": True,
}


@pytest.mark.parametrize("away_deg", [0.0, 1e-9, 5e-5])
def test_an_arm_at_its_goal_stays_with_rate_limits_and_rest(away_deg: float) -> None:
    plan = solve(
        Problem.manipulator([10, 20, 30], [10 + away_deg, 20, 30], duration=None, changes=LIMITED)
    )
    assert plan.duration == pytest.approx(1e-3)
    assert plan.objective == plan.duration


def test_staying_takes_no_longer_than_asked() -> None:
    assert solve(resting("unicycle", "free", duration_max=1e-4)).duration == 1e-4


def test_a_goal_that_is_not_the_start_is_driven_to() -> None:
    problem = resting("unicycle", "free", y_m=1e-4)
    plan = solve(problem)
    assert plan.verified
    assert abs(plan.q(plan.duration)[-1] - 1e-4) < 1e-6
    # x and heading go out and back: an area of 1e-4 at rates of one, in four times its root
    assert 0.02 < plan.duration < 0.05


def test_a_waypoint_elsewhere_is_something_to_do() -> None:
    tables = resting("unicycle", 20.0).to_dict()
    start = tables["start"]["heading_deg"]
    turned = Problem.from_dict(
        {**tables, "waypoints": [{"q": {"heading": np.deg2rad(start + 30)}}]}
    )
    assert np.abs(solve(turned).u(np.linspace(0, 20, 50))).max() > 0.01
    here = Problem.from_dict({**tables, "waypoints": [{"q": {"heading": np.deg2rad(start)}}]})
    assert solve(here).objective == 0.0


def test_a_goal_that_leaves_joints_free_is_there_already() -> None:
    assert solve(Problem.manipulator([10, 20, 30], ["free", 20, "free"])).objective == 0.0


def test_check_says_that_there_is_a_plan_and_nothing_reverses() -> None:
    found = check(resting("four-joint", "free"))
    assert found.has_plan
    assert found.reversal.verdict == "not needed"
    assert all(outcome["status"] == "solved" for outcome in found.outcomes)


def test_a_plan_that_stays_is_read_back_verified(tmp_path: Any) -> None:
    plan = solve(resting("car", "free"))
    again = load_plan(plan.save(tmp_path / "stay.json"))
    assert again == plan
    assert again.verified
