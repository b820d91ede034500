"""Models must contain the functions they stand for, rounding included."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from planner.certificate.cells import Cells, polynomials, slopes
from planner.certificate.evaluate import Evaluator, UnboundedError
from planner.certificate.least import least
from planner.certificate.model import Model

LONG = np.longdouble
ARITHMETIC = 8 * float(np.finfo(LONG).eps)
"""Rounding of the reference itself, which is about 1e-18 where long doubles are longer."""

x = ca.SX.sym("x")
Reference = Callable[[np.ndarray], np.ndarray]
FUNCTIONS: dict[str, tuple[ca.SX, Reference, float, float]] = {
    "sin": (ca.sin(x), np.sin, -3.0, 3.0),
    "cos": (ca.cos(x), np.cos, -3.0, 3.0),
    "tan": (ca.tan(x), np.tan, -1.0, 1.0),
    "sqrt": (ca.sqrt(x), np.sqrt, 0.3, 2.0),
    "reciprocal": (1 / x, lambda v: 1 / v, 0.3, 2.0),
    "power": (x**-1.5, lambda v: v ** LONG(-1.5), 0.3, 2.0),
    "exp": (ca.exp(x), np.exp, -1.0, 1.0),
    "log": (ca.log(x), np.log, 0.3, 2.0),
    "atan": (ca.atan(x), np.arctan, -3.0, 3.0),
    "acos": (ca.acos(x), np.arccos, -0.6, 0.6),
    "atan2": (ca.atan2(x, 2 - x), lambda v: np.arctan2(v, 2 - v), 0.2, 1.9),
    "tanh": (ca.tanh(x), np.tanh, -1.0, 1.0),
    "abs": (x * ca.fabs(x), lambda v: v * np.abs(v), -1.0, 1.0),
    "cubed cosine": (ca.cos(x) ** 3, lambda v: np.cos(v) ** 3, -1.4, 1.4),
}


def _value(c: np.ndarray, tau: float) -> np.ndarray:
    """Chebyshev series in long doubles."""
    before, now = np.ones(len(c), LONG), np.full(len(c), LONG(tau))
    total = c[:, 0].astype(LONG)
    for k in range(1, c.shape[1]):
        total = total + c[:, k].astype(LONG) * now
        before, now = now, 2 * LONG(tau) * now - before
    return total


def _random_model(seed: int, low: float, high: float, wander: float) -> Model:
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(20, 5)) * wander * (high - low)
    c[:, 0] = rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), 20)
    return Model(c, np.zeros(20))


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("wander", [1e-4, 0.01])
def test_functions_lie_inside_their_models(name: str, wander: float) -> None:
    expression, reference, low, high = FUNCTIONS[name]
    argument = _random_model(3, low, high, wander)
    (found,) = Evaluator([x], expression)([argument])
    assert np.all(np.isfinite(found.r))
    if wander == 1e-4:
        assert np.max(found.r) < 1e-9  # bounds that say nothing would pass the rest
    for tau in (-1.0, -0.71, -0.2, 0.0, 0.33, 0.9, 1.0):
        exact = reference(_value(argument.c, tau))
        error = np.abs(exact - _value(found.c, tau)).astype(float)
        assert np.all(error <= found.r + ARITHMETIC * (1 + np.abs(exact).astype(float)))


@given(st.integers(0, 10**6), st.sampled_from(sorted(FUNCTIONS)))
def test_remainders_of_arguments_are_carried(seed: int, name: str) -> None:
    expression, reference, low, high = FUNCTIONS[name]
    core = _random_model(seed, low, high, 0.003)
    slack = 0.01 * (high - low)
    (found,) = Evaluator([x], expression)([core.widened(np.full(20, slack))])
    for shift in (-slack, 0.37 * slack, slack):
        for tau in (-1.0, 0.1, 1.0):
            exact = reference(_value(core.c, tau) + LONG(shift))
            error = np.abs(exact - _value(found.c, tau)).astype(float)
            assert np.all(error <= found.r * (1 + 1e-12) + ARITHMETIC)


def test_what_is_not_defined_has_no_bound() -> None:
    across = Model(np.array([[0.1, 0.3], [1.0, 0.3]]), np.zeros(2))
    for expression in (ca.sqrt(x), 1 / x, ca.log(x), x**0.5):
        (found,) = Evaluator([x], expression)([across])
        assert np.isinf(found.r[0]), expression
        assert found.r[1] < 1e-3, expression


def test_an_operation_without_bounds_is_named() -> None:
    with pytest.raises(UnboundedError, match="operation"):
        Evaluator([x], ca.floor(x))


@given(st.integers(0, 10**6))
def test_polynomials_and_slopes_on_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = BPoly(rng.normal(size=(rng.integers(2, 15), 3, 2)), [0.0, 0.7, 1.1, 3.0])
    cells = Cells.of(curve.x).halved().halved()
    derived = curve.derivative()
    for tau in (-0.999, 0.123, 0.987):
        times = cells.times(np.array([tau]))[:, 0]
        for i in range(2):
            value, slope = polynomials(curve, cells)[i], slopes(curve, cells)[i]
            assert np.max(value.r) < 1e-11
            near = np.abs(curve(times)[:, i] - _value(value.c, tau)).astype(float)
            assert np.all(near <= value.r + 1e-12)
            near = np.abs(derived(times)[:, i] - _value(slope.c, tau)).astype(float)
            assert np.all(near <= slope.r + 1e-10)


@given(st.integers(0, 10**6))
def test_least_value_is_bracketed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(9, 2, 3))
    c[0, 1] = c[-1, 0]
    curve = BPoly(c, [0.0, 1.0, 2.5])
    cells = Cells.of(curve.x)
    found = least(polynomials(curve, cells), cells, np.ones(3))
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
    (found,) = least(polynomials(curve, cells), cells, np.ones(1))
    assert found.time_s == pytest.approx(centre, abs=1e-6)
    assert found.guaranteed <= -1e-3 + 1e-12
