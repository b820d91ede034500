"""Equality, hashes and copies of problems, plans and what they hold."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import planner

COPIES: list[Callable[[Any], Any]] = [
    copy.copy,
    copy.deepcopy,
    lambda value: pickle.loads(pickle.dumps(value)),
]


def made(name: str, **changes: Any) -> planner.Plan:
    problem = planner.load_problem("problems/paper.toml", {"limits.input_rad_s": 2.0, **changes})
    return planner.solve(problem, name)


@pytest.fixture(scope="module")
def plans() -> dict[str, planner.Plan]:
    return {
        "chained": made("polynomial"),
        "state": made("collocation"),
        "retimed": planner.retime(made("polynomial")),
        "compensated": planner.compensate(made("collocation", **{"machine.step_s": 0.01})),
    }


@pytest.mark.parametrize("kind", ["chained", "state", "retimed", "compensated"])
def test_a_copy_is_equal_and_has_the_same_hash(plans: dict[str, planner.Plan], kind: str) -> None:
    plan = plans[kind]
    for duplicate in COPIES:
        for value in (plan, plan.trajectory, plan.problem):
            again = duplicate(value)
            assert again == value
            assert hash(again) == hash(value)
            assert len({again, value}) == 1


def test_a_plan_read_back_and_a_plan_made_again_are_equal(
    plans: dict[str, planner.Plan], tmp_path: Path
) -> None:
    for plan in plans.values():
        assert planner.load_plan(plan.save(tmp_path / "plan.json")) == plan
    again = made("collocation")
    assert again.solve_time_s != plans["state"].solve_time_s
    assert again == plans["state"]


def test_other_motions_problems_verdicts_and_options_differ(plans: dict[str, planner.Plan]) -> None:
    plan = plans["chained"]
    others = [
        replace(plan, problem=plan.problem.changed({"limits.joint_deg": 79})),
        replace(plan, trajectory=plan.trajectory.slowed(1.5)),
        replace(plan, verified=False),
        replace(plan, options={**plan.options, "offset": 0.1}),
        replace(plan, method="piecewise"),
        replace(plan, compensation=plans["compensated"].compensation),
        *(other for kind, other in plans.items() if kind != "chained"),
    ]
    for other in others:
        assert plan != other
        assert other != plan
    assert len({plan, *others}) == 1 + len(others)
    assert plan != "plan"
    assert plan.trajectory != "trajectory"


def test_a_problem_has_the_hash_of_its_equals() -> None:
    problem = planner.load_problem("problems/paper.toml")
    whole = problem.changed({"goal.duration": 10})  # written as a whole number here
    real = problem.changed({"goal.duration": 10.0})
    assert whole == real
    assert hash(whole) == hash(real)
    tables = dict(reversed(problem.to_dict().items()))
    assert hash(planner.Problem.from_dict(tables)) == hash(problem)
    assert hash(problem) != hash(problem.changed({"goal.duration": 11}))


def test_values_that_hold_arrays_are_the_same_or_not(plans: dict[str, planner.Plan]) -> None:
    plan = plans["state"]
    for value in (planner.sensitivity(plan), plan.problem.limits):
        assert value == value
        assert value != copy.deepcopy(value)  # and no error of ambiguous arrays
        assert hash(value) == hash(value)
