"""Motion and response as one system, against the sensitivities of `planner.sensitivity`."""

from dataclasses import replace

import numpy as np
import pytest
from every_system import SYSTEMS
from numpy.typing import NDArray
from scipy.interpolate import BPoly

import planner
from planner.methods.collocation.transcription.augmented import Augmented
from planner.robustness.sensitivity import PAPER_SPREAD
from planner.systems.linearisation import parameters


def spread(names: tuple[str, ...]) -> tuple[tuple[str, float], ...]:
    return tuple(zip(names, np.linspace(0.5, 1.5, len(names)).tolist(), strict=True))


@pytest.mark.parametrize("n", range(2, 7))
def test_states_grow_as_half_the_square_of_the_joints(n: int) -> None:
    """The paper's three joints need eight beside their own, and one more for the effort."""
    system = SYSTEMS[f"manipulator-{n}"]
    errors = ("gain u1", "gain u2", *(f"start theta{i}" for i in range(1, n + 1)))
    made = Augmented(system, spread(errors))
    assert made.size - system.size == n * (n - 1) // 2 + 2 * (n - 1) + 1
    assert Augmented(system, made.spread, metered=True).size == made.size + 1


def _responses(system: planner.TriangularSystem) -> tuple[NDArray[np.float64], planner.Plan]:
    """W at the end of a smooth motion by small steps of the augmented system, and the motion."""
    import casadi as ca

    made = Augmented(system, spread(tuple(p.name for p in parameters(system))))
    q0 = np.full(system.size, 0.2)
    x, u, h = (ca.SX.sym(n, k) for n, k in (("x", made.size), ("u", 2), ("h", 1)))
    rate = lambda x: ca.vertcat(*made.rates_expr(x, u))  # noqa: E731
    a = rate(x)
    b = rate(x + h / 2 * a)
    c = rate(x + h / 2 * b)
    d = rate(x + h * c)
    step = ca.Function("step", [x, u, h], [x + h / 6 * (a + 2 * b + 2 * c + d)])
    pieces = np.array([[0.5, 0.3], [-0.2, 0.4], [0.6, -0.5]])
    edges, state = np.linspace(0, 1.5, 301), np.append(q0, np.zeros(made.size - system.size))
    states = [state]
    for k, width in enumerate(np.diff(edges)):
        state = np.asarray(step(state, pieces[k // 100], width)).ravel()
        states.append(state)
    W = made.response(state) / np.linspace(0.5, 1.5, len(made.spread))
    nodes = np.array(states)[:, : system.size]
    inputs = np.repeat(pieces, 100, axis=0)
    rates = system.rates(nodes[:-1], inputs), system.rates(nodes[1:], inputs)
    w = np.diff(edges)[:, None]
    bernstein = np.stack(
        [nodes[:-1], nodes[:-1] + w / 3 * rates[0], nodes[1:] - w / 3 * rates[1], nodes[1:]]
    )
    curve = planner.plan.trajectory.StateTrajectory(
        system, BPoly(bernstein, edges), BPoly(inputs[None].copy(), edges)
    )
    problem = planner.load_problem("problems/paper.toml")
    fitted = replace(
        problem, system=system, start=q0, user_goal=system.user(nodes[-1]), duration=1.5
    )
    return W, planner.Plan(fitted, "by hand", {}, curve)


@pytest.mark.parametrize(
    "name", ["manipulator-2", "manipulator-4", "ball-gear-3", "car", "trailers-2", "unicycle"]
)
def test_response_is_the_sensitivity(name: str) -> None:
    W, plan = _responses(SYSTEMS[name])
    found = planner.sensitivity(plan, samples=3000)
    # the path coordinate's row is kept only where something depends on it
    rows = slice(1, None)
    np.testing.assert_allclose(W[rows], found.terminal[rows], atol=1e-6)


def test_programme_measures_what_sensitivity_measures(paper: planner.Problem) -> None:
    plan = planner.solve(paper, "desensitised", starts=1, effort=1.0)
    found = planner.sensitivity(plan)
    assert plan.notes["passive_deg"] == pytest.approx(found.passive_block_deg(), abs=1e-5)
    assert plan.notes["total_deg"] == pytest.approx(found.total_deg(PAPER_SPREAD), abs=1e-5)
