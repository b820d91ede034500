"""The full chart domain: the sign of z₂ alone is not enough, as the paper's own example shows."""

import numpy as np
import pytest

import planner
from planner import chained_form


def _at(problem: planner.Problem, travel: float, points: list[list[float]]) -> planner.Plan:
    fixed = problem.changed({"goal.travel": travel})
    return planner.solve(fixed, "polynomial", points=points, allow_singular=True)


def g(z3: np.ndarray, K2: float, K3: float) -> np.ndarray:
    """Largest −z₂ for which θ₁ exists (n = 3, θ₂ > 0)."""
    c = np.cbrt(z3 / K3)
    return 3 * K2 * K3 * c**2 * np.sqrt(1 - c**2)


def test_printed_example_keeps_z2_negative_and_yet_has_no_theta1(
    unlimited: planner.Problem,
) -> None:
    plan = _at(unlimited, np.pi / 4, [[5.0, -0.2]])
    assert plan.status == "singular"
    assert plan.domain.z2_max < 0
    assert plan.domain.z2_crossings_s == ()
    assert not plan.domain.ok
    assert plan.domain.margin == pytest.approx(-0.221, abs=5e-4)  # cos²θ₁ would have to be 1.22
    assert "theta1 = 0" in plan.domain.label
    assert np.isnan(plan.q(plan.domain.time_s)[1])
    enter, leave = plan.domain.exits_s
    z = plan.z(np.linspace(0, 10, 2001))
    outside = -z[:, 1] > g(z[:, 2], 0.870125, 0.711625)
    t = np.linspace(0, 10, 2001)[outside]
    assert t[0] == pytest.approx(enter, abs=0.005)
    assert t[-1] == pytest.approx(leave, abs=0.005)
    z = plan.z(np.array([enter, leave]))
    np.testing.assert_allclose(-z[:, 1], g(z[:, 2], 0.870125, 0.711625), atol=1e-10)
    assert np.all(np.isfinite(plan.q([enter - 1e-6, leave + 1e-6])))
    assert np.isnan(plan.q([enter + 1e-6, leave - 1e-6])[:, 1]).all()


@pytest.mark.parametrize(
    ("travel", "points", "crossings"),
    [
        *[(travel, [], 2) for travel in (0.786, 0.7935, 0.9045, 0.95)],
        *[(travel, [], 0) for travel in (0.794, 0.82, 0.904)],
        *[(travel, [[5.0, -0.2]], 2) for travel in (0.778, 0.9055)],
        *[(travel, [[5.0, -0.2]], 0) for travel in (0.7785, 0.905)],
    ],
)
def test_z2_stays_negative_in_the_printed_ranges_alone(
    unlimited: planner.Problem, travel: float, points: list[list[float]], crossings: int
) -> None:
    plan = _at(unlimited, travel, points)
    assert (plan.domain.z2_max < 0) == (crossings == 0)
    assert len(plan.domain.z2_crossings_s) == crossings
    if crossings:
        zeros = plan.z(np.array(plan.domain.z2_crossings_s))[:, 1]
        np.testing.assert_allclose(zeros, 0, atol=1e-12)


def test_domain_of_a_plan_inside(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited.changed({"goal.travel": 0.82}), "polynomial")
    assert plan.domain.ok
    assert plan.domain.exits_s == ()
    assert plan.domain.margin == pytest.approx(np.sin(np.deg2rad(1)) ** 2, rel=1e-6)
    assert plan.domain.singular_times_s == ()
    form = chained_form(plan.problem.system)
    q = plan.q(np.linspace(0, 10, 50))
    np.testing.assert_allclose(form.z(q), plan.z(np.linspace(0, 10, 50)), atol=1e-12)
