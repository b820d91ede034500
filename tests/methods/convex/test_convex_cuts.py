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
from planner.methods.convex.programme import Goal, StalledError

Frames = Callable[..., Frame]
SMOOTH: Goal = "smooth"
PEAK: Goal = "peak"


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
    ("travel", "degree", "value"),
    [
        (0.79, 0, 0.562706),
        (0.80, 0, 0.282433),
        (0.82, 0, 0.157369),
        (0.83, 0, 0.222463),
        (0.79, 1, 0.561116),
    ],
)
def test_figures_of_the_example(
    printed: planner.Problem, frame_at: Frames, travel: float, degree: int, value: float
) -> None:
    """v₂ piecewise constant on 60 pieces gives them to the last printed digit; continuous not."""
    frame = frame_at(travel, degree=degree)
    best = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH)
    assert isinstance(best, ClassOptimum)
    assert best.value == pytest.approx(value, abs=5.1e-7)
    effort = np.sum(best.frame.x(best.y) ** 2) / 2 / best.frame.travel
    assert effort == pytest.approx(best.value, rel=1e-12)
    assert 0 <= best.gap < 1e-6
    assert best.proven <= 0


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("goal", [SMOOTH, PEAK])
@pytest.mark.parametrize("travel", [0.787, 0.895])
def test_certificate_checked_independently(
    printed: planner.Problem, frame_at: Frames, travel: float, goal: Goal, degree: int
) -> None:
    """Inside the window of one-way motions, yet no path of the class keeps z₂ ≤ −0.01."""
    assert travel in planner.travel_window(printed)
    frame = frame_at(travel, pieces=30, degree=degree)
    band = band_at(printed, frame)
    answer = optimum_by_cuts(frame, band, goal)
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


def test_a_travel_theory_calls_infeasible_has_a_path(printed: planner.Problem) -> None:
    """At 0.89 there is one; integration finds it inside."""
    wide = printed.changed({"limits": {"z2_margin": 0.01}, "goal.travel": 0.89})
    plan = planner.solve(wide, "convex", pieces=60)
    assert plan.verified
    assert plan.domain.ok
    assert plan.domain.z2_max <= -0.01
    # A plan keeps a hair away from the edge, which costs a trifle.
    assert 6.46285 < plan.notes["optimality"]["objective"] < 6.46285 * (1 + 1e-4)


@pytest.mark.parametrize(
    ("travel", "kind"),
    [
        pytest.param(0.79, "smooth", marks=pytest.mark.campaign),
        (0.83, "smooth"),
        pytest.param(0.88, "smooth", marks=pytest.mark.campaign),
        (0.79, "peak"),
    ],
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


def test_domain_and_floor_bite(printed: planner.Problem, frame_at: Frames) -> None:
    """Without one of them the optimum leaves it; with it, it does not, and costs more."""
    frame = frame_at(0.79)
    band = band_at(printed, frame)
    bands = (band, replace(band, K=np.zeros(0)), replace(band, floor=0), replace(band, floor=0.02))
    kept, free, low, high = (optimum_by_cuts(frame, each, SMOOTH) for each in bands)
    for found in (kept, free, low, high):
        assert isinstance(found, ClassOptimum)
    _, z2, z3, _ = frame.bernstein(free.y)
    assert np.max(-z2[0] - band.cap(z3[0])) > 0.01
    assert free.value < kept.value * 0.99
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


def test_where_it_stops_early(printed: planner.Problem, frame_at: Frames) -> None:
    """At a ceiling, with a valid bound; out of rounds, which is said."""
    frame = frame_at(0.79)
    answer = optimum_by_cuts(frame, band_at(printed, frame), SMOOTH, ceiling=0.4)
    assert isinstance(answer, BoundAboveCeiling)
    assert 0.4 < answer.bound <= 0.562707
    with pytest.raises(StalledError, match="2 rounds"):
        optimum_by_cuts(frame, band_at(printed, frame), SMOOTH, max_rounds=2)
