"""Minimise over linear rows A y ≤ b; return the optimum with a bound, or prove infeasibility.

There are two objectives, ½∫(dz₂/dz₁)² |dz₁| and max |dz₂/dτ|; both are reduced to min ½|y|². It is
solved by least-distance programming (Lawson and Hanson, *Solving Least Squares Problems*, 1974,
ch. 23) on SciPy's non-negative least squares, an active-set method that ends at rounding error and
yields a Farkas vector if there is no solution. Residuals, bound and certificate are computed in
this file from its vectors.

Of 2,301 programmes (all shipped problems and 17 random arms, both objectives) it solves or refutes
every one within the tolerances. OSQP solves 1,800 of them in 24 times the CPU time, and proves
none of the 155 infeasible ones infeasible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from planner.errors import solver_answer
from planner.methods.convex.paths import Frame
from planner.support.arrays import Array

GAP_TOLERANCE = 1e-9
"""Largest accepted gap between value and bound, relative to 1 + value."""

EXCESS_TOLERANCE = 2e-11
"""Largest accepted violation of rows of unit length."""

PROX = 1e-4
"""Weight of ½|y − centre|² beside ½t² in the search for the least peak t: small enough that the
first step ends at the least t, large enough that the active set resolves the rows' scales."""


@dataclass(frozen=True)
class Optimum:
    """A solution of a programme, with a bound that proves how near the optimum it is.

    Attributes:
        y: The solution, shape (p,).
        multipliers: λ ≥ 0, one per row.
        excess: Largest violation of the rows, scaled to unit length; ≤ 0 if all rows hold.
        value: The objective at y.
        bound: Lower bound of the objective over all feasible points, from the multipliers alone.
    """

    y: Array
    multipliers: Array
    excess: float
    value: float
    bound: float

    @property
    def accurate(self) -> bool:
        """Whether violation of rows and gap to the bound are within tolerance."""
        gap = (self.value - self.bound) / (1 + self.value)
        return bool(self.excess <= EXCESS_TOLERANCE and abs(gap) <= GAP_TOLERANCE)


@dataclass(frozen=True)
class Farkas:
    """A proof that no |y| ≤ radius satisfies A y ≤ b: u ≥ 0 with bᵀu + radius |Aᵀu| < 0.

    Attributes:
        multipliers: u, one per row, scaled so that Σ u = 1 on rows of unit length.
        residual: |Aᵀu|.
        value: bᵀu.
        radius: Bound on |y|. With a cap on the domain no path of the given number of pieces
            exceeds it; without one the proof covers only paths within it.
    """

    multipliers: Array
    residual: float
    value: float
    radius: float

    @property
    def margin(self) -> float:
        """Margin −(value + radius · residual) of the proof; a valid proof has a positive margin."""
        return -(self.value + self.radius * self.residual)


class StalledError(ArithmeticError):
    """Error of a programme for which no solution and no certificate was found within tolerance."""


Goal = Literal["smooth", "peak"]
"""What to minimise: "smooth": ½∫(dz₂/dz₁)² |dz₁|; "peak": max |dz₂/dτ|, and among the paths with
the least peak nearly the smoothest."""


def solve(goal: Goal, frame: Frame, A: Array, b: Array, radius: float) -> Optimum | Farkas:
    """Find the minimum over A y ≤ b, or prove that no |y| ≤ radius is feasible.

    Raises:
        StalledError: If no solution and no proof is found within tolerance.
    """
    if goal == "peak":
        C, d = frame.coefficient_rows()
        size = float(np.max(-b / np.linalg.norm(A, axis=1), initial=np.linalg.norm(d))) or 1.0
        best = _lowest_peak(C, d / size, A, b / size, radius / size)
        if isinstance(best, Farkas):
            return replace(best, value=size * best.value, radius=radius)
        values = size * best.excess, size * best.value, size * best.bound
        return Optimum(size * best.y, best.multipliers, *values)
    answer = solve_quadratic(A, b, radius)
    if isinstance(answer, Farkas):
        return answer
    fixed, scale = float(frame.least @ frame.least) / 2, abs(frame.travel)
    value, bound = (answer.value + fixed) / scale, (answer.bound + fixed) / scale
    return replace(answer, value=value, bound=bound)


