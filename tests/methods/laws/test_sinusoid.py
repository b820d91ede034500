"""Both sinusoidal laws against independent integration and the closed forms of the literature."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import planner
from planner.methods.laws.scores import end_margin
from planner.methods.laws.sinusoids import sinusoids, steps

Array = np.ndarray
boundary = st.lists(st.floats(-1, 1), min_size=8, max_size=8).map(np.array)
travels = st.one_of(st.just(0.0), st.floats(0.2, 2.0), st.floats(-2.0, -0.2))
amplitudes = st.one_of(st.floats(0.2, 2.0), st.floats(-2.0, -0.2))


def _ends(size: int, start: Array, goal: Array, travel: float) -> tuple[Array, Array]:
    z0, zT = start[:size], goal[:size].copy()
    zT[0] = z0[0] + travel
    return z0, zT


def _integrate(z0: Array, v: object, T: float, at: Array) -> Array:
    """z at times `at` by DOP853 on the chained form itself."""

    def rates(t: float, z: Array) -> Array:
        v1, v2 = v(t)  # type: ignore[operator]
        return np.concatenate([[v1, v2], z[1:-1] * v1])

    return solve_ivp(rates, (0, T), z0, "DOP853", t_eval=at, rtol=1e-12, atol=1e-13).y.T


@settings(max_examples=25)
@given(size=st.integers(3, 8), start=boundary, goal=boundary, travel=travels, amplitude=amplitudes)
def test_together_reaches_the_end(
    size: int, start: Array, goal: Array, travel: float, amplitude: float
) -> None:
    z0, zT = _ends(size, start, goal, travel)
    motion = sinusoids(z0, zT, amplitude, 10.0)
    curve = motion.z
    largest = np.maximum(1.0, np.max(np.abs(curve(np.linspace(0, 10, 101))), axis=0))
    assert np.max(np.abs(curve(10.0) - zT) / largest) <= 1e-9
    np.testing.assert_allclose(curve(0.0), z0, rtol=0, atol=1e-14)


@settings(max_examples=15)
@given(size=st.integers(3, 6), start=boundary, goal=boundary, travel=travels, amplitude=amplitudes)
def test_together_is_the_law_it_says(
    size: int, start: Array, goal: Array, travel: float, amplitude: float
) -> None:
    """Integrating a₀ + a₁ sin ωt and Σ bⱼ cos jωt gives the same curve."""
    T, omega = 2.0, np.pi
    z0, zT = _ends(size, start, goal, travel)
    motion = sinusoids(z0, zT, amplitude, T)
    assume(motion.condition < 1e6)
    harmonics = np.arange(size - 1) * omega

    def v(t: float) -> tuple[float, float]:
        v1 = travel / T + amplitude * omega * np.sin(omega * t)
        return v1, float(motion.coefficients @ np.cos(harmonics * t))

    times = np.linspace(0, T, 7)
    found = motion.z(times)
    largest = np.maximum(1.0, np.max(np.abs(found), axis=0))
    gap = np.abs(found - _integrate(z0, v, T, times)) / largest
    assert np.max(gap) < 1e-9 * max(1.0, float(np.max(np.abs(motion.coefficients))))


def test_representation_is_good_to_rounding() -> None:
    """z₂ and z₃ in closed form at Δz₁ = 0, between the interpolation points too."""
    z0, zT, T, A = np.array([0.3, -0.2, 0.5, 0.1]), np.array([0.3, 0.4, -0.6, 0.2]), 2.0, 0.7
    motion = sinusoids(z0, zT, A, T)
    omega, (b0, b1, b2) = 2 * np.pi / T, motion.coefficients
    t = np.linspace(0, T, 999)
    s1, s2, c1 = np.sin(omega * t), np.sin(2 * omega * t), np.cos(omega * t)
    z2 = z0[1] + b0 * t + b1 / omega * s1 + b2 / (2 * omega) * s2
    # ∫ sin ωt · (z₂₀ + b₀ t + b₁/ω sin ωt + b₂/2ω sin 2ωt) dt, times Aω
    z3 = z0[2] + A * omega * (
        z0[1] * (1 - c1) / omega
        + b0 * (s1 / omega**2 - t * c1 / omega)
        + b1 / omega * (t / 2 - s2 / (4 * omega))
        + b2 / (2 * omega) * (s1 / (2 * omega) - np.sin(3 * omega * t) / (6 * omega))
    )
    curve = motion.z(t)
    for column, exact in ((1, z2), (2, z3)):
        assert np.max(np.abs(curve[:, column] - exact)) <= 1e-13 * np.max(np.abs(exact))


def test_together_has_no_solution_without_amplitude() -> None:
    z0, zT = np.array([0.0, 0.1, 0.2, 0.3]), np.array([0.0, -0.1, 0.4, 0.2])
    with pytest.raises(np.linalg.LinAlgError):
        sinusoids(z0, zT, 0.0, 1.0)
    both = sinusoids(z0, np.stack([zT, zT]), np.array([0.0, 0.3]), 1.0)
    assert list(np.isnan(both.condition)) == [True, False]
    assert np.isfinite(both.z.c[:, :, 1]).all()


@settings(max_examples=25)
@given(size=st.integers(3, 8), start=boundary, goal=boundary, travel=travels, amplitude=amplitudes)
def test_steps_reach_the_end(
    size: int, start: Array, goal: Array, travel: float, amplitude: float
) -> None:
    z0, zT = _ends(size, start, goal, travel)
    motion = steps(z0, zT, np.full(size - 2, amplitude), np.ones(size - 1))
    largest = np.maximum(1.0, np.max(np.abs(motion.z.c), axis=(0, 1)))
    assert np.max(np.abs(motion.z(size - 1.0) - zT) / largest) <= 1e-9
    assert motion.residual <= 1e-9


@settings(max_examples=15)
@given(size=st.integers(3, 6), start=boundary, goal=boundary, travel=travels)
def test_each_step_moves_one_coordinate(
    size: int, start: Array, goal: Array, travel: float
) -> None:
    """Murray and Sastry: period k moves z_{k+2} by (2π/ω)(α/2ω)ᵏ β/k! and returns the lower."""
    z0, zT = _ends(size, start, goal, travel)
    amplitude = np.linspace(0.5, 1.0, size - 2)
    motion = steps(z0, zT, amplitude, np.linspace(1.0, 2.0, size - 1))
    edges = np.concatenate([[0.0], np.cumsum(np.linspace(1.0, 2.0, size - 1))])
    largest = np.maximum(1.0, np.max(np.abs(motion.z.c), axis=(0, 1)))
    for k in range(1, size - 1):
        before, after = motion.z(edges[k]), motion.z(edges[k + 1])
        gap = np.abs(after - before)[: k + 1] / largest[: k + 1]
        assert np.max(gap) < 1e-12
        omega = 2 * np.pi / (edges[k + 1] - edges[k])
        alpha = amplitude[k - 1] * omega
        moved = (2 * np.pi / omega) * (alpha / (2 * omega)) ** k * motion.coefficients[k - 1]
        rise = (after - before)[k + 1] / largest[k + 1]
        assert rise == pytest.approx(moved / factorial(k) / largest[k + 1], abs=1e-11)
        middle = edges[k] + 0.3 * (edges[k + 1] - edges[k])
        phase = omega * (middle - edges[k])
        expected = [alpha * np.sin(phase), motion.coefficients[k - 1] * np.cos(k * phase)]
        np.testing.assert_allclose(motion.v(middle), expected, rtol=1e-10, atol=1e-10)


# -- as methods ------------------------------------------------------------------------------------


def test_together_on_the_paper(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited, "sinusoid")
    assert plan.verified
    # The best of the samples may dip out of the domain between them; the plan may not.
    assert plan.domain.margin >= 0.09 * end_margin(unlimited)
    assert np.max(np.abs(plan.u(np.linspace(0, 10, 5001)))) < 0.5
    again = planner.solve(
        unlimited.changed({"goal.travel": plan.travel}),
        "sinusoid",
        amplitude=plan.notes["amplitude"],
    )
    times = np.linspace(0, 10, 50)
    np.testing.assert_allclose(again.z(times), plan.z(times), rtol=0, atol=1e-12)


def test_steps_on_the_paper(unlimited: planner.Problem) -> None:
    """It stays inside the domain, at a price: u₂ passes 100 rad/s."""
    problem = unlimited.changed({"goal.travel": 0.761506})
    plan = planner.solve(problem, "sinusoid_steps")
    assert plan.verified
    assert np.max(np.abs(plan.u(np.linspace(0, 10, 5001)))) > 100
    shared = planner.solve(
        problem,
        "sinusoid_steps",
        amplitude=plan.notes["amplitudes"],
        shares=[1.0, 4.0, 5.0],
    )
    # Shares change the timing of the same path.
    np.testing.assert_allclose(shared.q(1.0), plan.q(10 / 3), rtol=0, atol=1e-9)
    np.testing.assert_allclose(shared.q(5.0), plan.q(20 / 3), rtol=0, atol=1e-9)


def test_refusal_tells_how_many_were_tried(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.travel": 0.0})
    with pytest.raises(planner.SingularError, match=r"best sinusoid plan of \d+") as caught:
        planner.solve(problem, "sinusoid")
    assert caught.value.plan is not None
    assert caught.value.times_s


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("sinusoid", {"amplitude": 0.0}, "must not be zero"),
        ("sinusoid_steps", {"amplitude": [0.1, 0.0]}, "must not be zero"),
        ("sinusoid_steps", {"amplitude": [0.1]}, "has 1 values"),
        ("sinusoid_steps", {"shares": [1.0, 1.0]}, "has 2 parts"),
    ],
)
def test_bad_options(
    unlimited: planner.Problem, method: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(planner.InputError, match=message):
        planner.solve(unlimited, method, **options)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("angle", [5e-13, 1e-9])
def test_goals_beside_the_end_of_the_chart_raise_no_warnings(angle: float) -> None:
    """There z and the margins of what leaves the chart overflow."""
    goal = {"goal.theta_deg": [35, angle, 20]}
    problem = planner.load_problem("problems/parking.toml", goal)
    with pytest.raises(planner.NoPlanError):
        planner.solve(problem, "sinusoid_steps")
