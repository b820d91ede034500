"""Plans and machines made by hand: inputs that are exact polynomials, no method involved."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import fsolve

from planner import Machine, Plan, Problem
from planner.machine.machine import Draws, draw
from planner.plan.trajectory import StateTrajectory

K, K_G = [0.870125, 0.711625], 0.668811


def arm_problem(
    theta: list[float], end: float = 10.0, goal: list[float] | None = None, **tables: Any
) -> Problem:
    """A manipulator of as many joints as `theta` has, in degrees; later gear ratios shrink."""
    n = len(theta)
    ratios = [K[0] * 0.8178 ** (i - 2) for i in range(2, n + 1)]
    return Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": n, "K": ratios, "k_g": K_G},
            "start": {"theta_deg": theta},
            "goal": {"theta_deg": goal or theta, "duration": end},
            **tables,
        }
    )


def inputs(*pieces: tuple[list[float], list[float]], breaks: list[float]) -> BPoly:
    """u(t) by pieces, each two lists of power coefficients in t − start, highest first."""
    size = max(len(c) for piece in pieces for c in piece)
    padded = [[[0.0] * (size - len(c)) + list(c) for c in piece] for piece in pieces]
    return BPoly.from_power_basis(PPoly(np.array(padded).transpose(2, 0, 1), breaks))


def plan_from(problem: Problem, u: BPoly, pieces: int = 200) -> Plan:
    """A plan that executes u (values (2,)); its q by tight integration, piece by piece of u."""
    system = problem.system
    edges = np.unique(np.concatenate([np.linspace(0, u.x[-1], pieces + 1), u.x]))
    q = [problem.start]
    for a, b in pairwise(edges):
        inside = np.nextafter(b, a)

        def rates(t: float, q: np.ndarray, inside: float = inside) -> np.ndarray:
            return system.rates(q, u(min(t, inside)))

        q.append(solve_ivp(rates, (a, b), q[-1], "DOP853", rtol=1e-12, atol=1e-13).y[:, -1])
    nodes = np.array(q)
    left = system.rates(nodes[:-1], u(edges[:-1]))
    right = system.rates(nodes[1:], u(np.nextafter(edges[1:], 0)))
    cubic = [nodes[:-1], nodes[:-1] + left * _third(edges), nodes[1:] - right * _third(edges)]
    q_curve = BPoly(np.stack([*cubic, nodes[1:]]), edges)
    return Plan(problem, "by hand", {}, StateTrajectory(system, q_curve, _on(u, edges)))


def _third(edges: np.ndarray) -> np.ndarray:
    return np.diff(edges)[:, None] / 3


def _on(u: BPoly, edges: np.ndarray) -> BPoly:
    """The same polynomials on finer breaks."""
    power = PPoly.from_bernstein_basis(u)
    degree = power.c.shape[0] - 1
    factorial = [float(np.prod(np.arange(1, k + 1))) for k in range(degree + 1)]
    taylor = [power.derivative(k)(edges[:-1]) / factorial[k] for k in range(degree, -1, -1)]
    return BPoly.from_power_basis(PPoly(np.array(taylor), edges))


def smooth_plan_of(problem: Problem) -> Plan:
    """u1 constant, u2 a smooth bell with zero ends, such that all three joints reach the goal."""
    end = float(problem.duration or 0.0)
    turn = problem.goal[1] - problem.start[1]

    def bell(u1: float, skew: float) -> BPoly:
        even = np.array([0.0, -1.0, end, 0.0]) * 6 * turn / end**3
        odd = np.array([1.0, -1.5 * end, end**2 / 2, 0.0]) * skew / end**3
        return inputs(([u1 / end], list(even + odd)), breaks=[0.0, end])

    def miss(x: np.ndarray) -> np.ndarray:
        u = bell(x[0], x[1])
        rates = problem.system.rates
        motion = solve_ivp(
            lambda t, q: rates(q, u(t)), (0, end), problem.start, rtol=1e-11, atol=1e-12
        )
        return np.asarray(motion.y[2:, -1] - problem.goal[2:])

    u1, skew = fsolve(miss, [1.2, 0.0], xtol=1e-12)
    return plan_from(problem, bell(u1, skew))


def draws_of(joints: int = 3, samples: int = 1, **effects: Any) -> Draws:
    """Samples of an ideal machine with these effects."""
    return draw(Machine.ideal(**effects), joints, np.arange(samples), 0)
