"""The polynomial law against the paper's own equations and the numbers found in its example."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.methods.laws.legs import Leg, Point, steer

Array = np.ndarray
boundary = st.lists(st.floats(-1, 1), min_size=8, max_size=8).map(np.array)
travels = st.one_of(st.floats(0.2, 2.0), st.floats(-2.0, -0.2))


def _paper_matrices(b0: float, T: float, terms: int, rows: int) -> tuple[Array, Array]:
    """M (rows, terms) and D (rows, rows) of eq. (27) with b₀ restored (theory.md §4)."""
    M = [
        [b0**i * factorial(j) * T ** (i + j + 1) / factorial(i + j + 1) for j in range(terms)]
        for i in range(rows)
    ]
    D = [
        [(b0 * T) ** (i - j) / factorial(i - j) if i >= j else 0.0 for j in range(rows)]
        for i in range(rows)
    ]
    return np.array(M), np.array(D)


def test_step_3_as_printed_misses_the_goal() -> None:
    """Without b₀ the printed z₃ ends elsewhere whenever v₁ is not 1."""
    z0, zT, T = np.array([0.0, -0.03, 0.71, 0.02]), np.array([0.8, -0.52, 0.46, 0.52]), 10.0
    motion = steer(z0, zT, [Leg(T, 0.8, 3)])
    times = np.array([0, T / 2, T])
    c = np.linalg.solve(np.vander(times, 3, increasing=True), motion.v(times)[:, 1])
    printed = z0[2] + z0[1] * T + c[0] * T**2 / 2 + c[1] * T**3 / 6 + c[2] * T**4 / 12
    assert abs(printed - zT[2]) > 1.0
    assert motion.z(T)[2] == pytest.approx(zT[2], abs=1e-12)


@given(
    size=st.integers(3, 6),
    start=boundary,
    goal=boundary,
    travel=travels,
    values=st.lists(st.floats(-1, 1), max_size=2),
    share=st.floats(0, 1),
)
def test_coefficients_solve_equations_27_and_28(
    size: int, start: Array, goal: Array, travel: float, values: list[float], share: float
) -> None:
    """Each point is met and adds one coefficient; the equations give every zᵢ at any time."""
    T, m = 3.0, size - 1 + len(values)
    z0, zT = start[:size], goal[:size].copy()
    zT[0] = z0[0] + travel
    points = [Point(T * (k + 0.7) / 2.5, value) for k, value in enumerate(values)]
    motion = steer(z0, zT, [Leg(T, travel, m)], points)
    assert motion.residual < 1e-12
    times = np.linspace(0, T, m)
    c = np.linalg.solve(np.vander(times, m, increasing=True), motion.v(times)[:, 1])
    for t, z in ((T, zT), (share * T, motion.z(share * T))):
        M, D = _paper_matrices(travel / T, t, m, size - 1)
        scale = np.abs(M) @ np.abs(c) + np.abs(D) @ np.abs(z0[1:]) + np.abs(z[1:]) + 1e-3
        assert np.all(np.abs(M @ c + D @ z0[1:] - z[1:]) <= 1e-10 * scale)
        assert motion.z(t)[0] == pytest.approx(z0[0] + travel * t / T, abs=1e-12)
    size_of_z2 = max(1.0, float(np.max(np.abs(motion.z(np.linspace(0, T, 50))[:, 1]))))
    for p in points:
        assert motion.z(p.time_s)[1] == pytest.approx(p.value, abs=1e-10 * size_of_z2)


@given(size=st.integers(3, 8), start=boundary, goal=boundary, travel=travels, legs=st.booleans())
def test_end_is_reached_for_any_chain(
    size: int, start: Array, goal: Array, travel: float, legs: bool
) -> None:
    """Scaled end error ≤ 1e-9; z₁(0) = z₁(T) takes two legs."""
    T, z0, zT = 10.0, start[:size], goal[:size].copy()
    out_and_back = [Leg(T / 2, travel, size - 1), Leg(T / 2, -travel, size - 1)]
    zT[0] = z0[0] if legs else z0[0] + travel
    motion = steer(z0, zT, out_and_back if legs else [Leg(T, travel, size - 1)])
    largest = np.maximum(1.0, np.max(np.abs(motion.z(np.linspace(0, T, 101))), axis=0))
    assert np.max(np.abs(motion.z(T) - zT) / largest) <= 1e-9
    np.testing.assert_array_equal(motion.z(0.0), z0)


def _parking(paper: planner.Problem, **options: object) -> planner.Plan:
    problem = paper.changed({"limits": {}, "goal.travel": 0.0})
    return planner.solve(problem, "polynomial", allow_singular=True, **options)


@pytest.mark.parametrize("offset", ["mean", -1.3])
def test_two_legs_with_a_given_offset(paper: planner.Problem, offset: float | str) -> None:
    plan = _parking(paper, offset=offset)
    z = plan.z(np.array([0.0, 5.0, 10.0]))
    out = np.mean(z[0]) if offset == "mean" else offset
    assert z[1, 0] - z[0, 0] == pytest.approx(out, abs=1e-14)
    assert z[2, 0] == pytest.approx(z[0, 0], abs=1e-14)
    assert plan.notes["endpoint_residual"] < 1e-12
    assert plan.status == "singular"


def test_two_legs_need_an_offset(paper: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match=r"method\.polynomial\.offset"):
        _parking(paper, offset=0.0)
    beside = _beside(start=0.0)  # the unicycle at its origin: the mean of z(0) is 0
    with pytest.raises(planner.InputError, match=r'method\.polynomial\.offset \(m\).*"auto"'):
        planner.solve(beside, "polynomial", offset="mean")


def _beside(start: float) -> planner.Problem:
    """A unicycle to be moved one metre aside, with no way forward left over."""
    return planner.Problem.from_dict(
        {
            "system": {"kind": "unicycle"},
            "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": start},
            "goal": {"x_m": 0.0, "y_m": 1.0, "heading_deg": 0.0, "duration": 10.0},
        }
    )


@pytest.mark.parametrize("method", ["polynomial", "piecewise"])
def test_two_legs_choose_their_offset_by_the_peak(method: str) -> None:
    """It beats the paper's rule by far, and every offset of a fine scan."""
    problem = _beside(start=10.0)

    law = planner.METHODS[method]

    def peak(offset: float | str) -> float:
        plan = law.plan(problem, law.options(offset=offset))
        return float(np.max(plan.peak_u))

    chosen = planner.solve(problem, method)
    assert chosen.verified
    best = float(np.max(chosen.peak_u))
    assert chosen.options["offset"] == "auto"
    assert chosen.z(5.0)[0] - chosen.z(0.0)[0] == pytest.approx(chosen.notes["offset"])
    assert best < 0.06 * peak("mean")
    scanned = [peak(float(d)) for d in np.linspace(-3, 3, 40)]
    assert best <= min(scanned) * (1 + 1e-6)


