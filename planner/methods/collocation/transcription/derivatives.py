"""The functions of one interval with their derivatives, which `transcription` maps over the mesh.

`ChainRule` differentiates functions that are computed through many intermediate values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.interval import Stage
from planner.methods.collocation.transcription.unknowns import Index
from planner.support import deadline

Pattern = tuple[Index, Index]


@dataclass(frozen=True, eq=False)
class IntervalFunctions:
    """CasADi functions of one interval, with the column (y, c), state and control, and parameters.

    The parameters are those of `Form.parameters`, then the interval's width.

    Attributes:
        cost: Gives the cost.
        rows: Gives the rows, the first being minus the next state.
        gradient: Gives the gradient of the cost.
        jacobian: Gives the rows, and the nonzeros of (identity; Jacobian of the rows) by columns.
        gradient_and_hessian: With lam_f and lam_g also as arguments, gives the gradient of the
            Lagrangian and the nonzeros of its Hessian.
        points: Gives the coordinates at the collocation points.
        jacobian_pattern: Rows and columns of the Jacobian's nonzeros; the identity's rows belong to
            the previous interval, so they are negative.
        hessian_pattern: Rows and columns of the Hessian's nonzeros, both triangles.
    """

    cost: Any
    rows: Any
    gradient: Any
    jacobian: Any
    gradient_and_hessian: Any
    points: Any
    jacobian_pattern: Pattern
    hessian_pattern: Pattern


def interval_functions(stage: Stage) -> IntervalFunctions:
    """Build the functions of one interval with their first and second derivatives.

    Raises:
        TimeUpError: If time is up; eight joints with their response to errors take a second.
    """
    unknowns = ca.vertcat(stage.state, stage.control)
    inputs = [unknowns, ca.vertcat(stage.weights, stage.width)]
    rows = ca.vertcat(-stage.after, stage.rows)
    scale, duals = ca.SX.sym("scale"), ca.SX.sym("duals", stage.height)
    chain = ChainRule(unknowns, stage.inside, stage.meaning)
    gradient, hessian = chain.second(scale * stage.cost + ca.dot(duals, rows))
    identity = ca.DM.eye(stage.state.numel())
    zeros = ca.DM(identity.size1(), stage.control.numel())
    jacobian = ca.vertcat(ca.horzcat(identity, zeros), chain.jacobian(rows))
    (row, column), states = _pattern(jacobian), stage.state.numel()
    leading = np.where(row < states, row - stage.height, row - states), column
    return IntervalFunctions(
        cost=_function(chain, "cost", inputs, [stage.cost]),
        rows=_function(chain, "rows", inputs, [rows]),
        gradient=_function(chain, "gradient", inputs, [chain.jacobian(stage.cost).T]),
        jacobian=_function(chain, "jacobian", inputs, [rows, jacobian.nz[:]]),
        gradient_and_hessian=_function(
            chain, "hessian", [*inputs, scale, duals], [gradient, hessian.nz[:]]
        ),
        points=_function(chain, "points", inputs, [ca.vec(stage.points)]),
        jacobian_pattern=leading,
        hessian_pattern=_pattern(hessian),
    )


def _function(chain: ChainRule, name: str, inputs: list[Any], outputs: list[Any]) -> Any:
    deadline.check()
    outputs = ca.cse([ca.densify(out) for out in chain.substitute(outputs)])
    return ca.Function(f"interval_{name}", inputs, outputs)


def _pattern(matrix: Any) -> Pattern:
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)


class ChainRule:
    """Derivatives by w of functions L(w, v), where v is defined step by step: v = F(w, earlier v).

    Let Z = dv/dw, and mu the total derivatives of a function L(w, v) by each v, including the
    effect on later entries of v. Then L has the Hessian (I; Z)' M (I; Z), where M is the Hessian of
    L + mu' F in (w, v). M is sparse, since the collocation points are not coupled in it. This takes
    half the operations of differentiating L after substituting v. With substitution, by CasADi
    alone, five shipped problems took 10 to 30 % more processor time in total when desensitised, and
    3 to 7 % more with collocation.

    Args:
        unknowns: w, a column.
        inside: v, as columns of symbols.
        meaning: F, as columns, each in terms of w and of earlier columns of v.
    """

    def __init__(self, unknowns: Any, inside: Sequence[Any], meaning: Sequence[Any]) -> None:
        self.w, self.v, self.F = unknowns, ca.vertcat(*inside), ca.vertcat(*meaning)
        self.by_v = ca.jacobian(self.F, self.v)
        self.ends = np.cumsum([0, *(column.numel() for column in inside)]).tolist()
        rows = ca.vertsplit(ca.jacobian(self.F, self.w), self.ends)
        for k, (first, last) in enumerate(pairwise(self.ends)):
            if k > 0:
                rows[k] += self.by_v[first:last, :first] @ ca.vertcat(*rows[:k])
        self.Z = ca.vertcat(*rows)

    def jacobian(self, value: Any) -> Any:
        """Return the Jacobian by w of a column `value` in w and v, with a row for each entry."""
        return ca.jacobian(value, self.w) + ca.jacobian(value, self.v) @ self.Z

    def second(self, of: Any) -> tuple[Any, Any]:
        """Return the gradient and the Hessian by w of a scalar function of w and v."""
        mu, count = ca.SX.sym("mu", self.v.numel()), self.w.numel()
        whole = of + ca.dot(mu, self.F)
        hessian = ca.hessian(whole, ca.vertcat(self.w, self.v))[0]
        mixed = hessian[:count, count:] @ self.Z
        direct = hessian[:count, :count] + self.Z.T @ (hessian[count:, count:] @ self.Z)
        both = [ca.gradient(whole, self.w), ca.triu2symm(ca.triu(direct + mixed + mixed.T))]
        gradient, hessian = ca.substitute(both, [mu], [self._growth(of)])
        return gradient, hessian

    def _growth(self, of: Any) -> Any:
        out = ca.vertsplit(ca.gradient(of, self.v), self.ends)
        for k, (first, last) in reversed(list(enumerate(pairwise(self.ends[:-1])))):
            out[k] += self.by_v[last:, first:last].T @ ca.vertcat(*out[k + 1 :])
        return ca.densify(ca.vertcat(*out))

    def substitute(self, outputs: list[Any]) -> list[Any]:
        """Return the expressions with the definitions F substituted for the symbols v."""
        return list(ca.substitute_inplace(ca.vertsplit(self.v), ca.vertsplit(self.F), outputs)[1])
