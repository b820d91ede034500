"""The least-distance programme: measured residuals, certificates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from planner.methods.convex.programme import Farkas, Optimum, StalledError, solve_quadratic


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
