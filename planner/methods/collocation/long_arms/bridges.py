"""Close the gaps of a path: each step finds the nearest path whose gaps are a little smaller.

A path with gaps, or chain, consists of pieces with constant inputs over a unit of time, integrated
by a few Runge-Kutta steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.errors import solver_answer
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.support.calculus import runge_kutta
from planner.support.solver_calls import QUIET, QUIET_IPOPT, NlpCall
from planner.systems.triangular_system import TriangularSystem

Index = NDArray[np.int64]

FIRST_SHARE, LEAST_SHARE = 0.3, 4e-3
"""Least share of the gaps that the first step must close, or no later one does; and a later one."""

QUICK_ITERATIONS = 25
"""Number of iterations above which a step counts as hard, so that the next step is not larger."""

ITERATIONS = 40
PATIENCE = 200
"""Largest number of iterations to close all gaps of a chain; another chain is then faster."""

RESIDUAL = 1e-6
CORRECTIONS, PARTS = 2, 8
"""Number of corrections that make a chain exact, and number of parts in which one integrates each
piece. The later check has other steps; with equal ones it would hide the error."""


@dataclass(frozen=True, eq=False)
class PieceChain:
    """A path of K pieces with gaps between them.

    Attributes:
        q: Coordinates before each piece and at the end, shape (K+1, N).
        u: Integrals of the inputs over each piece, shape (K, 2).
        gap: Jumps of the coordinates after each piece, shape (K, N).
    """

    q: Array
    u: Array
    gap: Array


@dataclass(frozen=True, eq=False)
class ChainEnds:
    """Ends and limits of a closed chain.

    Attributes:
        start: Start, shape (N,).
        goal: Goal, shape (N,), NaN where free.
        limit: Largest |q|, shape (N,).
    """

    start: Array
    goal: Array
    limit: Array

    @classmethod
    def of(cls, problem: Problem, share: float = 1.0) -> ChainEnds:
        """Return start, goal and a share of a problem's joint limits, widened to contain both."""
        ends = np.fmax(np.abs(problem.start), np.abs(problem.goal))
        limit = np.fmax(share * problem.limits.joint, ends)
        return cls(problem.start, problem.goal, limit)


def cut_finer(
    system: TriangularSystem, chain: PieceChain, limited: list[int], turn: float, least: int = 1
) -> PieceChain:
    """Cut the pieces of a chain so that no limited coordinate turns by more than `turn` in a piece.

    Each piece is cut into at least `least` parts. The integration errors of the long pieces become
    gaps between the short pieces.
    """
    parts, piece, share = cuts(chain.q, limited, turn, least)
    before = ends_of(system, chain.q[:-1][piece], chain.u[piece] * share[:, None])
    u = chain.u[piece] / parts[piece, None]
    q = np.vstack([before, chain.q[-1:]])
    return PieceChain(q, u, q[1:] - ends_of(system, q[:-1], u))


def cuts(q: Array, limited: list[int], turn: float, least: int = 1) -> tuple[Index, Index, Array]:
    """Choose how to cut the pieces of q (K+1, N) so that limited coordinates turn by up to `turn`.

    Returns:
        Number of parts of each piece, shape (K,); for each part its piece, and its start as a
        fraction of the piece.
    """
    turns = np.max(np.abs(np.diff(q, axis=0)[:, limited]), axis=1)
    parts = np.maximum(least, np.ceil(turns / turn)).astype(int)
    share = np.concatenate([np.arange(n) / n for n in parts])
    return parts, np.repeat(np.arange(len(parts)), parts), share


def close_gaps(
    system: TriangularSystem, chain: PieceChain, ends: ChainEnds
) -> tuple[PieceChain | None, float]:
    """Return the chain with its gaps closed, or None if that fails; and the share of gaps closed.

    Args:
        system: The system.
        chain: The chain with gaps.
        ends: Ends and limits of the result.
    """
    nearest = _nearest(system, len(chain.u))
    share, step, iterations = 0.0, 1.0, 0
    whole = chain.gap
    while iterations < PATIENCE:
        aim = min(1.0, share + step)
        candidate, count = nearest(chain, (1.0 - aim) * whole, ends)
        iterations += count
        if candidate is None:
            step /= 3
            if step < (LEAST_SHARE if share else FIRST_SHARE):
                break
            continue
        chain, share = candidate, aim
        if share == 1.0:
            return chain, share
        step *= 2.0 if count < QUICK_ITERATIONS else 1.0
    return None, share


def make_exact(system: TriangularSystem, chain: PieceChain, ends: ChainEnds) -> PieceChain | None:
    """Return the nearest chain whose finely integrated pieces meet; None if a solve fails."""
    for _ in range(CORRECTIONS):
        fine = chain.q[:-1]
        for _ in range(PARTS):
            fine = ends_of(system, fine, chain.u / PARTS)
        error = fine - ends_of(system, chain.q[:-1], chain.u)
        candidate, _ = _nearest(system, len(chain.u))(chain, error, ends)
        if candidate is None:
            return None
        chain = candidate
    return chain


