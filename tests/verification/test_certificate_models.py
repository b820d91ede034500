"""Functions, polynomials and least values on cells: undefined ones, slopes, narrow dips."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from planner.verification.balls import models, polynomial_balls
from planner.verification.cells import Cells, least, polynomials
from planner.verification.functions import Expression, UnboundedError

x = ca.SX.sym("x")


def test_what_is_not_defined_has_no_bound() -> None:
    across = polynomial_balls(np.array([[[0.1, 0.3], [1.0, 0.3]]]), np.zeros((1, 2)))
    for expression in (ca.sqrt(x), 1 / x, ca.log(x), x**0.5):
        with np.errstate(all="ignore"):
            (found,) = models(Expression([x], expression)(across), 2)
        assert np.isinf(found.r[0]), expression
        assert found.r[1] < 1e-3, expression


def test_an_operation_without_bounds_is_named() -> None:
    with pytest.raises(UnboundedError, match="operation"):
        Expression([x], ca.floor(x))


def _value(c: np.ndarray, tau: float) -> np.ndarray:
    return np.polynomial.chebyshev.chebval(tau, c.T)


@given(st.integers(0, 10**6))
def test_polynomials_and_slopes_on_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = BPoly(rng.normal(size=(rng.integers(2, 15), 3, 2)), [0.0, 0.7, 1.1, 3.0])
    cells = Cells.of(curve.x).halved().halved()
    derived = curve.derivative()
    for tau in (-0.999, 0.123, 0.987):
        times = cells.times(np.array([tau]))[:, 0]
        for i in range(2):
            value, slope = polynomials(curve, cells)[i], polynomials(curve, cells, 1)[i]
            assert np.max(value.r) < 1e-11
            near = np.abs(curve(times)[:, i] - _value(value.c, tau))
            assert np.all(near <= value.r + 1e-12)
            near = np.abs(derived(times)[:, i] - _value(slope.c, tau))
            assert np.all(near <= slope.r + 1e-10)


@given(st.integers(0, 10**6))
def test_least_value_is_bracketed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(9, 2, 3))
    c[0, 1] = c[-1, 0]
    curve = BPoly(c, [0.0, 1.0, 2.5])
    cells = Cells.of(curve.x)
    found = least([(1.0, p, 0.0) for p in polynomials(curve, cells)], cells, np.ones(3))
    dense = curve(np.linspace(0, 2.5, 20001)).min(axis=0)
    for i, one in enumerate(found):
        assert one.guaranteed <= dense[i] + 1e-12
        assert one.attained - one.guaranteed < 2e-9
        assert one.attained <= dense[i] + 2e-9
        assert curve(one.time_s)[i] == pytest.approx(one.attained, abs=1e-10)


def test_a_dip_between_all_samples_is_found() -> None:
    """1e-9 wide: halving goes where the bound is, not where samples happen to be."""
    centre, width = 0.123456789, 1e-9
    square = np.array([[centre**2], [centre**2 - centre], [(1 - centre) ** 2]]) / width**2 * 1e-3
    cells = Cells.of(np.array([0.0, 1.0]))
    curve = BPoly(square[:, :, None] - 1e-3, [0.0, 1.0])
    (found,) = least([(1.0, p, 0.0) for p in polynomials(curve, cells)], cells, np.ones(1))
    assert found.time_s == pytest.approx(centre, abs=1e-6)
    assert found.guaranteed <= -1e-3 + 1e-12
