"""A first path inside the chart, found in the coordinates themselves, where no chart has an edge.

q₂ follows a curve that stays strictly between two bounds whatever its few parameters are; the other
coordinates are integrated along q₁, and least squares moves the parameters, and the travel where it
is free, until they end at the goal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from planner.convex.shape import Shape
from planner.problem import Problem
from planner.systems.base import Array, TriangularSystem
from planner.systems.manipulator import Manipulator

STEPS = 60
"""Runge–Kutta steps along the path."""

CLOSE = 1e-6
"""Largest miss at the goal, in the coordinates' units."""


@dataclass(frozen=True)
class Seed:
    """A path that meets the goal.

    Attributes:
        travel: Its travel.
        q: Coordinates at equal steps of q₁, shape (STEPS+1, N).
    """

    travel: float
    q: Array

    def coefficients(self, shape: Shape, z2: Array) -> Array:
        """Coefficients x of a shape that follow z₂ (STEPS+1,) of this path."""
        at = np.linspace(0, 1, len(z2))
        if shape.degree == 1:
            rates = np.interp(shape.breaks, at, np.gradient(z2, at))
        else:
            rates = np.diff(np.interp(shape.breaks, at, z2)) * shape.pieces
        return np.asarray(np.linalg.solve(shape.whiten, rates))


def seeds(problem: Problem, travels: Array, humps: Array) -> list[Seed]:
    """Paths from start to goal, at most one for each travel.

    Args:
        problem: Supplies the ends and the limit of q₂.
        travels: First guesses; kept as they are where the problem fixes the travel.
        humps: First guesses of the first parameter, tried in turn.
    """
    bounds, sines = _bounds(problem), problem.system.size
    found = []
    for travel in travels:
        for hump in humps:
            seed = _shoot(problem, bounds, sines, float(travel), float(hump))
            if seed is not None:
                found.append(seed)
                break
    return found


def _bounds(problem: Problem) -> Array:
    """Bounds of q₂ and its ends on their scale: (low, high, η(0), η(1))."""
    ends = np.array([problem.start[1], problem.goal[1]])
    angular = problem.system.coordinates[1].unit == "rad"
    high = min(
        problem.limits.joint[1], np.deg2rad(85.0) if angular else 10 + 10 * np.abs(ends).max()
    )
    high = max(high, float(np.abs(ends).max()) * 1.001)
    low = -high
    if isinstance(problem.system, Manipulator):  # one branch of θ₁
        near = 0.3 * float(np.abs(ends).min())
        low, high = (near, high) if problem.branch[1] > 0 else (-high, -near)
    unit = (ends - low) / (high - low)
    return np.array([low, high, *np.log(unit / (1 - unit))])


def _shoot(problem: Problem, bounds: Array, sines: int, travel: float, hump: float) -> Seed | None:
    path, ends = _shooter(problem.system, sines)
    free = problem.travel is None
    first = np.zeros(sines + 1)
    first[0], first[-1] = hump, np.log(abs(travel))
    count = len(first) if free else sines
    sign = np.sign(travel)

    def both(p: Array) -> tuple[Array, Array]:
        full = np.concatenate([p, first[count:]])
        value, slope = (out.full() for out in ends(problem.start, bounds, sign, full))
        if not np.all(np.isfinite(slope)):
            raise FloatingPointError
        return value[:, 0] - problem.goal[2:], slope[:, :count]

    def regular(p: Array) -> Array:
        return np.concatenate([both(p)[0], 1e-4 * (p - first[:count])])

    def slope(p: Array) -> Array:
        return np.concatenate([both(p)[1], 1e-4 * np.eye(count)])

    try:
        p = least_squares(regular, first[:count], slope, max_nfev=60).x
        for _ in range(4):  # the regularisation leaves a small miss; least-norm steps remove it
            miss, jacobian = both(p)
            p = p - np.linalg.lstsq(jacobian, miss, rcond=None)[0]
        miss = both(p)[0]
    except FloatingPointError:  # a joint ran beyond its range on the way
        return None
    if not np.all(np.abs(miss) <= CLOSE):
        return None
    full = np.concatenate([p, first[count:]])
    q = path(problem.start, bounds, sign, full).full().T
    return Seed(float(sign * np.exp(full[-1])), np.concatenate([problem.start[None], q]))


@lru_cache(maxsize=8)
def _shooter(system: TriangularSystem, sines: int) -> tuple[Any, Any]:
    """CasADi functions (start, bounds, sign, parameters) → path (N, STEPS), and → end, slope."""
    start, bounds, sign = ca.MX.sym("q0", system.size), ca.MX.sym("b", 4), ca.MX.sym("s")
    p = ca.MX.sym("p", sines + 1)
    tau = np.linspace(0, 1, 2 * STEPS + 1)
    waves = ca.DM(np.sin(np.outer(np.pi * tau, np.arange(1, sines + 1))))
    eta = bounds[2] + (bounds[3] - bounds[2]) * ca.DM(tau) + waves @ p[:-1]
    q2 = bounds[0] + (bounds[1] - bounds[0]) / (1 + ca.exp(-eta))
    travel = sign * ca.exp(p[-1])
    curve = ca.horzcat(q2[0:-1:2], q2[1::2], q2[2::2], ca.repmat(travel, STEPS, 1)).T
    path = _step(system).mapaccum(STEPS)(start, curve)
    end = path[2:, -1]
    arguments = [start, bounds, sign, p]
    return (
        ca.Function("path", arguments, [path]),
        ca.Function("ends", arguments, [end, ca.jacobian(end, p)]),
    )


def _step(system: TriangularSystem) -> Any:
    """One classical Runge–Kutta step: (q, (q₂ at its start, middle and end, Δ)) → q."""
    q, curve = ca.SX.sym("q", system.size), ca.SX.sym("c", 4)

    def rate(state: Any, q2: Any) -> Any:
        state = ca.vertcat(state[0], q2, state[2:])
        return curve[3] * ca.vertcat(1, 0, *system.slopes_expr(state))

    h = 1 / STEPS
    a = rate(q, curve[0])
    b = rate(q + h / 2 * a, curve[1])
    c = rate(q + h / 2 * b, curve[1])
    d = rate(q + h * c, curve[2])
    out = q + h / 6 * (a + 2 * b + 2 * c + d)
    out[1] = curve[2]
    return ca.Function("step", [q, curve], [out])
