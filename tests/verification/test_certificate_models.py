"""Functions, polynomials and least values on cells: undefined ones, slopes, narrow dips."""

from itertools import product
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly

import planner
from planner.plan.curves import Cells
from planner.plan.trajectory import StateTrajectory
from planner.support.calculus.chebyshev import from_bernstein
from planner.verification.balls import (
    RADIUS_COLUMN,
    REMAINDER_FACTOR,
    Ball,
    models,
    polynomial_balls,
)
from planner.verification.enclosure import perturbed_motion
from planner.verification.functions import Expression, UnboundedError, derivative, polynomials
from planner.verification.input_models import InputSource, feedback_law, resolve, root, source_of
from planner.verification.models import POINTS, Model, least_values, nodes
from planner.verification.place_proofs import lower_model

x = ca.SX.sym("x")


def test_what_is_not_defined_has_no_bound() -> None:
    across = polynomial_balls(np.array([[[0.1, 0.3], [1.0, 0.3]]]), np.zeros((1, 2)))
    for expression in (ca.sqrt(x), 1 / x, ca.log(x), x**0.5):
        with np.errstate(all="ignore"):
            (found,) = models(Expression([x], expression)(across), 2)
        assert np.isinf(found.r[0]), expression
        assert found.r[1] < 1e-3, expression


def test_an_operation_without_bounds_is_named() -> None:
    with pytest.raises(UnboundedError, match="the function floor"):
        Expression([x], ca.floor(x))


def _value(c: np.ndarray, tau: float) -> np.ndarray:
    return np.polynomial.chebyshev.chebval(tau, c.T)


@given(st.integers(0, 10**6))
def test_polynomials_and_slopes_on_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = BPoly(rng.normal(size=(rng.integers(2, 15), 3, 2)), [0.0, 0.7, 1.1, 3.0])
    cells = Cells.of(curve.x).halves().halves()
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


@pytest.mark.parametrize("degree", range(2, 15))
@pytest.mark.parametrize("scale", [1.0, 1e6, 1e-6])
def test_every_rounding_of_a_restriction_is_counted(degree: int, scale: float) -> None:
    """Nothing that is sampled comes near the worst case, so the bounds are held to their count.

    On part of a piece two subdivisions of as many levels as the degree round at least four times a
    level, then a product with a matrix once a term. A derivative is wrong by `slip` before that.
    """
    rng = np.random.default_rng(degree)
    curve = BPoly(scale * rng.uniform(0.5, 1.0, (degree + 1, 2, 1)), [0.0, 1.0, 2.5])
    matrix = np.sum(np.abs(from_bernstein(degree + 1)))
    whole = Cells.of(curve.x)
    for cells, steps in ((whole, degree + 1), (whole.halves(), 9 * degree + 1)):
        (found,) = polynomials(curve, cells)
        size = np.max(np.abs(curve.c[:, cells.piece, 0]), axis=0)
        assert np.all(found.r >= steps * matrix * 2.0**-53 * size)
        assert np.all(found.r <= 1e-11 * scale)
        (found,) = polynomials(curve, cells, 1)
        assert np.all(found.r >= derivative(curve, 1)[1][cells.piece, 0])


def test_cells_are_halved_until_the_motion_is_known_as_its_inputs_are() -> None:
    """Constant inputs, known at once, and eight turns round."""
    u = BPoly(np.array([[[1.0, 10.0]]]), [0.0, 5.0])
    path = StateTrajectory(planner.Unicycle(), BPoly(np.zeros((1, 1, 3)), [0.0, 5.0]), u)
    with np.errstate(all="ignore"):
        assert len(resolve(source_of(path)).cells.piece) == 4
        found = resolve(source_of(path), np.zeros(3))
    assert max(float(np.max(ball.relative_remainder)) for ball in found.rates) <= 1e-10


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_inputs_that_are_off_lead_to_motions_in_the_wider_balls(speed: float) -> None:
    """A car with a trailer, pulled and backed, which folds it: by another integrator."""
    train, start = planner.Trailers([2.0]), np.array([0.0, 0.1, 0.3, 0.1, 0.0])
    breaks, u, off = [0.0, 0.5, 1.0], np.array([speed, 0.2]), np.array([1e-7, 2e-7])
    still, inputs = (BPoly(np.tile(x, (1, 2, 1)), breaks) for x in (start, u))
    with np.errstate(all="ignore"):
        motion = resolve(source_of(StateTrajectory(train, still, inputs)), start)
        found = perturbed_motion(train, motion, off)
    times = motion.cells.times(nodes())
    far = np.zeros((train.size, *times.shape))
    for signs in product((-1, 0, 1), repeat=2):
        true = solve_ivp(
            lambda _, q, u: train.rates(q, u),
            (0.0, 1.0),
            start,
            "DOP853",
            t_eval=times.ravel(),
            args=(u + signs * off,),
            rtol=1e-12,
            atol=1e-13,
        ).y.reshape(far.shape)
        for i, ball in enumerate(found.q):
            away = np.abs(true[i] - ball.points.c)
            assert np.all(away <= ball.points.r + 1e-11), i
            far[i] = np.maximum(far[i], away)
    most = [np.max(ball.points.r) for ball in found.q]
    assert np.all(most <= 20 * np.max(far, axis=(1, 2)))


