"""Every operation on balls against mpmath, at random complex points of its discs.

These tests are what the certificate's soundness rests on: each operation must contain every value
that the discs of its arguments allow, rounding included, on the points, the segment and ellipses.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy.interpolate import BPoly

from planner import Trailers
from planner.plan.curves import Cells
from planner.plan.trajectory import StateTrajectory
from planner.verification import balls
from planner.verification import models as series
from planner.verification.balls import POINTS, RADIUS_COLUMN, RHO, Ball, models, polynomial_balls
from planner.verification.enclosure import enclose, integral
from planner.verification.functions import SUPPORTED, Expression, balls_on_cells
from planner.verification.input_models import composite
from planner.verification.models import halves

pytestmark = pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # as `certify`
mp = mpmath.mp.clone()
mp.dps = 40
OWN = mp.mpf(10) ** -33
"""Rounding of the reference itself."""

x, y = ca.SX.sym("x"), ca.SX.sym("y")
Exact = Callable[..., Any]
ANY = (-3.0, 3.0)
PLUS = (0.05, 4.0)
COLUMNS = len(RADIUS_COLUMN)
CELLS = 8


def _angle(b: Any, a: Any) -> Any:
    """The angle of (a, b), continued to complex arguments."""
    if mp.re(a) > abs(mp.re(b)):
        return mp.atan(b / a)
    return mp.sign(mp.re(b)) * mp.pi / 2 - mp.atan(a / b)


OPERATIONS: dict[str, tuple[Any, Exact, list[tuple[float, float]]]] = {
    "add": (x + y, lambda a, b: a + b, [ANY, ANY]),
    "subtract": (x - y, lambda a, b: a - b, [ANY, ANY]),
    "multiply": (x * y, lambda a, b: a * b, [ANY, ANY]),
    "divide": (x / y, lambda a, b: a / b, [ANY, PLUS]),
    "divide by less than zero": (x / -y, lambda a, b: -a / b, [ANY, PLUS]),
    "negate": (-x, lambda a: -a, [ANY]),
    "square": (x * x, lambda a: a * a, [ANY]),
    "twice": (2 * x, lambda a: 2 * a, [ANY]),
    "constant": (x + 0.1, lambda a: a + mp.mpf(0.1), [ANY]),
    "scaled": (0.1 * x, lambda a: a * mp.mpf(0.1), [ANY]),
    "reciprocal": (1 / x, lambda a: 1 / a, [PLUS]),
    "sqrt": (ca.sqrt(x), mp.sqrt, [PLUS]),
    "cube": (x**3, lambda a: a**3, [ANY]),
    "power 2/3": (x ** (2 / 3), lambda a: a ** mp.mpf(2 / 3), [PLUS]),
    "power -1.5": (x**-1.5, lambda a: a ** mp.mpf(-1.5), [PLUS]),
    "power 12": (x**12, lambda a: a**12, [PLUS]),
    "exp": (ca.exp(x), mp.exp, [ANY]),
    "exp of what is wide": (ca.exp(7.0 * x), lambda a: mp.exp(7 * a), [ANY]),
    "log": (ca.log(x), mp.log, [PLUS]),
    "sin": (ca.sin(x), mp.sin, [(-30.0, 30.0)]),
    "cos": (ca.cos(x), mp.cos, [(-30.0, 30.0)]),
    "tan": (ca.tan(x), mp.tan, [(-1.4, 1.4)]),
    "asin": (ca.asin(x), mp.asin, [(-0.95, 0.95)]),
    "acos": (ca.acos(x), mp.acos, [(-0.95, 0.95)]),
    "atan": (ca.atan(x), mp.atan, [ANY]),
    "atan2, x > 0": (ca.atan2(x, y), _angle, [ANY, PLUS]),
    "atan2, y > 0": (ca.atan2(x, y), _angle, [PLUS, ANY]),
    "atan2, y < 0": (ca.atan2(-x, y), lambda a, b: _angle(-a, b), [PLUS, ANY]),
    "sinh": (ca.sinh(x), mp.sinh, [ANY]),
    "cosh": (ca.cosh(x), mp.cosh, [ANY]),
    "tanh": (ca.tanh(x), mp.tanh, [ANY]),
}


def _argument(rng: np.random.Generator, low: float, high: float) -> Ball:
    """Discs from rounding to a third, slopes from 1e-9 to a third over the ellipse."""
    shape = (CELLS, COLUMNS)
    c = rng.uniform(low, high, shape)
    b = (
        rng.normal(size=shape)
        * 10.0 ** rng.uniform(-9, -0.5, shape)
        / np.maximum(RADIUS_COLUMN, 1.0)
    )
    b[:, :POINTS] = 0.0
    r = 10.0 ** rng.uniform(-17, -0.7, shape) * rng.integers(0, 2, shape)
    return Ball(c, b, r)


def _place(rng: np.random.Generator, column: int) -> Any:
    """A point of the segment, or of an ellipse, mostly near its edge; zero for a point."""
    if column <= POINTS:
        return mp.mpf(rng.uniform(-1, 1) if column == POINTS else 0.0)
    w = mp.mpf(float(RHO[column - POINTS])) * mp.expjpi(rng.uniform(0, 2))
    return (w + 1 / w) / 2 * mp.mpf(rng.uniform() ** 0.2)


def _values(rng: np.random.Generator, ball: Ball, cell: int, column: int, z: Any) -> Any:
    """A value that a ball allows at z, mostly on the edge of its disc."""
    c, b, r = (float(v[cell, column]) for v in (ball.c, ball.b, ball.r))
    real = column <= POINTS
    way = mp.mpf(rng.choice([-1.0, 1.0])) if real else mp.expjpi(rng.uniform(0, 2))
    return mp.mpf(c) + mp.mpf(b) * z + mp.mpf(r) * way * mp.mpf(rng.uniform() ** 0.2)


def _holds(ball: Ball, cell: int, column: int, z: Any, exact: Any) -> bool:
    c, b, r = (mp.mpf(float(v[cell, column])) for v in (ball.c, ball.b, ball.r))
    return bool(abs(exact - c - b * z) <= r + OWN)


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_contains_the_exact_values(name: str) -> None:
    expression, exact, ranges = OPERATIONS[name]
    rng = np.random.default_rng(sorted(OPERATIONS).index(name))
    arguments = [_argument(rng, low, high) for low, high in ranges]
    symbols = [x, y][: len(arguments)]
    with np.errstate(all="ignore"):
        (found,) = Expression([ca.vertcat(*symbols)], expression)(arguments)
    bounded = np.argwhere(np.isfinite(found.r))
    assert len(bounded) > CELLS * COLUMNS / 3
    for cell, column in bounded:
        z = _place(rng, column)
        values = [_values(rng, ball, cell, column, z) for ball in arguments]
        assert _holds(found, cell, column, z, exact(*values)), (name, cell, column)


@pytest.mark.parametrize("name", ["abs", "sign"])
def test_signs_belong_to_the_whole_cell(name: str) -> None:
    """One function on all columns: its sign on the segment holds on the ellipses, or nothing."""
    expression = {"abs": ca.fabs(x), "sign": ca.sign(x)}[name]
    rng = np.random.default_rng(1)
    base, slope, doubt = rng.normal(size=CELLS), rng.normal(size=CELLS) / 2, rng.uniform(size=CELLS)
    r = np.broadcast_to(doubt[:, None] / 3, (CELLS, COLUMNS))
    b = np.where(np.arange(COLUMNS) < POINTS, 0.0, slope[:, None])
    c = np.repeat(base[:, None], COLUMNS, 1)
    c[:, :POINTS] += slope[:, None] * series.nodes()
    (found,) = Expression([x], expression)([Ball(c, b, r)])
    kept = np.abs(base) > np.abs(slope) + doubt / 3
    assert 0 < np.sum(kept) < CELLS
    if name == "abs":  # no more than the range of |p| where its sign may change
        low, high = (found.c + s * found.r for s in (-1, 1))
        most = np.abs(base) + np.abs(slope) + doubt / 3
        assert np.all(low[~kept, : POINTS + 1] >= -1e-14)
        assert np.all(high[~kept, : POINTS + 1] <= most[~kept, None] * (1 + 1e-14))
    for cell in range(CELLS):
        for column in range(COLUMNS):
            if column > POINTS and not kept[cell]:
                assert np.isinf(found.r[cell, column])
                continue
            z = _place(rng, column)
            at = mp.mpf(float(series.nodes()[column])) if column < POINTS else z
            own = (
                base[cell]
                + mp.mpf(slope[cell]) * at
                + mp.mpf(doubt[cell] * 0.33) * rng.choice([-1, 1])
            )
            sign = mp.sign(mp.mpf(base[cell])) if column > POINTS else mp.sign(own)
            assert _holds(found, cell, column, z, sign * own if name == "abs" else sign)


def test_every_operation_that_balls_know_is_tested() -> None:
    tested = {ca.OP_FABS, ca.OP_SIGN}
    for expression, *_ in OPERATIONS.values():
        function = ca.Function("f", [ca.vertcat(x, y)], [expression])
        tested |= {function.instruction_id(k) for k in range(function.n_instructions())}
    never = {ca.OP_ASSIGN, ca.OP_CONSTPOW, ca.OP_POW}
    assert SUPPORTED - never <= tested, SUPPORTED - tested


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("sin", -60.0, 60.0),
        ("cos", -60.0, 60.0),
        ("exp", -20.0, 20.0),
        ("expm1", 0.0, 3.0),
        ("sinh", 0.0, 3.0),
        ("log", 1e-3, 9.0),
        ("sqrt", 1e-3, 9.0),
        ("arctan", -9.0, 9.0),
        ("arcsin", -1.0, 1.0),
    ],
)
def test_numpy_is_right_within_four_units(name: str, low: float, high: float) -> None:
    rng = np.random.default_rng(2)
    at = np.concatenate(
        [rng.uniform(low, high, 150), rng.normal(size=50) * 1e-8 + (low + high) / 2]
    )
    at = np.append(at, np.arange(-6, 7) * np.pi / 2 if name in ("sin", "cos") else [])
    exact = getattr(mp, {"arctan": "atan", "arcsin": "asin"}.get(name, name))
    for argument, value in zip(at, getattr(np, name)(at), strict=True):
        truth = exact(mp.mpf(argument))
        size = 1 if name in ("sin", "cos") else abs(truth)
        assert abs(truth - mp.mpf(value)) <= 4 * balls.ROUNDING_UNIT * size, argument


@pytest.mark.parametrize("a", [-2.5, -1.5, -1 / 3, 0.5, 2 / 3, 1.5, 9.0])
def test_numpy_powers_are_right_within_four_units(a: float) -> None:
    at = np.random.default_rng(3).uniform(1e-3, 9.0, 60)
    for argument, value in zip(at, at**a, strict=True):
        truth = mp.mpf(argument) ** mp.mpf(a)
        assert abs(truth - mp.mpf(value)) <= 4 * balls.ROUNDING_UNIT * truth


def _series(c: np.ndarray, z: Any) -> Any:
    """Chebyshev series, exactly."""
    before, now, total = mp.mpf(1), z, mp.mpf(float(c[0]))
    for value in c[1:]:
        total += mp.mpf(float(value)) * now
        before, now = now, 2 * z * now - before
    return total


def _node(column: int) -> Any:
    return -mp.cospi((2 * mp.mpf(column) + 1) / (2 * POINTS))


@pytest.mark.parametrize("width", [1, 2, 5, 16, 20])
def test_polynomials(width: int) -> None:
    rng = np.random.default_rng(width)
    c = rng.normal(size=(2, 3, width)) * 10.0 ** rng.uniform(-6, 0, (2, 3, 1))
    slip = 10.0 ** rng.uniform(-16, -8, (2, 3))
    found = polynomial_balls(c, slip)
    off = c.copy()
    off[..., -1] += slip * 0.999
    for k in range(2):
        for cell in range(3):
            for column in range(COLUMNS):
                z = _place(rng, column)
                exact = _series(off[k, cell], z if column >= POINTS else _node(column))
                assert _holds(found[k], cell, column, z, exact)


def _waves(rng: np.random.Generator, cells: int) -> tuple[np.ndarray, Ball]:
    """e^(a + bz + cz²/…) on some cells: its exponents, and its ball."""
    c = rng.normal(size=(1, cells, 3)) * np.array([0.3, 0.6, 0.1])
    return c[0], balls.exponential(polynomial_balls(c, np.zeros((1, cells)))[0])


def test_the_reciprocal_of_a_disc_is_hardly_larger_than_it() -> None:
    middle, width = 10.0, 0.1
    disc = polynomial_balls(np.array([[[middle]]]), np.array([[width]]))[0]
    found = balls.reciprocal(disc)
    truth = 1 / (middle - width) - 1 / middle
    assert np.max(found.reach[0, :POINTS]) < 1.001 * truth


def test_interpolants() -> None:
    rng = np.random.default_rng(4)
    c, ball = _waves(rng, 12)
    (found,) = models([ball], 12)
    assert np.max(found.r) < 1e-8  # bounds that say nothing would pass the rest
    for cell in range(12):
        for tau in (*rng.uniform(-1, 1, 10), -1.0, 1.0):
            z = mp.mpf(tau)
            assert abs(mp.exp(_series(c[cell], z)) - _series(found.c[cell], z)) <= found.r[cell]


def test_interpolants_of_wrong_values() -> None:
    """What the points' radii allow must be inside, in its worst combination."""
    rng = np.random.default_rng(5)
    c, ball = _waves(rng, 4)
    off = 1e-6
    for tau in rng.uniform(-1, 1, 12):
        way = np.sign(np.polynomial.chebyshev.chebvander(tau, POINTS - 1) @ series.interpolation())
        wrong = Ball(ball.c.copy(), ball.b, ball.r.copy())
        wrong.c[:, :POINTS] += off * way
        wrong.r[:, :POINTS] += off
        (found,) = models([wrong], 4)
        for cell in range(4):
            gap = abs(mp.exp(_series(c[cell], mp.mpf(tau))) - _series(found.c[cell], mp.mpf(tau)))
            assert gap <= found.r[cell]