def test_an_offset_can_be_chosen_for_the_margin(paper: planner.Problem) -> None:
    turned = paper.changed(
        {"limits": {}, "goal.travel": 0.0, "start.theta_deg": [40.0, 50.0, 30.0]}
        | {"goal.theta_deg": [40.0, 50.0, 30.4]}
    )

    def margin(**options: object) -> float:
        plan = planner.solve(turned, "polynomial", allow_singular=True, **options)
        return plan.domain.margin

    widest = margin(criterion="margin")
    assert widest > 0
    assert widest >= margin(criterion="peak")
    assert widest >= margin(offset="mean")


# -- the paper's example in numbers (theory.md §5) ---------------------------------------------


def _example(unlimited: planner.Problem, travel: float) -> planner.Plan:
    problem = unlimited.changed({"goal.travel": travel})
    return planner.solve(problem, "polynomial", points=[], allow_singular=True)


def test_range_of_travels_inside_the_domain(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited, "polynomial", travel="middle")
    ((low, high),) = plan.notes["travel_ranges_in_domain"]
    assert low == pytest.approx(0.794, abs=5e-4)
    assert high == pytest.approx(0.8285, abs=5e-4)
    for travel, inside in ((low - 1e-4, False), (low + 1e-4, True), (high + 1e-4, False)):
        assert _example(unlimited, travel).domain.ok == inside


@pytest.mark.parametrize(("travel", "u2"), [(0.80, 141), (0.81, 89), (0.82, 40), (0.825, 17)])
def test_first_command(unlimited: planner.Problem, travel: float, u2: float) -> None:
    assert abs(_example(unlimited, travel).u(0.0)[1]) == pytest.approx(u2, abs=0.5)


def test_best_travel_keeps_u2_small(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited, "polynomial")
    assert plan.travel == pytest.approx(0.82866, abs=1e-5)
    peak = np.max(np.abs(plan.u(np.linspace(0, 10, 20001))), axis=0)
    assert peak[1] == pytest.approx(0.5825, abs=1e-3)
    assert plan.verified


# -- refusals -------------------------------------------------------------------------------------


def test_points_need_a_duration(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.duration": "free", "limits.input_rad_s": 1.0})
    with pytest.raises(planner.InputError, match=r"goal\.duration"):
        planner.solve(problem, "polynomial", points=[[5.0, -0.2]])


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("travel", [0.6, 0.85])
def test_a_constraint_time_that_leaves_the_coefficients_open_is_named(
    unlimited: planner.Problem, sign: int, travel: float
) -> None:
    """M is singular there whatever the travel, so that another travel is no advice."""
    time = 5 * (1 + sign / np.sqrt(5))
    with pytest.raises(planner.SingularError, match="at any travel") as refusal:
        planner.solve(
            unlimited.changed({"goal.travel": travel}),
            "polynomial",
            points=[[time, -0.2]],
            allow_singular=True,
        )
    assert f"{time:.4g} s" in str(refusal.value)
    assert refusal.value.advice == "constraint points at other times"