def _lowest_peak(C: Array, d: Array, A: Array, b: Array, radius: float) -> Optimum | Farkas:
    """Minimise the peak t of |C y + d| ≤ t over A y ≤ b: repeat min ½t² + ½ε|y − c|², c the
    previous y.

    The tolerances are for programmes of the size of 1. This proximal iteration ends exactly after
    finitely many steps (Rockafellar, *Monotone operators and the proximal point algorithm*, 1976),
    usually two; the smaller ε, the fewer.
    """
    feasible = solve_quadratic(A, b, radius)
    if isinstance(feasible, Farkas):
        return feasible
    if not np.any(C @ feasible.y + d):
        return replace(feasible, value=0.0, bound=0.0)
    unit, least = float(np.mean(np.linalg.norm(C, axis=1))), float(np.linalg.norm(C, ord=-2))
    one = np.ones((len(C), 1))
    rows = np.block([[C / unit, -one], [-C / unit, -one], [A, np.zeros((len(A), 1))]])
    limit = np.concatenate([-d / unit, d / unit, b])
    shrink, centre = np.ones(C.shape[1] + 1), np.zeros(C.shape[1] + 1)
    for k in range(8):
        shrink[:-1] = (PROX / 10 ** (k // 2)) ** -0.5
        answer = solve_quadratic(rows * shrink, limit - rows @ centre, np.inf)
        assert isinstance(answer, Optimum)  # with an infinite radius no certificate has a margin
        y = centre[:-1] + answer.y[:-1] * shrink[0]
        value = float(np.max(np.abs(C @ y + d)))
        # Minimise the Lagrangian of min t over all y of so small a peak, with the multipliers
        # scaled for t.
        dual = answer.multipliers / -(rows[:, -1] @ answer.multipliers)
        reach = (float(np.linalg.norm(d)) + len(C) ** 0.5 * value) / least
        slack = reach * float(np.linalg.norm(rows[:, :-1].T @ dual))
        bound = unit * float(-dual @ limit - slack)
        centre = np.append(y, 0.0)
        if value - bound <= 1e-9 * value:
            multipliers = answer.multipliers[2 * len(C) :]
            return replace(answer, y=y, multipliers=multipliers, value=value, bound=bound)
    raise StalledError("the least peak did not settle")


def solve_quadratic(A: Array, b: Array, radius: float) -> Optimum | Farkas:
    """Minimise ½|y|² over A y ≤ b, or prove that no |y| ≤ radius is feasible.

    Args:
        A: Rows, shape (m, p); none may be zero.
        b: Right-hand sides, shape (m,).
        radius: Known bound on |y|.

    Raises:
        StalledError: If the tolerance is not reached.
    """
    length = np.linalg.norm(A, axis=1)
    G, h = A / length[:, None], b / length
    if np.all(h >= 0):
        return _optimum(G, h, np.zeros(A.shape[1]), np.zeros(len(h)))
    answer = solver_answer(partial(_least_distance, G, h, radius), lambda _: None)
    if isinstance(answer, Farkas) and answer.margin > 0:
        return answer
    if isinstance(answer, Optimum) and answer.accurate:
        return replace(answer, multipliers=answer.multipliers / length)
    raise StalledError("no solution and no certificate within tolerance")


def _optimum(G: Array, h: Array, y: Array, multipliers: Array) -> Optimum:
    duals = np.maximum(multipliers, 0.0)
    pull = G.T @ duals
    bound = float(-(pull @ pull) / 2 - h @ duals)
    excess = float(np.max(G @ y - h, initial=-np.inf))
    return Optimum(y, duals, excess, float(y @ y / 2), bound)


def _farkas(G: Array, h: Array, raw: Array, radius: float) -> Farkas | None:
    duals = np.maximum(raw, 0.0)
    if not np.any(duals > 0) or not np.all(np.isfinite(duals)):
        return None
    duals /= duals.sum()
    return Farkas(duals, float(np.linalg.norm(G.T @ duals)), float(h @ duals), radius)


def _least_distance(G: Array, h: Array, radius: float) -> Optimum | Farkas | None:
    from scipy.optimize import nnls  # slow to import

    target = np.zeros(G.shape[1] + 1)
    target[-1] = 1.0
    stacked = -np.concatenate([G.T, h[None]])
    raw, _ = nnls(stacked, target, maxiter=20 * len(h))
    proof = _farkas(G, h, raw, radius)
    if proof is not None and proof.margin > 0:
        return proof
    remainder = stacked @ raw - target
    if remainder[-1] == 0:
        return None
    return _optimum(G, h, -remainder[:-1] / remainder[-1], raw / -remainder[-1])
