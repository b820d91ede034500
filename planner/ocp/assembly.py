"""The whole problem from one interval: CasADi functions with exact sparse derivatives.

The derivatives of one interval are formed symbolically once and mapped over all intervals; the
sparse patterns of the whole follow by index arithmetic. Building takes milliseconds and does not
grow with the mesh, where differentiating the whole graph takes tenths of seconds and does.

Jacobian pattern (Radau, one block row an interval; t: column of T, n: state at the left edge,
u: input, p: collocation points, the last of which is the next left edge):

    t n u p
    t . . n u p
    t . . . . . n u p
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from planner.ocp.layout import Index, Layout
from planner.ocp.stage import Stage
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Program:
    """A nonlinear programme for `casadi.nlpsol`.

    Attributes:
        problem: The expressions x, p, f, g; p = (three weights, K widths).
        derivatives: nlpsol's options grad_f, jac_g and hess_lag.
        rows: Function (x, p) to g, for judging an iterate.
        cost: Function (x, p) to f.
    """

    problem: dict[str, Any]
    derivatives: dict[str, Any]
    rows: Any
    cost: Any


@dataclass(frozen=True, eq=False)
class _Mapped:
    """Symbols of the whole, cut into one column an interval."""

    w: Any
    p: Any
    unknowns: Any
    widths: Any
    weights: Any
    count: int

    @property
    def args(self) -> tuple[Any, Any, Any]:
        return self.unknowns, self.widths, self.weights


def assemble(stage: Stage, layout: Layout) -> Program:
    """Repeat one interval over the mesh."""
    x = _columns(stage, layout)
    inputs = [stage.unknowns, stage.width, stage.weights]
    values = ca.Function("stage", inputs, [stage.cost, stage.rows]).map(x.count)
    costs, rows = values(*x.args)
    f, g = ca.sum2(costs), ca.vec(rows)
    names = ["x", "p"]
    derivatives = {
        "grad_f": ca.Function(
            "nlp_grad_f", [x.w, x.p], [f, _gradient(stage, layout, x)], names, ["f", "grad_f_x"]
        ),
        "jac_g": ca.Function(
            "nlp_jac_g", [x.w, x.p], [g, _jacobian(stage, layout, x)], names, ["g", "jac_g_x"]
        ),
        "hess_lag": _hessian(stage, layout, x),
    }
    return Program(
        problem={"x": x.w, "p": x.p, "f": f, "g": g},
        derivatives=derivatives,
        rows=ca.Function("rows", [x.w, x.p], [g]),
        cost=ca.Function("cost", [x.w, x.p], [f]),
    )


def _columns(stage: Stage, layout: Layout) -> _Mapped:
    count, m = layout.stages.shape
    w, p = ca.MX.sym("w", layout.size), ca.MX.sym("p", 3 + count)
    unknowns = ca.reshape(w[layout.stages.ravel().tolist()], m, count)
    return _Mapped(w, p, unknowns, p[3:].T, ca.repmat(p[:3], 1, count), count)


def _gradient(stage: Stage, layout: Layout, x: _Mapped) -> Any:
    gradient = ca.densify(ca.gradient(stage.cost, stage.unknowns))
    inputs = [stage.unknowns, stage.width, stage.weights]
    columns = ca.Function("stage_grad", inputs, [gradient]).map(x.count)(*x.args)
    return _scatter(layout.stages.ravel(), layout.size) @ ca.vec(columns)


def _jacobian(stage: Stage, layout: Layout, x: _Mapped) -> Any:
    jacobian = ca.jacobian(stage.rows, stage.unknowns)
    inputs = [stage.unknowns, stage.width, stage.weights]
    columns = ca.Function("stage_jac", inputs, [jacobian.nz[:]]).map(x.count)(*x.args)
    row, column = _pattern(jacobian)
    height = stage.rows.numel()
    rows = (height * np.arange(x.count)[:, None] + row).ravel()
    cols = layout.stages[:, column].ravel()
    order = np.lexsort((rows, cols))
    pattern = ca.Sparsity.triplet(
        height * x.count, layout.size, rows[order].tolist(), cols[order].tolist()
    )
    return ca.MX(pattern, ca.vec(columns)[order.tolist()])


def _hessian(stage: Stage, layout: Layout, x: _Mapped) -> Any:
    height = stage.rows.numel()
    scale, dual = ca.SX.sym("scale"), ca.SX.sym("dual", height)
    lagrangian = scale * stage.cost + ca.dot(dual, stage.rows)
    hessian: Any = ca.triu(ca.hessian(lagrangian, stage.unknowns)[0])
    inputs = [stage.unknowns, stage.width, stage.weights, scale, dual]
    mapped = ca.Function("stage_hess", inputs, [hessian.nz[:]]).map(x.count)
    whole_scale, whole_dual = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", height * x.count)
    duals = ca.reshape(whole_dual, height, x.count)
    columns = mapped(*x.args, ca.repmat(whole_scale, 1, x.count), duals)
    row, column = _pattern(hessian)
    rows, cols = layout.stages[:, row].ravel(), layout.stages[:, column].ravel()
    key = np.maximum(rows, cols) * layout.size + np.minimum(rows, cols)
    distinct, where = np.unique(key, return_inverse=True)
    pattern = ca.Sparsity.triplet(
        layout.size,
        layout.size,
        (distinct % layout.size).tolist(),
        (distinct // layout.size).tolist(),
    )
    nonzeros = _scatter(where, len(distinct)) @ ca.vec(columns)
    return ca.Function(
        "nlp_hess_l",
        [x.w, x.p, whole_scale, whole_dual],
        [ca.MX(pattern, nonzeros)],
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )


def _pattern(matrix: Any) -> tuple[Array, Array]:
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)


def _scatter(where: Index, size: int) -> Any:
    """Sparse 0/1 matrix (size, len(where)) that adds entry k to place where[k]."""
    count = len(where)
    matrix = sp.csc_matrix((np.ones(count), (where, np.arange(count))), shape=(size, count))
    pattern = ca.Sparsity(size, count, matrix.indptr.tolist(), matrix.indices.tolist())
    return ca.DM(pattern, matrix.data)
