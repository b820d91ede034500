"""What a convex plan may minimise over linear rows: ∫ω², or max |ω|."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.convex.cuts import Programme
from planner.convex.frame import Frame
from planner.convex.quadratic import Farkas, Optimum, StalledError, solve_quadratic
from planner.systems.base import Array

SMOOTH = "half the integral of (dz2/dz1)^2 over |z1|"
PEAK = "greatest |dz2/dtau|, tau from 0 to 1"

PROX = 1e-4
"""Weight of ½|y − centre|² beside ½t² in the least peak; small enough for the first step to end at
the least t, great enough to keep the rows' scales within what the active set resolves."""


def smoothest(engine: str) -> Programme:
    """½∫(dz₂/dz₁)² |dz₁|, by the engine named ("active set" or "osqp")."""

    def solve(
        frame: Frame, A: Array, b: Array, radius: float, guess: Array | None
    ) -> Optimum | Farkas:
        answer = solve_quadratic(A, b, radius, engine, guess)
        if isinstance(answer, Farkas):
            return answer
        fixed = float(frame.least @ frame.least) / 2
        scale = abs(frame.travel)
        return replace(
            answer, value=(answer.value + fixed) / scale, bound=(answer.bound + fixed) / scale
        )

    return Programme(SMOOTH, solve, 1e-10)


def lowest_peak() -> Programme:
    """max |dz₂/dτ|, and of all paths that attain it the smoothest.

    The linear programme min t is solved as min ½t² + ½ε|y − c|², whose proximal iteration (c the
    last y) ends exactly after finitely many steps (Rockafellar, *Monotone operators and the
    proximal point algorithm*, 1976); two are usual. The bound comes from the multipliers alone.
    """
    return Programme(PEAK, _lowest_peak, 1e-10)


def _lowest_peak(
    frame: Frame, A: Array, b: Array, radius: float, guess: Array | None
) -> Optimum | Farkas:
    C, d = frame.coefficient_rows()
    unit = float(np.mean(np.linalg.norm(C, axis=1)))
    rows, limit = _epigraph(C / unit, d / unit, A, b)
    shrink = np.append(np.full(frame.size, PROX**-0.5), 1.0)
    centre = np.zeros(frame.size + 1)
    for _ in range(8):
        try:
            answer = solve_quadratic(
                rows * shrink, limit - rows @ centre, np.inf, "active set alone"
            )
        except StalledError:
            return _certificate(A, b, radius)
        assert isinstance(answer, Optimum)  # an infinite radius leaves no certificate a margin
        y = centre[:-1] + answer.y[:-1] * shrink[0]
        value = float(np.max(np.abs(C @ y + d)))
        bound = unit * _bound(rows, limit, answer.multipliers, radius)
        centre = np.append(y, 0.0)
        if value - bound <= 1e-9 * value:
            multipliers = answer.multipliers[2 * len(C) :]
            return replace(answer, y=y, multipliers=multipliers, value=value, bound=bound)
    raise StalledError("the least peak did not settle")


def _epigraph(C: Array, d: Array, A: Array, b: Array) -> tuple[Array, Array]:
    """|C y + d| ≤ t and A y ≤ b as rows on (y, t)."""
    one, none = np.ones((len(C), 1)), np.zeros((len(A), 1))
    return np.block([[C, -one], [-C, -one], [A, none]]), np.concatenate([-d, d, b])


def _certificate(A: Array, b: Array, radius: float) -> Farkas:
    answer = solve_quadratic(A, b, radius)
    if isinstance(answer, Farkas):
        return answer
    raise StalledError("no least peak, yet no certificate that there is no path")


def _bound(rows: Array, limit: Array, multipliers: Array, radius: float) -> float:
    """Least of the Lagrangian of min t over |y| ≤ radius; the multipliers scaled to suit t."""
    scaled = multipliers / -(rows[:, -1] @ multipliers)
    residual = float(np.linalg.norm(rows[:, :-1].T @ scaled))
    return float(-scaled @ limit - radius * residual)