def test_integrals() -> None:
    """Of the exponential over a few cells, at the points and on the ellipses."""
    rng = np.random.default_rng(6)
    breaks = np.array([0.0, 0.3, 0.4, 1.1])
    (t,) = balls_on_cells(BPoly(np.array([breaks[:-1], breaks[1:]]), breaks), Cells.of(breaks))
    found = integral(balls.exponential(t), np.diff(breaks), 0.25)
    assert np.max(found.r[:, :POINTS]) < 1e-12
    for cell in range(3):
        low, high = (mp.mpf(float(v)) for v in breaks[cell : cell + 2])
        for column in range(COLUMNS):
            z = _place(rng, column)
            at = _node(column) if column < POINTS else z
            exact = mp.mpf(0.25) + mp.exp((low + high) / 2 + at * (high - low) / 2) - 1
            assert _holds(found, cell, column, z, exact), (cell, column)


def test_integrals_of_lines() -> None:
    """∫ z dz = z²/2 from the middle, with nothing else for a wrong centre to hide in."""
    rng = np.random.default_rng(9)
    (line,) = polynomial_balls(np.array([[[0.3, 2.0]]]), np.zeros((1, 1)))
    found = integral(line, np.array([1.0]), 0.0)
    for column in range(POINTS, COLUMNS):
        for _ in range(12):
            z = _place(rng, column)
            middle = (mp.mpf(0.3) - 1) / 2  # ∫ from −1 to 0, over half the width
            exact = middle + (mp.mpf(0.3) * z + z * z) / 2
            assert _holds(found, 0, column, z, exact), column


