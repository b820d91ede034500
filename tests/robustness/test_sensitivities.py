"""Sensitivities of several plans side by side: each plan's own, one sentence, one picture."""

import shlex

import numpy as np
import pytest

import planner
from planner import report
from planner.methods.registry import parse_specs
from planner.robustness.sensitivities import next_step, worth


@pytest.fixture(scope="module")
def plans(unlimited: planner.Problem) -> dict[str, planner.Plan]:
    return {name: planner.solve(unlimited, name) for name in ("polynomial", "piecewise")}


def test_each_plan_has_its_own_and_the_sentence_names_the_least(
    plans: dict[str, planner.Plan],
) -> None:
    found = planner.sensitivities({**plans, "none": None})
    for label, plan in plans.items():
        assert found.passive_block_deg[label] == planner.sensitivity(plan).passive_block_deg()
    assert "smallest for piecewise (0.508 deg)" in found.sentence
    assert "0.958 deg of each total is the floor" in found.sentence
    one = planner.sensitivities({"a": plans["polynomial"], "b": plans["polynomial"]})
    assert "0.561 deg for every plan" in one.sentence


def test_errors_add_up_to_the_total(plans: dict[str, planner.Plan]) -> None:
    found = planner.sensitivities(plans, {"gain": 0.02, "start theta1": 0.01})
    names, responses = found.responses
    assert names == ["gain u1", "gain u2", "start theta1"]
    assert found.sizes == [(0.02, "1"), (0.02, "1"), (0.01, "rad")]
    for label, each in found.plans.items():
        assert np.linalg.norm(responses[label]) == pytest.approx(each.total_deg(found.spread))


def test_the_picture_shows_the_numbers(plans: dict[str, planner.Plan]) -> None:
    found = planner.sensitivities(plans)
    _, axes = report.plot_sensitivities(found)
    widths = [bar.get_width() for bar in axes[0, 0].patches]
    assert widths[2:] == pytest.approx(list(found.passive_block_deg.values()))
    assert len(axes[0, 1].patches) == 2 * len(found.sizes)


def test_plans_of_two_systems_are_refused(plans: dict[str, planner.Plan]) -> None:
    arm = planner.Problem.manipulator([10, 10], [30, 30], duration=3.0)
    with pytest.raises(planner.InputError, match="several systems"):
        planner.sensitivities({**plans, "other": planner.solve(arm)})


def test_the_verdict_says_whether_a_small_total_is_worth_its_effort(
    plans: dict[str, planner.Plan],
) -> None:
    found = planner.sensitivities(plans)
    words = found.verdict
    assert words.startswith(
        "piecewise instead of polynomial: not worth it, the total above its floor falls by"
    )
    assert "--methods 'polynomial compensated,piecewise compensated'" in words
    assert "Next, compensate" in words
    assert found.to_dict()["verdict"] == words


def test_what_is_worth_its_price() -> None:
    """The part above the floor is compared: 0.636 and 0.367 degrees of the paper's example."""
    assert worth(1.0, 0.5, 0.0, 1.9).startswith("worth it, the total above its floor falls by 50 %")
    assert worth(1.0, 0.5, 0.0, 2.1).startswith("not worth it, ")
    assert worth(1.150, 1.026, 0.958, 1.7).startswith("worth it, ")
    assert "42 % (0.636 to 0.367 deg) for 9.5 times the effort" in worth(1.150, 1.026, 0.958, 9.5)


def test_plans_with_names_of_the_users_own_get_a_command_that_runs(
    paper: planner.Problem,
) -> None:
    """It told of `my compensated first plan`, which is no method."""
    plans = {k: planner.solve(paper, k) for k in ("sinusoid", "collocation")}
    own = {"my first plan": plans["sinusoid"], "collocation: slow": plans["collocation"]}
    words = shlex.split(planner.sensitivities(own).verdict.partition(": planner ")[2])
    methods = words[words.index("--methods") + 1]
    assert sorted(methods.split(",")) == ["collocation compensated", "sinusoid compensated"]
    for spec in parse_specs(paper, methods):
        assert spec.compensated


def test_the_next_step_compensates_no_plan_that_ends_at_the_goal_anyway() -> None:
    for end, word in (("plan", "collocation compensated"), ("machine", "collocation,")):
        problem = planner.load_problem("problems/paper.toml", {"method.collocation.end": end})
        specs = parse_specs(problem, ["collocation", "desensitised"])
        assert word in str(next_step(problem, *specs))
