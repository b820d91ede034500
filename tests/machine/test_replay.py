"""Replay of plans that the methods make, and its refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import planner
from planner import InputError, Machine, Plan, SingularError, replay
from planner.explorer.screen import error_panel
from planner.report.page.words import verdict_html

PROTOTYPE = Machine.prototype(step_s=0.005)
"""Coarse steps, where the test is not about them."""


def polynomial(problem: planner.Problem, travel: float) -> Plan:
    return planner.solve(problem.changed({"goal.travel": travel}), "polynomial")


@pytest.fixture(scope="module")
def calm(unlimited: planner.Problem) -> Plan:
    """The polynomial close to its best travel: first command 2.9 rad/s."""
    return polynomial(unlimited, 0.828)


@pytest.mark.parametrize(("travel", "first"), [(0.80, 141), (0.82, 40), (0.828, 2.9)])
def test_ideal_replay_ends_where_the_plan_does(
    unlimited: planner.Problem, travel: float, first: float
) -> None:
    plan = polynomial(unlimited, travel)
    assert plan.u(0.0)[1] == pytest.approx(first, rel=0.1)
    run = replay(plan, Machine.ideal(), record_s=None)
    assert np.max(np.abs(run.terminal_error)) < 1e-6
    assert np.max(run.deviation) < 1e-6
    assert run.index_E_deg[0] < 1e-4
    if travel == 0.828:  # and it does not hang on the step
        for step in (1e-2, 2e-3):
            run = replay(plan, Machine.ideal(step_s=step), record_s=None)
            assert np.max(np.abs(run.terminal_error)) < 1e-8


def test_a_spike_meets_the_velocity_limit_and_the_error_shows_it(
    unlimited: planner.Problem, calm: Plan
) -> None:
    spiked = polynomial(unlimited, 0.80)
    worse = replay(spiked, PROTOTYPE, samples=20, record_s=None)
    better = replay(calm, PROTOTYPE, samples=20, record_s=None)
    assert np.all(worse.saturated_s[:, 1] > 0.01)
    assert np.all(worse.index_E_deg > 2 * better.index_E_deg)


def test_the_problem_names_the_machine(calm: Plan) -> None:
    coarse = replace(calm, problem=calm.problem.changed({"machine": {"step_s": 0.005}}))
    assert replay(coarse, record_s=None).machine == PROTOTYPE
    table = {"preset": "ideal", "step_s": 0.01}
    ideal = replace(calm, problem=calm.problem.changed({"machine": table}))
    run = replay(ideal, record_s=None)
    assert run.machine == Machine.ideal(step_s=0.01)
    assert np.max(np.abs(run.terminal_error)) < 1e-6


def test_shapes_and_summary(calm: Plan) -> None:
    run = replay(calm, PROTOTYPE, samples=4, settle_s=0.3, record_s=0.1)
    assert run.t[[0, -2, -1]] == pytest.approx([0, 10.2, 10.3])
    assert run.q.shape == (4, len(run.t), 4)
    assert run.motor_rates.shape == (4, len(run.t), 2)
    assert run.terminal_error_deg.shape == (4, 3)
    assert run.index_E_deg.shape == (4,)
    assert np.all(run.index_E_deg >= run.terminal_E_deg)
    assert np.array_equal(np.abs(run.terminal_error_deg).max(axis=1), run.terminal_E_deg)
    assert run.percentile(50) == np.median(run.index_E_deg)
    assert repr(run).startswith("Replay(polynomial plan, 4 samples, seed 0: E median ")
    with pytest.raises(AttributeError):
        run.seed = 3  # type: ignore[misc]
    summary = json.loads(json.dumps(run.to_dict()))
    assert summary["E_median_deg"] == pytest.approx(np.median(run.index_E_deg))
    assert summary["E_median_deg"] <= summary["E_p95_deg"]
    assert summary["samples"] == 4


def test_one_machine_has_no_percentiles(calm: Plan) -> None:
    run = replay(calm, PROTOTYPE, samples=[3], record_s=0.1)
    E = f"{run.index_E_deg[0]:.3g}"
    says = f"Replay(polynomial plan, 1 sample, seed 0: E {E} deg on this machine; samples=100 shows"
    assert repr(run).startswith(says)
    assert "median" not in repr(run)
    note = error_panel(run)["note"]  # type: ignore[index]
    assert note.startswith(f"E {E} deg")
    assert "95 %" not in note
    result = planner.compare(calm.problem, ["polynomial"], machine=PROTOTYPE, samples=1)
    text = " ".join(result.markdown().split())
    assert "over 1 machines" not in text
    assert "one machine" in text.split("has no percentiles")[0]
    assert "95 %" not in verdict_html(result)


def test_the_motors_rest_when_the_plan_is_over(calm: Plan) -> None:
    machine = PROTOTYPE.with_(input_bias_rad_s=0.01)
    run = replay(calm, machine, samples=2, settle_s=0.5)
    assert np.max(np.abs(run.motor_rates[:, -1])) < 1e-9
    late = run.t >= 10.4
    assert np.ptp(run.q[:, late], axis=1).max() < 1e-6


def test_a_path_outside_the_chart_is_refused_with_its_times(unlimited: planner.Problem) -> None:
    with pytest.raises(SingularError) as caught:
        polynomial(unlimited, 0.7854)
    refused = caught.value.plan
    assert refused is not None
    with pytest.raises(InputError, match=r"no real inputs \(.*t = \d.*s; ") as again:
        replay(refused)
    assert f"{refused.domain.singular_times_s[0]:.4g}" in str(again.value)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"feedback": "yes"}, "feedback = 'yes'"),
    ({"samples": 0}, "samples = 0"),
    ({"samples": -3}, "samples = -3"),
    ({"samples": True}, "samples = True"),
    ({"samples": 1.5}, "samples = 1.5"),
    ({"samples": []}, "samples = "),
    ({"samples": [1, -2]}, "samples = "),
    ({"seed": -1}, "seed = -1"),
    ({"seed": 0.5}, "seed = 0.5"),
    ({"settle_s": -0.1}, "settle_s = -0.1"),
    ({"settle_s": float("nan")}, "settle_s = nan"),
    ({"record_s": 0}, "record_s = 0"),
]


@pytest.mark.parametrize(("arguments", "part"), BAD, ids=[str(a) for a, _ in BAD])
def test_bad_arguments(calm: Plan, arguments: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError) as caught:
        replay(calm, Machine.ideal(), **arguments)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
