"""Paths as affine functions of their coefficients, against their own polynomials."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import BPoly

from planner.methods.convex.paths import Frame, Shape, end_basis, input_shape

SHAPES = [(7, 0), (7, 1), (12, 0), (12, 1)]


def make(shape: Shape, coordinates: int, travel: float, seed: int) -> tuple[Frame, np.ndarray]:
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(-1, 1, (2, coordinates))
    goal[0] = start[0] + travel
    frame = Frame(shape, start, goal, travel)
    return frame, rng.normal(size=frame.size)


@pytest.mark.parametrize("kind", SHAPES)
@given(
    coordinates=st.integers(3, 6),
    travel=st.floats(0.3, 2.0).map(lambda d: d) | st.floats(-2.0, -0.3),
    seed=st.integers(0, 10**6),
)
def test_any_coefficients_meet_both_ends_and_obey_the_chain(
    kind: tuple[int, int], coordinates: int, travel: float, seed: int
) -> None:
    frame, y = make(input_shape(*kind), coordinates, travel, seed)
    curves = [BPoly(c, frame.shape.breaks) for c in frame.bernstein(y)]
    size = max(np.max(np.abs(c.c)) for c in curves)
    inner = np.random.default_rng(seed + 1).uniform(0, 1, 15)
    for i in range(1, coordinates):
        assert curves[i](0.0) == pytest.approx(frame.start[i], abs=1e-12 * size)
        assert curves[i](1.0) == pytest.approx(frame.goal[i], abs=1e-9 * size)
        rate = curves[i - 1](inner) * (travel if i > 1 else 1.0)
        np.testing.assert_allclose(curves[i].derivative()(inner), rate, atol=1e-9 * size)
        rows, constant = frame.z_rows(i, inner)
        np.testing.assert_allclose(rows @ y + constant, curves[i](inner), atol=1e-9 * size)


@pytest.mark.parametrize("kind", SHAPES)
def test_square_and_peak_are_those_of_the_curve(kind: tuple[int, int]) -> None:
    frame, y = make(input_shape(*kind), 4, -0.7, 3)
    omega = BPoly(frame.bernstein(y)[0], frame.shape.breaks)
    integral = sum(
        quad(lambda t: float(omega(t)) ** 2, a, b)[0]
        for a, b in zip(frame.shape.breaks[:-1], frame.shape.breaks[1:], strict=True)
    )
    assert np.sum(frame.x(y) ** 2) == pytest.approx(integral, rel=1e-9)
    dense = np.abs(omega(np.linspace(0, 1 - 1e-12, 20001)))
    assert frame.peak(y) == pytest.approx(dense.max(), rel=1e-3)
    assert frame.peak(y) >= dense.max() * (1 - 1e-12)


@pytest.mark.parametrize("kind", SHAPES)
def test_least_coefficients_are_orthogonal_to_the_free_ones(kind: tuple[int, int]) -> None:
    frame, _ = make(input_shape(*kind), 5, 0.9, 8)
    _, _, null = end_basis(frame.shape, 4)
    np.testing.assert_allclose(null.T @ frame.least, 0, atol=1e-12 * np.linalg.norm(frame.least))
