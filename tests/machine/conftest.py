"""Plans to replay: smooth ones whose inputs are exact polynomials, made without any method."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import fsolve

from planner.plan import Plan
from planner.problem import Problem
from planner.trajectory import StateTrajectory

T = 10.0
PAPER = {
    "system": {"kind": "manipulator", "joints": 3, "K": [0.870125, 0.711625], "k_g": 0.668811},
    "start": {"theta_deg": [1, 1, 1]},
    "goal": {"theta_deg": [30, 30, 30], "duration": T},
}


def plan_from_inputs(problem: Problem, u: BPoly, pieces: int = 200) -> Plan:
    """A plan that executes u (values (2,)); its q by tight integration and Hermite pieces."""
    system, end = problem.system, float(u.x[-1])
    grid = np.unique(np.concatenate([np.linspace(0, end, pieces + 1), u.x]))
    motion = solve_ivp(
        lambda t, q: system.rates(q, u(t)),
        (0, end),
        problem.start,
        "DOP853",
        t_eval=grid,
        rtol=1e-12,
        atol=1e-13,
        max_step=float(np.min(np.diff(u.x))),
    )
    q = motion.y.T
    rates = system.rates(q, u(grid))
    q_curve = BPoly.from_derivatives(grid, np.stack([q, rates], axis=1))
    power = PPoly.from_bernstein_basis(u)
    shifted = [power.derivative(k)(grid[:-1]) for k in range(power.c.shape[0])]
    scale = [1.0 / np.prod(np.arange(1, k + 1)) for k in range(len(shifted))]
    coefficients = np.stack([s * f for s, f in zip(shifted, scale, strict=True)][::-1])
    u_curve = BPoly.from_power_basis(PPoly(coefficients, grid))
    return Plan(problem, "by hand", {}, StateTrajectory(system, q_curve, u_curve))


def polynomial_inputs(*coefficients: tuple[float, ...], end: float = T) -> BPoly:
    """u(t) from the power coefficients of u1 and of u2, highest first."""
    size = max(len(c) for c in coefficients)
    padded = np.array([[0.0] * (size - len(c)) + list(c) for c in coefficients])
    return BPoly.from_power_basis(PPoly(padded.T[:, None, :], [0.0, end]))


def _bell(problem: Problem, u1: float, skew: float) -> BPoly:
    """u1 constant; u2 bell-shaped, zero at both ends, of the travel that θ₁ needs."""
    turn = problem.goal[1] - problem.start[1]
    even = np.array([0.0, -1.0, T, 0.0]) * 6 * turn / T**3
    odd = np.array([1.0, -1.5 * T, T**2 / 2, 0.0]) * skew / T**3
    return polynomial_inputs((u1,), tuple(even + odd))


@pytest.fixture(scope="session")
def paper_problem() -> Problem:
    return Problem.from_dict(PAPER)


@pytest.fixture(scope="session")
def smooth_plan(paper_problem: Problem) -> Plan:
    """A smooth polynomial plan from (1, 1, 1) to (30, 30, 30) degrees in 10 s, |u| < 0.25 rad/s."""

    def miss(x: np.ndarray) -> np.ndarray:
        u = _bell(paper_problem, x[0] / 10, x[1])
        rates = paper_problem.system.rates
        end = solve_ivp(
            lambda t, q: rates(q, u(t)), (0, T), paper_problem.start, rtol=1e-11, atol=1e-12
        )
        return end.y[2:, -1] - paper_problem.goal[2:]

    u1, skew = fsolve(miss, [1.2, 0.0], xtol=1e-12)
    return plan_from_inputs(paper_problem, _bell(paper_problem, u1 / 10, skew))
