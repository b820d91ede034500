"""Collocation from a plan of a neighbouring problem, and what is built anew for it: nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import InputError, Plan, Problem
from planner.methods.collocation import method as replan
from planner.methods.collocation.method import plan_collocation, replan_collocation
from planner.methods.collocation.transcription import transcription as transcriptions
from planner.problem.tables.method_options import CollocationOptions

PROBLEMS = Path(__file__).parents[3] / "problems"
NEIGHBOUR = {"goal.theta_deg": [31, 30, 29], "start.theta_deg": [2, 1, 1]}
AT_LIMITS = {
    "start.theta_deg": [10, 10, 10],
    "goal.theta_deg": [10, 10, 30],
    "goal.duration": 24.0,
    "limits": {"input_rad_s": 0.2, "joint_deg": 80, "z2_margin": 0.25},
}


@pytest.fixture(scope="module")
def found(paper: Problem) -> Plan:
    return plan_collocation(paper, CollocationOptions())


@pytest.mark.parametrize("solver", ["auto", "ipopt"])
@pytest.mark.parametrize(
    ("base", "changes"),
    [
        ({}, NEIGHBOUR),
        ({}, {"goal.duration": 14.0}),
        (AT_LIMITS, {"goal.theta_deg": [10, 10, 29.5]}),
    ],
)
def test_fewer_iterations_to_the_same_optimum(
    paper: Problem, base: dict[str, Any], changes: dict[str, Any], solver: Any
) -> None:
    # on one mesh: the plan's own, which is finer, would settle the objective 3e-4 lower
    options = CollocationOptions(solver=solver, start="straight", refinements=0)
    problem = paper.changed(base | changes)
    cold = plan_collocation(problem, options)
    warm = replan_collocation(problem, options, plan_collocation(paper.changed(base), options))
    # the paper's straight line is so near the answer that Fatrop takes no fewer from a plan
    easy = changes is NEIGHBOUR and solver == "auto"
    assert warm.iterations < cold.iterations + easy
    assert warm.objective == pytest.approx(cold.objective, rel=1e-6)
    assert warm.notes["start"] == "warm"
    assert planner.verify(warm).ok


def test_it_stays_on_the_same_way_round() -> None:
    """Of the crossing's two local optima the one at hand is followed, without any search."""
    problem = planner.load_problem(PROBLEMS / "crossing.toml")
    bump = planner.solve(problem, "collocation", start="bump", starts=1)
    moved = problem.changed({"goal.theta_deg": [-24, 20, 30]})
    warm = planner.solve(moved, "collocation", warm=bump)
    assert warm.verified
    assert len(warm.notes["tried"]) == 1
    times = np.linspace(0, 10, 50)
    assert np.max(np.abs(warm.q(times) - bump.q(times))) < 0.3


def test_a_plan_of_another_method_will_do(paper: Problem, found: Plan) -> None:
    polynomial = planner.solve(paper.changed({"limits": {}, "goal.travel": 0.8235}), "polynomial")
    warm = planner.solve(paper, "collocation", warm=polynomial, intervals=14)
    assert warm.notes["start"] == "warm"
    assert warm.objective == pytest.approx(found.objective, rel=1e-6)


def test_a_start_that_leads_nowhere_is_given_up(
    paper: Problem, found: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replan, "_near_motions", lambda *_: [])
    again = planner.solve(paper, "collocation", warm=found)
    assert again.notes["start"] == "straight"
    assert again.objective == pytest.approx(found.objective, rel=1e-9)


def test_refusals(paper: Problem, found: Plan) -> None:
    two = planner.load_problem(PROBLEMS / "four-joint.toml")
    with pytest.raises(InputError, match="another system"):
        planner.solve(two, "collocation", warm=found)
    with pytest.raises(InputError, match=r"warm.*'collocation'"):
        planner.solve(paper, "polynomial", warm=found)
    outside = planner.load_problem(PROBLEMS / "paper-fig5.toml")
    singular = planner.solve(outside, "polynomial", allow_singular=True)
    with pytest.raises(InputError, match="leaves the chart's domain"):
        planner.solve(paper, "collocation", warm=singular)


@pytest.fixture
def builds(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The transcriptions built, noted as it happens; there are none to begin with."""
    built: list[object] = []
    inner = transcriptions.interval_functions

    def counting(*args: Any) -> Any:
        built.append(args)
        return inner(*args)

    monkeypatch.setattr(transcriptions, "interval_functions", counting)
    transcriptions.transcription.cache_clear()
    return built


def test_other_numbers_or_guesses_build_nothing(paper: Problem, builds: list[object]) -> None:
    """On one mesh: each finer one is built for."""
    once = CollocationOptions(refinements=0)
    first = plan_collocation(paper, once)
    assert len(builds) == 1
    again = plan_collocation(paper, once)
    assert first.build_time_s > 0 == again.build_time_s
    np.testing.assert_array_equal(again.q(first.t), first.q(first.t))
    numbers: list[dict[str, Any]] = [
        {"start.theta_deg": [2, 3, 4]},
        {"goal.theta_deg": [28, 31, 30]},
        {"goal.travel": 0.83},
        {"goal.duration": 11.0},
        {"limits.input_rad_s": [0.4, 0.3]},
        {"limits.input_rate_rad_s2": 0.5},
        {"limits.joint_deg": 70},
        {"limits.z2_margin": 0.02},
    ]
    for changes in numbers:
        assert plan_collocation(paper.changed(changes), once).build_time_s == 0
    plan_collocation(paper, CollocationOptions(rest=True, refinements=0))
    replan_collocation(paper.changed(NEIGHBOUR), once, first)
    plan_collocation(paper, CollocationOptions(start="straight", max_iterations=80, refinements=0))
    assert len(builds) == 1


def test_limits_that_slip_between_nodes_cost_one_more_build(
    paper: Problem, builds: list[object]
) -> None:
    for joint in (35, 34, 36):
        problem = paper.changed({"limits.joint_deg": joint})
        found = plan_collocation(problem, CollocationOptions())
        assert found.notes["limits_inside"]
    assert len(builds) == 2


def test_another_mesh_or_degree_is_built_for(paper: Problem, builds: list[object]) -> None:
    several: list[dict[str, Any]] = [{"intervals": 19}, {"intervals": 19, "degree": 4}]
    for options in several:
        plan_collocation(paper, CollocationOptions(**options))
    assert len(builds) == 2
