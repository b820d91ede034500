"""The functions of one interval, differentiated once; `transcription` maps them over the whole.

Derivatives of what is computed by way of many intermediate values.
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
    """Functions of (y, c) and the parameters (`Form.parameters`, width), all dense columns.

    Attributes:
        cost: To the cost.
        rows: To the rows, the first being minus the state it leads to.
        gradient: To the gradient of the cost.
        jacobian: To rows, and the nonzeros of (identity; Jacobian of the rows) by columns.
        hessian: With lam_f and lam_g to gradient of the Lagrangian and nonzeros of its Hessian.
        points: To the coordinates at the collocation points.
        jacobian_pattern: Rows and columns of those nonzeros; the identity's rows are those of the
            interval before, so that they are negative.
        hessian_pattern: Rows and columns, both triangles.
    """

    cost: Any
    rows: Any
    gradient: Any
    jacobian: Any
    hessian: Any
    points: Any
    jacobian_pattern: Pattern
    hessian_pattern: Pattern


def interval_functions(stage: Stage) -> IntervalFunctions:
    """Differentiate one interval.

    Raises:
        TimeUpError: If time is up; with eight joints and their response it takes a second.
    """
    unknowns = ca.vertcat(stage.state, stage.control)
    inputs = [unknowns, ca.vertcat(stage.weights, stage.width)]
    rows = ca.vertcat(-stage.after, stage.rows)
    scale, duals = ca.SX.sym("scale"), ca.SX.sym("duals", stage.height)
    chain = ChainRule(unknowns, stage.inside, stage.meaning)
    gradient, hessian = chain.second(scale * stage.cost + ca.dot(duals, rows))
    identity = ca.DM.eye(stage.state.numel())
    beside = ca.DM(identity.size1(), stage.control.numel())
    jacobian = ca.vertcat(ca.horzcat(identity, beside), chain.jacobian(rows))
    (row, column), own = _pattern(jacobian), stage.state.numel()
    leading = np.where(row < own, row - stage.height, row - own), column
    return IntervalFunctions(
        cost=_function(chain, "cost", inputs, [stage.cost]),
        rows=_function(chain, "rows", inputs, [rows]),
        gradient=_function(chain, "gradient", inputs, [chain.jacobian(stage.cost).T]),
        jacobian=_function(chain, "jacobian", inputs, [rows, jacobian.nz[:]]),
        hessian=_function(chain, "hessian", [*inputs, scale, duals], [gradient, hessian.nz[:]]),
        points=_function(chain, "points", inputs, [ca.vec(stage.points)]),
        jacobian_pattern=leading,
        hessian_pattern=_pattern(hessian),
    )


def _function(chain: ChainRule, name: str, inputs: list[Any], outputs: list[Any]) -> Any:
    deadline.check()
    outputs = ca.cse([ca.densify(out) for out in chain.closed(outputs)])
    return ca.Function(f"interval_{name}", inputs, outputs)


def _pattern(matrix: Any) -> Pattern:
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)


class ChainRule:
    """Derivatives along a chain of definitions v = F(w, v before), such as the values inside.

    With Z = dv/dw, and with mu the rates at which a function L(w, v) grows with each v by way of
    those after it, L has the Hessian (I; Z)' M (I; Z), where M is that of L + mu' F in (w, v): it
    is sparse, each collocation point standing for itself. That takes half the operations of
    differentiating L after v is put in. With that, by CasADi alone, five shipped problems took 10
    to 30 % more processor time desensitised, all in all; collocation 3 to 7 %.

    Args:
        unknowns: w, a column.
        inside: v, as columns of symbols.
        meaning: F, as columns, each in terms of w and of the columns of v before it.
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

    def jacobian(self, of: Any) -> Any:
        """First derivatives by w, as a matrix with a row for each entry of a column."""
        return ca.jacobian(of, self.w) + ca.jacobian(of, self.v) @ self.Z

    def second(self, of: Any) -> tuple[Any, Any]:
        """Gradient and Hessian by w of one function."""
        mu, count = ca.SX.sym("mu", self.v.numel()), self.w.numel()
        whole = of + ca.dot(mu, self.F)
        hessian = ca.hessian(whole, ca.vertcat(self.w, self.v))[0]
        mixed = hessian[:count, count:] @ self.Z
        own = hessian[:count, :count] + self.Z.T @ (hessian[count:, count:] @ self.Z)
        both = [ca.gradient(whole, self.w), ca.triu2symm(ca.triu(own + mixed + mixed.T))]
        gradient, hessian = ca.substitute(both, [mu], [self._growth(of)])
        return gradient, hessian

    def _growth(self, of: Any) -> Any:
        out = ca.vertsplit(ca.gradient(of, self.v), self.ends)
        for k, (first, last) in reversed(list(enumerate(pairwise(self.ends[:-1])))):
            out[k] += self.by_v[last:, first:last].T @ ca.vertcat(*out[k + 1 :])
        return ca.densify(ca.vertcat(*out))

    def closed(self, outputs: list[Any]) -> list[Any]:
        """Expressions with v put in."""
        return list(ca.substitute_inplace(ca.vertsplit(self.v), ca.vertsplit(self.F), outputs)[1])
