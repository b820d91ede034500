"""The companion paper's indicators, in our reading, against direct simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly

import planner
from planner import Indicators, indicators
from planner.plan.trajectory import StateTrajectory

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def plan(unlimited: planner.Problem) -> planner.Plan:
    return planner.solve(unlimited.changed({"goal.travel": 0.8286}), "polynomial")


@pytest.fixture(scope="module")
def found(plan: planner.Plan) -> Indicators:
    return indicators(plan)


def _ends(plan: planner.Plan, starts: Array) -> Array:
    """Ends (…, 4) of the motions from starts (…, 4), integrated together."""

    def rates(t: float, q: Array) -> Array:
        return plan.problem.system.rates(q.reshape(starts.shape), plan.u(t)).ravel()

    span = (0, plan.duration)
    motion = solve_ivp(rates, span, starts.ravel(), "DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(motion.y[:, -1]).reshape(starts.shape)


def test_initial_error_matrix_against_differences(plan: planner.Plan, found: Indicators) -> None:
    matrix = found.initial_error_matrix
    step = 1e-5 * np.eye(4)
    above, below = _ends(plan, plan.problem.start + np.stack([step, -step]))
    np.testing.assert_allclose(matrix, (above - below).T / 2e-5, rtol=0, atol=2e-6)
    gain = found.initial_error_gain
    assert gain == pytest.approx(np.linalg.svd(matrix[1:, 1:])[1][0])
    assert gain > 1


def test_control_precision_of_the_driven_joint(plan: planner.Plan, found: Indicators) -> None:
    """θ₁ is the sum of its held rates, whatever the rest does; a short period loses little."""
    for period in (0.4, 0.1):
        moved = period * np.sum(plan.u(np.arange(0, 10, period))[:, 1])
        error = np.rad2deg(abs(plan.problem.start[1] + moved - plan.problem.goal[1]))
        missed = indicators(plan, period).control_precision_deg
        assert missed >= error - 1e-6
    assert found.control_precision_deg < missed / 5  # held for 0.01 s


def test_held_input_ends_where_a_direct_simulation_does(plan: planner.Plan) -> None:
    q, system, h = plan.problem.start, plan.problem.system, 4e-3
    for k in range(2_500):  # period 0.4 s, classical Runge–Kutta
        u = plan.u(0.4 * (k // 100))
        k1 = system.rates(q, u)
        k2 = system.rates(q + h / 2 * k1, u)
        k3 = system.rates(q + h / 2 * k2, u)
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + system.rates(q + h * k3, u))
    error = np.rad2deg(np.max(np.abs(q - plan.q(plan.duration))[1:]))
    assert indicators(plan, 0.4).control_precision_deg == pytest.approx(error, abs=1e-7)


def test_steep_start_costs_precision(found: Indicators, unlimited: planner.Problem) -> None:
    steep = planner.solve(unlimited.changed({"goal.travel": 0.81}), "polynomial")
    assert indicators(steep).control_precision_deg > 10
    assert found.control_precision_deg < 0.1


def _turn(middle: float) -> planner.Plan:
    """θ₁, θ₂ from (0, 0) to (30, 0)° with θ₂ going aside by middle/2; inputs play no part."""
    problem = planner.Problem.manipulator([0, 0], [30, 0], duration=1.0)
    a = np.pi / 6
    q = BPoly(np.array([[0, 0, 0], [0, a / 2, middle], [0, a, 0]])[:, None], [0.0, 1.0])
    u = BPoly(np.array([[0, a], [0, a]])[:, None], [0.0, 1.0])
    return planner.Plan(problem, "by hand", {}, StateTrajectory(problem.system, q, u))


def test_distance_from_the_straight_line() -> None:
    found = indicators(_turn(0.2))
    assert found.joints == ("theta1", "theta2")
    assert found.linear_deviation_deg == pytest.approx(np.rad2deg(0.1), rel=1e-6)
    assert found.linear_approximation == pytest.approx(0.1 / (np.pi / 6), rel=1e-6)
    assert indicators(_turn(0.0)).linear_approximation == pytest.approx(0, abs=1e-12)


def test_timing_plays_no_part_in_the_path(plan: planner.Plan, found: Indicators) -> None:
    after = indicators(planner.retime(plan, {"input_rad_s": 0.3}))
    assert after.linear_approximation == pytest.approx(found.linear_approximation, rel=1e-6)
    np.testing.assert_allclose(
        after.initial_error_matrix, found.initial_error_matrix, rtol=0, atol=1e-5
    )


def test_a_period_of_nothing_is_refused(plan: planner.Plan) -> None:
    with pytest.raises(planner.InputError, match="period_s"):
        indicators(plan, 0.0)
