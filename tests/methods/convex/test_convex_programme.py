"""The least-distance programme: measured residuals, certificates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from planner.methods.convex.paths import Frame, input_shape
from planner.methods.convex.programme import Farkas, Optimum, StalledError, solve, solve_quadratic


def feasible(seed: int, rows: int = 30, size: int = 8) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rows, size)) * rng.uniform(0.1, 10, (rows, 1))
    inside = rng.normal(size=size)
    return A, A @ inside + rng.uniform(0, 0.3, rows)


@pytest.mark.parametrize("seed", range(3))
def test_optimum_agrees_with_an_independent_solver(seed: int) -> None:
    A, b = feasible(seed)
    answer = solve_quadratic(A, b, 100.0)
    assert isinstance(answer, Optimum)
    reference = minimize(
        lambda y: y @ y / 2,
        np.zeros(8),
        jac=lambda y: y,
        constraints={"type": "ineq", "fun": lambda y: b - A @ y, "jac": lambda y: -A},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert answer.value == pytest.approx(reference.fun, rel=1e-6)
    assert np.max(A @ answer.y - b) <= 1e-9
    assert np.all(answer.multipliers >= 0)
    # The bound is what the multipliers say, recomputed here.
    pull = A.T @ answer.multipliers
    assert -pull @ pull / 2 - b @ answer.multipliers == pytest.approx(answer.bound, abs=1e-8)
    assert answer.bound <= answer.value + 1e-9
    np.testing.assert_allclose(-pull, answer.y, atol=1e-7)


def test_a_wrong_answer_is_not_called_accurate() -> None:
    A, b = feasible(2)
    answer = solve_quadratic(A, b, 100.0)
    assert isinstance(answer, Optimum)
    assert answer.accurate
    assert not replace(answer, excess=1e-8).accurate
    assert not replace(answer, bound=answer.bound * 0.999).accurate


@pytest.mark.parametrize("seed", range(3))
def test_certificate_of_an_empty_set(seed: int) -> None:
    A, b = feasible(seed)
    A, b = np.concatenate([A, -A[:1]]), np.append(b, -b[0] - 0.5)  # A₀y ≤ b₀ and A₀y ≥ b₀ + ½
    answer = solve_quadratic(A, b, 50.0)
    assert isinstance(answer, Farkas)
    assert answer.margin > 0
    length = np.linalg.norm(A, axis=1)
    u = answer.multipliers
    assert np.all(u >= 0)
    assert (b / length) @ u + 50.0 * np.linalg.norm((A / length[:, None]).T @ u) < 0
    assert linprog(np.zeros(8), A, b, bounds=(None, None)).status == 2


def test_a_set_that_is_not_empty_has_no_certificate() -> None:
    """A thin set, feasible by 1e-7, must not be called empty."""
    A, b = feasible(4)
    A, b = np.concatenate([A, -A[:1]]), np.append(b, -b[0] + 1e-7)
    answer = solve_quadratic(A, b, 50.0)
    assert isinstance(answer, Optimum)
    assert np.max(A @ answer.y - b) <= 1e-9


def test_no_claim_is_made_where_none_can_be() -> None:
    """Empty, but with an infinite radius no residual is small enough for a certificate."""
    A, b = np.array([[1.0, 1e-17], [-1.0, 1e-17]]), np.array([-1.0, -1.0])
    with pytest.raises(StalledError):
        solve_quadratic(A, b, np.inf)


def test_a_solver_that_raises_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("out of order")

    monkeypatch.setattr("scipy.optimize.nnls", fail)
    with pytest.raises(StalledError):
        solve_quadratic(np.array([[-1.0, 0.0]]), np.array([-2.0]), 10.0)


def least_peak(frame: Frame, A: np.ndarray, b: np.ndarray, size: float = 1.0) -> float:
    """The least peak of a linear programme in units of `size`."""
    C, d = frame.coefficient_rows()
    one = np.ones((len(C), 1))
    rows = np.block([[C, -one], [-C, -one], [A, np.zeros((len(A), 1))]])
    limits = np.concatenate([-d, d, b]) / size
    return linprog(np.append(np.zeros(frame.size), 1.0), rows, limits, bounds=(None, None)).fun


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("size", [1e-11, 1e-5, 1.0, 1e5])
def test_the_least_peak_agrees_with_a_linear_programme_at_every_size(
    size: float, degree: int
) -> None:
    """A floor and a cap of z₂ keep the path from the one of least peak without them."""
    start, goal = size * np.array([0.1, 0.2, -0.1, 0.3]), size * np.array([0.8, -0.1, 0.2, 0.1])
    frame = Frame(input_shape(20, degree), start, goal, 0.7)
    rows, constant = frame.z_rows(1, np.linspace(0.1, 0.9, 9))
    A = np.concatenate([rows, -rows])
    b = np.concatenate([size * 0.9 - constant, constant + size * 0.8])
    answer, least = solve("peak", frame, A, b, 1e9), least_peak(frame, A, b, size)
    assert isinstance(answer, Optimum)
    assert least_peak(frame, A[:0], b[:0], size) < 0.99 * least
    assert answer.value == pytest.approx(size * least, rel=1e-8)
    assert answer.bound == pytest.approx(answer.value, rel=1e-9)
    assert answer.excess <= 1e-10 * size


def test_a_least_peak_among_paths_that_nearly_have_it_is_found() -> None:
    """With one ε for all rounds the path creeps towards it by a millionth a round."""
    frame = Frame(
        input_shape(12, 1),
        np.array([-1.148, -0.2496, -0.8495]),
        np.array([0.0694, -0.1468, 1.6817]),
        0.71677,
    )
    tau = np.array([0.06212, 0.06345, 0.43195])
    rows, constant = frame.z_rows(1, tau)
    middle = -0.2496 + 0.1028 * tau
    A = np.concatenate([rows, -rows])
    b = np.concatenate([middle + 4.961 - constant, constant - middle + 4.961])
    answer = solve("peak", frame, A, b, 1e6)
    assert isinstance(answer, Optimum)
    assert answer.value == pytest.approx(least_peak(frame, A, b), rel=1e-8)


def test_a_refutation_holds_at_every_size() -> None:
    frame = Frame(input_shape(20, 0), np.zeros(3), np.array([1.0, 1e4, 2e3]), 1.0)
    rows, constant = frame.z_rows(1, np.array([0.5]))
    A, b = np.concatenate([rows, -rows]), np.array([0.0, -1e3]) + np.append(-constant, constant)
    answer = solve("peak", frame, A, b, 1e6)
    assert isinstance(answer, Farkas)
    assert answer.radius == 1e6
    length = np.linalg.norm(A, axis=1)
    assert answer.multipliers @ (b / length) == pytest.approx(answer.value, rel=1e-9)
    assert answer.margin > 0
