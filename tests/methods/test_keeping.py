"""What methods promise before they search, and that this is what then happens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.methods.keeping import answers, not_promised, refuse_unkept
from planner.plan.measures import peak_rates
from planner.solve import solve_and_check

PROBLEMS = Path(__file__).parents[2] / "problems"
RATES = {"limits.input_rate_rad_s2": 5.0}
U1, U2 = "rate of input u1", "rate of input u2"


def promised(problem: planner.Problem, method: str) -> Mapping[str, str]:
    return answers(problem, planner.METHODS[method].keeps)


def test_everything_that_is_judged_has_an_answer(paper: planner.Problem) -> None:
    problem = planner.load_problem(PROBLEMS / "obstacle.toml").changed(RATES)
    plan = planner.solve(paper, "convex")
    judged = planner.verify(replace(plan, problem=problem)).margins
    for method in planner.METHODS:
        said = promised(problem, method)
        own = ("integra", "against the verification")  # doubts of the judge, which are no demands
        assert {label for label in judged if not any(w in label for w in own)} <= said.keys()


GIVEN: dict[str, dict[str, Any]] = {  # which a law would search for
    "polynomial": {"offset": 1.0},
    "piecewise": {"offset": 1.0},
    "sinusoid": {"amplitude": 0.5},
    "sinusoid_steps": {"amplitude": 0.5},
}


@pytest.mark.parametrize("travel", [0.0, 0.8])
@pytest.mark.parametrize("method", GIVEN)
def test_a_rate_that_is_never_kept_is_that_of_an_input_that_jumps(
    paper: planner.Problem, method: str, travel: float
) -> None:
    changes = {"limits": {}, "goal.travel": travel}
    plan = planner.solve(paper.changed(changes), method, allow_singular=True, **GIVEN[method])
    chained: Any = plan.trajectory
    v = chained.v_curve.c  # where z leaves the chart there is no u
    jump = np.any(np.abs(v[-1, :-1] - v[0, 1:]) > 1e-9, axis=0)
    said = promised(paper.changed({**changes, **RATES, "goal.duration": "free"}), method)
    assert (said[U1] == "never") == jump[0]
    assert not jump[1] or said[U2] == "judged"
    smooth = method == "sinusoid" or (method == "polynomial" and travel != 0)
    assert (said[U2] == "kept") == smooth


def test_a_law_whose_time_is_free_keeps_what_depends_on_the_speed(
    paper: planner.Problem,
) -> None:
    problem = paper.changed({**RATES, "goal.duration": "free", "goal.travel": 0.8287})
    said = promised(problem, "polynomial")
    assert {said[U1], said[U2], said["input u1"], said["input u2"]} == {"kept"}
    plan = planner.solve(problem, "polynomial")
    assert np.max(peak_rates(plan.trajectory)) <= 5.0
    assert promised(paper.changed(RATES), "polynomial")[U1] == "judged"


def test_convex_paths_keep_the_joints_that_move_one_way(paper: planner.Problem) -> None:
    limits = {"limits.joint_deg": [80.0, 30.0, 30.0]}
    problem = paper.changed(limits)
    said = promised(problem, "convex")
    joints = {label: answer for label, answer in said.items() if label.startswith("joint")}
    assert joints == {"joint theta1": "judged", "joint theta2": "kept", "joint theta3": "kept"}
    q = planner.solve(problem, "convex").q(np.linspace(0.0, 10.0, 2001))
    for i in (2, 3):
        ends = sorted([problem.start[i], problem.goal[i]])
        assert ends[0] - 1e-9 <= np.min(q[:, i])
        assert np.max(q[:, i]) <= ends[1] + 1e-9
    with pytest.raises(planner.VerificationError) as refusal:
        solve_and_check(
            paper.changed({"limits.joint_deg": [31.0, 40.0, 40.0]}), "convex", advice=False
        )
    assert [v.label for v in refusal.value.violations] == ["joint theta1"]


def test_what_is_never_kept_is_refused_before_the_search(paper: planner.Problem) -> None:
    there_and_back = {"start.theta_deg": [20, 20, 20], "goal.theta_deg": [30, 20, 20]}
    problem = paper.changed({**there_and_back, **RATES, "goal.travel": 0.0})
    says = "'polynomial' .* rate of input u1"
    with pytest.raises(planner.NoPlanError, match=says) as refusal:
        planner.solve(problem, "polynomial")
    assert refusal.value.plan is None
    assert "collocation" in {change.method for change in refusal.value.changes}
    refuse_unkept(problem, "sinusoid", planner.METHODS["sinusoid"].keeps)


def test_check_says_what_is_not_promised(paper: planner.Problem) -> None:
    found = planner.check(paper.changed({"goal.travel": 0.8287}), ["polynomial"]).to_dict()
    found = found["not_promised"]["polynomial"]
    assert {"input u1", "joint theta1", "z2 margin"} <= set(found)
    assert "goal theta1" not in found
    assert not_promised(paper, planner.METHODS["collocation"].keeps) == ()


def test_wider_limits_are_no_help_where_an_input_jumps(paper: planner.Problem) -> None:
    with pytest.raises(planner.NoPlanError) as refusal:
        planner.solve(paper.changed(RATES), "piecewise")
    assert "rate of input u2" in str(refusal.value.advice)
