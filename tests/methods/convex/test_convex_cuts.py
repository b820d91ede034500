"""The convex optimum at one travel: the figures of the paper's example, a second code path, proofs.

The reference is a CasADi programme with IPOPT on the same pieces. It shares no code with the
planner: z is advanced by its own Taylor steps, and the domain is tested at many points a piece.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog

import planner
from planner.methods.convex.band import Band, band_of
from planner.methods.convex.global_optimum import (
    BoundAboveCeiling,
    ClassOptimum,
    EmptyClass,
    band_rows,
    optimum_by_cuts,
)
from planner.methods.convex.paths import Frame
from planner.methods.convex.programme import Programme, StalledError

Frames = Callable[..., Frame]
SMOOTH, PEAK = Programme("smooth"), Programme("peak")


def band_at(problem: planner.Problem, frame: Frame, edge: float = 0.0) -> Band:
    return band_of(problem, frame.start, frame.goal, edge)


def reference(frame: Frame, band: Band, kind: str, samples: int = 8) -> float:
    """Least ½∫(dz₂/ds)²|ds| ("smooth") or max |dz₂/dτ| ("peak") with v₂ constant on pieces."""
    K2, K3 = band.K
    opti, pieces = ca.Opti(), frame.shape.pieces
    omega, h, D = opti.variable(pieces), 1 / pieces, frame.travel
    a, b, c = (ca.MX(v) for v in frame.start[1:])
    for k in range(pieces):
        for t in h * np.arange(1, samples + 1) / samples:
            z2 = a + omega[k] * t
            z3 = b + D * (a * t + omega[k] * t**2 / 2)
            z4 = c + D * b * t + D**2 * (a * t**2 / 2 + omega[k] * t**3 / 6)
            if k < pieces - 1 or t < h * (1 - 1e-9):
                root = (z3 / K3) ** (1 / 3)
                cap = 3 * K2 * K3 * root**2 * ca.sqrt(1 - root**2)
                opti.subject_to(opti.bounded(band.floor, band.sign * z2, band.cap_factor * cap))
        a, b, c = z2, z3, z4
    for end, value in zip((a, b, c), frame.goal[1:], strict=True):
        opti.subject_to(end == value)
    if kind == "smooth":
        cost = ca.sumsqr(omega) * h / 2 / abs(D)
    else:
        cost = opti.variable()
        opti.subject_to(opti.bounded(-cost, omega, cost))
    opti.minimize(cost)
    opti.set_initial(omega, float(frame.goal[1] - frame.start[1]))
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-10}
    quiet["expand"] = True  # half the time
    opti.solver("ipopt", quiet)
    return float(opti.solve().value(cost))


@pytest.mark.parametrize(
    ("travel", "value"), [(0.79, 0.562706), (0.80, 0.282433), (0.82, 0.157369), (0.83, 0.222463)]
)
def test_figures_of_the_example(
    printed: planner.Problem, frame_at: Frames, travel: float, value: float
) -> None:
    """v₂ piecewise constant on 60 pieces gives them to the last printed digit."""
    frame = frame_at(travel)
    best = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH)
    assert isinstance(best, ClassOptimum)
    assert best.value == pytest.approx(value, abs=5.1e-7)
    effort = np.sum(best.frame.x(best.y) ** 2) / 2 / best.frame.travel
    assert effort == pytest.approx(best.value, rel=1e-12)
    assert 0 <= best.gap < 1e-6
    assert best.proven <= 0


def test_continuous_v2_does_not_give_those_figures(
    printed: planner.Problem, frame_at: Frames
) -> None:
    frame = frame_at(0.79, degree=1)
    best = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH)
    assert isinstance(best, ClassOptimum)
    assert best.value == pytest.approx(0.561116, abs=1e-6)
    assert 0 <= best.gap < 1e-6


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("programme", [SMOOTH, PEAK])
@pytest.mark.parametrize("travel", [0.787, 0.895])
def test_certificate_checked_independently(
    printed: planner.Problem, frame_at: Frames, travel: float, programme: Programme, degree: int
) -> None:
    """Inside the window of one-way motions, yet no path of the class keeps z₂ ≤ −0.01."""
    assert travel in planner.travel_window(printed)
    frame = frame_at(travel, pieces=30, degree=degree)
    band = band_at(printed, frame)
    answer = optimum_by_cuts(frame, band, programme)
    assert isinstance(answer, EmptyClass)
    u, proof = answer.proof.multipliers, answer.proof
    assert np.all(u >= 0)
    # Nothing a path inside the band can do makes up for it: |y| is bounded by the cap's top.
    assert answer.b @ u + proof.radius * np.linalg.norm(answer.A.T @ u) < -1e-4
    assert linprog(np.zeros(frame.size), answer.A, answer.b, bounds=(None, None)).status == 2
    # The rows say what they claim: every band path that exists at a feasible travel keeps them.
    other = frame_at(0.82, pieces=30, degree=degree)
    best = optimum_by_cuts(other, band, SMOOTH)
    assert isinstance(best, ClassOptimum)
    A, b = band_rows(other, band, answer.touch)
    assert np.max(A @ best.y - b) <= 1e-9


def test_a_travel_theory_calls_infeasible_has_a_path(
    printed: planner.Problem, frame_at: Frames
) -> None:
    """At 0.89 there is one, proven here by dense evaluation in the angles' own terms."""
    frame = frame_at(0.89)
    best = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH)
    assert isinstance(best, ClassOptimum)
    assert best.value == pytest.approx(6.46285, abs=1e-5)
    K2, K3 = printed.system.K  # type: ignore[attr-defined]
    omega = frame.shape.bernstein(frame.x(best.y))[0]
    h, D = 1 / 60, 0.89
    z2, z3, z4 = frame.start[1:]
    t = np.linspace(0, h, 401)
    for w in omega:
        p2 = z2 + w * t
        p3 = z3 + D * (z2 * t + w * t**2 / 2)
        p4 = z4 + D * z3 * t + D**2 * (z2 * t**2 / 2 + w * t**3 / 6)
        theta2 = np.arccos(np.cbrt(p3 / K3))
        cos2 = -p2 / (3 * K2 * K3 * np.cos(theta2) ** 2 * np.sin(theta2))
        assert np.all(cos2 <= 1)
        assert np.all(p2 <= -0.01)
        z2, z3, z4 = p2[-1], p3[-1], p4[-1]
    np.testing.assert_allclose([z2, z3, z4], frame.goal[1:], atol=1e-12)


