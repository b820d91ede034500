"""Goals that leave joints free: what a file may say, and where the joints may be."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import travel_window
from planner.problem.feasibility import chart_ends_report, least_duration
from planner.problem.nonholonomy import nonholonomy
from planner.problem.tables.kinds import json_schema

ROOT = Path(__file__).parents[2]
LENGTHS = [0.4, 0.3, 0.2]


def found_reach(problem: planner.Problem) -> Any:
    """What `check` finds of the goal's joint angles; the method is refused at once."""
    return planner.check(problem, ["polynomial"]).reach


def tip(*place: float, **more: Any) -> planner.Problem:
    return planner.Problem.manipulator(
        [1, 1, 1], tip_m=list(place), link_lengths=LENGTHS, joint_deg=80, **more
    )


def test_a_file_its_problem_and_back() -> None:
    import jsonschema  # slow

    problem = planner.load_problem(ROOT / "problems/tip.toml")
    assert problem.free == (1, 2, 3)
    assert np.all(np.isnan(problem.goal))
    assert problem.tip is not None
    np.testing.assert_allclose(problem.tip.place, [0.4964, 0.6598])
    assert problem.tip.angle is None
    assert planner.Problem.from_dict(problem.to_dict()) == problem
    data = json.loads(json.dumps(problem.to_dict()))
    assert jsonschema.Draft202012Validator(json_schema()).is_valid(data)
    (one,) = problem.final
    assert one is problem.tip
    assert problem.tip not in problem.requirements
    labels = [part.label for demand in problem.demands for part in demand.parts]
    goals = [label for label in labels if label.startswith("goal")]
    assert goals == ["goal phi2", "goal tip x", "goal tip y"]
    fixed = problem.settled(np.deg2rad([0, 10, 20, 30]))
    assert fixed.free == ()
    assert fixed.tip is None
    np.testing.assert_allclose(np.rad2deg(fixed.goal[1:]), [10, 20, 30])


def test_some_joints_and_the_direction_of_the_last_link() -> None:
    problem = planner.Problem.manipulator([1, 1, 1], [20, "free", "free"], tip_angle_deg=75)
    assert problem.free == (2, 3)
    assert problem.tip is not None
    assert problem.tip.place is None
    assert problem.tip.angle == pytest.approx(np.deg2rad(75))
    assert "goal tip angle" in {part.label for part in problem.tip.parts}
    goal = next(d for d in problem.demands if type(d).__name__ == "Goal")
    assert [part.label for part in goal.parts] == ["goal phi2", "goal theta1"]
    reach = found_reach(problem)
    assert reach is not None
    for q in reach.branches:
        assert q[1] == pytest.approx(np.deg2rad(20))
        assert np.sum(q[1:]) == pytest.approx(np.deg2rad(75))


