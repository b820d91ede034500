"""Certificates of plans made by hand: what is violated by a hair must not be certified."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from by_hand import by_hand as crude
from hypothesis import given, settings
from hypothesis import strategies as st
from outside import integrate
from scipy.interpolate import BPoly

import planner
from planner.problem.requirements.ends import TipGoal


def by_hand(problem: planner.Problem, corners: np.ndarray, duration: float) -> planner.Plan:
    """A plan with linear inputs between corners (K+1, 2), whose q(t) is a crude cubic spline."""
    breaks = np.linspace(0, duration, len(corners))
    u = BPoly(np.stack([corners[:-1], corners[1:]]), breaks)
    guess = np.zeros((4, len(corners) - 1, problem.system.size)) + problem.start
    plan = crude(problem, BPoly(guess, breaks), u)
    motion, _ = integrate(plan, rtol=1e-12, atol=1e-13)
    c = np.empty_like(guess)
    for k, (a, b) in enumerate(pairwise(breaks)):
        times = np.array([a, np.nextafter(b, a)])
        ends = motion(times)
        slopes = problem.system.rates(ends, plan.u(times)) * (b - a) / 3
        c[:, k] = ends[0], ends[0] + slopes[0], ends[1] - slopes[1], ends[1]
    return crude(problem, BPoly(c, breaks), u)


@pytest.fixture(scope="module")
def arc(paper: planner.Problem) -> planner.Plan:
    """θ₁ = 1° + 2t − 4t²: it peaks at t = 0.25 s with a curvature of 8 rad/s²."""
    problem = paper.changed(
        {"limits": {"joint_deg": 80.0}, "goal.duration": 0.4, "goal.theta_deg": [10, 5, 5]}
    )
    return by_hand(problem, np.linspace([0.3, 2.0], [0.3, 2.0 - 8 * 0.4], 17), 0.4)


PEAK = np.deg2rad(1) + 0.25


@pytest.mark.parametrize(("excess", "status"), [(1e-6, "violated"), (-1e-6, "proven")])
def test_a_hair_over_a_limit(arc: planner.Plan, excess: float, status: str) -> None:
    """1e-6 rad for 1e-3 s, which sampling at 1 ms may well miss; the least |z₂| of DOP853."""
    motion, _ = integrate(arc, rtol=1e-12, atol=1e-13)
    z = planner.chained_form(arc.problem.system).z(motion(np.linspace(0, 0.4, 100001)))
    least = float(np.min(arc.problem.z2_sign * z[:, 1]))
    limits = {
        "joint_deg": float(np.rad2deg(PEAK - excess)),
        "input_rad_s": [0.3 - excess, 3.0],
        "z2_margin": 1e-4,
    }
    problem = arc.problem.changed({"limits": limits})
    exact = replace(problem, limits=replace(problem.limits, z2_margin=least + excess))
    certificate = planner.certify(replace(arc, problem=exact))
    for label in ("joint theta1", "input u1", "z2 margin"):
        assert certificate[label].status == status
        assert certificate[label].guaranteed <= -excess + 1e-9
    claim = certificate["joint theta1"]
    assert claim.time_s == pytest.approx(0.25, abs=1e-3)
    assert claim.guaranteed == pytest.approx(-excess, abs=1e-9)
    assert claim.attained == pytest.approx(-excess, abs=1e-9)


@pytest.mark.parametrize("length", [0.5, 2.0])
def test_the_way_to_a_disc_beyond_the_tip_of_links_of_any_length(
    paper: planner.Problem, length: float
) -> None:
    changes = {"system.link_lengths": 3 * [length], "goal.duration": 10.0}
    bare = planner.solve(paper.changed(changes), "collocation")
    theta = bare.q(np.linspace(0.0, bare.duration, 2001))[:, 1:]
    tips = bare.problem.system.arm_points(theta)[:, -1]
    centre = 1.3 * tips[len(tips) // 2]
    away = float(np.min(np.linalg.norm(tips - centre, axis=1)))
    for radius, status in ((away - 1e-5 * length, "proven"), (away + 1e-5 * length, "violated")):
        disc = {"centre_m": centre.tolist(), "radius_m": radius}
        plan = replace(bare, problem=bare.problem.changed({"obstacles": [disc]}))
        claim = planner.certify(plan)["clearance of link 3 from obstacle 1"]
        assert claim.status == status
        assert claim.attained == pytest.approx(away - radius, abs=1e-6)  # sampled


def test_the_way_to_discs_beside_links_is_known_to_a_nanometre(arc: planner.Plan) -> None:
    """Each is on the perpendicular of a link's middle half way in time; at 20001 times."""
    motion, _ = integrate(arc)
    points = arc.problem.system.arm_points(motion(np.linspace(0.0, 0.4, 20001))[:, 1:])
    middles, links = (points[:, 1:] + points[:, :-1]) / 2, np.diff(points, axis=1)
    sides = links[10000] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    centres = middles[10000] + 0.3 * sides
    discs = [{"centre_m": centre.tolist(), "radius_m": 0.1} for centre in centres]
    problem = arc.problem.changed({"obstacles": discs})
    certificate = planner.certify(replace(arc, problem=problem))
    for n, centre in enumerate(centres, 1):
        off = centre - points[:, :-1]
        share = np.clip(np.sum(off * links, axis=2) / np.sum(links**2, axis=2), 0.0, 1.0)
        away = np.min(np.linalg.norm(off - share[..., None] * links, axis=2), axis=0)
        for k, least in enumerate(away, 1):
            claim = certificate[f"clearance of link {k} from obstacle {n}"]
            assert claim.guaranteed == pytest.approx(least - 0.1, abs=1e-9)
            assert claim.attained == pytest.approx(least - 0.1, abs=1e-9)


