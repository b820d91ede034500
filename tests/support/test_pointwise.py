import casadi as ca
import numpy as np
import pytest

from planner.support.compiled_calls import Pointwise


@pytest.fixture(scope="module")
def column() -> Pointwise:
    q, u = ca.SX.sym("q", 3), ca.SX.sym("u", 2)
    return Pointwise("column", [q, u], ca.vertcat(q[0] * u[1], 0, ca.sin(q[2]), q[1]))


@pytest.mark.parametrize("lead", [(), (1,), (7,), (2, 3), (0,)])
def test_maps_over_leading_axes(column: Pointwise, lead: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    q, u = rng.normal(size=(*lead, 3)), rng.normal(size=(*lead, 2))
    expected = np.stack([q[..., 0] * u[..., 1], 0 * q[..., 0], np.sin(q[..., 2]), q[..., 1]], -1)
    np.testing.assert_allclose(column(q, u), expected, rtol=1e-15)


def test_matrices_keep_rows_and_columns() -> None:
    q = ca.SX.sym("q", 2)
    matrix = Pointwise("matrix", [q], ca.vertcat(ca.horzcat(q[0], 0, 1), ca.horzcat(q[1], q[0], 2)))
    points = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(matrix(points), [[[1, 0, 1], [2, 1, 2]], [[3, 0, 1], [4, 3, 2]]])


def test_arguments_may_be_strided(column: Pointwise) -> None:
    q = np.arange(12.0).reshape(3, 4).T
    u = np.ones((4, 4))[:, ::2]
    np.testing.assert_allclose(column(q, u)[:, 3], q[:, 1])


def test_many_sizes_keep_few_maps(column: Pointwise) -> None:
    rng = np.random.default_rng(1)
    q, u = rng.normal(size=(80, 3)), rng.normal(size=(80, 2))
    every = column(q, u)
    for count in range(1, 80):
        np.testing.assert_array_equal(column(q[:count], u[:count]), every[:count])
    assert len(column._mapped) == 7  # 1, 2, 4 … 64 points
