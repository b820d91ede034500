"""Links of an arm that keep clear of each other: planned, and refused where they do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.problem.requirements.self_collision import SelfCollision
from planner.solve import solve_and_check

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def problem() -> planner.Problem:
    return planner.load_problem(ROOT / "problems/self-collision.toml")


@pytest.fixture(scope="module")
def crossing(problem: planner.Problem) -> planner.Plan:
    """Of least effort, where links may cross."""
    return planner.solve(problem.changed({"limits.self_clearance_m": None}), start="straight")


@pytest.fixture(scope="module")
def plan(problem: planner.Problem) -> planner.Plan:
    return planner.solve(problem)


def clearance_of(problem: planner.Problem) -> SelfCollision:
    assert problem.self_collision is not None
    return problem.self_collision


def distances(plan: planner.Plan) -> Any:
    """Of each joint from each link, all along, shape (R, T)."""
    system: Any = plan.problem.system
    points = system.arm_points(plan.q(np.linspace(0, plan.duration, 20001))[:, 1:])
    return SelfCollision.of(0.03, system).distances(points)


def test_the_least_effort_crosses_and_is_refused(
    problem: planner.Problem, crossing: planner.Plan
) -> None:
    assert np.min(distances(crossing)) < -0.02
    asked = planner.Plan(problem, crossing.method, {}, crossing.trajectory)
    broken = planner.verify(asked).violations
    assert {v.label for v in broken} >= {"clearance of joint 1 from link 4"}
    assert min(v.value for v in broken) == pytest.approx(np.min(distances(crossing)), abs=1e-6)
    certificate = planner.certify(asked)
    assert "violated" in {certificate[v.label].status for v in broken}


def test_the_plan_keeps_clear_at_all_times_and_that_is_proven(
    problem: planner.Problem, crossing: planner.Plan, plan: planner.Plan
) -> None:
    least = np.min(distances(plan))
    assert least >= 0.03
    assert plan.certificate is not None
    assert plan.certificate.ok
    check = planner.verify(plan)
    parts = clearance_of(problem).parts
    assert min(check.margins[part.label] for part in parts) == pytest.approx(least - 0.03, abs=1e-6)
    system: Any = problem.system
    np.testing.assert_allclose(system.arm_points(plan.q(40.0)[1:])[-1], [0.0, -0.04], atol=1e-6)
    assert np.sign(plan.q(40.0)[3]) != np.sign(crossing.q(40.0)[3])  # it folds the other way


def test_links_that_touch_on_the_machine_are_told(plan: planner.Plan) -> None:
    machine = planner.Machine.prototype(step_s=0.01, initial_angle_error_deg=20.0)
    run = planner.replay(plan, machine, samples=20, seed=1)
    broken = [each for each in run.limits if each.broken and "from link" in each.part.label]
    assert broken
    assert all(each.worst < 0 for each in broken)
    assert "limits.self_clearance_m = " in run.limit_words


def test_goals_that_would_cross_are_not_expected(problem: planner.Problem) -> None:
    reach = planner.check(problem, ["polynomial"]).reach
    free = planner.check(problem.changed({"limits.self_clearance_m": None}), ["polynomial"]).reach
    assert reach is not None
    assert free is not None
    assert reach.blocked == len(free.branches) - len(reach.branches) == 1


def test_where_nothing_comes_near_the_plan_is_the_same() -> None:
    folding = planner.Problem.manipulator(
        [5, 20, 20, 20], [15, 30, 27, 24], link_lengths=[0.3, 0.2, 0.2, 0.3], duration=60.0
    )
    plain = planner.solve(folding)  # one guess alone may lead the two searches to other optima
    kept = planner.solve(folding.changed({"limits.self_clearance_m": 0.05}))
    assert kept.objective == pytest.approx(plain.objective, rel=1e-5)
    assert np.min(distances(kept)) > 0.05


@pytest.mark.parametrize("method", ["polynomial", "convex"])
def test_paths_in_the_chart_are_judged(paper: planner.Problem, method: str) -> None:
    near = {"limits": {"self_clearance_m": 0.49}, "system.link_lengths": [1.0, 0.5, 1.0]}
    problem = paper.changed({**near, "goal.travel": 0.82})
    plan, check = solve_and_check(problem, method)
    assert plan.certificate is not None
    assert plan.certificate.ok
    assert check.margins["clearance of joint 2 from link 3"] == pytest.approx(0.01, abs=1e-9)