def test_the_verdict_names_what_is_open(arc: planner.Plan) -> None:
    """The arc misses its goal, so that the certificate as a whole must not hold."""
    certificate = planner.certify(arc)
    assert not certificate.ok
    assert {c.label for c in certificate.open} == {"goal theta1", "goal theta2", "goal theta3"}
    assert "goal theta1: violated by" in str(certificate)
    assert certificate["joint theta1"].status == "proven"


def test_bounds_on_the_distance_to_the_goal_hold_the_true_one(paper: planner.Problem) -> None:
    """θ₁ winds up by 40 rad and back, after which θ₃ is known to 1.6e-3 rad only."""
    problem = paper.changed({"system.link_lengths": [1.0, 1.0, 1.0], "limits": {}})
    slow = problem.changed({"goal.duration": 40.0})
    wound = by_hand(slow, np.linspace([0.3, 4.0], [0.3, -4.0], 5), 40.0)
    end = wound.q(40.0)[1:]
    x, y = problem.system.arm_points(end)[-1]  # type: ignore[attr-defined]
    for off in (-1e-2, -2e-3, -5e-4, 0.0, 5e-4, 2e-3, 1e-2):
        goal = slow.changed({"goal.theta_deg": np.rad2deg([*end[:2], end[2] + off]).tolist()})
        tip = TipGoal(("x", "y"), (x, y + off), 3.0)
        certificate = planner.certify(replace(wound, problem=replace(goal, tip=tip)))
        for label, slack in (("goal theta3", 2e-5), ("goal tip y", 6e-5)):
            claim = certificate[label]
            assert claim.status == ("violated" if abs(off) >= 2e-3 else "undecided")
            assert claim.guaranteed < slack - abs(off) < claim.attained
            assert claim.attained - claim.guaranteed < 4e-3
        assert certificate["goal theta1"].status == "proven"


def test_rates_and_jumps(arc: planner.Plan) -> None:
    limited = arc.problem.changed({"limits.input_rate_rad_s2": [1.0, 8.0]})
    certificate = planner.certify(replace(arc, problem=limited))
    assert certificate["rate of input u2"].guaranteed == pytest.approx(0.0, abs=1e-9)
    assert certificate["rate of input u2"].status == "proven"
    jumping = np.array([[[0.1, 0.0], [0.2, 0.0]]])
    breaks = np.array([0.0, 0.2, 0.4])
    still = BPoly(np.zeros((1, 2, 4)) + limited.start, breaks)
    certificate = planner.certify(crude(limited, still, BPoly(jumping, breaks)))
    assert certificate["rate of input u1"].status == "violated"
    assert certificate["rate of input u1"].time_s == pytest.approx(0.2)
    assert certificate["rate of input u1"].attained == -np.inf  # no rate is as great as a jump's
    assert certificate["rate of input u2"].status == "proven"


@settings(max_examples=8)
@given(st.integers(0, 10**6))
def test_certified_margins_are_no_greater_than_true_ones(seed: int) -> None:
    """Against DOP853 to 1e-12, at 20001 times."""
    rng = np.random.default_rng(seed)
    root = Path(__file__).parents[2]
    problem = planner.load_problem(root / "problems/paper.toml").changed(
        {"limits": {"joint_deg": 75.0, "input_rad_s": 0.9, "z2_margin": 1e-4}}
    )
    plan = by_hand(problem, rng.uniform([0.05, 0.0], [0.3, 0.25], size=(6, 2)), 4.0)
    motion, _ = integrate(plan, rtol=1e-12, atol=1e-13)
    times = np.linspace(0, 4.0, 20001)
    truth = motion(times)
    form, system = planner.chained_form(problem.system), problem.system
    z2 = problem.z2_sign * form.z(truth)[:, 1] - 1e-4
    true = {
        "z2 margin": z2,
        "chart domain": np.min(system.chart_margins(truth, problem.branch), axis=1),
        **{f"joint theta{i}": problem.limits.joint[i] - np.abs(truth[:, i]) for i in (1, 2, 3)},
        **{f"input u{i + 1}": 0.9 - np.abs(plan.u(times)[:, i]) for i in range(2)},
    }
    certificate = planner.certify(plan)
    for label, margins in true.items():
        claim = certificate[label]
        least = float(np.min(margins))
        assert np.isfinite(claim.guaranteed)
        assert claim.guaranteed <= least + 1e-9, label
        assert claim.attained >= claim.guaranteed
        assert claim.attained <= least + 1e-9, label
    gaps = np.max(np.abs(truth - plan.q(times)), axis=0)
    bounds = np.array(list(certificate.motion_error.values()))
    assert np.all(gaps <= bounds + 1e-11)
    assert np.all(bounds <= 1.2 * gaps + 1e-8)


def test_a_perturbed_interpolant_has_a_larger_error_bound(arc: planner.Plan) -> None:
    motion, times = integrate(arc, rtol=1e-12, atol=1e-13)
    bounds = []
    for size in (0.0, 1e-7, 1e-5, 1e-2):
        c = arc.trajectory.q_curve.c.copy()  # type: ignore[attr-defined]
        c[1, :, 2] += size
        curve = BPoly(c, arc.t)
        trajectory = replace(arc.trajectory, q_curve=curve)  # type: ignore[type-var]
        bound = planner.certify(replace(arc, trajectory=trajectory)).motion_error["theta2"]
        assert bound >= np.max(np.abs(motion(times)[:, 2] - curve(times)[:, 2])) - 1e-11
        bounds.append(bound)
    assert bounds == sorted(bounds)
    assert bounds[-1] > 4e-3 > 100 * bounds[-2]
