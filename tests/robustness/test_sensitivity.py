"""First-order sensitivities against re-integration of the perturbed machine."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from perturbed import draws, motions
from scipy.integrate import solve_ivp

import planner
from planner import sensitivity

STEP = 1e-4


@pytest.fixture(scope="module")
def plan(unlimited: planner.Problem) -> planner.Plan:
    return planner.solve(unlimited.changed({"goal.travel": 0.825}), "polynomial")


def _perturbed(plan: planner.Plan, name: str, size: float) -> np.ndarray:
    """End of the motion with one parameter changed, by the NumPy kinematics and DOP853."""
    system = plan.problem.system
    word, _, which = name.partition(" ")
    gain, bias, delay, q0 = np.ones(2), np.zeros(2), np.zeros(2), plan.problem.start.copy()
    clock = np.ones(2)
    index = {"u1": 0, "u2": 1}.get(which, 0)
    names = [c.name for c in system.coordinates]
    match word:
        case "gain":
            gain[index] += size
        case "bias":
            bias[index] = size
        case "delay":
            delay[index] = size
        case "stretch":
            clock[index] += size
        case "start":
            q0[names.index(which)] += size
        case _:
            K = system.K.copy()
            K[int(word[1:]) - 2] *= 1 + size
            system = planner.Manipulator(K, system.k_g)

    def rates(t: float, q: np.ndarray) -> np.ndarray:
        u = np.array([plan.trajectory.u((t - delay[i]) / clock[i])[i] / clock[i] for i in range(2)])
        return system.rates(q, u * gain + bias * (t <= plan.duration))

    end = plan.duration + (0.1 if word in ("delay", "stretch") else 0.0)
    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 0.5}
    motion = solve_ivp(rates, (0, plan.duration), q0, "DOP853", **options)
    q = motion.y[:, -1]
    if end > plan.duration:
        q = solve_ivp(rates, (plan.duration, end), q, "DOP853", **options).y[:, -1]
    return q


NAMES = ["gain u1", "gain u2", "bias u2", "start theta1", "start theta2", "start phi2", "K2", "K3"]


@pytest.mark.parametrize("name", NAMES)
def test_terminal_column_matches_a_difference(plan: planner.Plan, name: str) -> None:
    found = sensitivity(plan)
    column = found.terminal[:, found.parameters.index(name)]
    up, down = _perturbed(plan, name, STEP), _perturbed(plan, name, -STEP)
    np.testing.assert_allclose(column, (up - down) / (2 * STEP), atol=2e-5)


def test_delay_column_matches_a_difference(plan: planner.Plan) -> None:
    found = sensitivity(plan)
    late = _perturbed(plan, "delay u2", 1e-3) - _perturbed(plan, "delay u2", 0.0)
    column = found.terminal[:, found.parameters.index("delay u2")]
    np.testing.assert_allclose(column, late / 1e-3, atol=1e-4)


@pytest.mark.parametrize("which", ["u1", "u2"])
def test_stretch_column_matches_a_difference(plan: planner.Plan, which: str) -> None:
    found = sensitivity(plan)
    up, down = (_perturbed(plan, f"stretch {which}", size) for size in (2e-4, -2e-4))
    column = found.terminal[:, found.parameters.index(f"stretch {which}")]
    np.testing.assert_allclose(column, (up - down) / 4e-4, atol=2e-3 * np.max(np.abs(column)))


@pytest.mark.parametrize("word", ["delay", "stretch"])
def test_both_inputs_late_together_change_nothing(plan: planner.Plan, word: str) -> None:
    found = sensitivity(plan)
    both = sum(found.terminal[:, found.parameters.index(f"{word} u{i}")] for i in (1, 2))
    np.testing.assert_allclose(both, 0, atol=1e-12)


def test_nonlinear_monte_carlo_agrees_along_the_path(paper: planner.Problem) -> None:
    """Hundreds of perturbed motions by another integrator, against S(t) at every tenth."""
    plan = planner.solve(paper, "collocation")
    found = sensitivity(plan)
    spread = {"gain u1": 0.01, "gain u2": 0.01, "bias u1": 0.002, "bias u2": 0.002, "K2": 0.01,
              "K3": 0.01, **{f"start theta{i}": np.deg2rad(0.5) for i in (1, 2, 3)}}  # fmt: skip
    t = np.linspace(0, plan.duration, 11)
    seen = np.std(motions(plan, draws(spread, 600), t) - plan.q(t), axis=0)
    sigma = np.array([spread.get(name, 0.0) for name in found.parameters])
    at = [int(np.argmin(np.abs(found.t - time))) for time in t]
    told = np.sqrt(np.sum((found.along[at] * sigma) ** 2, axis=-1))
    np.testing.assert_allclose(seen[:, 1:], told[:, 1:], rtol=0.12)


def test_the_floor_is_the_same_for_every_plan(unlimited: planner.Problem) -> None:
    plans = [
        planner.solve(unlimited.changed({"goal.travel": travel}), "polynomial")
        for travel in (0.80, 0.825)
    ]
    one, two = (sensitivity(p) for p in plans)
    mask = one.floor
    np.testing.assert_allclose(one.terminal[mask], two.terminal[mask], atol=1e-6)
    others = ~mask & (np.abs(one.terminal) > 1e-6) & (np.arange(4) > 0)[:, None]
    assert np.median(np.abs(one.terminal - two.terminal)[others]) > 1e-3


def test_floor_of_the_paper_example(plan: planner.Plan) -> None:
    found = sensitivity(plan)
    own = 3 * 0.5**2 + 2 * 0.29**2  # three starts, the gain of u2 on theta1, of u1 on theta2
    assert found.floor_deg() == pytest.approx(np.sqrt(own), rel=1e-6)
    assert found.floor_deg() < found.total_deg()
    assert found.passive_block_deg() < found.total_deg()


def test_along_starts_at_identity_and_ends_at_terminal(plan: planner.Plan) -> None:
    found = sensitivity(plan)
    start = found.parameters.index("start phi2")
    np.testing.assert_array_equal(found.along[0][:, start : start + 4], np.eye(4))
    np.testing.assert_array_equal(found.along[-1], found.terminal)
    assert found.entry("theta1", "start theta1") == pytest.approx(1.0)


def test_unknown_names_are_listed(plan: planner.Plan) -> None:
    with pytest.raises(planner.InputError, match=r"'gain u3'.*gain u1"):
        sensitivity(plan).entry("theta1", "gain u3")


@pytest.mark.parametrize(
    "ask",
    [planner.sensitivity, planner.machine_sensitivity, planner.error_budget],
)
def test_a_path_outside_the_chart_is_refused(
    unlimited: planner.Problem, ask: Callable[[planner.Plan], Any]
) -> None:
    problem = unlimited.changed({"goal.travel": float(np.pi / 4)})
    plan = planner.solve(problem, "polynomial", allow_singular=True)
    with pytest.raises(planner.InputError, match="no real inputs"):
        ask(plan)
