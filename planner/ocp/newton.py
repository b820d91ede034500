"""Newton's method, for a start so near the answer that it meets the same limits.

Limits that the start touches are held as equations. Each step solves

    (H + J' W J) dx = -(slope + J' (duals + W r)),        duals += W (J dx + r)

with the Lagrangian's Hessian H, the objective's slope, the Jacobian J of what is held, its
residuals r and large weights W, but for which this is Newton's step on the optimality conditions.
The first duals are those that fit the slope best. The matrix is positive definite where the point
is a minimum along the rows. Where it is not, where a step breaks a limit, or where a limit held
pushes the wrong way, it is for other solvers to find out which limits are met.

Steps are CasADi functions as a whole: calls from Python would double the time for short chains.

Source: Nocedal and Wright, Numerical Optimization, 2nd ed., sections 17.3 and 18.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf

from planner.ocp.assembly import Program
from planner.ocp.backends import FATROP_TOLERANCE, Answer, Settings
from planner.ocp.bounds import Bounds
from planner.ocp.transcription import Transcription
from planner.systems.base import Array
from planner.systems.pointwise import evaluated

ROUNDS = 2
"""Times that two steps follow the first one, which shows whether other limits are met. From a start
worth its while two steps are enough, for long chains four."""

WEIGHT, FIXED = 1e11, 1e20
"""Weights of rows and unknowns held. Singular values of J are down to 1e-5 for six joints."""

TOUCHING = 1e-6
"""Distance from a limit within which it counts as met."""


class Newton:
    """A backend, see `backends`: from a start and a problem's numbers to an answer."""

    def __init__(self, made: Transcription, settings: Settings) -> None:
        self._rows, self._tolerance = made.program.g, settings.tolerance
        self._functions = _Functions(made.program)

    def __call__(self, start: Array, data: Bounds) -> Answer:
        """Answer, or give the start back."""
        n, m, p = len(start), len(data.row_lower), data.parameters
        values, duals = np.append(start, _value(self._rows, start, p)), np.zeros(m)
        held = _held(data, values)
        broken, taken, finished = held.broken(values), 0, False
        for count in (1, *[2] * ROUNDS):
            if not broken <= TOUCHING:
                break
            steps = self._functions.first if count == 1 else self._functions.more
            found = _value(steps, values[:n], p, held.weights, held.target[n:], duals)
            values, duals, slope, matrix = np.split(found, [n + m, n + 2 * m, 2 * (n + m)])
            broken, taken = held.broken(values), taken + count
            if len(slope) and self._settled(held, values, slope, broken):
                push = np.append(-slope, duals) * held.side
                finished = bool(np.min(push) >= -self._tolerance) and self._least(matrix, n)
                break
        status = "Solve_Succeeded" if finished else "Other_Limits_Or_Too_Far"
        return Answer(values[:n] if finished else start, finished, status, taken)

    def _settled(self, held: _Held, values: Array, slope: Array, broken: float) -> bool:
        """Whether nothing is left to gain, to the tolerance that is asked of Fatrop."""
        residual = np.max(np.abs(values - held.target) * held.all)
        gain = np.max(np.abs(slope) * ~held.all[: len(slope)])
        kept = max(residual, broken) <= self._tolerance
        return bool(kept and gain <= max(self._tolerance, FATROP_TOLERANCE))

    def _least(self, matrix: Array, size: int) -> bool:
        """Whether the last step's matrix is positive definite."""
        below, column = self._functions.band
        band = np.zeros((int(np.max(below)) + 1, size))
        band[below, column] = matrix
        return not dpbtrf(band, lower=1)[1]


def _value(function: Any, *arguments: Array) -> Array:
    return evaluated(function, arguments, np.empty(function.nnz_out(0)))


@dataclass(frozen=True, eq=False)
class _Held:
    """What is held as equations; all arrays are over the unknowns, then the rows.

    Attributes:
        lower: All bounds.
        upper: The same.
        all: Whether each is held.
        side: 1 and -1 for limits held at their upper and lower bound, else 0.
        target: The value at which each is held, else 0.
        weights: W.
    """

    lower: Array
    upper: Array
    all: NDArray[np.bool_]
    side: Array
    target: Array
    weights: Array

    def broken(self, values: Array) -> float:
        """By how much the other limits are broken at most, or minus their distance."""
        over = np.maximum(self.lower - values, values - self.upper)
        over[self.all] = -np.inf
        return float(np.max(over))


def _held(data: Bounds, values: Array) -> _Held:
    """What values of unknowns and rows touch."""
    lower = np.append(data.lower, data.row_lower)
    upper = np.append(data.upper, data.row_upper)
    equal, side = lower == upper, np.zeros(len(values))
    side[np.abs(upper - values) <= TOUCHING] = 1.0
    side[np.abs(values - lower) <= TOUCHING] = -1.0
    side[equal] = 0.0
    every = equal | (side != 0)
    target = np.where(side < 0, lower, upper)
    target[~every] = 0.0
    weights = every * WEIGHT
    weights[: len(data.lower)] *= FIXED / WEIGHT
    return _Held(lower, upper, every, side, target, weights)


class _Functions:
    """Steps, made when they are first wanted.

    All are of unknowns, parameters, weights, targets of the rows and duals.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.x, self.p = program.problem["x"], program.problem["p"]
        n, m = self.x.numel(), program.problem["g"].numel()
        weights, self.target = ca.MX.sym("weights", n + m), ca.MX.sym("target", m)
        self.duals = ca.MX.sym("duals", m)
        self.fixed, self.weighed = ca.vertsplit(weights, [0, n, n + m])
        self.inputs = [self.x, self.p, weights, self.target, self.duals]

    @cached_property
    def first(self) -> Any:
        """To unknowns, rows and duals after one step from the duals that fit the slope best."""
        rows, J = self.program.jacobian(self.x, self.p)
        slope = self.program.gradient(self.x, self.p)
        matrix = ca.MX.eye(self.x.numel()) + self._normal(J)
        duals = self.weighed * (J @ ca.solve(matrix, -slope, "ldl"))
        x, duals, _ = self._step(self.x, duals)
        rows = self.program.g(x, self.p)
        return ca.Function("first", self.inputs, [ca.vertcat(x, rows, duals)])

    @cached_property
    def more(self) -> Any:
        """To unknowns, rows, duals, the Lagrangian's slope and the matrix after two steps."""
        x, duals, _ = self._step(self.x, self.duals)
        x, duals, matrix = self._step(x, duals)
        rows, J = self.program.jacobian(x, self.p)
        slope = self.program.gradient(x, self.p) + J.T @ duals
        lower = ca.tril(matrix)
        row, column = (np.array(each) for each in lower.sparsity().get_triplet())
        self.band = row - column, column
        found = ca.vertcat(x, rows, duals, slope, lower.nz[:])
        return ca.Function("more", self.inputs, [found])

    def _step(self, x: Any, duals: Any) -> tuple[Any, Any, Any]:
        rows, J = self.program.jacobian(x, self.p)
        matrix = self.program.hessian(x, self.p, 1.0, duals)[1] + self._normal(J)
        pull = self.weighed * (rows - self.target)
        slope = self.program.gradient(x, self.p) + J.T @ (duals + pull)
        dx = ca.solve(matrix, -slope, "ldl")
        return x + dx, duals + self.weighed * (J @ dx) + pull, matrix

    def _normal(self, J: Any) -> Any:
        return J.T @ (ca.diag(self.weighed) @ J) + ca.diag(self.fixed)
