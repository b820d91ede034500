"""The functions of one interval, differentiated once; the whole problem maps them (`assembly`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from planner.ocp.chain import Chain
from planner.ocp.layout import Index
from planner.ocp.stage import Stage

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

    def named(self) -> dict[str, Any]:
        """The functions by name."""
        names = ("cost", "rows", "gradient", "jacobian", "hessian", "points")
        return {name: getattr(self, name) for name in names}

    def replaced(self, functions: dict[str, Any]) -> IntervalFunctions:
        """With other functions of those names."""
        return replace(self, **functions)


def interval_functions(stage: Stage) -> IntervalFunctions:
    """Differentiate one interval."""
    unknowns = ca.vertcat(stage.state, stage.control)
    inputs = [unknowns, ca.vertcat(stage.weights, stage.width)]
    rows = ca.vertcat(-stage.after, stage.rows)
    scale, duals = ca.SX.sym("scale"), ca.SX.sym("duals", stage.height)
    chain = Chain(unknowns, stage.inside, stage.meaning)
    gradient, hessian = chain.second(scale * stage.cost + ca.dot(duals, rows))
    identity = ca.DM.eye(stage.state.numel())
    beside = ca.DM(identity.size1(), stage.control.numel())
    jacobian = ca.vertcat(ca.horzcat(identity, beside), chain.jacobian(rows))
    return IntervalFunctions(
        cost=_function(chain, "cost", inputs, [stage.cost]),
        rows=_function(chain, "rows", inputs, [rows]),
        gradient=_function(chain, "gradient", inputs, [chain.jacobian(stage.cost).T]),
        jacobian=_function(chain, "jacobian", inputs, [rows, jacobian.nz[:]]),
        hessian=_function(chain, "hessian", [*inputs, scale, duals], [gradient, hessian.nz[:]]),
        points=_function(chain, "points", inputs, [ca.vec(stage.points)]),
        jacobian_pattern=_leading(_pattern(jacobian), stage),
        hessian_pattern=_pattern(hessian),
    )


def _function(chain: Chain, name: str, inputs: list[Any], outputs: list[Any]) -> Any:
    outputs = ca.cse([ca.densify(out) for out in chain.closed(outputs)])
    return ca.Function(f"interval_{name}", inputs, outputs)


def _leading(pattern: Pattern, stage: Stage) -> Pattern:
    row, column = pattern
    size = stage.state.numel()
    return np.where(row < size, row - stage.height, row - size), column


def _pattern(matrix: Any) -> Pattern:
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)
