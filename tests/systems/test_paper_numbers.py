"""The numbers of the paper's example that belong to the chart (section 4.3)."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import planner
from planner import Manipulator, chained_form


def angles(*degrees: float) -> np.ndarray:
    return np.array([0.0, *np.deg2rad(degrees)])


def test_constants_follow_from_the_printed_start(paper: planner.Problem) -> None:
    c, s = np.cos(np.deg2rad(1)), np.sin(np.deg2rad(1))
    K3 = 0.7113 / c**3
    K2 = 0.0324 / (3 * K3 * c**4 * s)
    system = paper.system
    assert isinstance(system, Manipulator)
    # The printed digits leave these ranges; ours lie inside.
    assert system.K[1] == pytest.approx(K3, abs=0.00005 / c**3)
    assert system.K[0] == pytest.approx(K2, rel=0.00005 / 0.0324 + 0.00005 / 0.7113)
    rho = system.K[1] / system.K[0]
    assert rho == pytest.approx(0.8178, abs=5e-5)
    assert system.k_g == pytest.approx(rho**2, abs=1e-4)


def test_boundary_values_and_the_misprint(paper: planner.Problem) -> None:
    form = chained_form(paper.system)
    start, goal = form.z(angles(1, 1, 1)), form.z(angles(30, 30, 30))
    np.testing.assert_array_equal(np.round(start[1:], 4), [-0.0324, 0.7113, 0.0175])
    np.testing.assert_array_equal(np.round(goal[1:], 4), [-0.5225, 0.4622, 0.5236])


@pytest.mark.parametrize("K", [[0.870125, 0.711625], [0.87, 0.71, 0.58]])
def test_the_jacobian_is_triangular_with_products_on_its_diagonal(K: list[float]) -> None:
    """(18) to (20), by differences of z and of the slopes at random poses."""
    system = Manipulator(K)
    form, size = chained_form(system), len(K) + 2
    shift = 1e-6 * np.eye(size)
    for q in np.random.default_rng(0).uniform(0.2, 1.2, (20, size)):
        jacobian = (form.z(q + shift) - form.z(q - shift)).T / 2e-6
        slopes = (system.slopes(q + shift) - system.slopes(q - shift)).T / 2e-6
        assert np.abs(np.tril(jacobian, -1)[1:]).max() < 1e-8
        product = 1.0
        for i in range(size - 1, 1, -1):
            assert jacobian[i, i] == pytest.approx(product, rel=1e-6)
            product *= slopes[i - 2, i - 1]
        assert jacobian[1, 1] == pytest.approx(product, rel=1e-6)


@given(K2=st.floats(0.01, 100), K3=st.floats(0.01, 100))
def test_no_constants_give_the_printed_value(K2: float, K3: float) -> None:
    """z₂(T)/z₂(0) has no constant in it, so −0.532 contradicts −0.0324 for every machine."""
    form = chained_form(Manipulator([K2, K3]))
    ratio = form.z(angles(30, 30, 30))[1] / form.z(angles(1, 1, 1))[1]
    assert ratio == pytest.approx(-0.5225 / -0.0324, rel=2e-3)
    assert abs(ratio * 0.0324 - 0.532) > ratio * 0.00005 + 0.0005


@pytest.mark.parametrize(("degrees", "gain"), [(1, 883), (10, 9.3), (30, 1.7)])
def test_gain_from_v2_to_u2_near_the_edge(
    paper: planner.Problem, degrees: float, gain: float
) -> None:
    form, q = chained_form(paper.system), angles(degrees, degrees, degrees)
    seen = form.u(q, np.array([0.0, 1.0]))[1] - form.u(q, np.zeros(2))[1]
    assert seen == pytest.approx(gain, rel=0.03)


@given(z2=st.floats(-1.5, 0.5), z3=st.floats(-0.5, 1.5))
def test_domain_is_the_band_below_g(z2: float, z3: float) -> None:
    """theory.md section 2: 0 < z₃ < K₃ and 0 < −z₂ < g(z₃), and not z₂ < 0 alone."""
    K2, K3 = 0.870125, 0.711625
    system = Manipulator([K2, K3])
    assume(abs(z3) > 1e-6 and abs(z3 - K3) > 1e-9)  # the angles near 90 and 0 deg are rounded
    c = np.cbrt(z3 / K3)
    g = 3 * K2 * K3 * c**2 * np.sqrt(max(1 - c**2, 0.0))
    assume(abs(z2 + g) > 1e-9 and abs(z2) > 1e-12)
    inside = 0 < z3 < K3 and 0 < -z2 < g
    q = chained_form(system).q(np.array([0.0, z2, z3, 0.3]), np.ones(4))
    margins = chained_form(system).margins(np.array([0.0, z2, z3, 0.3]), np.ones(4))
    assert bool(np.all(np.nan_to_num(margins, nan=-1.0) > 0)) == inside
    assert inside <= bool(np.all(np.isfinite(q)))


def test_z2_below_zero_is_not_enough(paper: planner.Problem) -> None:
    system = paper.system
    z = np.array([0.0, -0.9, 0.4, 0.3])
    margins = chained_form(system).margins(z, np.ones(4))
    label = system.margin_labels[int(np.nanargmin(margins))][1]
    assert np.nanmin(margins) < 0
    assert "theta1 = 0" in label
    assert np.isnan(chained_form(system).q(z, np.ones(4))[1])