def test_a_trailer_behind_a_car_that_goes_straight_on() -> None:
    """Its angle reads itself, and tan β/2 falls as e^(−vt/l): at complex times too, hardly more."""
    rng, breaks, length = np.random.default_rng(11), np.array([0.0, 0.3, 0.7]), 2.0
    start = np.array([0.0, 0.0, 0.8, 0.1, 0.0])  # x, steering, hitch, heading of the trailer, y
    still = np.tile(start, (1, 2, 1))
    speed = np.tile([1.5, 0.0], (1, 2, 1))
    path = StateTrajectory(Trailers([length], 1.0), BPoly(still, breaks), BPoly(speed, breaks))
    cells = Cells.of(breaks)
    with np.errstate(all="ignore"):
        motion = enclose(path, cells, balls_on_cells(path.u_curve, cells), start)
    hitch, heading = motion.q[2:4]
    assert np.max(hitch.r[:, : POINTS + 1]) < 1e-2  # a line is 3e-3 off
    assert np.max(hitch.ellipses.remainder) < 1e-12
    for cell in range(2):
        low, high = (mp.mpf(float(v)) for v in breaks[cell : cell + 2])
        for column in range(COLUMNS):
            z = _place(rng, column)
            at = _node(column) if column < POINTS else z
            fallen = mp.exp(-1.5 * ((low + high) / 2 + at * (high - low) / 2) / length)
            exact = 2 * mp.atan(mp.tan(mp.mpf(0.8) / 2) * fallen)
            assert _holds(hitch, cell, column, z, exact), (cell, column)
            assert _holds(heading, cell, column, z, mp.mpf(0.1) + mp.mpf(0.8) - exact)


