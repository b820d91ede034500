"""One piece of a path: constant inputs for a unit of time, by a few Runge-Kutta steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.systems.base import Array, TriangularSystem

STEPS = 3


@dataclass(frozen=True, eq=False)
class Piece:
    """CasADi functions of (q, u), u being the inputs' integrals over the piece.

    Attributes:
        end: Where the piece leads, N.
        slopes: Jacobians of that with respect to q (N × N) and u (N × 2), dense.
        curvature: Of (q, u, λ): Hessian of λ · end with respect to (q, u), dense.
    """

    end: Any
    slopes: Any
    curvature: Any


@lru_cache(maxsize=16)
def piece(system: TriangularSystem) -> Piece:
    """The functions for a system."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    end = q
    for _ in range(STEPS):
        end = _runge_kutta(system, end, u, 1.0 / STEPS)
    jacobians = [ca.densify(ca.jacobian(end, q)), ca.densify(ca.jacobian(end, u))]
    dual = ca.SX.sym("dual", system.size)
    hessian = ca.densify(ca.hessian(ca.dot(dual, end), ca.vertcat(q, u))[0])
    return Piece(
        end=ca.Function("end", [q, u], [end]),
        slopes=ca.Function("slopes", [q, u], jacobians),
        curvature=ca.Function("curvature", [q, u, dual], [hessian]),
    )


def ends(system: TriangularSystem, q: Array, u: Array) -> Array:
    """Where pieces lead, shape (M, N), from q (M, N) under u (M, 2)."""
    return np.asarray(piece(system).end.map(len(q))(q.T, u.T)).T


def _runge_kutta(system: TriangularSystem, q: Any, u: Any, h: float) -> Any:
    def rates(at: Any) -> Any:
        return ca.vertcat(*system.rates_expr(at, u))

    k1 = rates(q)
    k2 = rates(q + h / 2 * k1)
    k3 = rates(q + h / 2 * k2)
    k4 = rates(q + h * k3)
    return q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
