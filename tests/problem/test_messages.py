"""What a user reads when a problem file is wrong: one line a key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import planner

NAN, INF = float("nan"), float("inf")


def complaint(paper: planner.Problem, changes: dict[str, Any]) -> str:
    with pytest.raises(planner.InputError) as caught:
        paper.changed(changes)
    return str(caught.value).replace(f"{paper.source}: ", "")


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("goal.duration", -1, "'goal.duration' = -1: must be 'free' or greater than 0"),
        ("goal.duration", "fre", "'goal.duration' = 'fre': must be 'free' or a number"),
        ("goal.duration", True, "'goal.duration' = True: must be 'free' or a number"),
        ("goal.duration", NAN, "'goal.duration' = nan: must be 'free' or a finite number"),
        ("goal.travel", INF, "'goal.travel' = inf: must be 'free' or a finite number"),
        ("limits.joint_deg", 95, "'limits.joint_deg' = 95: must be less than 90 or a list"),
        ("limits.joint_deg", [9, 95, 9], "'limits.joint_deg[1]' = 95: must be less than 90"),
        ("limits.joint_deg", [9, "x", 9], "'limits.joint_deg[1]' = 'x': must be a number"),
        ("start.theta_deg", 5, "'start.theta_deg' = 5: must be a list"),
        ("start", 5, "'start' = 5: must be a table"),
        ("title", 5, "'title' = 5: must be a text in quotes"),
        ("system.joints", 3.0, "'system.joints' = 3.0: must be a whole number"),
        ("method.polynomial.points", [[5.0]],
         "'method.polynomial.points[0]' = [5.0]: must be a list of at least 2 values, not 1"),
        ("machine.preset", "x", "'machine.preset' = 'x': must be 'prototype' or 'ideal'"),
    ],
)  # fmt: skip
def test_one_line_a_key(paper: planner.Problem, key: str, value: Any, line: str) -> None:
    assert complaint(paper, {key: value}) == line


def test_a_misspelt_key_is_not_reported_as_missing_too(paper: planner.Problem) -> None:
    assert complaint(paper, {"start": {"theta": [1, 2, 3]}}) == (
        "unknown key 'start.theta' (value [1, 2, 3]); did you mean 'theta_deg'?"
        " allowed: theta_deg, phi_rad"
    )
    assert complaint(paper, {"start": {}}) == "missing key 'start.theta_deg'"


def test_a_key_in_the_wrong_table_is_sent_home(paper: planner.Problem) -> None:
    assert complaint(paper, {"goal.joint_deg": 80}).endswith("it belongs to [limits]")
    assert complaint(paper, {"duration": 80}).endswith("it belongs to [goal]")
    unicycle = planner.load_problem(Path(__file__).parents[2] / "problems/unicycle.toml")
    text = complaint(unicycle, {"waypoints": [{"q": {"x": 1.0}, "heading_deg": 90}]})
    assert text.endswith("write it into waypoints[0].q: q = { heading_deg = ... }")


def test_a_key_of_an_obstacle_cannot_be_set_alone(paper: planner.Problem) -> None:
    post = {"centre_m": [2.2, 1.75], "radius_m": 0.1}
    with pytest.raises(planner.InputError, match="'obstacles'"):
        paper.changed({"obstacles": [post], "obstacles.0.radius_m": 0.2})


@pytest.mark.parametrize("key", ["float", "int", "list[float]", "goal.float", "goal.literal['a']"])
def test_keys_that_look_like_type_names_are_named(paper: planner.Problem, key: str) -> None:
    assert f"unknown key '{key}'" in complaint(paper, {key: 1})


def test_every_wrong_key_is_told_at_once(paper: planner.Problem) -> None:
    lines = complaint(paper, {"goal.duration": -1, "limits.joint_deg": 95, "goal.x": 1})
    assert len(lines.splitlines()) == 3
