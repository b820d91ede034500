"""Links of an arm that keep clear of each other: what a file may say, formulas, judge, proof."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import minimize

import planner
from planner import Manipulator
from planner.plan.trajectory import StateTrajectory
from planner.problem.requirements.requirement import MotionPoint
from planner.problem.requirements.self_collision import SelfCollision
from planner.systems.manipulator import prototype_ratios

LENGTHS = [0.3, 0.2, 0.2, 0.3]


def arm(joints: int = 4) -> Manipulator:
    return Manipulator(prototype_ratios(joints), 0.668811, [0.3, 0.2, 0.2, 0.3, 0.15][:joints])


def folding(clearance: float | None = 0.05, **more: Any) -> planner.Problem:
    changes = {} if clearance is None else {"limits.self_clearance_m": clearance}
    return planner.Problem.manipulator(
        [5, 20, 20, 20], [5, 70, 70, 40], link_lengths=LENGTHS, changes=changes, **more
    )


def clearance_of(problem: planner.Problem) -> SelfCollision:
    assert problem.self_collision is not None
    return problem.self_collision


def by_search(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
    """The distance of two segments, by a convex programme."""

    def gap(s: np.ndarray) -> float:
        return float(np.sum((a + s[0] * (b - a) - c - s[1] * (d - c)) ** 2))

    return float(np.sqrt(minimize(gap, (0.5, 0.5), bounds=[(0, 1)] * 2, tol=1e-14).fun))


def poses(count: int, joints: int = 4) -> Iterator[np.ndarray]:
    rng, system = np.random.default_rng(3), arm(joints)
    yield from system.arm_points(rng.uniform(-1.5, 1.5, (count, joints)))
    yield from system.arm_points(rng.uniform(1.2, 1.5, (count, joints)))


def test_the_least_distance_is_that_of_the_segments() -> None:
    required, crossed = SelfCollision.of(0.05, arm()), 0
    for points in poses(12):
        least = min(
            by_search(points[i - 1], points[i], points[j - 1], points[j])
            for i, j in required.link_pairs
        )
        found = min(float(value) for value in required.distances(points))
        crossed += least < 1e-4
        if least < 1e-4:
            assert found <= 0
        else:
            assert found == pytest.approx(least, abs=1e-5)
    assert 0 < crossed < 24


def test_what_crosses_is_as_far_inside_as_its_nearest_end() -> None:
    """A link through the middle of the first: the way out is that of its end."""
    required = SelfCollision(4, 0.05)
    points = np.array([[0, 0], [0.3, 0], [0.3, 0.2], [0.12, 0.2], [0.1, -0.04]])
    values = dict(zip(required.joint_link_pairs, required.distances(points), strict=True))
    assert min(values.values()) == pytest.approx(-0.04)
    assert values[4, 1] == pytest.approx(-0.04)
    assert values[0, 4] == pytest.approx(-0.04)
    assert values[4, 2] > 0
    place, touched, away = required.nearest_pair(points)
    np.testing.assert_allclose([place, touched], [[0.1, -0.04], [0.1, 0]], atol=1e-15)
    assert away == pytest.approx(-0.04)


@pytest.mark.parametrize(("joints", "count"), [(3, 4), (4, 10), (5, 18)])
def test_parts_are_joints_and_links_that_are_not_beside_each_other(joints: int, count: int) -> None:
    required = SelfCollision.of(0.05, arm(joints))
    assert len(required.parts) == len(required.joint_link_pairs) == count
    assert all(link not in (place, place + 1) for place, link in required.joint_link_pairs)
    labels = [part.label for part in required.parts]
    assert len(set(labels)) == count
    assert "clearance of joint 1 from link 3" in labels
    assert "clearance of the tip from link 1" in labels
    assert required.fault(arm(joints)) is None


def test_rows_have_the_slope_of_the_distance_at_contact() -> None:
    import casadi as ca

    required, system = SelfCollision.of(0.05, arm()), arm()
    q = ca.SX.sym("q", 5)
    rows = ca.vertcat(*required.rows(MotionPoint(system, q)))
    both = ca.Function("rows", [q], [rows, ca.jacobian(rows, q)])
    rng, seen = np.random.default_rng(0), 0
    at = np.column_stack([np.zeros(20000), rng.uniform([-1, 0.8, 0.8, 0.8], 1.5, (20000, 4))])
    values = np.stack(required.values(MotionPoint.of(system, at)), axis=1)
    close = (np.abs(values - 0.05) < 2e-3) & (np.min(values, axis=1) > 0)[:, None]
    for state, k in [(at[n], k) for n, k in np.argwhere(close)[:40]]:
        found, slope = (np.asarray(x) for x in both(state))
        sides = np.stack([state + 1e-6 * np.eye(5), state - 1e-6 * np.eye(5)])
        there = np.stack(
            required.values(
                MotionPoint.of(system, np.append(sides, state[None, None].repeat(2, 0), 1))
            )
        )
        assert found[k, 0] == pytest.approx(float(there[k, 0, -1]), abs=1e-4)
        wanted = (there[k, 0, :5] - there[k, 1, :5]) / 2e-6
        np.testing.assert_allclose(slope[k], wanted, atol=0.05 * np.max(np.abs(wanted)) + 1e-6)
        seen += 1
    assert seen == 40


def test_a_file_says_it_and_no_more_is_asked_by_default() -> None:
    problem = folding(0.05)
    required = problem.self_collision
    assert required == SelfCollision(4, 0.05)
    assert required in problem.requirements
    assert planner.Problem.from_dict(problem.to_dict()) == problem
    assert not any(isinstance(each, SelfCollision) for each in folding(None).demands)
    assert not problem.divided


@pytest.mark.parametrize(
    ("problem", "clearance", "changes", "said"),
    [
        (folding(None), 0.0, {}, "limits.self_clearance_m"),
        (folding(None), 0.2, {},
         "'limits.self_clearance_m': 0.2 m must be less than the shortest inner link"),
        (planner.Problem.manipulator([10, 20], [20, 30]), 0.1, {},
         "'limits.self_clearance_m': an arm of 2 links has only neighbouring links"),
        (folding(None), 0.1, {"goal.theta_deg": [5, 80, 80, 70]},
         "contradiction: at the goal the clearance of"),
        (folding(None), 0.1, {"start.theta_deg": [5, 80, 80, 89]},
         "contradiction: at the start links cross ("),
    ],
)  # fmt: skip
def test_contradictions_are_named(
    problem: planner.Problem, clearance: float, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(planner.InputError) as refused:
        problem.changed({"limits.self_clearance_m": clearance, **changes})
    assert said in str(refused.value)


def swung(problem: planner.Problem, u2: float, seconds: float) -> planner.Plan:
    """θ₁ turns and nothing else: the arm keeps its shape."""
    start = problem.start
    end = start + u2 * seconds * np.eye(5)[1]
    curve = BPoly(np.stack([start, end])[:, None], [0.0, seconds])
    u = BPoly(np.array([[[0.0, u2]]]), curve.x)
    return planner.Plan(problem, "collocation", {}, StateTrajectory(problem.system, curve, u))


def driven(problem: planner.Problem, u1: float, seconds: float) -> planner.Plan:
    """The drive runs: all passive joints fold; the motion by an integrator of its own."""
    from scipy.integrate import solve_ivp

    system, times = problem.system, np.linspace(0.0, seconds, 41)
    u = np.array([u1, 0.0])
    run = solve_ivp(
        lambda t, q: system.rates(q, u), (0, seconds), problem.start, t_eval=times,
        rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    rates = np.array([system.rates(q, u) for q in run.y.T])
    curve = BPoly.from_derivatives(times, np.stack([run.y.T, rates], axis=1))
    inputs = BPoly(np.broadcast_to(u, (1, 40, 2)).copy(), times)
    return planner.Plan(problem, "collocation", {}, StateTrajectory(system, curve, inputs))


@pytest.fixture(scope="module")
def folded() -> planner.Plan:
    """An arm that folds until its last link comes near the first."""
    start = {"start.theta_deg": [5, 60, 60, 40], "goal.theta_deg": [5, 60, 60, 41]}
    return driven(folding(None).changed(start), 1.0, 2.2)


def exact_least(plan: planner.Plan) -> float:
    system: Any = plan.problem.system
    points = system.arm_points(plan.q(np.linspace(0, plan.duration, 40001))[:, 1:])
    return float(np.min(SelfCollision.of(0.05, system).distances(points)))


def kept(plan: planner.Plan, clearance: float) -> planner.Plan:
    problem = plan.problem.changed({"limits.self_clearance_m": clearance})
    return planner.Plan(problem, plan.method, {}, plan.trajectory)


def test_judge_and_proof_agree_with_dense_samples(folded: planner.Plan) -> None:
    least = exact_least(folded)
    assert 0.02 < least < 0.2
    for clearance, ok in ((least - 1e-4, True), (least + 1e-4, False)):
        plan = kept(folded, clearance)
        check, certificate = planner.verify(plan), planner.certify(plan)
        labels = [part.label for part in clearance_of(plan.problem).parts]
        margins = {label: check.margins[label] for label in labels}
        assert min(margins.values()) == pytest.approx(least - clearance, abs=1e-8)
        assert all(v.label not in labels for v in check.violations) == ok
        worst = min(margins, key=margins.__getitem__)
        assert certificate[worst].status == ("proven" if ok else "violated")
        assert certificate[worst].attained == pytest.approx(least - clearance, abs=1e-6)
        others = {certificate[label].status for label in labels if label != worst}
        assert others == {"proven"}


def test_links_that_cross_between_the_samples_of_ends_are_broken() -> None:
    """The arm folds on until its last link lies across the first."""
    start = {"start.theta_deg": [5, 70, 70, 40], "goal.theta_deg": [5, 70, 70, 41]}
    crossed = kept(driven(folding(None).changed(start), 1.0, 8.0), 0.02)
    assert exact_least(crossed) < -0.01
    broken = {v.label: v for v in planner.verify(crossed).violations if "clearance" in v.label}
    assert min(v.value for v in broken.values()) < -0.01
    certificate = planner.certify(crossed)
    assert "violated" in {certificate[label].status for label in broken}
    assert not certificate.ok


def test_a_shape_that_only_turns_keeps_its_distances() -> None:
    problem = folding(0.05)
    plan = swung(problem, 0.2, 2.0)
    check = planner.verify(plan)
    start = [
        float(v)
        for v in clearance_of(problem).values(MotionPoint.of(problem.system, problem.start))
    ]
    for part, value in zip(clearance_of(problem).parts, start, strict=True):
        assert check.margins[part.label] == pytest.approx(value - 0.05, abs=1e-9)
        claim = planner.certify(plan)[part.label]
        assert claim.guaranteed == pytest.approx(value - 0.05, abs=1e-9)
        assert claim.guaranteed <= value - 0.05 + 1e-12


def test_other_requirements_are_worded_as_changes() -> None:
    required = SelfCollision(4, 0.05)
    part = required.parts[0]
    near, across = (planner.Violation(part, v, 0.05, 1.0, required) for v in (0.04, -0.04))
    assert SelfCollision.easing([near]) == "limits.self_clearance_m = 0.03996 or less"
    assert SelfCollision.easing([across]) == "another start or goal"
    assert required.removal() == (
        {"limits.self_clearance_m": None},
        "",
        "the links' clearance",
    )
