"""A problem without a file: `Problem.manipulator`."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import planner
from planner.problem.tables.arms import JointGoal, JointStart, LimitsTable, ManipulatorTable
from planner.problem.tables.kinds import REQUIREMENTS
from planner.systems.manipulator import prototype_ratios

Problem = planner.Problem


def test_the_papers_problem_without_its_file() -> None:
    paper = planner.load_problem("problems/paper.toml")
    built = Problem.manipulator(
        np.ones(3), (30, 30, 30), input_rad_s=[0.5, 0.5], joint_deg=80, z2_margin=0.01
    )
    named = built.changed({"title": paper.name})
    assert named == paper
    assert planner.solve(built).travel == pytest.approx(planner.solve(paper).travel)


def test_more_joints_continue_the_ratio_as_the_shipped_problem_does() -> None:
    four = planner.load_problem("problems/four-joint.toml")
    assert prototype_ratios(4) == four.to_dict()["system"]["K"]
    built = Problem.manipulator([1] * 6, [20] * 6)
    K = np.array(built.to_dict()["system"]["K"])
    assert len(K) == 5
    assert K[1:] / K[:-1] == pytest.approx(0.711625 / 0.870125, abs=2e-6)
    assert Problem.manipulator([1, 1], [20, 20]).to_dict()["system"]["K"] == [0.870125]


def test_constants_gear_travel_and_duration_are_those_given() -> None:
    own = Problem.manipulator([1, 1], [20, 20], K=[0.5], k_g=0.9, travel=0.8, duration=None)
    assert own.system == planner.Manipulator([0.5], 0.9)
    assert (own.travel, own.duration) == (0.8, None)
    gear = planner.Gear(30.0, 36.68, 35.0, 1.0, 1.2)
    geared = Problem.manipulator([1, 1, 1], [20, 20, 20], gear=gear)
    assert geared.system == planner.Manipulator.from_gear(3, gear)
    assert Problem.manipulator([1, 1, 1], [9, 9, 9], k_g=2.0).system.k_g == 2.0  # type: ignore[attr-defined]
    further = Problem.manipulator([1, 1], [9, 9], changes={"machine.preset": "ideal"})
    assert further.machine.preset == "ideal"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"goal_deg": [30, 30]}, "goal.theta_deg has 2 angles but system.joints = 3"),
        ({"start_deg": 5}, "'start.theta_deg' = 5: must be a list"),
        ({"start_deg": [1]}, "'system.joints' = 1: must be at least 2"),
        ({"K": [0.5]}, "joints = 3 needs 2 values in K .K2 ... K3., not 1"),
        ({"K": [0.5, 0.4]}, "K needs k_g too"),
        ({"K": [0.5, 0.4], "k_g": 1.0, "gear": {"r1": 1}}, "either K .with k_g. or gear|gear.R"),
        ({"joint_deg": 95}, "'limits.joint_deg' = 95: must be less than 90"),
        ({"duration": -1}, "'goal.duration' = -1: must be"),
        ({"travel": 47.0}, "looks like degrees"),
        ({"goal_deg": [89, 30, 30], "joint_deg": 80}, "contradiction: goal theta1 = 89 deg"),
        ({"changes": {"goal.durration": 1}}, "did you mean 'duration'"),
    ],
)
def test_what_a_file_may_not_say_is_refused_here(changed: dict[str, Any], words: str) -> None:
    arguments: dict[str, Any] = {"start_deg": [1, 1, 1], "goal_deg": [30, 30, 30], **changed}
    with pytest.raises(planner.InputError, match=words):
        Problem.manipulator(**arguments)


def test_it_has_an_argument_for_each_key_of_system_and_limits() -> None:
    keys = {*ManipulatorTable.model_fields, *LimitsTable.model_fields, *JointGoal.model_fields}
    keys -= {"kind", "joints", "k_g_rule", "theta_deg"}
    keys -= REQUIREMENTS.keys()  # limits of all kinds of systems: by changes
    assert set(JointStart.model_fields) == {"theta_deg", "phi_rad"}  # start_deg; phi_rad by changes
    assert keys <= set(inspect.signature(Problem.manipulator).parameters)
