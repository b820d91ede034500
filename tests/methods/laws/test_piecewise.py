"""The piecewise constant law against its closed form, and its least-squares choice of slots."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.methods.laws.legs import Leg, steer

Array = np.ndarray
boundary = st.lists(st.floats(-1, 1), min_size=8, max_size=8).map(np.array)
travels = st.one_of(st.floats(0.2, 2.0), st.floats(-2.0, -0.2))


def _closed_form(b0: float, T: float, slots: int, rows: int) -> Array:
    """The matrix N of theory.md §4 for any number of slots, shape (rows, slots)."""
    d = T / slots
    N = np.empty((rows, slots))
    for i in range(rows):
        for j in range(slots):
            span = (T - j * d) ** (i + 1) - (T - (j + 1) * d) ** (i + 1)
            N[i, j] = b0**i * span / factorial(i + 1)
    return N


def _drift(z0: Array, travel: float) -> Array:
    rows = len(z0) - 1
    D = [[travel ** (i - j) / factorial(i - j) if i >= j else 0.0 for j in range(rows)]
         for i in range(rows)]  # fmt: skip
    return np.array(D) @ z0[1:]


@given(
    size=st.integers(3, 8),
    extra=st.integers(0, 4),
    start=boundary,
    goal=boundary,
    travel=travels,
)
def test_slots_solve_the_closed_form(
    size: int, extra: int, start: Array, goal: Array, travel: float
) -> None:
    T, slots = 3.0, size - 1 + extra
    z0, zT = start[:size], goal[:size].copy()
    zT[0] = z0[0] + travel
    motion = steer(z0, zT, [Leg(T / slots, travel / slots, 1)] * slots)
    assert motion.residual <= 1e-9
    v2 = motion.v((np.arange(slots) + 0.5) * T / slots)[:, 1]
    N = _closed_form(travel / T, T, slots, size - 1)
    wanted = zT[1:] - _drift(z0, travel)
    scale = np.abs(N) @ np.abs(v2) + np.abs(wanted)
    assert np.all(np.abs(N @ v2 - wanted) <= 1e-9 * scale)
    # Least ∫v₂²: v₂ has no part that the conditions do not ask for.
    _, _, rows = np.linalg.svd(N / np.linalg.norm(N, axis=1, keepdims=True))
    assert np.max(np.abs(rows[size - 1 :] @ v2), initial=0.0) <= 1e-8 * np.linalg.norm(v2)


def test_more_slots_cost_less(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.travel": 0.82})
    costs = []
    for slots in (3, 6, 12):
        plan = planner.solve(problem, "piecewise", slots=slots, allow_singular=True)
        assert len(plan.t) == slots + 1
        middles = (np.arange(slots) + 0.5) * 10 / slots
        costs.append(np.mean(plan.v(middles)[:, 1] ** 2))
    assert costs[0] > costs[1] > costs[2]


def test_middle_of_the_range(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited, "piecewise", travel="middle")
    assert plan.verified
    ((low, high),) = plan.notes["travel_ranges_in_domain"]
    assert plan.travel == pytest.approx((low + high) / 2, abs=1e-12)


def test_two_legs(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.travel": 0.0})
    plan = planner.solve(problem, "piecewise", allow_singular=True, offset=0.4)
    z = plan.z(np.array([0.0, 5.0, 10.0]))
    assert z[1, 0] - z[0, 0] == pytest.approx(0.4, abs=1e-14)
    assert plan.notes["endpoint_residual"] < 1e-12
    assert len(plan.t) == 7


def test_too_few_slots(unlimited: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match="slots = 2 is too few"):
        planner.solve(unlimited, "piecewise", slots=2)