class _Nearest:
    """Callable that finds the nearest chain with given gaps and within limits, by IPOPT.

    The unknowns are (q₀, u₀, q₁, u₁, …, q_K); the derivatives are those of one piece, repeated.
    """

    def __init__(self, system: TriangularSystem, count: int) -> None:
        self._size, self._count = system.size, count
        self._solver = NlpCall("ipopt", "nearest", *chain_programme(system, count))

    def __call__(
        self, chain: PieceChain, gap: Array, ends: ChainEnds
    ) -> tuple[PieceChain | None, int]:
        lower, upper = self._bounds(ends)
        x = self._pack(chain.q, chain.u)
        inputs = {"x0": np.clip(x, lower, upper), "p": x, "lbx": lower, "ubx": upper}
        inputs |= {"lbg": gap.ravel(), "ubg": gap.ravel()}
        answer = solver_answer(lambda: self._solver(**inputs), lambda _: {})
        if not answer:
            return None, ITERATIONS
        iterations = int(self._solver.stats()["iter_count"])
        excess = float(np.max(np.abs(np.asarray(answer["g"]).ravel() - gap.ravel())))
        if not excess <= RESIDUAL:
            return None, iterations
        vector, size = np.asarray(answer["x"]).ravel(), self._size
        body = vector[:-size].reshape(self._count, size + 2)
        q = np.vstack([body[:, :size], vector[-size:]])
        return PieceChain(q, body[:, size:], gap), iterations

    def _pack(self, q: Array, u: Array) -> Array:
        return np.concatenate([np.concatenate([q[:-1], u], axis=1).ravel(), q[-1]])

    def _bounds(self, ends: ChainEnds) -> tuple[Array, Array]:
        upper = np.repeat(ends.limit[None], self._count + 1, axis=0)
        lower = -upper
        lower[0] = upper[0] = ends.start
        is_fixed = ~np.isnan(ends.goal)
        lower[-1, is_fixed] = upper[-1, is_fixed] = ends.goal[is_fixed]
        free = np.full((self._count, 2), np.inf)
        return self._pack(lower, -free), self._pack(upper, free)


@lru_cache(maxsize=8)
def _nearest(system: TriangularSystem, count: int) -> _Nearest:
    return _Nearest(system, count)


def chain_programme(system: TriangularSystem, count: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Build the programme of the nearest chain, and the solver's options with the derivatives."""
    size, m = system.size, system.size + 2
    w, near = (ca.MX.sym(name, count * m + size) for name in ("w", "near"))
    columns = ca.reshape(w[:-size], m, count)
    after = ca.horzcat(columns[:size, 1:], w[-size:])
    one, given = piece(system), (columns[:size, :], columns[size:, :])
    f, g = ca.sumsqr(w - near), ca.vec(after - one.end.map(count)(*given))
    scale, dual = ca.MX.sym("scale"), ca.MX.sym("dual", size * count)
    curved = one.curvature.map(count)(*given, ca.reshape(dual, size, count))
    alone, every = ca.DM.eye(count), ca.DM.eye(count * m + size)
    blocks = ca.MX(
        ca.kron(alone, ca.DM.ones(size, m)).sparsity(), ca.vec(one.slopes.map(count)(*given))
    )
    following = ca.horzcat(ca.DM(size * count, m), ca.kron(alone, ca.DM.eye(m)[:size, :]))
    jacobian = following[:, : count * m + size] - ca.horzcat(blocks, ca.MX(size * count, size))
    blocks = ca.MX(ca.kron(alone, ca.DM.ones(m, m)).sparsity(), ca.vec(curved))
    hessian = ca.triu(2 * scale * every - ca.diagcat(blocks, ca.MX(size, size)))
    names, inputs = ["x", "p"], [w, near, scale, dual]
    given_names = [*names, "lam_f", "lam_g"]
    derivatives = {
        "jac_g": ca.Function("nlp_jac_g", [w, near], [g, jacobian], names, ["g", "jac_g_x"]),
        "hess_lag": ca.Function("nlp_hess_l", inputs, [hessian], given_names, ["hess_gamma_x_x"]),
    }
    return {"x": w, "p": near, "f": f, "g": g}, {**_OPTIONS, **derivatives}


_OPTIONS: dict[str, Any] = {
    **QUIET,
    "ipopt": {
        **QUIET_IPOPT,
        "max_iter": ITERATIONS,
        "tol": 1e-6,
        "constr_viol_tol": 1e-10,
        "acceptable_iter": 0,
        "bound_relax_factor": 0.0,
        "mu_init": 1e-3,
        "bound_push": 1e-4,
        "bound_frac": 1e-4,
    },
}


STEPS = 3
"""Number of Runge-Kutta steps per piece; `cut_finer` and `make_exact` correct the steps' errors."""


@dataclass(frozen=True, eq=False)
class Piece:
    """CasADi functions of one piece, from its start q and the integral u of its inputs.

    Attributes:
        end: End of the piece, N.
        slopes: Jacobian of the end with respect to (q, u), dense.
        curvature: Hessian of λ · end with respect to (q, u), dense; λ is a third argument.
    """

    end: Any
    slopes: Any
    curvature: Any


@lru_cache(maxsize=16)
def piece(system: TriangularSystem) -> Piece:
    """Build the functions of a piece with constant inputs, and their derivatives, for a system."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    end = q
    for _ in range(STEPS):
        end = runge_kutta.step(lambda x, _: ca.vertcat(*system.rates_expr(x, u)), end, 1.0 / STEPS)
    both, dual = ca.vertcat(q, u), ca.SX.sym("dual", system.size)
    slopes, curvature = ca.jacobian(end, both), ca.hessian(ca.dot(dual, end), both)[0]
    return Piece(
        end=ca.Function("end", [q, u], [end]),
        slopes=ca.Function("slopes", [q, u], [ca.densify(slopes)]),
        curvature=ca.Function("curvature", [q, u, dual], [ca.densify(curvature)]),
    )


def ends_of(system: TriangularSystem, q: Array, u: Array) -> Array:
    """Return the ends of pieces, (M, N), that start at q (M, N) with input integrals u (M, 2)."""
    return np.asarray(piece(system).end.map(len(q))(q.T, u.T)).T
