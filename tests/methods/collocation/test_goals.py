"""Goals that leave joints free: configuration and motion are found together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner import Machine
from planner.problem.problem import WIDEST_FREE_JOINT_RAD
from planner.problem.requirements.ends import TipGoal
from planner.solve import solve_and_check
from planner.verification.verify import GOAL_TOLERANCE

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def problem() -> planner.Problem:
    return planner.load_problem(ROOT / "problems/tip.toml")


@pytest.fixture(scope="module")
def plan(problem: planner.Problem) -> planner.Plan:
    return planner.solve(problem)


def end(plan: planner.Plan) -> Any:
    return plan.q(plan.duration)


def tip(plan: planner.Plan, q: Any = None) -> Any:
    system: Any = plan.problem.system
    return system.arm_points(end(plan)[1:] if q is None else q[..., 1:])[..., -1, :]


def test_the_tip_arrives_and_the_joints_cost_less_than_those_given(
    problem: planner.Problem, plan: planner.Plan
) -> None:
    assert plan.verified
    np.testing.assert_allclose(tip(plan), [0.4964, 0.6598], atol=1e-6)
    given = planner.solve(problem.settled(np.deg2rad([0, 30, 30, 30])))
    np.testing.assert_allclose(tip(given), [0.4964, 0.6598], atol=5e-5)  # the place is rounded
    assert plan.objective < 0.5 * given.objective
    assert np.deg2rad(plan.notes["goal_theta_deg"]) == pytest.approx(end(plan)[1:])


def test_no_neighbouring_configuration_costs_less(
    problem: planner.Problem, plan: planner.Plan
) -> None:
    """The joints are the best: with the first moved either way and the others to match, by the law
    of cosines, the plan for all joints given costs more."""
    theta = end(plan)[1:]
    a, b, c = problem.system.link_lengths  # type: ignore[attr-defined]
    for step in (-0.003, 0.003):
        first = theta[0] + step
        x, y = np.array([0.4964, 0.6598]) - a * np.array([np.cos(first), np.sin(first)])
        third = np.arccos((x * x + y * y - b * b - c * c) / (2 * b * c))
        second = np.arctan2(y, x) - np.arctan2(c * np.sin(third), b + c * np.cos(third)) - first
        near = planner.solve(problem.settled(np.array([0, first, second, third])))
        np.testing.assert_allclose(tip(near), [0.4964, 0.6598], atol=1e-6)
        assert near.objective > plan.objective
        assert (
            near.objective < 2 * plan.objective
        )  # the valley is narrow: most goals need turning back
    same = planner.solve(problem.settled(end(plan)))
    assert same.objective == pytest.approx(plan.objective, rel=1e-6)


def test_the_judge_and_the_proof_find_the_tip_where_another_integrator_does(
    plan: planner.Plan,
) -> None:
    system = plan.problem.system
    found = solve_ivp(
        lambda t, q: system.rates(q, plan.trajectory.u(t)),
        (0.0, plan.duration),
        plan.problem.start,
        rtol=1e-10,
        atol=1e-12,
        max_step=plan.duration / 50,
    ).y[:, -1]
    reach = 0.9
    missed = tip(plan, found) - [0.4964, 0.6598]
    check = planner.verify(plan)
    assert check.ok
    assert plan.certificate is not None
    assert plan.certificate.ok
    for name, off in zip("xy", missed, strict=True):
        assert -check.margins[f"goal tip {name}"] == pytest.approx(abs(off), abs=1e-8)
        claim = plan.certificate[f"goal tip {name}"]
        assert claim.status == "proven"
        assert claim.guaranteed == pytest.approx(GOAL_TOLERANCE * reach - abs(off), abs=1e-7)
    np.testing.assert_array_equal(check.terminal_error[1:], 0)


@pytest.mark.parametrize("off", [(1.0, 0.0), (0.0, -1.0)])
def test_a_tip_that_is_missed_is_broken_and_proven_to_be(
    problem: planner.Problem, plan: planner.Plan, off: tuple[float, float]
) -> None:
    near, far = (
        problem.changed({"goal.tip_m": [x + by * 0.9 * GOAL_TOLERANCE * d for x, d in at]})
        for by in (0.9, 1.1)
        for at in [list(zip((0.4964, 0.6598), off, strict=True))]
    )
    assert planner.verify(planner.Plan(near, plan.method, {}, plan.trajectory)).ok
    missed = planner.Plan(far, plan.method, {}, plan.trajectory)
    (broken,) = planner.verify(missed).violations
    name = "goal tip x" if off[0] else "goal tip y"
    assert (broken.label, broken.unit) == (name, "m")
    assert broken.limit - broken.value == pytest.approx(
        1.1 * 0.9 * GOAL_TOLERANCE * sum(off), rel=0.01
    )
    assert planner.certify(missed)[name].status == "violated"


def test_place_and_direction_together(problem: planner.Problem) -> None:
    asked = problem.changed({"goal.tip_m": [0.5, 0.65], "goal.tip_angle_deg": 90.0})
    plan = planner.solve(asked)
    np.testing.assert_allclose(tip(plan), [0.5, 0.65], atol=1e-6)
    assert np.sum(end(plan)[1:]) == pytest.approx(np.deg2rad(90), abs=1e-6)
    assert plan.certificate is not None
    assert plan.certificate["goal tip angle"].status == "proven"


def test_some_joints_given_the_others_free(paper: planner.Problem) -> None:
    plan = planner.solve(paper.changed({"goal.theta_deg": ["free", 30, "free"]}))
    assert end(plan)[2] == pytest.approx(np.deg2rad(30), abs=1e-6)
    assert abs(end(plan)[3] - paper.start[3]) > np.deg2rad(5)  # it is driven along
    all_given = planner.solve(paper)
    assert plan.objective < 0.5 * all_given.objective
    assert {c.label for c in planner.certify(plan).claims} >= {"goal theta2"}
    assert "goal theta1" not in planner.verify(plan).margins


def test_free_joints_end_inside_their_limits(problem: planner.Problem) -> None:
    folded = problem.changed({"goal.tip_m": [0.2, 0.42], "limits": {}, "goal.duration": "free"})
    plan = planner.solve(folded.changed({"limits.input_rad_s": 0.5}))
    assert np.max(np.abs(end(plan)[1:])) <= WIDEST_FREE_JOINT_RAD + 1e-9
    np.testing.assert_allclose(tip(plan), [0.2, 0.42], atol=1e-6)


def test_the_best_of_all_branches_is_kept_and_named(plan: planner.Plan) -> None:
    tried = {entry["start"]: entry["objective"] for entry in plan.notes["tried"]}
    assert len(tried) == 4
    assert all(" towards (" in start for start in tried)
    assert plan.objective == pytest.approx(min(tried.values()), rel=1e-6)
    assert tried[plan.notes["start"]] == min(tried.values())
    assert max(tried.values()) > 2 * plan.objective


def test_by_way_of_a_place(problem: planner.Problem) -> None:
    way = {"waypoints": [{"theta_deg": [10, "free", 30]}], "goal.tip_m": [0.5, 0.6]}
    plan = planner.solve(problem.changed(way), starts=1, attempts=1)
    np.testing.assert_allclose(tip(plan), [0.5, 0.6], atol=1e-6)


def test_around_a_disc(problem: planner.Problem, plan: planner.Plan) -> None:
    there = tip(plan, plan.q(3.0))
    disc = {"centre_m": (there * (1 + 0.04 / np.linalg.norm(there))).tolist(), "radius_m": 0.05}
    blocked = problem.changed({"obstacles": [disc]})
    assert not planner.verify(planner.Plan(blocked, plan.method, {}, plan.trajectory)).ok
    around = planner.solve(blocked, starts=1, attempts=1, intervals=20)
    np.testing.assert_allclose(tip(around), [0.4964, 0.6598], atol=1e-6)


def test_a_warm_start_moves_to_a_tip_nearby(problem: planner.Problem, plan: planner.Plan) -> None:
    moved = problem.changed({"goal.tip_m": [0.5, 0.64]})
    warm = planner.solve(moved, warm=plan)
    assert warm.notes["stage"] == "warm start"
    assert warm.objective == pytest.approx(planner.solve(moved).objective, rel=1e-6)
    np.testing.assert_allclose(tip(warm), [0.5, 0.64], atol=1e-6)


def test_out_of_the_limits_reach_the_nearest_place_is_proposed(problem: planner.Problem) -> None:
    tied = problem.changed({"goal.tip_m": [-0.1, 0.7], "limits.joint_deg": 50})
    with pytest.raises(planner.NoPlanError) as refused:
        solve_and_check(tied, "collocation", advice=False)
    assert refused.value.reason.endswith(" m")
    assert "within the limits were found that put the tip at (-0.1, 0.7) m" in str(refused.value)
    first = refused.value.changes[0].keys
    (nearest,) = first.values()
    assert list(first) == ["goal.tip_m"]
    np.testing.assert_allclose(nearest, [-0.1, 0.7], atol=0.2)
    assert planner.solve(tied.changed({**first, "goal.duration": "free"})).verified


@pytest.mark.parametrize(
    "method", ["polynomial", "piecewise", "sinusoid", "sinusoid_steps", "convex"]
)
def test_methods_in_the_chart_ask_for_all_joints(problem: planner.Problem, method: str) -> None:
    with pytest.raises(planner.NoPlanError) as refused:
        planner.solve(problem, method)
    assert "[goal] leaves theta1, theta2, theta3 free" in refused.value.sentence
    assert "collocation" in {change.method for change in refused.value.changes}


def test_the_way_out_works(problem: planner.Problem, plan: planner.Plan) -> None:
    angles = plan.notes["goal_theta_deg"]
    given = {"goal.theta_deg": angles, "goal.tip_m": None, "goal.duration": "free"}
    law = planner.solve(problem.changed(given), "polynomial")
    np.testing.assert_allclose(tip(law), [0.4964, 0.6598], atol=1e-5)


def test_desensitised_plans_keep_the_tip(problem: planner.Problem, plan: planner.Plan) -> None:
    calm = planner.solve(problem, "desensitised", starts=1, intervals=20)
    np.testing.assert_allclose(tip(calm), [0.4964, 0.6598], atol=1e-6)
    assert calm.notes["goal_theta_deg"] != plan.notes["goal_theta_deg"]


def test_both_solvers_pose_the_same_end(problem: planner.Problem, plan: planner.Plan) -> None:
    for solver in ("ipopt", "fatrop"):
        other = planner.solve(problem, solver=solver)
        assert other.objective == pytest.approx(plan.objective, rel=1e-6)


def test_a_tip_that_misses_says_which_key_would_be_kept() -> None:
    asked = TipGoal(("x", "y", "angle"), (0.5, 0.6, 1.0), 0.9)
    x, _, angle = asked.parts
    broken = [
        planner.Violation(part, value, part.low, 1.0, asked)
        for part, value in ((x, 0.45), (angle, np.pi / 3))
    ]
    assert TipGoal.easing(broken) == "goal.tip_m = [0.45, 0.6] and goal.tip_angle_deg = 60"


def test_a_long_arm_finds_its_tip() -> None:
    """Four joints, whose paths may need the ladder: one expected goal is enough for it."""
    arm = planner.Problem.manipulator(
        [5, 5, 5, 5], tip_m=[0.6, 0.6], link_lengths=[0.3, 0.3, 0.2, 0.2], joint_deg=80,
        input_rad_s=0.5, duration=None,
    )  # fmt: skip
    plan = planner.solve(arm, starts=1, attempts=2)
    np.testing.assert_allclose(tip(plan), [0.6, 0.6], atol=2e-5)


def test_on_the_machine_tracked_and_compensated(
    problem: planner.Problem, plan: planner.Plan
) -> None:
    """The goal that was found is then fixed: what is tracked and aimed at is the plan's end."""
    machine = Machine.prototype(step_s=0.01)
    run = planner.replay(plan, machine, samples=2, feedback=True)
    assert np.max(run.terminal_E_deg) < 0.5
    better = planner.compensate(plan, machine)
    assert better.verified
    loose, aimed = (planner.replay(each, machine.nominal(), samples=1) for each in (plan, better))
    assert np.max(aimed.terminal_E_deg) < 0.02 < np.max(loose.terminal_E_deg)
    assert better.problem == problem
    np.testing.assert_allclose(tip(plan, aimed.q[0, -1]), [0.4964, 0.6598], atol=5e-4)
