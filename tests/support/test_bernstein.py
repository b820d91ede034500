"""Piecewise polynomials against SciPy's, exact fractions, and on parts of their pieces."""

import subprocess
import sys
from fractions import Fraction
from math import comb
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly

from planner.support.calculus.bernstein import Bernstein, elevate, part, split
from planner.support.calculus.chebyshev import integration, points

SHAPES: list[tuple[int, ...]] = [(), (3,), (2, 2)]


def pair(degree: int, pieces: int, shape: tuple[int, ...]) -> tuple[Bernstein, Any, Any]:
    rng = np.random.default_rng((degree, pieces, len(shape)))
    x = np.append(-0.5, np.cumsum(rng.uniform(0.01, 3.0, pieces)))
    c = rng.normal(size=(degree + 1, pieces, *shape))
    return Bernstein(c, x), BPoly(c, x), rng


def places(x: Any, rng: Any) -> Any:
    """Between the breaks, at them, beside them, and outside."""
    outside = [x[0] - 0.3 * (x[1] - x[0]), x[-1] + 0.3 * (x[-1] - x[-2])]
    between = rng.uniform(x[0], x[-1], 50)
    beside = np.nextafter(x, -np.inf), np.nextafter(x, np.inf)
    return np.concatenate([between, x, *beside, outside])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("pieces", [1, 2, 7])
@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4, 5, 9, 15])
def test_values_derivatives_and_integrals_are_those_of_scipy(
    degree: int, pieces: int, shape: tuple[int, ...]
) -> None:
    ours, theirs, rng = pair(degree, pieces, shape)
    t = places(ours.x, rng)
    compared = [(ours, theirs), (ours.antiderivative(), theirs.antiderivative())]
    compared += [(ours.derivative(k), theirs.derivative(k)) for k in (1, 2, 3)]
    for mine, other in compared:
        expected = other(t)
        size = np.max(np.abs(other.c))
        assert mine(t).shape == (*t.shape, *shape)
        np.testing.assert_allclose(mine(t), expected, rtol=1e-13, atol=1e-13 * size)
        np.testing.assert_allclose(
            mine(t[:6].reshape(2, 3)), other(t[:6].reshape(2, 3)), atol=size * 1e-13
        )
        for single, wanted in zip(t[::9], expected[::9], strict=True):
            assert mine(single).shape == shape
            np.testing.assert_allclose(mine(single), wanted, rtol=1e-13, atol=1e-13 * size)
    assert np.all(np.isnan(ours(np.array([np.nan]))))
    assert np.all(np.isnan(ours(np.nan)))
    assert ours(np.zeros(0)).shape == (0, *shape)


@pytest.mark.parametrize("degree", [3, 8, 16])
def test_values_are_no_further_from_the_exact_ones_than_scipys(degree: int) -> None:
    ours, theirs, rng = pair(degree, 1, ())
    t = rng.uniform(*ours.x, 40)
    (a, b), c = map(Fraction, ours.x.tolist()), [Fraction(float(v)) for v in ours.c[:, 0]]
    exact = []
    for time in t.tolist():
        s = (Fraction(time) - a) / (b - a)
        terms = (c[j] * comb(degree, j) * s**j * (1 - s) ** (degree - j) for j in range(degree + 1))
        exact.append(sum(terms, Fraction(0)))
    many, single, scipys = (
        max(abs(float(Fraction(float(v)) - w)) for v, w in zip(values, exact, strict=True))
        for values in (ours(t), [ours(time) for time in t], theirs(t))
    )
    assert max(many, single) <= scipys + 4 * np.finfo(float).eps


def test_a_break_belongs_to_the_piece_that_begins_there() -> None:
    steps = Bernstein(np.array([[1.0, 2.0, 3.0]]), np.array([0.0, 1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(
        steps(np.array([-1.0, 0.0, 1.0, 2.0, 3.0, 4.0])), [1, 1, 2, 3, 3, 3]
    )
    assert [float(steps(t)) for t in (0.0, 1.0, 2.0, 3.0)] == [1, 2, 3, 3]
    piece = np.array([0, 1])
    np.testing.assert_array_equal(steps.piece_values(piece, np.ones((1, 2))), [[1, 2]])


@pytest.mark.parametrize("shape", SHAPES)
def test_inside_pieces_are_the_values_at_the_times(shape: tuple[int, ...]) -> None:
    curve, _, rng = pair(5, 4, shape)
    piece = np.array([0, 3, 1])
    for fraction in (rng.uniform(0.1, 0.9, (6, 3)), np.tile(rng.uniform(0.1, 0.9, (6, 1)), 3)):
        t = curve.x[piece] + np.diff(curve.x)[piece] * fraction
        np.testing.assert_allclose(
            curve.piece_values(piece, fraction), curve(t), rtol=0, atol=1e-13
        )


def test_pieces_of_an_antiderivative_meet_to_the_last_bit() -> None:
    c = pair(9, 40, ())[0].antiderivative().c
    np.testing.assert_array_equal(c[0, 1:], c[-1, :-1])


def test_parts_and_higher_degrees_are_the_same_polynomial() -> None:
    curve, _, rng = pair(6, 5, ())
    x = np.linspace(0.0, 1.0, 9)
    low, high = np.sort(rng.uniform(0.0, 1.0, (2, 5)), axis=0)
    at = rng.uniform(0.1, 0.9, 5)
    (left, right), middle = split(curve.c, at), part(curve.c, low, high)
    for c, begin, end in ((left, 0 * at, at), (right, at, 1.0), (middle, low, high)):
        unit = Bernstein(c, np.arange(6.0))
        pieces = np.arange(5)
        expected = curve.piece_values(pieces, begin + (end - begin) * x[:, None])
        values = unit.piece_values(pieces, np.tile(x[:, None], 5))
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13)
    higher = Bernstein(elevate(curve.c, 11), curve.x)
    t = places(curve.x, rng)[:-2]
    np.testing.assert_allclose(higher(t), curve(t), rtol=0, atol=1e-13)


def test_coefficients_that_do_not_fit_the_breaks_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Bernstein(np.zeros((2, 3)), np.arange(3.0))


def test_a_plan_starts_without_the_slow_parts_of_scipy() -> None:
    code = (
        "import sys; from planner.cli.app import main\n"
        "sys.argv = ['planner', 'plan', 'problems/paper.toml', '--quiet']\n"
        "try: main()\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "print([m for m in ('interpolate', 'special', 'optimize', 'spatial')"
        " if 'scipy.' + m in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("count", [15, 16, 29])
def test_integrals_by_values_begin_with_nothing_and_are_exact(count: int) -> None:
    x = points(count)
    np.testing.assert_array_equal(integration(count)[0], 0.0)
    for power in range(count):
        integral = integration(count) @ x**power
        np.testing.assert_allclose(integral, x ** (power + 1) / (power + 1), rtol=0, atol=1e-15)
