from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BPoly

from planner.methods.collocation.transcription.form import Kind, scheme
from planner.support.calculus.bernstein import basis

ALL = [(kind, d) for kind in ("radau", "legendre") for d in range(1, 6)]


@pytest.mark.parametrize(("kind", "degree"), ALL)
def test_polynomials_of_the_degree_are_exact(kind: Kind, degree: int) -> None:
    s = scheme(kind, degree)
    coefficients = np.random.default_rng(degree).normal(size=degree + 1)
    f = np.polynomial.Polynomial(coefficients)
    values = f(np.array([0.0, *s.points]))
    np.testing.assert_allclose(s.integration @ f.deriv()(s.points), values[1:] - f(0.0), atol=1e-12)
    curve = BPoly((s.bernstein @ values)[:, None], [0.0, 1.0])
    tau = np.linspace(0, 1, 7)
    np.testing.assert_allclose(curve(tau), f(tau), atol=1e-12)


@pytest.mark.parametrize(("kind", "degree"), ALL)
def test_quadrature_has_the_order_of_its_family_and_no_more(kind: Kind, degree: int) -> None:
    s = scheme(kind, degree)
    exact = 2 * degree - 1 if kind == "radau" else 2 * degree
    for power in range(exact):
        assert s.quadrature @ s.points**power == pytest.approx(1 / (power + 1), abs=1e-13)
    assert abs(s.quadrature @ s.points**exact - 1 / (exact + 1)) > 1e-7


@pytest.mark.parametrize("degree", range(1, 6))
def test_radau_ends_on_the_interval_and_legendre_does_not(degree: int) -> None:
    assert scheme("radau", degree).points[-1] == 1.0
    assert scheme("legendre", degree).points[-1] < 0.99


def test_bernstein_polynomials_sum_to_one() -> None:
    tau = np.linspace(0, 1, 5)
    np.testing.assert_allclose(basis(4, tau).sum(axis=0), 1.0, atol=1e-15)
