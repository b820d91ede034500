"""Order of convergence against an analytic solution, and defects by a second code path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import planner
from planner import Manipulator, chained_form
from planner.methods.collocation.transcription.augmented import Augmented
from planner.methods.collocation.transcription.form import Form, Kind, Mesh, uniform
from planner.methods.collocation.transcription.transcription import transcription
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.measures import INTEGRALS
from planner.problem.requirements.motion_limits import JointLimit, Z2Margin
from planner.systems.linearisation import parameters

PROBLEMS = Path(__file__).parents[3] / "problems"
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
    parameters = np.concatenate([np.eye(INTEGRALS)[1], mesh.widths])
    guess = Iterate(
        DURATION,
        np.tile(START, (intervals + 1, 1)),
        np.tile(START, (intervals, degree, 1)),
        np.tile(INPUT, (intervals, 1)),
    )
    w = made.layout.pack(guess, mesh.widths)
    known = [made.layout.nodes[0], made.layout.durations[:1], made.layout.inputs.ravel()]
    free = np.setdiff1d(np.arange(made.layout.size), np.concatenate(known))
    for _ in range(12):
        rows, jacobian = made.program.jacobian(w, parameters)
        step = spsolve(jacobian.sparse()[:, free].tocsc(), -np.asarray(rows).ravel())
        w[free] += step
    assert np.max(np.abs(step)) < 1e-11
    return made.outcome(w, parameters)[2].nodes[-1]


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
@pytest.mark.parametrize("name", ["four-joint", "trailers"])
def test_rows_agree_with_numpy(name: str, kind: Kind, input_kind: Any) -> None:
    """The manipulator's collocation values follow from the rest, the trailers' are unknowns."""
    system = planner.load_problem(PROBLEMS / f"{name}.toml").system
    form = Form(5, kind, 3, input_kind, kept=(Z2Margin(0.0, 1),))
    made, rng = transcription(system, form), np.random.default_rng(3)
    mesh = Mesh(np.array([0.0, 0.1, 0.35, 0.6, 0.8, 1.0]))
    p = np.concatenate([rng.random(3), np.zeros(INTEGRALS - 3), mesh.widths])
    w = made.layout.pack(some_iterate(form, system.size, rng), mesh.widths)
    objective, rows, iterate = made.outcome(w, p)
    np.testing.assert_allclose(made.layout.pack(iterate, mesh.widths), w, atol=1e-14)
    rows = rows.reshape(5, made.height)
    left, right = iterate.input_ends()
    s = form.scheme
    u = left[:, None] + s.points[:, None] * (right - left)[:, None]
    rates = 3.7 * mesh.widths[:, None, None] * system.rates(iterate.points, u)
    gap = iterate.nodes[1:] - iterate.nodes[:-1] - np.einsum("j,kjn->kn", s.quadrature, rates)
    moves = np.einsum("ij,kjn->kin", s.integration, rates)
    defects = iterate.points - iterate.nodes[:-1, None] - moves
    solved = [i for i in range(system.size) if i not in made.layout.lifted]
    assert len(solved) == {"four-joint": 5, "trailers": 4}[name]
    np.testing.assert_allclose(defects[..., solved], 0, atol=1e-12)
    seen = set()
    for label in made.labels:
        found = rows[:, label.positions]
        if label.kind == "motion":
            np.testing.assert_allclose(found, gap[:, label.index, None], atol=1e-12)
        elif label.kind == "defect":
            np.testing.assert_allclose(found, defects[..., label.index], atol=1e-12)
        elif label.kind == "kept":
            z2 = chained_form(system).z(iterate.nodes[:-1])[:, 1, None]
            np.testing.assert_allclose(found, z2, rtol=1e-12)
        else:  # duration and corners of the input are copied on, which `pack` has obeyed
            np.testing.assert_allclose(found, 0, atol=1e-12)
        seen.add(label.kind)
    assert seen == {"motion", "carried", "kept"} | ({"defect"} if name == "trailers" else set())
    squares = (left**2 + left * right + right**2) / 3
    cost = 3.7 * (p[0] + mesh.widths @ (squares @ p[1:3]))
    assert objective == pytest.approx(cost, rel=1e-12)


def some_iterate(form: Form, size: int, rng: np.random.Generator) -> Iterate:
    K, d = form.intervals, form.degree
    nodes, points = rng.normal(size=(K + 1, size)), rng.normal(size=(K, d, size))
    inputs = rng.normal(size=(K + (form.input == "linear"), 2))
    return Iterate(3.7, 0.3 * nodes, 0.3 * points, inputs)


RESPONSE: dict[str, Any] = {"passive": 2.0, "terminal": 1.0, "path": 0.5, "backoff": 2.0}
"""What makes every term and row of a transcription of motion and response."""


@pytest.mark.parametrize("input_kind", ["constant", "linear"])
@pytest.mark.parametrize(
    "name", [pytest.param("four-joint", marks=pytest.mark.campaign), "trailers"]
)
@pytest.mark.parametrize("errors", [(), ("gain u1", "stretch u2", "start theta1")])
def test_derivatives_agree_with_casadi_on_the_whole_graph(
    name: str, input_kind: Any, errors: tuple[str, ...]
) -> None:
    system = planner.load_problem(PROBLEMS / f"{name}.toml").system
    known = [e for e in errors if e in {p.name for p in parameters(system)}]
    spread = tuple((error, 0.1 * k) for k, error in enumerate(known, 1))
    more = Augmented(system, spread, **RESPONSE, metered=True) if spread else None
    joints = JointLimit(system.coordinates, (1.0,) * system.size, ("",) * system.size)
    limits = joints, Z2Margin(0.0, 1)
    form = Form(3, "radau", 2, input_kind, inner=True, kept=limits, augmented=more)
    program = transcription(system, form).program
    x, p = program.problem["x"], program.problem["p"]
    f, g = program.problem["f"], program.problem["g"]
    duals = ca.MX.sym("duals", g.numel())
    hessian, slope = ca.hessian(1.3 * f + ca.dot(duals, g), x)
    reference = ca.Function(
        "reference", [x, p, duals], [ca.gradient(f, x), ca.jacobian(g, x), slope, hessian]
    )
    rng = np.random.default_rng(0)
    w, v, lam = rng.random(x.numel()) + 0.1, rng.random(p.numel()), rng.random(g.numel())
    gradient, jacobian, slope, hessian = (dense(m) for m in reference(w, v, lam))
    ours = program.gradient_and_hessian(w, v, 1.3, lam)
    close = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(dense(program.gradient(w, v)), gradient, **close)
    np.testing.assert_allclose(dense(program.value_gradient(w, v)[1]), gradient, **close)
    np.testing.assert_allclose(dense(program.jacobian(w, v)[1]), jacobian, **close)
    np.testing.assert_allclose(dense(ours[0]), slope, **close)
    np.testing.assert_allclose(dense(ours[1]), hessian, **close)
    np.testing.assert_allclose(dense(program.triangle(w, v, 1.3, lam)), np.triu(hessian), **close)


def dense(matrix: Any) -> np.ndarray[Any, Any]:
    return np.asarray(ca.densify(matrix))