@pytest.mark.parametrize(
    ("travel", "kind"), [(0.79, "smooth"), (0.83, "smooth"), (0.88, "smooth"), (0.79, "peak")]
)
def test_optimum_agrees_with_ipopt(
    printed: planner.Problem, frame_at: Frames, travel: float, kind: str
) -> None:
    frame = frame_at(travel, pieces=20)
    band = band_at(printed, frame)
    best = optimum_by_cuts(frame, band, SMOOTH if kind == "smooth" else PEAK)
    assert isinstance(best, ClassOptimum)
    assert 0 <= best.gap < 1e-6
    expected = reference(frame, band, kind)
    # The reference tests the domain at samples only, so it may be lower by a trifle.
    assert best.bound >= expected * (1 - 1e-4)
    assert best.value == pytest.approx(expected, rel=1e-4)
    assert best.value >= expected * (1 - 1e-6)


def test_domain_bites(printed: planner.Problem, frame_at: Frames) -> None:
    """Without the cap the optimum leaves the domain; with it, it does not, and costs more."""
    frame = frame_at(0.79)
    band = band_at(printed, frame)
    open_band = replace(band, K=np.zeros(0))
    free = optimum_by_cuts(frame, open_band, SMOOTH)
    kept = optimum_by_cuts(frame, band, SMOOTH)
    assert isinstance(free, ClassOptimum)
    assert isinstance(kept, ClassOptimum)
    _, z2, z3, _ = frame.bernstein(free.y)
    assert np.max(-z2[0] - band.cap(z3[0])) > 0.01
    assert free.value < kept.value * 0.99


def test_floor_bites(printed: planner.Problem, frame_at: Frames) -> None:
    frame = frame_at(0.79)
    low, high = (
        optimum_by_cuts(frame, replace(band_at(printed, frame), floor=f), SMOOTH) for f in (0, 0.02)
    )
    assert isinstance(low, ClassOptimum)
    assert isinstance(high, ClassOptimum)
    assert np.max(frame.bernstein(low.y)[1]) > -0.02
    assert np.max(frame.bernstein(high.y)[1]) <= -0.02
    assert high.value > low.value


@pytest.mark.parametrize("flip", [[-1, 1, 1], [-1, -1, -1], [1, -1, -1]])
def test_branches_mirror_each_other(printed: planner.Problem, flip: list[int]) -> None:
    """θ₁ → −θ₁ changes nothing; (θ₂, θ₃) → −(θ₂, θ₃) turns the travel round."""
    mirrored = printed.changed(
        {
            "start.theta_deg": [float(f) for f in flip],
            "goal.theta_deg": [30.0 * f for f in flip],
            "goal.travel": 0.79 * flip[2],
            "limits": {"z2_margin": 0.01},
        }
    )
    plan = planner.METHODS["convex"].plan(mirrored, planner.METHODS["convex"].options(pieces=60))
    optimality = plan.notes["optimality"]
    assert optimality["kind"] == "global"
    assert plan.objective == pytest.approx(0.56272, abs=2e-5)
    middle = plan.q(plan.duration / 2)
    assert np.sign(middle[1:3]).tolist() == flip[:2]


def test_ceiling_stops_early_with_a_valid_bound(printed: planner.Problem, frame_at: Frames) -> None:
    frame = frame_at(0.79)
    answer = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH, ceiling=0.4)
    assert isinstance(answer, BoundAboveCeiling)
    assert 0.4 < answer.bound <= 0.562707


def test_running_out_of_rounds_is_said(printed: planner.Problem, frame_at: Frames) -> None:
    frame = frame_at(0.79)
    with pytest.raises(StalledError, match="2 rounds"):
        optimum_by_cuts(frame, band_at(printed, frame), SMOOTH, max_rounds=2)


def test_osqp_throughout_gives_the_same(printed: planner.Problem, frame_at: Frames) -> None:
    frame = frame_at(0.83)
    band = band_at(printed, frame)
    ours, theirs = (
        optimum_by_cuts(frame, band, SMOOTH),
        optimum_by_cuts(frame, band, Programme("smooth", "osqp")),
    )
    assert isinstance(ours, ClassOptimum)
    assert isinstance(theirs, ClassOptimum)
    assert theirs.final.engine == "osqp"
    assert ours.value == pytest.approx(theirs.value, rel=1e-8)
    np.testing.assert_allclose(ours.y, theirs.y, atol=1e-6)
