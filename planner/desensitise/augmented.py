"""A motion and its response to errors, as one system of ordinary differential equations.

The response W = S diag(σ) to errors of one standard deviation obeys Ẇ = A W + B diag(σ): one more
column a parameter, never the n² entries of a covariance. Triangular systems leave most entries
empty; those that are constant (an offset of θᵢ arrives whole at θᵢ) or known in closed form (the
gain of u₂ meets q₂ with its travel) need no state either. For the manipulator of three joints, five
errors and so fifteen entries, seven states are left, all linear in themselves. The covariance along
the path is P = W Wᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.linearised import Linearised, linearised
from planner.systems.base import Array, TriangularSystem

DEGREES = 180 / np.pi
"""The response is kept in degrees (lengths in their unit over 57.3): its size is near 1."""


@dataclass(frozen=True, eq=False)
class Augmented:
    """States x = (q, w), w being the m entries of W that need integration.

    Attributes:
        system: What moves.
        names: Names of the P errors, in the order of W's columns.
        size: Number N + m of states.
        rates: Function (x, u, t, σ, q₀) to ẋ.
        response: Function (x, t, σ, q₀) to W (N, P) in degrees; row 0, the path coordinate's, is
            left out (zero) where nothing depends on it.
        initial: Function σ to w(0) (m).
    """

    system: TriangularSystem
    names: tuple[str, ...]
    size: int
    rates: Any
    response: Any
    initial: Any


@dataclass(frozen=True, eq=False)
class _Column:
    values: list[Any]
    states: list[Any]
    rates: list[Any]
    initial: list[Any]


@lru_cache(maxsize=32)
def augmented(system: TriangularSystem, names: tuple[str, ...]) -> Augmented:
    """Write down the augmented system for these errors."""
    form, N = linearised(system), system.size
    sigma, q0 = ca.SX.sym("sigma", len(names)), ca.SX.sym("q0", N)
    columns = [_column(system, form, name, sigma[p], q0) for p, name in enumerate(names)]
    w = ca.vertcat(*(state for c in columns for state in c.states))
    rates = ca.vertcat(form.rates, *(rate for c in columns for rate in c.rates))
    response = ca.horzcat(*(ca.vertcat(*c.values) for c in columns))
    initial = ca.vertcat(*(value for c in columns for value in c.initial))
    m = sum(len(c.states) for c in columns)
    x = ca.SX.sym("x", N + m)
    swap = [x[:N], x[N:], form.u, form.t, sigma, q0]
    of_parts = ca.Function("parts", [form.q, w, form.u, form.t, sigma, q0], [rates, response])
    moved, carried = of_parts(*swap)
    return Augmented(
        system=system,
        names=names,
        size=N + m,
        rates=ca.Function("rates", [x, form.u, form.t, sigma, q0], [moved]),
        response=ca.Function("response", [x, form.t, sigma, q0], [carried]),
        initial=ca.Function("initial", [sigma], [initial]),
    )


def _column(system: TriangularSystem, form: Linearised, name: str, sigma: Any, q0: Any) -> _Column:
    """One error's column of W, and the states that it needs."""
    N, b, start = system.size, form.forcing[name], form.initial[name]
    read = _read(form)
    reached = [bool(start[i]) or b[i].nnz() > 0 for i in range(N)]
    for _ in range(N):
        reached = [r or any(reached[j] for j in read[i]) for i, r in enumerate(reached)]
    wanted = [i > 0 or any(0 in rows for rows in read) for i in range(N)]
    values: list[Any] = [ca.SX(0)] * N
    states, moving = [], []
    for i in range(N):
        if not (reached[i] and wanted[i]):
            continue
        if b[i].nnz() == 0 and not any(reached[j] and wanted[j] for j in read[i]):
            values[i] = DEGREES * sigma * start[i]
        elif i == 1 and name == f"gain {system.inputs[1].name}":
            values[i] = DEGREES * sigma * (form.q[1] - q0[1])
        elif i == 1 and name == f"bias {system.inputs[1].name}":
            values[i] = DEGREES * sigma * form.t
        else:
            values[i] = ca.SX.sym(f"{name} {i}")
            states.append(values[i])
            moving.append(i)
    column = ca.vertcat(*values)
    rates = [form.A[i, :] @ column + DEGREES * sigma * b[i] for i in moving]
    initial = [DEGREES * sigma * start[i] for i in moving]
    return _Column(values, states, rates, initial)


def _read(form: Linearised) -> list[list[int]]:
    """For each coordinate, which coordinates its rate reads."""
    N = form.q.numel()
    return [[j for j in range(N) if form.A[i, j].nnz() > 0] for i in range(N)]


def degrees(response: Array) -> float:
    """Root sum of squares of a block of W."""
    return float(np.sqrt(np.sum(np.square(response))))
