"""Certificates of the planner's own plans, of every kind of trajectory."""

import json
from contextvars import copy_context
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outside import integrate
from scipy.interpolate import BPoly

import planner
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory
from planner.problem.requirements.ends import TipGoal
from planner.problem.requirements.places import Waypoint
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.support import deadline
from planner.support.deadline import TimeUpError, time_limit
from planner.verification.evidence import STANDSTILL_REASON
from planner.verification.input_models import enclose_trajectory
from planner.verification.place_proofs import distance_bounds

PROBLEMS = Path(__file__).parents[2] / "problems"


def _solved(name: str, method: str, **options: Any) -> planner.Plan:
    return planner.solve(planner.load_problem(PROBLEMS / f"{name}.toml"), method, **options)


def _agrees_with_verify(plan: planner.Plan) -> planner.Certificate:
    """The same requirements under the same names, and no margin better than the sampled one."""
    certificate, check = plan.certificate, planner.verify(plan)
    assert certificate is not None
    names = {c.label for c in certificate.claims} - {"chart domain"}
    assert names >= {n for n in check.margins if n.startswith(("input", "rate", "joint", "z2"))}
    for label in names:
        if not label.startswith(("goal", "start", "duration", "plan's")):  # margins of a tolerance
            assert certificate[label].guaranteed <= check.margins[label] + 1e-9, label
    error = max(certificate.motion_error.values())
    assert check.interpolant_error <= error * (1 + 1e-6) + 1e-10
    return certificate


def test_the_optimal_plan_is_proven(optimal: planner.Plan) -> None:
    certificate = _agrees_with_verify(optimal)
    assert certificate.ok, str(certificate)
    assert max(certificate.motion_error.values()) < 1e-6
    assert str(certificate).startswith("all 12 requirements proven between the nodes")
    assert not certificate["chart domain"].required


@pytest.mark.parametrize(
    ("name", "method"),
    [("ball-gear", "polynomial"), ("trailers", "collocation"), ("paper", "convex")],
)
def test_other_kinds_of_plans_are_proven(name: str, method: str) -> None:
    options = {"pieces": 30, "scan": 5} if method == "convex" else {}
    certificate = _agrees_with_verify(_solved(name, method, **options))
    assert certificate.ok, str(certificate)


def test_retimed_plans_are_proven(optimal: planner.Plan, retimed: planner.Plan) -> None:
    """And the times of claims are those of the clock, not of the path."""
    for plan in (retimed, planner.retime(_solved("ball-gear", "polynomial"))):
        certificate = _agrees_with_verify(plan)
        assert certificate.ok, str(certificate)
        assert min(certificate[f"input u{i}"].guaranteed for i in (1, 2)) < 1e-6
    assert retimed.duration < 0.9 * optimal.duration
    certificate = planner.certify(retimed)
    assert certificate["goal theta1"].time_s == pytest.approx(retimed.duration, rel=1e-12)
    claim = certificate["chart domain"]
    assert claim.time_s is not None
    at, problem = retimed.q(claim.time_s), retimed.problem
    least = problem.system.chart_margins(at, problem.branch).min()
    assert least == pytest.approx(claim.attained, abs=1e-8)


def test_a_goal_of_the_tip_is_proven_at_the_end_alone(optimal: planner.Plan) -> None:
    arm: Any = optimal.problem.system
    x, y = arm.arm_points(optimal.q(optimal.duration)[1:])[-1]
    for off, status in ((0.0, "proven"), (1e-3, "violated")):
        tip = TipGoal(("x", "y"), (x + off, y), 3.0)
        certificate = planner.certify(replace(optimal, problem=replace(optimal.problem, tip=tip)))
        assert certificate["goal tip x"].status == status
        assert certificate["goal tip y"].status == "proven"
        assert certificate["goal tip y"].time_s == optimal.duration


