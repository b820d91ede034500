"""A motion and its response to errors, as one system to transcribe.

The response W = S diag(σ) to errors of one standard deviation follows from Ṡ = A S + B: one column
per parameter, instead of the n² entries of a covariance. In triangular systems most entries are
zero, and constant entries (an offset of θᵢ stays such an offset) need no state. For the manipulator
of three joints with five errors, eight of the fifteen entries are states. Each state is the change
of its entry, so all begin at zero. The covariance along the path is P = W Wᵀ.
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
"""Factor from radians to degrees, in which the response is weighted, so that its size is near 1."""

VARIANCE_ROUNDING = 1e-6 / DEGREES
"""Standard deviation (rad, or as z₂) added so that the root is smooth at a variance of zero."""


@dataclass(frozen=True, eq=False)
class _Expressions:
    """Number of states x, function from (x, u) to ẋ, and function from x to the response W."""

    size: int
    rates: Any
    response: Pointwise


@dataclass(frozen=True)
class Augmented:
    """A system with its response to errors, with states x = (q, w), where w are the varying
    entries of S and, if needed, a clock and the effort so far.

    Attributes:
        system: The system.
        spread: Names of the P errors, in the order of W's columns, with standard deviations.
        passive: Weight of the squared passive block (deg²): rows q₃ … of the columns for the start
            of q₂ and the gain of u₂.
        terminal: Weight of the squared terminal response (deg²).
        path: Weight of the squared response, averaged along the path (deg²).
        backoff: Number of standard deviations by which limits are backed off, see `backs_off`.
        metered: Whether the last state is the effort so far.
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
        """Number of states x."""
        return self._formulas.size

    def rates_expr(self, x: Any, u: Any) -> list[Any]:
        """Return the rates ẋ of the states as CasADi expressions in x and the inputs u (2)."""
        return list(ca.vertsplit(self._formulas.rates(x, u)))

    def end_cost_expr(self, x: Any) -> Any:
        """Return the cost of the response at the end state x, deg², as a CasADi expression."""
        W = DEGREES * self._formulas.response.function(x)
        return self.passive * ca.sumsqr(W[2:, self._passive]) + self.terminal * ca.sumsqr(W[1:, :])

    def path_cost_expr(self, x: Any) -> Any:
        """Return the cost of the response at a state x on the path, deg², as an expression."""
        return self.path * ca.sumsqr(DEGREES * self._formulas.response.function(x)[1:, :])

    def sides(self, q: Any, value: Any, places: list[Any]) -> list[Any]:
        """Return a limited value, an expression in q, minus and plus its back-off at each state."""
        both = ca.Function("value", [q], [value, ca.jacobian(value, q)])
        out = []
        for x in places:
            here, slope = both(x[: self.system.size])
            variance = ca.sumsqr(slope @ self._formulas.response.function(x))
            spread = ca.sqrt(variance + VARIANCE_ROUNDING**2)
            out += [here - self.backoff * spread, here + self.backoff * spread]
        return out

    def response(self, x: Array) -> Array:
        """Return the response W (…, N, P) in SI units at states x (…, N + m); row 0 is zero if
        no rate depends on the path coordinate."""
        return self._formulas.response(x)

    def sizes_deg(self, x: Array) -> tuple[float, float]:
        """Return the norms of the passive block and of the whole response at a state x, degrees."""
        W = DEGREES * self.response(x)
        return float(np.linalg.norm(W[2:, self._passive])), float(np.linalg.norm(W[1:]))

    @property
    def _passive(self) -> list[int]:
        system = self.system
        names = (f"start {system.coordinates[1].name}", f"gain {system.inputs[1].name}")
        return [p for p, (name, _) in enumerate(self.spread) if name in names]

    @cached_property
    def _formulas(self) -> _Expressions:
        form = linearise(self.system)
        states, rates, columns = list[Any](), list[Any](), list[Any]()
        for error, sigma in self.spread:
            moving, column = _column(form, error)
            for i, state in moving.items():
                states.append(state)
                rates.append(form.A[i, :] @ column + form.forcing[error][i])
            columns.append(sigma * column)
        if ca.depends_on(ca.vertcat(ca.SX(), *rates), form.t):
            states, rates = [*states, form.t], [*rates, ca.SX(1)]
        if self.metered:
            states, rates = [*states, ca.SX.sym("effort")], [*rates, ca.sumsqr(form.u)]
        whole = ca.vertcat(form.q, *states)
        return _Expressions(
            whole.numel(),
            ca.Function("rates", [whole, form.u], [ca.vertcat(form.rates, *rates)]),
            Pointwise("response", [whole], ca.horzcat(*columns)),
        )


def _column(form: Linearisation, error: str) -> tuple[dict[int, Any], Any]:
    """Return an error's column of S, and before it the symbols of the varying entries by row."""
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
"""A system that can be transcribed: alone, or augmented by its response to errors."""


def backs_off(requirement: Requirement) -> bool:
    """Return whether a requirement is backed off: a limit on coordinates, but not an obstacle.

    A requirement whose rows depend on its fields (`row_fields`) is not backed off, since the slope
    of a row must be a function of q alone.
    """
    return requirement.reads == {"q"} and requirement.smooth and not requirement.row_fields
