"""The transcription of motion and response: Radau collocation of the augmented system.

Objective: what the response weighs (deg²), the effort, and the duration where that is free.
Everything that differs from one problem to another is a number, so that a programme is built once
for a system, a mesh size and a choice of constraints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.chained import chained_form
from planner.desensitise.augmented import Augmented
from planner.ocp.form import Form
from planner.ocp.obstacles import clearances

ROUND = 1e-6
"""Rounds off the square root of a variance that is zero, in its unit (deg, or that of z₂)."""

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Shape:
    """What distinguishes one programme from another, beside its augmented system.

    Attributes:
        form: Mesh size, scheme, input, and whether input rates and z₂ have limits.
        joints: Coordinates whose limits are kept with a back-off; empty without back-off.
        obstacles: Number of discs that the links clear.
    """

    form: Form
    joints: tuple[int, ...] = ()
    obstacles: int = 0


@dataclass(frozen=True, eq=False)
class Program:
    """A nonlinear programme.

    Unknowns (T, x₀, x at all points by interval, u); parameters by `Program.pack`.

    Attributes:
        made: The augmented system.
        shape: Its shape.
        problem: Expressions x, p, f, g for `casadi.nlpsol`.
        jacobian: Its option jac_g: function (x, p) to g and ∂g/∂x.
        rows: Function (x, p) to g.
        measures: Function (x, p) to (passive², terminal², path², effort).
        states: Positions of the states at the mesh's edges, shape (K+1, M).
        points: At the collocation points, shape (K, d, M).
        inputs: Of the inputs, shape (K or K+1, 2).
        size: Number of unknowns.
        kinds: For each row its kind: "motion", "rate i", "z2", "joint+ i", "joint- i",
            "obstacle disc.link", "effort"; shape (rows,).
    """

    made: Augmented
    shape: Shape
    problem: dict[str, Any]
    jacobian: Any
    rows: Any
    measures: Any
    states: Index
    points: Index
    inputs: Index
    size: int
    kinds: NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class _Numbers:
    """Parameters, as symbols of one interval (SX) or of the whole (MX)."""

    q0: Any
    sigma: Any
    gamma: Any
    sign: Any
    discs: Any

    def __iter__(self) -> Iterator[Any]:
        return iter((self.q0, self.sigma, self.gamma, self.sign, self.discs))


@lru_cache(maxsize=32)
def program(made: Augmented, shape: Shape) -> Program:
    """Build the programme, or return the one built before."""
    form, M, P = shape.form, made.size, len(made.names)
    N, K, d = made.system.size, form.intervals, form.degree
    T, x0, U = ca.MX.sym("T"), ca.MX.sym("x0", M), ca.MX.sym("U", 2, form.input_nodes)
    X = ca.MX.sym("X", M, K * d)
    q0, sigma, weights = ca.MX.sym("q0", N), ca.MX.sym("sigma", P), ca.MX.sym("weights", 5)
    gamma, sign, edges = ca.MX.sym("gamma"), ca.MX.sym("sign"), ca.MX.sym("edges", K + 1)
    discs = ca.MX.sym("discs", 3 * shape.obstacles)
    stage, kinds = _stage(made, shape)
    left = ca.horzcat(x0, X[:, d - 1 : K * d - 1 : d]) if K > 1 else x0
    right = U[:, 1:] if form.input == "linear" else U
    own = [left, ca.reshape(X, M * d, K), U[:, :K], right, edges[:-1].T, edges[1:].T]
    shared = [ca.repmat(s, 1, K) for s in (T, q0, sigma, gamma, sign, discs)]
    rows, effort, path = stage.map(K)(*own, *shared)
    used, spread = ca.sum2(effort), ca.sum2(path)
    W = made.response(X[:, -1], T, sigma, q0)
    passive, terminal = ca.sumsqr(W[2:, _passive(made)]), ca.sumsqr(W[1:, :])
    cost = ca.dot(weights, ca.vertcat(passive, terminal, spread, used, T))
    x = ca.vertcat(T, x0, ca.vec(X), ca.vec(U))
    p = ca.vertcat(q0, sigma, weights, gamma, sign, discs, edges)
    g = ca.vertcat(ca.vec(rows), used)
    at = 1 + M + np.arange(M * K * d).reshape(K, d, M)
    states = np.concatenate([1 + np.arange(M)[None], at[:, -1]])
    inputs = 1 + M * (1 + K * d) + np.arange(2 * form.input_nodes).reshape(-1, 2)
    whole = [np.zeros((K, 1), dtype=np.int64), states[:-1], at.reshape(K, -1), inputs[:K]]
    whole += [inputs[1:]] if form.input == "linear" else []
    touched = np.concatenate(whole, axis=1)
    jacobian = _jacobian(stage, [*own, *shared], touched, used, x)
    return Program(
        made=made,
        shape=shape,
        problem={"x": x, "p": p, "f": cost, "g": g},
        jacobian=ca.Function("nlp_jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        rows=ca.Function("rows", [x, p], [g]),
        measures=ca.Function("measures", [x, p], [ca.vertcat(passive, terminal, spread, used)]),
        states=states,
        points=at,
        inputs=inputs,
        size=x.numel(),
        kinds=np.array([*(kinds * K), "effort"]),
    )


def _jacobian(stage: Any, arguments: list[Any], touched: Index, used: Any, x: Any) -> Any:
    """∂g/∂x from one interval's rows: symbolic once, placed by index arithmetic.

    Differentiating the whole graph instead costs twenty times as much an evaluation.
    """
    K, count = touched.shape
    symbols = [ca.SX.sym(f"a{i}", stage.size1_in(i)) for i in range(stage.n_in())]
    left, points, u, v, begin, end, T, *rest = symbols
    unknowns = ca.vertcat(T, left, points, u, *([v] if _reads_right(count, symbols) else []))
    rows = stage(left, points, u, v if _reads_right(count, symbols) else u, begin, end, T, *rest)[0]
    block = ca.jacobian(rows, unknowns)
    values = ca.Function("rows_jac", symbols, [block.nz[:]]).map(K)(*arguments)
    row, column = (np.array(a, dtype=np.int64) for a in block.sparsity().get_triplet())
    height = rows.numel()
    at = (height * np.arange(K)[:, None] + row).ravel()
    to = touched[:, column].ravel()
    order = np.lexsort((at, to))
    pattern = ca.Sparsity.triplet(height * K, x.numel(), at[order].tolist(), to[order].tolist())
    return ca.vertcat(ca.MX(pattern, ca.vec(values)[order.tolist()]), ca.jacobian(used, x))


def _reads_right(count: int, symbols: list[Any]) -> bool:
    """Whether an interval touches the input at its right end too."""
    left, points, u, *_ = symbols
    return bool(count > 1 + left.numel() + points.numel() + u.numel())


def _passive(made: Augmented) -> list[int]:
    """Columns of the passive block: the start of q₂ and the gain of u₂."""
    system = made.system
    wanted = (f"start {system.coordinates[1].name}", f"gain {system.inputs[1].name}")
    return [p for p, name in enumerate(made.names) if name in wanted]


def _stage(made: Augmented, shape: Shape) -> tuple[Any, list[str]]:
    """Function of one interval to its rows, effort and share of the response along the path."""
    form, M, N = shape.form, made.size, made.system.size
    s, d = form.scheme, form.degree
    left, P = ca.SX.sym("left", M), ca.SX.sym("P", M, d)
    u = [ca.SX.sym("u", 2), ca.SX.sym("v", 2)]
    begin, end, T = ca.SX.sym("begin"), ca.SX.sym("end"), ca.SX.sym("T")
    n = _Numbers(
        ca.SX.sym("q0", N),
        ca.SX.sym("sigma", len(made.names)),
        ca.SX.sym("gamma"),
        ca.SX.sym("sign"),
        ca.SX.sym("discs", 3 * shape.obstacles),
    )
    width, linear = end - begin, form.input == "linear"
    values, rows, path = ca.horzcat(left, P), [], 0
    kinds: list[str] = []
    for j, tau in enumerate(s.points):
        time = T * (begin + width * tau)
        now = u[0] + float(tau) * (u[1] - u[0]) if linear else u[0]
        moved = made.rates(P[:, j], now, time, n.sigma, n.q0)
        rows.append(values @ s.differentiation[j] - T * width * moved)
        kinds += ["motion"] * M
        W = made.response(P[:, j], time, n.sigma, n.q0)
        path += width * s.quadrature[j] * ca.sumsqr(W[1:, :])
        for kind, row in _limits(made, shape, P[:, j], W, n):
            rows.append(row)
            kinds.append(kind)
    if form.rate_limits:
        rows.append((u[1] - u[0]) / (T * width))
        kinds += [f"rate {i}" for i in range(2)]
    square = (ca.sumsqr(u[0]) + ca.dot(*u) + ca.sumsqr(u[1])) / 3 if linear else ca.sumsqr(u[0])
    arguments = [left, ca.vec(P), *u, begin, end, T, *n]
    out = [ca.vertcat(*rows), T * width * square, path]
    return ca.Function("stage", arguments, out), kinds


def _limits(made: Augmented, shape: Shape, x: Any, W: Any, n: _Numbers) -> list[tuple[str, Any]]:
    """What has limits at a point, with the spread of γ standard deviations where it backs off."""
    q = ca.SX.sym("q", made.system.size)
    out = []
    if shape.form.chart:
        z2 = chained_form(made.system).z_expr(q)[1]
        pair = ca.Function("z2", [q], [z2, ca.jacobian(z2, q)])
        value, slope = pair(x[: made.system.size])
        room = n.gamma * ca.sqrt(ca.sumsqr(slope @ W * (np.pi / 180)) + ROUND**2)
        out.append(("z2", n.sign * value - room))
    for i in shape.joints:
        room = n.gamma * (np.pi / 180) * ca.sqrt(ca.sumsqr(W[i, :]) + ROUND**2)
        out += [(f"joint+ {i}", x[i] + room), (f"joint- {i}", x[i] - room)]
    for k in range(shape.obstacles):
        clear = clearances(made.system, x, n.discs[3 * k : 3 * k + 3])
        out += [(f"obstacle {k}.{link}", room) for link, room in enumerate(clear, 1)]
    return out
