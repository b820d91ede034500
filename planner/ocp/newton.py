"""Newton's method, for a start so near the answer that it meets the same limits.

Limits that the start touches are held as equations. Each step solves

    (H + J' W J) dx = -(slope + J' (duals + W r)),        duals += W (J dx + r)

with the Lagrangian's Hessian H, the objective's slope, the Jacobian J of what is held, its
residuals r and large weights W, but for which this is Newton's step on the optimality conditions.
The first duals are those that fit the slope best. The matrix is positive definite where the point
is a minimum along the rows. Where it is not, where a step breaks a limit, or where a limit held
pushes the wrong way, it is for other solvers to find out which limits are met.

Steps are CasADi functions as a whole, what they are judged by included: calls from Python would
double the time for short chains. Two steps share a Hessian, which is half the work.

Source: Nocedal and Wright, Numerical Optimization, 2nd ed., sections 17.3 and 18.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg.lapack import dpbtrf

from planner.ocp.assembly import Program
from planner.ocp.backends import FATROP_TOLERANCE, Answer, Settings
from planner.ocp.bounds import Bounds
from planner.ocp.transcription import Transcription
from planner.systems.base import Array
from planner.systems.pointwise import Call
from planner.unsaid import unsaid

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
        self._tolerance = settings.tolerance
        self._gain = max(settings.tolerance, FATROP_TOLERANCE)
        self._functions = _Functions(made.program)

    def __call__(self, start: Array, data: Bounds) -> Answer:
        """Answer, or give the start back."""
        with unsaid("LDL factorization has zeros", "stderr"):  # no answer will come of it
            return self._answer(start, data)

    def _answer(self, start: Array, data: Bounds) -> Answer:
        limits = data.lower, data.row_lower, data.upper, data.row_upper
        given, functions = (data.parameters, np.concatenate(limits)), self._functions
        x, duals, held, (broken,) = functions.first.parts(start, *given)
        taken, finished = 1, False
        for _ in range(ROUNDS):
            if not broken <= TOUCHING:
                break
            more = functions.more.parts(x, *given, duals, held)
            x, duals, (broken, residual, gain, pull), matrix = more
            taken += 2
            if max(residual, broken) <= self._tolerance and gain <= self._gain:
                finished = bool(pull <= self._tolerance) and self._least(matrix, len(start))
                break
        status = "Solve_Succeeded" if finished else "Other_Limits_Or_Too_Far"
        return Answer(x if finished else start, finished, status, taken)

    def _least(self, matrix: Array, size: int) -> bool:
        """Whether the last step's matrix is positive definite."""
        where, height = self._functions.band
        band = np.zeros(height * size)
        band[where] = matrix
        columns = band.reshape(height, size, order="F")
        return not dpbtrf(columns, lower=1, overwrite_ab=1)[1]


class _Parts:
    """A function whose columns are told apart."""

    def __init__(self, name: str, inputs: list[Any], outputs: list[Any]) -> None:
        self._call = Call(ca.Function(name, inputs, ca.cse([ca.vertcat(*outputs)])))
        ends = np.cumsum([column.numel() for column in outputs]).tolist()
        self._parts = [slice(*pair) for pair in pairwise([0, *ends])]

    def parts(self, *arguments: Array) -> list[Array]:
        found = self._call(*arguments)
        return [found[part] for part in self._parts]


