"""What a problem may say and reads like a mistake; and the way out of a contradiction in z2."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pytest

import planner

PAPER = planner.load_problem("problems/paper.toml")
SMALL = {"start.theta_deg": [0.1, 0.1, 0.1], "limits.z2_margin": None}


@pytest.mark.parametrize("goal", [[0.52, 0.52, 0.52], np.deg2rad([30, -30, 89]), [0, 0, 1.59]])
def test_radians_by_mistake_are_told(goal: Any) -> None:
    with pytest.warns(planner.InputWarning, match=r"1\.6 degrees"):
        changed = PAPER.changed({**SMALL, "goal.theta_deg": goal})
    assert np.rad2deg(changed.goal[1:]) == pytest.approx(np.asarray(goal))  # used as it stands
    with pytest.warns(planner.InputWarning, match="^problems/paper.toml: .*start"):
        planner.load_problem("problems/paper.toml", {**SMALL, "goal.theta_deg": goal})
    with pytest.warns(planner.InputWarning, match="^manipulator: .*start"):
        planner.Problem.manipulator([0, 0, 0], goal)


@pytest.mark.parametrize(
    ("start", "goal"),
    [([1, 1, 1], [30, 30, 30]), ([0, 0, 0], [0, 0, 0]), ([2, 0, 0], [0.1, 0, 0]), ([0.5], [1.6])],
)
def test_small_angles_on_one_side_or_none_at_all_are_no_mistake(
    start: list[float], goal: list[float]
) -> None:
    joints = 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        planner.Problem.manipulator((start * joints)[:joints], (goal * joints)[:joints])


def test_an_obstacle_in_millimetres_is_told() -> None:
    with pytest.warns(planner.InputWarning, match=r"obstacle 1 .*\(2200, 1750\) m"):
        PAPER.changed({"obstacles": [{"centre_m": [2200, 1750], "radius_m": 300}]})


def test_it_is_said_once() -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for _ in range(3):
            PAPER.changed({**SMALL, "goal.theta_deg": [0.5, 0.4, 0.3], "title": "said once"})
    assert len(told) == 1


def test_a_goal_beyond_z2_zero_names_the_way_out() -> None:
    tables = planner.load_problem("problems/four-joint.toml").to_dict()
    tables["start"], tables["goal"] = {"theta_deg": [1] * 4}, {"theta_deg": [30] * 4}
    tables["limits"]["z2_margin"] = 0.01
    with pytest.raises(planner.InputError) as refusal:
        planner.Problem.from_dict(tables)
    text = str(refusal.value)
    assert re.search(r"z2 .*goal .*0\.196385.*limits\.z2_margin", text)
    del tables["limits"]["z2_margin"]
    assert planner.Problem.from_dict(tables).limits.z2_margin is None


def test_a_margin_too_wide_for_an_end_says_which_would_do() -> None:
    with pytest.raises(planner.InputError, match=r"z2 .* -0\.0324") as refusal:
        PAPER.changed({"limits.z2_margin": 0.1})
    found = re.search(r"lower limits.z2_margin to ([\d.]+), or leave it out$", str(refusal.value))
    assert found
    assert PAPER.changed({"limits.z2_margin": float(found[1])}).limits.z2_margin > 0.03