def test_a_cell_of_noise_is_halved_once_however_often_others_are() -> None:
    """In the first second a remainder of 1e-6 that does not shrink, in the other one of 5e-3 that
    shrinks a hundredfold whenever it is halved."""

    def inputs(cells: Cells) -> list[Ball]:
        rest = np.where(cells.piece == 0, 1e-6, 5e-3 * (4 * cells.size) ** np.log2(100))
        zero = np.zeros((len(rest), len(RADIUS_COLUMN)))
        radius = np.where(np.arange(len(RADIUS_COLUMN)) < POINTS, zero, np.inf)
        radius[:, -1] = rest / REMAINDER_FACTOR[-1]
        return [Ball(zero, zero, radius)] * 2

    trajectory: Any = SimpleNamespace(breaks=np.array([0.0, 1.0, 2.0]))
    found = resolve(InputSource(trajectory, inputs, inputs))
    np.testing.assert_array_equal(np.bincount(found.cells.piece), [8, 64])


@given(st.integers(0, 10**6))
def test_least_value_is_bracketed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    c = rng.normal(size=(9, 2, 3))
    c[0, 1] = c[-1, 0]
    curve = BPoly(c, [0.0, 1.0, 2.5])
    cells = Cells.of(curve.x)
    found = least_values([(1.0, p, 0.0) for p in polynomials(curve, cells)], cells, np.ones(3))
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
    (found,) = least_values([(1.0, p, 0.0) for p in polynomials(curve, cells)], cells, np.ones(1))
    assert found.time_s == pytest.approx(centre, abs=1e-6)
    assert found.guaranteed <= -1e-3 + 1e-12


def test_the_rate_of_a_feedback_is_its_derivative_along_the_motion() -> None:
    """u of (z, v) and du/dt of (z, v, ż, v̇), by differences of the chart's NumPy code."""
    arm = planner.Manipulator([0.87, 0.71], 0.67)
    form, rng = planner.chained_form(arm), np.random.default_rng(2)
    for _ in range(5):
        q = rng.uniform(0.2, 0.9, 4)
        branch, z = arm.branch(q), form.z(q)
        v, dz, dv = (rng.normal(size=k) for k in (2, 4, 2))
        u, rate = feedback_law(arm, tuple(branch.tolist()))
        balls = [[Ball.constant(float(value)) for value in x] for x in (z, v, dz, dv)]
        np.testing.assert_allclose(
            [ball.c[0, 0] for ball in u(*balls[:2])], form.inputs(z, v, branch), rtol=1e-12
        )
        h = 1e-6
        ahead, back = (form.inputs(z + s * dz, v + s * dv, branch) for s in (h, -h))
        found = [ball.c[0, 0] for ball in rate(*balls)]
        np.testing.assert_allclose(found, (ahead - back) / (2 * h), rtol=1e-6, atol=1e-7)


def test_a_root_lies_where_slope_and_defect_allow_it_and_nowhere_else() -> None:
    """x² = 2 from 1.4 with its slope 2x; from zero nothing is known of it."""
    for start, side in ((1.4, 1.0), (-1.4, -1.0)):
        guess = whole_ball(start)
        found, slope = root(guess, guess * guess + -2.0, lambda x: x * 2.0, side)
        away = np.abs(side * np.sqrt(2.0) - found.c)
        assert np.all(away <= found.r)
        assert np.all(found.r < 1.1 * away)
        assert np.all(np.abs(2 * side * np.sqrt(2.0) - slope.c) <= slope.r)
    for start, side in ((0.1, 1.0), (1.4, -1.0)):  # far away; the slope has another sign
        guess = whole_ball(start)
        found, slope = root(guess, guess * guess + -2.0, lambda x: x * 2.0, side)
        assert np.all(np.isinf(found.r))
        assert np.all(np.isinf(slope.r))


def whole_ball(value: float) -> Ball:
    """A number on one cell."""
    return Ball(np.full((1, len(RADIUS_COLUMN)), value), *np.zeros((2, 1, len(RADIUS_COLUMN))))


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.1, 0.4), (-0.3, 0.2), (-0.5, -0.1), (-0.9, -0.5), (-2.0, -1.0), (-1.5, 1.0)],
)
def test_no_place_of_a_link_is_farther_than_it_is(low: float, high: float) -> None:
    """A point on the line of a link of length 0.7, at a along it: from behind its base (a > 0)
    to beyond its end. On one range of a the bound is the distance itself, and across two ranges it
    is at both ends."""
    length, middle, half = 0.7, (low + high) / 2, (high - low) / 2
    x = np.linspace(-1, 1, 41)
    a = middle + half * x
    squared = [middle**2 + half**2 / 2, 2 * middle * half, half**2 / 2]
    along, square = (Model(np.array([c]), np.zeros(1)) for c in ([middle, half], squared))
    found = lower_model(square, along, square, length)
    bound = np.polynomial.chebyshev.chebval(x, found.c[0])
    truth = np.where(a >= 0, a, np.maximum(0.0, -a - length)) ** 2
    assert np.all(bound - found.r <= truth + 1e-12)
    if low >= 0 or high <= -length or (high <= 0 and low >= -length):
        assert bound == pytest.approx(truth, abs=1e-12)
    else:
        assert bound[[0, -1]] == pytest.approx(truth[[0, -1]], abs=1e-12)
