"""Paired differences of machine parameters, against exact derivatives and against replays."""

import numpy as np
import pytest

import planner
from planner import MachineSensitivity, machine_sensitivity, sensitivity
from planner.problem.tables.machine_effects import EFFECTS


@pytest.fixture(scope="module")
def plan(paper: planner.Problem) -> planner.Plan:
    return planner.solve(paper, "collocation")


@pytest.fixture(scope="module")
def ideal(plan: planner.Plan) -> MachineSensitivity:
    return machine_sensitivity(plan, planner.Machine.ideal())


@pytest.fixture(scope="module")
def machine() -> planner.Machine:
    return planner.Machine.prototype(backlash_deg={"value": 4.0, "spread": 0.8})


@pytest.fixture(scope="module")
def found(plan: planner.Plan, machine: planner.Machine) -> MachineSensitivity:
    return machine_sensitivity(plan, machine)


@pytest.mark.parametrize(
    ("effect", "element", "parameter", "unit"),
    [
        ("input_gain_error", "u1", "gain u1", 180 / np.pi),
        ("input_gain_error", "u2", "gain u2", 180 / np.pi),
        ("input_bias_rad_s", "u2", "bias u2", 180 / np.pi),
        ("gear_ratio_error", "theta2", "K2", 180 / np.pi),
        ("gear_ratio_error", "theta3", "K3", 180 / np.pi),
        ("initial_angle_error_deg", "theta1", "start theta1", 1.0),
        ("initial_angle_error_deg", "theta2", "start theta2", 1.0),
    ],
)
def test_smooth_parameters_agree_with_the_exact_derivatives(
    plan: planner.Plan,
    ideal: MachineSensitivity,
    effect: str,
    element: str,
    parameter: str,
    unit: float,
) -> None:
    exact = sensitivity(plan)
    column = exact.terminal[1:, exact.parameters.index(parameter)] * unit
    entry = next(e for e in ideal.entries if (e.effect, e.element) == (effect, element))
    np.testing.assert_allclose(entry.terminal, column, atol=2e-3 * np.max(np.abs(column)))


def test_prototype_matches_replays_of_two_machines(
    plan: planner.Plan, machine: planner.Machine, found: MachineSensitivity
) -> None:
    entry = next(e for e in found.entries if e.name == "backlash_deg theta3")
    assert (entry.low, entry.high, entry.spread) == (pytest.approx(3.2), pytest.approx(4.8), 0.8)
    ends = []
    for value in (entry.high, entry.low):
        changed = machine.nominal().with_(backlash_deg=[4.0, value])
        ends.append(planner.replay(plan, changed, record_s=None).terminal_error_deg[0])
    np.testing.assert_allclose(entry.terminal, (ends[0] - ends[1]) / 1.6, atol=1e-6)
    nominal = planner.replay(plan, machine.nominal(), record_s=None).terminal_error_deg[0]
    np.testing.assert_allclose(found.nominal_error_deg, nominal, atol=1e-6)


def test_every_parameter_of_the_machine_is_there(
    machine: planner.Machine, found: MachineSensitivity
) -> None:
    told = {e.effect for e in found.entries} | set(found.omitted)
    assert told == set(EFFECTS)
    assert not set(found.omitted) & set(machine.effects)
    assert found.matrix.shape == (3, len(found.entries))
    assert all(e.high > e.low for e in found.entries)
    period = next(e for e in found.entries if e.effect == "control_period_s")
    assert not period.has_no_effect


def test_total_predicts_the_spread_of_replays_of_smooth_errors(plan: planner.Plan) -> None:
    machine = planner.Machine.prototype(step_s=0.01).only(
        "input_gain_error", "input_bias_rad_s", "gear_ratio_error", "initial_angle_error_deg"
    )
    found = machine_sensitivity(plan, machine)
    run = planner.replay(plan, machine, samples=1000, record_s=None)
    seen = np.sqrt(np.sum(np.var(run.terminal_error_deg, axis=0)))
    assert found.total_deg == pytest.approx(seen, rel=0.05)
