"""The programme min ½|y|² subject to A y ≤ b, its optimality measured and its infeasibility proven.

Two engines: OSQP (operator splitting, polished), and least-distance programming (Lawson and Hanson,
*Solving Least Squares Problems*, 1974, ch. 23) on SciPy's non-negative least squares, an active-set
method that ends at rounding error and yields a Farkas vector when there is no solution. Neither's
word is taken: the residuals, the bound and the certificate are computed here from the vectors.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.optimize import nnls

from planner.interrupts import osqp_result
from planner.systems.base import Array

GAP_TOLERANCE = 1e-9
"""Largest gap between value and bound that is accepted, relative to 1 + value."""

EXCESS_TOLERANCE = 2e-11
"""Largest violation accepted, on rows of unit length."""


@dataclass(frozen=True)
class Optimum:
    """A solution with its own proof.

    Attributes:
        y: The point.
        multipliers: λ ≥ 0, one a row.
        excess: Largest violation over rows of unit length; ≤ 0 when all hold.
        value: The objective at y.
        bound: What no feasible point's objective can be below, from the multipliers alone.
        engine: "osqp", "active set", "highs" or "none needed".
        iterations: OSQP's iterations; 0 otherwise.
        time_s: Seconds inside the engine (OSQP's own count of them).
    """

    y: Array
    multipliers: Array
    excess: float
    value: float
    bound: float
    engine: str
    iterations: int
    time_s: float

    @property
    def gap(self) -> float:
        """(value − bound) / (1 + value)."""
        return (self.value - self.bound) / (1 + self.value)

    @property
    def accurate(self) -> bool:
        """Whether violation and gap are within tolerance."""
        return bool(self.excess <= EXCESS_TOLERANCE and abs(self.gap) <= GAP_TOLERANCE)


@dataclass(frozen=True)
class Farkas:
    """A proof that no |y| ≤ radius satisfies A y ≤ b: u ≥ 0 with bᵀu + radius |Aᵀu| < 0.

    Attributes:
        multipliers: u, one a row, scaled so that Σ u = 1 on rows of unit length.
        residual: |Aᵀu|, computed here.
        value: bᵀu, computed here.
        radius: Bound on |y| that every path of the class obeys.
    """

    multipliers: Array
    residual: float
    value: float
    radius: float

    @property
    def margin(self) -> float:
        """−(value + radius · residual); the proof holds when it is positive."""
        return -(self.value + self.radius * self.residual)


class StalledError(ArithmeticError):
    """Neither a solution nor a certificate within tolerance."""


def solve_quadratic(
    A: Array, b: Array, radius: float, engine: str = "active set", guess: Array | None = None
) -> Optimum | Farkas:
    """Solve, or prove that no |y| ≤ radius is feasible.

    Args:
        A: Rows, shape (m, p); none may be zero.
        b: Right-hand sides, shape (m,).
        radius: Bound on |y| that is known from elsewhere.
        engine: "active set" or "osqp", the other of which takes over where the first is not
            accurate; or "active set alone".
        guess: A point near the solution, for OSQP.

    Raises:
        StalledError: If neither engine reaches the tolerance.
    """
    length = np.linalg.norm(A, axis=1)
    G, h = A / length[:, None], b / length
    answer = _engines(G, h, radius, engine, guess)
    if isinstance(answer, Farkas):
        return answer
    return replace(answer, multipliers=answer.multipliers / length)


def _engines(
    G: Array, h: Array, radius: float, engine: str, guess: Array | None
) -> Optimum | Farkas:
    if np.all(h >= 0):  # y = 0; OSQP would polish nothing, and say so on standard output
        zero = np.zeros(len(h))
        return _optimum(G, h, np.zeros(G.shape[1]), zero, "none needed", 0, 0.0)
    for attempt in _ORDER[engine]:
        answer = attempt(G, h, radius, guess)
        if isinstance(answer, Farkas) and answer.margin > 0:
            return answer
        if isinstance(answer, Optimum) and answer.accurate:
            return answer
    raise StalledError("no solution and no certificate within tolerance")


def osqp_answer(A: Array, b: Array, guess: Array | None = None) -> Optimum | None:
    """OSQP's own answer on rows of unit length, accurate or not; None if it has no solution."""
    length = np.linalg.norm(A, axis=1)
    answer = _by_osqp(A / length[:, None], b / length, np.inf, guess)
    return answer if isinstance(answer, Optimum) else None


def _optimum(
    G: Array, h: Array, y: Array, multipliers: Array, engine: str, iterations: int, time_s: float
) -> Optimum:
    kept = np.maximum(multipliers, 0.0)
    pull = G.T @ kept
    bound = float(-(pull @ pull) / 2 - h @ kept)
    excess = float(np.max(G @ y - h, initial=-np.inf))
    return Optimum(y, kept, excess, float(y @ y / 2), bound, engine, iterations, time_s)


def _farkas(G: Array, h: Array, raw: Array, radius: float) -> Farkas | None:
    kept = np.maximum(raw, 0.0)
    if not np.any(kept > 0) or not np.all(np.isfinite(kept)):
        return None
    kept /= kept.sum()
    return Farkas(kept, float(np.linalg.norm(G.T @ kept)), float(h @ kept), radius)


def _by_active_set(
    G: Array, h: Array, radius: float, guess: Array | None
) -> Optimum | Farkas | None:
    began = time.perf_counter()
    target = np.zeros(G.shape[1] + 1)
    target[-1] = 1.0
    stacked = -np.concatenate([G.T, h[None]])
    try:
        raw, _ = nnls(stacked, target, maxiter=20 * len(h))
    except RuntimeError:
        return None
    remainder = stacked @ raw - target
    certificate = _farkas(G, h, raw, radius)
    if certificate is not None and certificate.margin > 0:
        return certificate
    if remainder[-1] == 0:
        return None
    spent = time.perf_counter() - began
    y = -remainder[:-1] / remainder[-1]
    return _optimum(G, h, y, raw / -remainder[-1], "active set", 0, spent)


def _by_osqp(G: Array, h: Array, radius: float, guess: Array | None) -> Optimum | Farkas | None:
    import osqp  # a tenth of a second, which only this needs

    solver = osqp.OSQP()
    size = G.shape[1]
    solver.setup(
        sp.eye(size, format="csc"),
        np.zeros(size),
        sp.csc_matrix(G),
        np.full(len(h), -np.inf),
        h,
        verbose=False,
        eps_abs=GAP_TOLERANCE,
        eps_rel=GAP_TOLERANCE,
        eps_prim_inf=GAP_TOLERANCE,
        polishing=True,
        scaling=0,
        max_iter=4000,
    )
    if guess is not None:
        solver.warm_start(x=guess)
    result = osqp_result(solver)
    if np.all(np.isfinite(result.x)) and np.all(np.isfinite(result.y)):
        info = result.info
        return _optimum(G, h, result.x, result.y, "osqp", info.iter, info.run_time)
    proof = result.prim_inf_cert
    return None if proof is None else _farkas(G, h, np.asarray(proof), radius)


_ORDER = {
    "osqp": (_by_osqp, _by_active_set),
    "active set": (_by_active_set, _by_osqp),
    "active set alone": (_by_active_set,),
}