class _Functions:
    """Steps, made when they are first wanted.

    All are of unknowns, parameters and limits: lower ones of the unknowns, then of the rows, then
    upper ones. Values and what is said of them are of unknowns, then rows, too.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.x, self.p = program.problem["x"], program.problem["p"]
        self.n, self.m = self.x.numel(), program.problem["g"].numel()
        limits = ca.MX.sym("limits", 2 * (self.n + self.m))
        self.lower, self.upper = ca.vertsplit(limits, self.n + self.m)
        self.inputs = [self.x, self.p, limits]

    @cached_property
    def first(self) -> _Parts:
        """To unknowns, duals, what is held, and by how much other limits are broken.

        One step from the duals that fit the slope best.
        """
        rows, J = self.program.jacobian(self.x, self.p)
        before = ca.vertcat(self.x, rows)
        held = _Held.at(before, self.lower, self.upper, self.n)
        slope = self.program.gradient(self.x, self.p)
        matrix = ca.MX.eye(self.n) + held.normal(J)
        duals = held.weighed * (J @ ca.solve(matrix, -slope, "ldl"))
        hessian = self._hessian(self.x, duals)
        x, duals, _ = self._step(self.x, duals, held, hessian)
        broken = self._broken(before, held)
        return _Parts("first", self.inputs, [x, duals, held.packed, broken])

    @cached_property
    def more(self) -> _Parts:
        """With duals and what is held, to unknowns, duals, four numbers and the matrix.

        The numbers are, after two steps, by how much other limits are broken, the greatest
        residual, the greatest slope, and how hard a limit held pulls the wrong way. They pass NaN
        over, with which no answer stands: `solver` evaluates its rows anew.
        """
        given, packed = ca.MX.sym("duals", self.m), ca.MX.sym("held", 3 * (self.n + self.m))
        every, side, target = ca.vertsplit(packed, self.n + self.m)
        held = _Held(every, side, target, self.n)
        hessian = self._hessian(self.x, given)
        x, duals, _ = self._step(self.x, given, held, hessian)
        x, duals, matrix = self._step(x, duals, held, hessian)
        rows, J = self.program.jacobian(x, self.p)
        values, slope = ca.vertcat(x, rows), self.program.gradient(x, self.p) + J.T @ duals
        said = ca.vertcat(
            self._broken(values, held),
            ca.mmax(held.all * ca.fabs(values - held.target)),
            ca.mmax((1 - held.all[: self.n]) * ca.fabs(slope)),
            -ca.mmin(held.side * ca.vertcat(-slope, duals)),
        )
        lower = ca.tril(matrix)
        row, column = (np.array(each) for each in lower.sparsity().get_triplet())
        height = int(np.max(row - column)) + 1
        self.band = row - column + height * column, height
        return _Parts("more", [*self.inputs, given, packed], [x, duals, said, lower.nz[:]])

    def _hessian(self, x: Any, duals: Any) -> Any:
        return self.program.hessian(x, self.p, 1.0, duals)[1]

    def _step(self, x: Any, duals: Any, held: _Held, hessian: Any) -> tuple[Any, Any, Any]:
        rows, J = self.program.jacobian(x, self.p)
        matrix = hessian + held.normal(J)
        pull = held.weighed * (rows - held.target[self.n :])
        slope = self.program.gradient(x, self.p) + J.T @ (duals + pull)
        dx = ca.solve(matrix, -slope, "ldl")
        return x + dx, duals + held.weighed * (J @ dx) + pull, matrix

    def _broken(self, values: Any, held: _Held) -> Any:
        """By how much limits that are not held are broken at most, or minus their distance."""
        over = ca.fmax(self.lower - values, values - self.upper)
        return ca.mmax(ca.if_else(held.all, -np.inf, over))


@dataclass(frozen=True, eq=False)
class _Held:
    """What is held as equations: expressions over the unknowns, then the rows.

    Attributes:
        all: Whether each is held.
        side: 1 and -1 for limits held at their upper and lower bound, else 0.
        target: The value at which each is held, else 0.
        unknowns: How many there are.
    """

    all: Any
    side: Any
    target: Any
    unknowns: int

    @classmethod
    def at(cls, values: Any, lower: Any, upper: Any, unknowns: int) -> _Held:
        """What values touch of their limits."""
        equal, near = lower == upper, TOUCHING
        low = ca.logic_and(ca.fabs(values - lower) <= near, ca.logic_not(equal))
        high = ca.logic_and(ca.fabs(upper - values) <= near, ca.logic_not(ca.logic_or(equal, low)))
        target = ca.if_else(ca.logic_or(equal, low), lower, 0) + ca.if_else(high, upper, 0)
        return cls(ca.logic_or(equal, ca.logic_or(low, high)), high - low, target, unknowns)

    @property
    def packed(self) -> Any:
        """As one column."""
        return ca.vertcat(self.all, self.side, self.target)

    @property
    def weighed(self) -> Any:
        """W of the rows."""
        return WEIGHT * self.all[self.unknowns :]

    def normal(self, J: Any) -> Any:
        """J' W J of rows and unknowns held."""
        fixed = ca.diag(FIXED * self.all[: self.unknowns])
        return J.T @ (ca.diag(self.weighed) @ J) + fixed
