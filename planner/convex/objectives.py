"""What a convex plan may minimise over linear rows: ∫ω² by `quadratic`, max |ω| by a linear programme."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from planner.convex.cuts import Programme
from planner.convex.frame import Frame
from planner.convex.quadratic import Farkas, Optimum, StalledError, solve_quadratic
from planner.systems.base import Array


SMOOTH = "half the integral of (dz2/dz1)^2 over |z1|"
PEAK = "greatest |dz2/dtau|, tau from 0 to 1"

_TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def smoothest(engine: str) -> Programme:
    """½∫(dz₂/dz₁)² |dz₁|, by the engine named ("active set" or "osqp")."""

    def solve(
        frame: Frame, A: Array, b: Array, radius: float, guess: Array | None
    ) -> Optimum | Farkas:
        answer = solve_quadratic(A, b, radius, engine, guess)
        if isinstance(answer, Farkas):
            return answer
        fixed = frame.least @ frame.least / 2
        scale = abs(frame.travel)
        return replace(
            answer, value=(answer.value + fixed) / scale, bound=(answer.bound + fixed) / scale
        )

    return Programme(SMOOTH, solve, 1e-10)


def lowest_peak() -> Programme:
    """max |dz₂/dτ|, by HiGHS; its multipliers give the bound."""
    return Programme(PEAK, _lowest_peak, 2e-9)


def _lowest_peak(
    frame: Frame, A: Array, b: Array, radius: float, guess: Array | None
) -> Optimum | Farkas:
    """Raises `StalledError` if HiGHS stops without an answer that holds."""
    began = time.perf_counter()
    length = np.linalg.norm(A, axis=1)
    A, b = A / length[:, None], b / length
    C, d = frame.coefficient_rows()
    one = np.ones((len(C), 1))
    rows = np.block([[C, -one], [-C, -one], [A, np.zeros((len(A), 1))]])
    limit = np.concatenate([-d, d, b])
    cost = np.zeros(frame.size + 1)
    cost[-1] = 1.0
    result = linprog(cost, rows, limit, bounds=(None, None), method="highs", options=_TIGHT)
    if result.status == 2:
        answer = solve_quadratic(A, b, radius)
        if isinstance(answer, Farkas):
            return answer
    if result.status != 0:
        raise StalledError(f"linear programme: {result.message}")
    multipliers = np.maximum(-result.ineqlin.marginals, 0.0)
    y = result.x[:-1]
    return Optimum(
        y=y,
        multipliers=multipliers[2 * len(C) :] / length,
        excess=float(np.max(A @ y - b)),
        value=float(np.max(np.abs(C @ y + d))),
        bound=_peak_bound(C, d, A, b, multipliers, radius),
        engine="highs",
        iterations=int(result.nit),
        time_s=time.perf_counter() - began,
    )


def _peak_bound(C: Array, d: Array, A: Array, b: Array, multipliers: Array, radius: float) -> float:
    """Least of the Lagrangian over |y| ≤ radius, the peak's own multipliers made to sum to one."""
    up, down, rows = np.split(multipliers, [len(C), 2 * len(C)])
    total = up.sum() + down.sum()
    signed, rows = (up - down) / total, rows / total
    residual = float(np.linalg.norm(C.T @ signed + A.T @ rows))
    return float(signed @ d - rows @ b - radius * residual)