def test_an_ordinary_goal_leaves_nothing_free(paper: planner.Problem) -> None:
    assert paper.free == paper.final == ()
    assert found_reach(paper) is None
    assert paper.likely is paper
    assert paper.settled(paper.start) is paper


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"goal.theta_deg": [1, 2, 3]}, "'goal': theta_deg gives every joint and so fixes the tip"),
        ({"goal.tip_m": None}, "'goal': needs theta_deg, the joint angles; or a goal of the tip: "),
        ({"goal.tip_m": None, "goal.theta_deg": ["free"] * 3},
         "'goal': leaves every joint free; give an angle in theta_deg, or tip_m"),
        ({"goal.theta_deg": [1, 2, "free"]},
         "goal.tip_m needs 2 free joints, but goal.theta_deg leaves 1 free"),
        ({"goal.theta_deg": [1, "free", "free"], "goal.tip_angle_deg": 0.0},
         "goal.tip_m and goal.tip_angle_deg need 3 free joints"),
        ({"goal.theta_deg": ["free", "free"]}, "goal.theta_deg has 2 angles but system.joints = 3"),
        ({"system.link_lengths": None},
         "goal.tip_m needs system.link_lengths, the lengths of the links in metres"),
        ({"goal.tip_m": [1.2, 0.5]},
         "goal.tip_m = [1.2, 0.5] is 1.3 m from the base, and the stretched arm is 0.9 m long;"
         " the nearest place that it could reach is [0.8308, 0.3462] m"),
        ({"goal.tip_m": [400.0, 300.0]}, "(in millimetres? The key is in metres)"),
        ({"goal.tip_m": [40.0, 30.0]}, "(in centimetres? The key is in metres)"),
        ({"system.link_lengths": [0.8, 0.1, 0.1], "goal.tip_m": [0.3, 0.4]},
         "the longest link keeps the tip at least 0.6 m away"),
        ({"goal.tip_angle_deg": 271.0},
         "the sum of 3 joints' angles, each within 90 degrees; it must lie between -270 and"
         " 270 degrees"),
        ({"obstacles": [{"centre_m": [0.5, 0.6], "radius_m": 0.1}]},
         "m inside obstacle 1; move goal.tip_m or the obstacle"),
        ({"goal.tip_m": [0.5]}, "'goal.tip_m'"),
        ({"goal.theta_deg": [95, "free", "free"]}, "goal.theta_deg"),
    ],
)  # fmt: skip
def test_contradictions_are_named(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(planner.InputError) as refused:
        tip(0.5, 0.55).changed(changes)
    assert said in str(refused.value)


def exact(place: tuple[float, float], angle: float, sign: float) -> np.ndarray:
    """The arm of three joints with the last link's direction given, by the law of cosines."""
    a, b, c = LENGTHS
    x, y = place[0] - c * np.cos(angle), place[1] - c * np.sin(angle)
    second = sign * np.arccos((x * x + y * y - a * a - b * b) / (2 * a * b))
    first = np.arctan2(y, x) - np.arctan2(b * np.sin(second), a + b * np.cos(second))
    return np.array([first, second, angle - first - second])


def test_branches_are_those_of_the_law_of_cosines() -> None:
    problem = tip(0.7, 0.2, tip_angle_deg=10.0).changed({"limits": {}})
    reach = found_reach(problem)
    assert reach is not None
    wanted = [exact((0.7, 0.2), np.deg2rad(10), sign) for sign in (1, -1)]
    wanted.sort(key=lambda theta: np.linalg.norm(theta - np.deg2rad(1)))
    assert len(reach.branches) == 2
    for q, theta in zip(reach.branches, wanted, strict=True):
        np.testing.assert_allclose(q[1:], theta, atol=1e-8)
    assert (reach.missed_m, reach.missed_deg) == (0, 0)
    assert reach.blocked == 0


def test_branches_keep_their_limits_and_those_that_touch_something_are_counted() -> None:
    free = tip(0.7, 0.2, tip_angle_deg=10.0).changed({"limits": {}})
    up, down = (exact((0.7, 0.2), np.deg2rad(10), sign) for sign in (1, -1))
    elbow = LENGTHS[0] * np.array([np.cos(down[0]), np.sin(down[0])])
    disc = {"centre_m": elbow.tolist(), "radius_m": 0.02}
    blocked = found_reach(free.changed({"obstacles": [disc]}))
    assert blocked is not None
    assert blocked.blocked == 1
    np.testing.assert_allclose([q[1:] for q in blocked.branches], [up], atol=1e-8)
    limits = [90.0 - 1e-9, 89.0, float(np.rad2deg(abs(down[2]))) + 1]
    assert abs(up[2]) > abs(down[2]) + np.deg2rad(2)
    limited = found_reach(free.changed({"limits.joint_deg": limits}))
    assert limited is not None
    np.testing.assert_allclose([q[1:] for q in limited.branches], [down], atol=1e-8)


def test_a_place_that_the_limits_keep_out_of_reach_has_a_nearest_one() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # small angles at the start are no slip here
        problem = tip(-0.3, 0.3)
    problem = problem.changed({"limits.joint_deg": 30.0})
    reach = found_reach(problem)
    assert reach is not None
    assert reach.branches == ()
    grid = np.deg2rad(np.linspace(-30, 30, 61))
    theta = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    tips = problem.system.arm_points(theta)[:, -1]  # type: ignore[attr-defined]
    least = np.min(np.linalg.norm(tips - [-0.3, 0.3], axis=1))
    missed = np.linalg.norm(reach.tip[:2] - [-0.3, 0.3])
    assert least <= missed < least + 0.02  # a little inside, so that it can be asked for
    again = found_reach(problem.changed({"goal.tip_m": reach.tip[:2].tolist()}))
    assert again is not None
    assert again.branches


@pytest.mark.parametrize(
    ("place", "angle_deg"), [(None, 170.0), ((-0.3, 0.3), None), ((-0.3, 0.3), 170.0)]
)
def test_a_place_is_missed_by_metres_and_a_direction_by_degrees(
    place: tuple[float, float] | None, angle_deg: float | None
) -> None:
    goal = {"tip_m": place, "tip_angle_deg": angle_deg}
    asked = {key: value for key, value in goal.items() if value is not None}
    problem = planner.Problem.manipulator([1, 1, 1], link_lengths=LENGTHS, joint_deg=30, **asked)
    reach = found_reach(problem)
    assert reach is not None
    told = reach.to_dict()
    if place is None:
        assert reach.missed_m is told["missed_m"] is None
    else:
        off = np.linalg.norm(reach.tip[:2] - place)
        assert reach.missed_m == told["missed_m"] == pytest.approx(off, rel=1e-9)
    if angle_deg is None:
        assert reach.missed_deg is told["missed_deg"] is None
    else:
        off = abs(np.rad2deg(reach.tip[2]) - angle_deg)
        assert reach.missed_deg == told["missed_deg"] == pytest.approx(off, rel=1e-9)
    units = [unit for unit, one in (("m", place), ("deg", angle_deg)) if one is not None]
    assert reach.missed_words.split()[1::3] == units


def test_what_is_known_of_an_end_without_its_joints() -> None:
    problem = tip(0.5, 0.5, duration=2.0, input_rad_s=0.5)
    assert travel_window(problem) is None
    assert least_duration(problem).seconds == 0
    start, goal = chart_ends_report(problem)
    assert start.in_chart
    assert not goal.in_chart
    assert np.all(np.isnan(goal.z))
    places = [place.name for place in nonholonomy(problem).places]
    assert places == ["start", "start with theta1 = 0"]
    tied = planner.Problem.manipulator([1, 1, 1], [60, "free", "free"], input_rad_s=0.5)
    assert least_duration(tied).seconds == pytest.approx(np.deg2rad(59) / 0.5)