def test_lines_where_ellipses_say_nothing() -> None:
    rng = np.random.default_rng(10)
    (line,) = polynomial_balls(np.array([[[0.3, 2.0]]]), np.full((1, 1), 1e-3))
    line.r[:, POINTS + 1 :] = np.inf
    (found,) = models([line], 1)
    assert 1e-3 <= found.r[0] < 1.1e-3
    for tau in rng.uniform(-1, 1, 9):
        exact = mp.mpf(0.3) + 2 * mp.mpf(tau)
        assert abs(_series(found.c[0], mp.mpf(tau)) - exact) <= found.r[0]


def test_angles_across_their_cut_have_no_bound() -> None:
    """x < 0 while y changes its sign: the angle jumps by 2π."""
    base = np.ones((1, COLUMNS))
    b, r = 0 * base, np.full((1, COLUMNS), 0.2)
    beside, across = Ball(-base, b, r), Ball(0.1 * base, b, r)
    for y in (across, -across):
        assert np.all(np.isinf(balls.arctangent2(y, beside).r))
    assert np.all(np.isfinite(balls.arctangent2(Ball(base, b, r), -across).r))


def test_errors_of_rates_add_up_in_integrals() -> None:
    width = np.array([0.5, 0.25])
    c = np.zeros((2, COLUMNS))
    off = integral(Ball(c, c, c + 1e-3), width, 0.0)
    assert np.all(off.r[0, :POINTS] >= 1e-3 * 0.5 * (series.nodes() + 1) / 2)
    assert np.all(off.r[1] >= 1e-3 * 0.5)
    assert np.all(off.r[:, POINTS:] >= 1e-3 * width[:, None] / 2 * RADIUS_COLUMN[POINTS:])


