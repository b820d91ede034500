"""A plan is verified for the problem's own system, and for no other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from registered import restored

import planner
from planner import Manipulator
from planner.plan.trajectory import StateTrajectory
from planner.support.user_tables import Table
from planner.verification.verdict import judge

OTHER_ARMS = {
    "system.K": ([0.87, 0.7], "K = "),
    "system.k_g": (0.7, "k_g = "),
    "system.link_lengths": ([1.0, 1.0, 0.5], "link_lengths = "),
}


@pytest.fixture(scope="module")
def compensated(optimal: planner.Plan) -> planner.Plan:
    return planner.compensate(optimal)


@pytest.fixture
def registry() -> Iterator[None]:
    with restored():
        yield


@pytest.mark.parametrize("key", OTHER_ARMS)
@pytest.mark.parametrize("made", ["optimal", "law", "retimed", "compensated"])
def test_a_plan_of_another_arm_is_refused_and_says_what_differs(
    key: str, made: str, request: pytest.FixtureRequest
) -> None:
    plan: planner.Plan = request.getfixturevalue(made)
    value, words = OTHER_ARMS[key]
    moved = replace(plan, problem=plan.problem.changed({key: value}))
    found, check = judge(moved)
    assert not found.verified
    assert found.certificate is None
    assert f"another system than the problem's: {words}" in str(check.violations[0])
    assert "nan" not in str(check.violations[0])
    assert planner.verify(moved).violations[-1].label.startswith("the plan is made for another")


def test_a_file_is_a_plan_of_the_arm_that_it_names(optimal: planner.Plan, tmp_path: Any) -> None:
    """It holds no other system than its problem's, so that its motion is wrong instead."""
    moved = replace(optimal, problem=optimal.problem.changed({"system.K": [0.9, 0.7]}))
    back = planner.load_plan(moved.save(tmp_path / "plan.json"))
    assert not back.verified
    assert "theta" in back.violation or "q(t)" in back.violation


class _Twin(Manipulator):
    """An arm that says it is a manipulator with the same constants, and moves otherwise."""

    def slopes(self, q: np.ndarray) -> np.ndarray:
        return 0.9 * super().slopes(q)

    def slopes_expr(self, q: Any) -> list[Any]:
        return [0.9 * slope for slope in super().slopes_expr(q)]


class _Liar(_Twin):
    """It says that it equals any arm, too."""

    def __eq__(self, other: object) -> bool:
        return True

    def __hash__(self) -> int:
        return hash(self._text)


@pytest.mark.parametrize("arm", [_Twin, _Liar])
def test_an_arm_that_only_looks_the_same_is_none(
    optimal: planner.Plan, arm: type[Manipulator]
) -> None:
    """The judge integrates with the problem's system, whatever a trajectory says of its own."""
    own = optimal.problem.system
    assert isinstance(own, Manipulator)
    twin = arm(own.K, own.k_g, own.link_lengths)
    elsewhere = planner.solve(optimal.problem.changed({"system.K": (0.9 * own.K).tolist()}))
    assert isinstance(elsewhere.trajectory, StateTrajectory)
    path = replace(elsewhere.trajectory, system=twin)
    found, check = judge(replace(elsewhere, problem=optimal.problem, trajectory=path))
    assert not found.verified
    assert not check.ok


@pytest.mark.usefixtures("registry")
def test_a_method_that_plans_for_its_own_arm_is_refused(paper: planner.Problem) -> None:
    def plan(problem: planner.Problem, options: Table) -> planner.Plan:
        mine = planner.solve(problem.changed({"system.K": [0.87, 0.7]}))
        return replace(mine, problem=problem)

    planner.register_method("own_arm", plan, options=Table, summary="plans for its own arm")
    with pytest.raises(planner.VerificationError, match="another system") as info:
        planner.solve(paper, "own_arm")
    assert "K = [0.87, 0.7] instead of [0.8701" in str(info.value)
    assert "nan" not in str(info.value)


class _Unknown(StateTrajectory):
    """A trajectory that evaluates in its own way, of which no proof knows anything."""


@pytest.mark.usefixtures("registry")
def test_a_plan_of_which_nothing_is_proven_is_not_verified(
    optimal: planner.Plan, paper: planner.Problem
) -> None:
    path = optimal.trajectory
    assert isinstance(path, StateTrajectory)
    odd = replace(optimal, trajectory=_Unknown(path.system, path.q_curve, path.u_curve))
    assert planner.verify(odd).ok
    found, check = judge(odd)
    assert not found.verified
    assert "nothing of the plan can be proven: " in str(check.violations[0])
    planner.register_method("odd", lambda *_: odd, options=Table, summary="its own trajectory")
    with pytest.raises(planner.VerificationError, match="nothing of the plan can be proven"):
        planner.solve(paper, "odd")


def test_the_plan_that_a_compensated_one_compensates_is_judged_too(
    compensated: planner.Plan, paper: planner.Problem
) -> None:
    made = compensated.compensation
    assert made is not None
    path = made.plan.trajectory
    assert isinstance(path, StateTrajectory)
    bent = replace(path, u_curve=path.u_curve.slowed(1.0, 1.1))
    for inside, words in (
        (replace(made.plan, trajectory=bent), "in its original plan, "),
        (replace(made.plan, problem=paper.changed({"limits.input_rad_s": 9.0})), "another problem"),
    ):
        found, check = judge(replace(compensated, compensation=replace(made, plan=inside)))
        assert not found.verified
        assert words in str(check.violations[0])
