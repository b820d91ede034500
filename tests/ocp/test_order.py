"""Order of convergence against an analytic solution, and defects by a second code path."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from planner.ocp.form import Form
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh, uniform
from planner.ocp.scheme import Kind
from planner.ocp.transcription import transcription
from planner.systems import Manipulator

START = np.array([0.1, -0.9, 0.2])
INPUT = np.array([0.8, 1.7])
DURATION = 1.0


def analytic(t: float) -> np.ndarray[Any, Any]:
    """Two joints, constant inputs: θ̇₂ = k₂ cos³(θ₁(0) + u₂t) u₁ integrates to sin − sin³/3."""
    system = Manipulator([0.9], 0.7)
    u1, u2 = INPUT
    theta1 = START[1] + u2 * t
    swept = [np.sin(a) - np.sin(a) ** 3 / 3 for a in (START[1], theta1)]
    theta2 = START[2] + system.k_g * system.K[0] * u1 * (swept[1] - swept[0]) / u2
    return np.array([START[0] + system.k_g * u1 * t, theta1, theta2])


def integrated(kind: Kind, degree: int, intervals: int) -> np.ndarray[Any, Any]:
    """The end state of the transcription with all inputs given: its rows solved by Newton."""
    made = transcription(Manipulator([0.9], 0.7), Form(intervals, kind, degree))
    mesh = uniform(intervals)
    parameters = np.concatenate([[0, 1, 1], mesh.widths])
    guess = Iterate(
        DURATION,
        np.tile(START, (intervals + 1, 1)),
        np.tile(START, (intervals, degree, 1)),
        np.tile(INPUT, (intervals, 1)),
    )
    w = made.layout.pack(guess)
    known = np.concatenate([[0], made.layout.nodes[0], made.layout.inputs.ravel()])
    free = np.setdiff1d(np.arange(made.layout.size), known)
    for _ in range(12):
        rows, jacobian = made.program.derivatives["jac_g"](w, parameters)
        step = spsolve(jacobian.sparse()[:, free].tocsc(), -np.asarray(rows).ravel())
        w[free] += step
    assert np.max(np.abs(step)) < 1e-11
    return made.layout.unpack(w).nodes[-1]


@pytest.mark.parametrize(
    ("kind", "degree", "order"),
    [("radau", d, 2 * d - 1) for d in (1, 2, 3)] + [("legendre", d, 2 * d) for d in (1, 2, 3)],
)
def test_order_of_convergence_at_the_end_point(kind: Kind, degree: int, order: int) -> None:
    meshes = {1: (64, 128), 2: (16, 32), 3: (8, 16)}[degree]
    errors = [np.abs(integrated(kind, degree, k) - analytic(DURATION))[2] for k in meshes]
    slope = np.log2(errors[0] / errors[1])
    assert errors[1] > 1e-13  # above rounding, so that the slope means something
    assert slope == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize("input_kind", ["constant", "linear"])
@pytest.mark.parametrize("kind", ["radau", "legendre"])
def test_rows_agree_with_numpy(kind: Kind, input_kind: Any) -> None:
    system = Manipulator([0.87, 0.71, 0.58], 0.67)
    form = Form(5, kind, 3, input_kind, rate_limits=input_kind == "linear")
    made, rng = transcription(system, form), np.random.default_rng(3)
    mesh = Mesh(np.array([0.0, 0.1, 0.35, 0.6, 0.8, 1.0]))
    iterate = made.layout.unpack(rng.normal(size=made.layout.size))
    iterate = Iterate(3.7, iterate.nodes, iterate.points, iterate.inputs)
    w, p = made.layout.pack(iterate), np.concatenate([rng.random(3), mesh.widths])
    rows = np.asarray(made.program.rows(w, p)).reshape(5, made.height)
    left, right = iterate.input_ends()
    s = form.scheme
    values = np.concatenate([iterate.nodes[:-1, None], iterate.points], axis=1)
    u = left[:, None] + s.points[:, None] * (right - left)[:, None]
    slope = np.einsum("ij,kjn->kin", s.differentiation, values)
    defects = slope - 3.7 * mesh.widths[:, None, None] * system.rates(iterate.points, u)
    gap = np.einsum("j,kjn->kn", s.end, values) - iterate.nodes[1:]
    rates = (right - left) / (3.7 * mesh.widths[:, None])
    expected = {"dynamics": defects, "continuity": gap[:, None], "rate": rates[:, None]}
    kinds = set()
    for label in made.labels:
        wanted = expected[label.kind][:, :, label.index]
        np.testing.assert_allclose(rows[:, label.positions], wanted, atol=1e-12)
        kinds.add(label.kind)
    assert kinds >= {"dynamics"} | ({"rate"} if input_kind == "linear" else set())
    squares = (left**2 + left * right + right**2) / 3
    cost = 3.7 * (p[0] + mesh.widths @ (squares @ p[1:3]))
    assert float(made.program.cost(w, p)) == pytest.approx(cost, rel=1e-12)


@pytest.mark.parametrize("kind", ["radau", "legendre"])
def test_derivatives_agree_with_casadi_on_the_whole_graph(kind: Kind) -> None:
    system = Manipulator([0.87, 0.71], 0.67)
    made = transcription(system, Form(3, kind, 2, "linear", rate_limits=True, chart=True))
    x, p = made.program.problem["x"], made.program.problem["p"]
    f, g = made.program.problem["f"], made.program.problem["g"]
    duals = ca.MX.sym("duals", g.numel())
    hessian = ca.hessian(1.3 * f + ca.dot(duals, g), x)[0]
    reference = ca.Function(
        "reference", [x, p, duals], [ca.gradient(f, x), ca.jacobian(g, x), ca.triu(hessian)]
    )
    rng = np.random.default_rng(0)
    w, v, lam = rng.random(x.numel()) + 0.5, rng.random(p.numel()), rng.random(g.numel())
    gradient, jacobian, triangle = (np.asarray(ca.densify(m)) for m in reference(w, v, lam))
    ours = made.program.derivatives
    np.testing.assert_allclose(np.asarray(ours["grad_f"](w, v)[1]), gradient, atol=1e-11)
    np.testing.assert_allclose(ca.densify(ours["jac_g"](w, v)[1]), jacobian, atol=1e-11)
    np.testing.assert_allclose(ca.densify(ours["hess_lag"](w, v, 1.3, lam)), triangle, atol=1e-10)
