"""A motion and its response to errors, as one system to transcribe.

The response W = S diag(σ) to errors of one standard deviation follows from Ṡ = A S + B: one more
column a parameter, never the n² entries of a covariance. Triangular systems leave most entries
empty, and those that are constant (an offset of θᵢ arrives whole at θᵢ) need no state. For the
manipulator of three joints, five errors and so fifteen entries, eight states are left. Each is the
change of its entry, so that all begin at zero. The covariance along the path is P = W Wᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from planner.problem.requirements.requirement import Requirement
from planner.support.arrays import Array
from planner.support.compiled_calls import Pointwise
from planner.systems.linearisation import Linearisation, linearise
from planner.systems.triangular_system import TriangularSystem

DEGREES = 180 / np.pi
"""The response is weighed in degrees (lengths in their unit over 57.3): its size is near 1."""

VARIANCE_ROUNDING = 1e-6 / DEGREES
"""Rounds off the square root of a variance that is zero, in its unit (rad, or that of z₂)."""


@dataclass(frozen=True)
class Augmented:
    """A system with the states x = (q, w), w being what changes of S, a clock and the effort.

    Attributes:
        system: What moves.
        spread: Names of the P errors, in the order of W's columns, with standard deviations.
        passive: Weight of the passive block squared (deg²): rows q₃ … of the columns of the start
            of q₂ and the gain of u₂.
        terminal: Weight of the whole terminal response squared (deg²).
        path: Weight of the response squared, averaged along the path (deg²).
        backoff: Standard deviations by which limits are backed off, see `backs_off`.
        metered: Whether the last state is the effort spent.
    """

    system: TriangularSystem
    spread: tuple[tuple[str, float], ...]
    passive: float = 0.0
    terminal: float = 0.0
    path: float = 0.0
    backoff: float = 0.0
    metered: bool = False

    @property
    def size(self) -> int:
        """Number of states."""
        return self._made.size

    def rates_expr(self, x: Any, u: Any) -> list[Any]:
        """CasADi expressions of ẋ."""
        return list(ca.vertsplit(self._made.rates(x, u)))

    def end_cost_expr(self, x: Any) -> Any:
        """CasADi expression of what the response costs at the end."""
        W = DEGREES * self._made.response.function(x)
        return self.passive * ca.sumsqr(W[2:, self._passive]) + self.terminal * ca.sumsqr(W[1:, :])

    def path_cost_expr(self, x: Any) -> Any:
        """CasADi expression of what it costs on the way."""
        return self.path * ca.sumsqr(DEGREES * self._made.response.function(x)[1:, :])

    def sides(self, q: Any, value: Any, places: list[Any]) -> list[Any]:
        """An expression in q (N), at places x, less and more by the back-off."""
        both = ca.Function("value", [q], [value, ca.jacobian(value, q)])
        out = []
        for x in places:
            here, slope = both(x[: self.system.size])
            spread = ca.sqrt(
                ca.sumsqr(slope @ self._made.response.function(x)) + VARIANCE_ROUNDING**2
            )
            out += [here - self.backoff * spread, here + self.backoff * spread]
        return out

    def response(self, x: Array) -> Array:
        """W (…, N, P) in SI units at x (…, N + m); row 0, the path coordinate's, is left out (zero)
        where nothing depends on it."""
        return self._made.response(x)

    def sizes_deg(self, x: Array) -> tuple[float, float]:
        """Size of the passive block, and of the whole response, at x (N + m)."""
        W = DEGREES * self.response(x)
        return float(np.linalg.norm(W[2:, self._passive])), float(np.linalg.norm(W[1:]))

    @property
    def _passive(self) -> list[int]:
        system = self.system
        names = (f"start {system.coordinates[1].name}", f"gain {system.inputs[1].name}")
        return [p for p, (name, _) in enumerate(self.spread) if name in names]

    @cached_property
    def _made(self) -> _Expressions:
        return _expressions(self)


@dataclass(frozen=True, eq=False)
class _Expressions:
    """Number of the states x, and functions (x, u) to ẋ and x to W."""

    size: int
    rates: Any
    response: Pointwise


def _expressions(made: Augmented) -> _Expressions:
    form = linearise(made.system)
    states, rates, columns = list[Any](), list[Any](), list[Any]()
    for error, sigma in made.spread:
        moving, column = _column(form, error)
        for i, state in moving.items():
            states.append(state)
            rates.append(form.A[i, :] @ column + form.forcing[error][i])
        columns.append(sigma * column)
    if ca.depends_on(ca.vertcat(ca.SX(), *rates), form.t):
        states, rates = [*states, form.t], [*rates, ca.SX(1)]
    if made.metered:
        states, rates = [*states, ca.SX.sym("effort")], [*rates, ca.sumsqr(form.u)]
    whole = ca.vertcat(form.q, *states)
    return _Expressions(
        whole.numel(),
        ca.Function("rates", [whole, form.u], [ca.vertcat(form.rates, *rates)]),
        Pointwise("response", [whole], ca.horzcat(*columns)),
    )


def _column(form: Linearisation, error: str) -> tuple[dict[int, Any], Any]:
    """One error's column of S, and the symbols of those of its entries that move."""
    N, b, start = form.q.numel(), form.forcing[error], form.initial[error]
    read = [[j for j in range(N) if form.A[i, j].nnz() > 0] for i in range(N)]
    reached = [bool(start[i]) or b[i].nnz() > 0 for i in range(N)]
    for _ in range(N):
        reached = [r or any(reached[j] for j in read[i]) for i, r in enumerate(reached)]
    reached[0] &= any(0 in rows for rows in read)
    moving = {
        i: ca.SX.sym(f"{error} {i}")
        for i in range(N)
        if reached[i] and (b[i].nnz() > 0 or any(reached[j] for j in read[i]))
    }
    constant = [start[i] if reached[i] else 0.0 for i in range(N)]
    return moving, ca.vertcat(*(c + moving.get(i, 0.0) for i, c in enumerate(constant)))


MovingSystem = TriangularSystem | Augmented
"""What a transcription moves."""


def backs_off(required: Requirement) -> bool:
    """Whether a requirement is backed off: limits on coordinates, but not places to clear.

    Nor those whose rows read numbers: the slope of such rows is no function of q alone.
    """
    return required.reads == {"q"} and required.smooth and not required.numbers