@dataclass(frozen=True)
class _Turning(Requirement):
    """(du₁/dt)² ≤ 1, of which there is no proof."""

    reads = frozenset({"du"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("square of a rate", "", -np.inf, 1.0, 1.0),)

    def rows(self, point: MotionPoint) -> list[Any]:
        return [point.du[0] ** 2]


def test_a_function_of_the_rates_is_undecided_and_says_why(optimal: planner.Plan) -> None:
    asked = replace(optimal.problem, registered_limits=(_Turning(),))
    claim = planner.certify(replace(optimal, problem=asked))["square of a rate"]
    assert claim.status == "undecided"
    assert "there is no proof" in claim.why


def test_a_certificate_lists_requirements_in_the_order_of_the_problem(
    optimal: planner.Plan,
) -> None:
    own = {part.label: part.unit for each in optimal.problem.demands for part in each.parts}
    certificate = planner.certify(optimal)
    labels = [claim.label for claim in certificate.claims[:-1]]
    assert labels == [label for label in own if label in labels]
    assert {
        claim.unit for claim in certificate.claims if claim.unit != own.get(claim.label, "")
    } == set()


def test_a_retimed_plan_too_fast_is_not_proven(retimed: planner.Plan) -> None:
    free = retimed.problem.changed({"goal.duration": "free"})
    faster = replace(retimed, problem=free, trajectory=retimed.trajectory.slowed(1 - 2e-6))
    broken = planner.certify(faster).open
    assert {c.status for c in broken} == {"violated"}
    assert {c.label for c in broken} <= {"input u1", "input u2"}


def test_standstill_of_a_retimed_path_is_undecided_and_says_why(paper: planner.Problem) -> None:
    """θ₁ starts from rest on its path, and u₁ with it: length' = 0 there."""
    q = np.stack([paper.start + np.array([0.0, share, 0.0, 0.0]) for share in (0.0, 0.0, 0.1)])
    u = np.array([[0.0, 0.0], [0.0, 0.2]])
    path = StateTrajectory(
        paper.system, BPoly(q[:, None], [0.0, 1.0]), BPoly(u[:, None], [0.0, 1.0])
    )
    length = BPoly(np.array([[0.0], [0.0], [0.1]]), [0.0, 1.0])
    clock = BPoly(np.array([[0.0], [0.1]]), [0.0, 1.0])
    retimed = RetimedTrajectory(path, length, clock, np.array([0.0, 1.0]))
    certificate = planner.certify(planner.Plan(paper, "by hand", {}, retimed))
    assert certificate["input u2"].status == "undecided"
    assert certificate["input u2"].why == STANDSTILL_REASON
    assert certificate["joint theta1"].status == "proven"


@dataclass(frozen=True, repr=False, eq=False)
class Unheard(StateTrajectory):
    """A kind of trajectory that nothing is known of."""

    kind = "unheard"


def test_what_nothing_is_known_of_is_undecided_and_says_why(optimal: planner.Plan) -> None:
    path = optimal.trajectory
    assert isinstance(path, StateTrajectory)
    other = Unheard(path.system, path.q_curve, path.u_curve)
    certificate = planner.certify(replace(optimal, trajectory=other))
    assert not certificate.ok
    assert all(c.status == "undecided" for c in certificate.claims)
    assert "trajectories of kind 'unheard'" in str(certificate)
    assert np.isinf(certificate.motion_error["theta1"])


@pytest.mark.parametrize(
    "method",
    [
        "polynomial",
        pytest.param("piecewise", marks=pytest.mark.campaign),
        pytest.param("convex", marks=pytest.mark.campaign),
    ],
)
def test_laws_of_a_system_whose_chart_is_solved_numerically(method: str) -> None:
    """Also retimed; and by another integrator, the bound on the motion holds."""
    plan = _solved("custom", method)
    assert plan.certificate is not None
    for made in (plan, planner.retime(plan)):
        certificate = planner.certify(made)
        assert certificate.ok, str(certificate)
        motion, times = integrate(made)
        away = np.max(np.abs(motion(times) - made.q(times)), axis=0)
        bounds = np.array(list(certificate.motion_error.values()))
        assert np.all(away <= bounds + 1e-10)
        assert np.max(bounds) < 1e-7
    limits = plan.problem.limits.input
    peak = np.max(np.abs(plan.u(np.linspace(0.0, plan.duration, 20001))), axis=0)
    for i, label in enumerate(("input speed", "input turn rate")):
        assert plan.certificate[label].guaranteed == pytest.approx(limits[i] - peak[i], abs=1e-4)


def test_a_law_in_a_chart_that_drifts() -> None:
    """z2 reads y too, so that its rate has a part that does not come from v2."""
    problem = planner.load_problem(PROBLEMS / "custom.toml")
    drifting = problem.changed({"system.slopes": ["tan(heading) + 0.2*y", "y"]})
    plan = planner.solve(drifting, "polynomial")
    assert plan.certificate is not None
    assert plan.certificate.ok, str(plan.certificate)


def test_a_chart_that_is_solved_numerically_is_no_better_than_its_curves() -> None:
    """A coefficient of z moved by 1e-3: the motion ends elsewhere, and is found to."""
    plan = _solved("custom", "polynomial")
    path = plan.trajectory
    assert isinstance(path, ChainedTrajectory)
    v = path.v_curve.c.copy()
    v[1, 0, 1] += 1e-3
    moved = replace(path, v_curve=BPoly(v, path.v_curve.x))
    certificate = planner.certify(replace(plan, trajectory=moved))
    assert "violated" in {claim.status for claim in certificate.open}


def test_a_path_outside_the_chart_is_not_certified() -> None:
    plan = _solved("paper-fig5", "polynomial", allow_singular=True)
    assert plan.certificate is None
    certificate = planner.certify(plan)
    claim = certificate["chart domain"]
    assert claim.status == "violated"
    assert claim.time_s == pytest.approx(8.0, abs=0.1)
    assert {c.status for c in certificate.claims if c != claim} == {"undecided"}


def test_a_certificate_is_saved_and_read_back(optimal: planner.Plan, tmp_path: Path) -> None:
    for plan in (optimal, replace(optimal, certificate=None)):
        back = planner.load_plan(plan.save(tmp_path / "plan.json"))
        assert back.certificate is not None
        assert optimal.certificate is not None
        assert back.certificate.claims == optimal.certificate.claims
    assert back.certificate != optimal.certificate  # its time is its own
    certificate = planner.certify(_solved("paper-fig5", "polynomial", allow_singular=True))
    stored = json.dumps(certificate.to_dict(), allow_nan=False)
    again = planner.plan.claims.certificate_from_dict(json.loads(stored))
    assert str(again) == str(certificate)
    assert again.claims[0] == certificate.claims[0]


@pytest.mark.parametrize("judged", [planner.verify, planner.certify])
def test_a_stop_ends_it_and_a_time_limit_does_not(judged: Any, optimal: planner.Plan) -> None:
    with time_limit(1e-9):
        judged(optimal)
        deadline.end(copy_context(), "the Stop button")
        with pytest.raises(TimeUpError):
            judged(optimal)


def test_the_distance_at_a_time_holds_wherever_the_time_may_be(optimal: planner.Plan) -> None:
    """A time known to within a slip: the bounds hold at all times so near, and are not vague."""
    _, motion, _ = enclose_trajectory(optimal.trajectory, optimal.problem.start)
    given, slip = np.array([np.nan, 0.3, np.nan, np.nan]), 0.01
    point = Waypoint(1, given, 4.0, "rad", optimal.problem.system)
    for time in np.linspace(0.5, 9.5, 19):
        low, high = distance_bounds(motion.cells, motion.states, point, float(time), slip)
        near = abs(optimal.q(time + slip * np.linspace(-1, 1, 11))[:, 1] - 0.3)
        assert low <= near.min() + 1e-5  # the plan's own curve is not quite the motion
        assert near.max() <= high + 1e-5
        assert high - low < 0.1


def test_a_waypoint_at_any_time_is_proven_where_no_sample_is(optimal: planner.Plan) -> None:
    rng = np.random.default_rng(0)
    for time in rng.uniform(0.3, 9.7, 10):
        place = np.rad2deg(optimal.q(time)[1:] + 1e-5).tolist()
        problem = optimal.problem.changed({"waypoints": [{"theta_deg": place}]})
        claim = planner.certify(replace(optimal, problem=problem))["distance from waypoint 1"]
        assert claim.status == "proven"
        assert claim.guaranteed > 2e-5 - 1.1e-5
        assert claim.time_s == pytest.approx(time, abs=1e-3)
    far = np.rad2deg(optimal.q(5.0)[1:] + 0.2).tolist()
    problem = optimal.problem.changed({"waypoints": [{"theta_deg": far}]})
    claim = planner.certify(replace(optimal, problem=problem))["distance from waypoint 1"]
    assert claim.status != "proven"