@pytest.mark.parametrize("width", [1, 2, 6, 17])
def test_polynomials_of_balls(width: int) -> None:
    rng = np.random.default_rng(width)
    c = rng.normal(size=(2, CELLS, width)) * 10.0 ** -np.linspace(0, 3, width)
    slip = 10.0 ** rng.uniform(-16, 0, (2, CELLS, 1))
    argument = _argument(rng, -1.0, 1.0)
    found = composite(c, slip, argument)
    off = c.copy()
    off[..., -1:] += slip * 0.999
    for cell in range(CELLS):
        for column in range(COLUMNS):
            z = _place(rng, column)
            at = _values(rng, argument, cell, column, z)
            for k in range(2):
                assert _holds(found[k], cell, column, z, _series(off[k, cell], at))


def test_halves() -> None:
    rng = np.random.default_rng(7)
    c = rng.normal(size=(6, POINTS)) * 10.0 ** -np.linspace(0, 9, POINTS)
    new, r = halves(c, np.zeros(6))
    for row in range(12):
        for tau in rng.uniform(-1, 1, 4):
            whole = (mp.mpf(tau) + (1 if row >= 6 else -1)) / 2
            gap = abs(_series(c[row % 6], whole) - _series(new[row], mp.mpf(tau)))
            assert gap <= r[row] < 1e-12


def test_constants_of_the_bounds() -> None:
    """Matrices right to a few units; the sums that bounds rest on not too small."""
    for column in range(POINTS):
        for k in range(POINTS):
            exact = mp.chebyt(k, _node(column))
            assert abs(exact - series.evaluation(POINTS)[column, k]) <= 4 * balls.ROUNDING_UNIT
    basis = np.polynomial.chebyshev.chebvander(np.linspace(-1, 1, 2001), POINTS - 1)
    lebesgue = np.sum(np.abs(basis @ series.interpolation()), axis=1)
    assert 0.999 * series.LEBESGUE_BOUND < np.max(lebesgue) <= series.LEBESGUE_BOUND
    for z in (_place(np.random.default_rng(8), column) for column in range(POINTS, COLUMNS)):
        column = np.flatnonzero(float(abs(z)) <= RADIUS_COLUMN)
        assert len(column)
    for column, rho in enumerate(RHO, POINTS):
        edge = [(rho * w + 1 / (rho * w)) / 2 for w in np.exp(1j * np.linspace(0, np.pi, 201))]
        assert np.max(np.abs(edge)) <= RADIUS_COLUMN[column]
        assert np.max(np.abs(np.square(edge) - 0.5)) <= balls.SQUARE_COLUMN[column]


def test_whole_powers_are_products_whatever_the_number_s_type() -> None:
    """A product is as tight as can be; Lagrange's bound of other powers is not."""
    (ball,) = polynomial_balls(np.array([[[1.0, 0.5, 0.25]]]) @ np.eye(3), np.zeros((1, 1)))
    squared, product = balls.power(ball, 2.0), ball * ball
    for name in ("c", "b", "r"):
        assert np.array_equal(getattr(squared, name), getattr(product, name))


@pytest.mark.parametrize("a", [2.5, 12.0, -1.5])
@pytest.mark.parametrize("reach", [0.3, 0.6, 0.9])
def test_powers_of_wide_discs_hold_their_edges(a: float, reach: float) -> None:
    one = np.ones((1, COLUMNS))
    found = balls.power(Ball(one, 0 * one, reach * one), a)
    for value in (1 - reach, 1 + reach):
        assert all(_holds(found, 0, k, mp.mpf(0), mp.mpf(value) ** a) for k in range(COLUMNS))


@pytest.mark.parametrize("reach", [0.1, 1.9, 2.1, 3.0, 10.0, 300.0, 9e5])
def test_the_exponential_of_what_is_wide(reach: float) -> None:
    """Its greatest value is within, and it is small where the whole disc is far below zero."""
    c = -1e6 if reach > 700 else 0.0
    one = np.ones((1, COLUMNS))
    found = balls.exponential(Ball(c * one, 0 * one, reach * one))
    highest = mp.exp(mp.mpf(c) + mp.mpf(reach))
    for r in found.r[0]:
        assert mp.mpf(float(found.c[0, 0])) + mp.mpf(float(r)) >= highest
        assert float(r) <= 3 * float(highest) + reach * np.exp(c) + 1e-300
