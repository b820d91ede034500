"""Objectives of collocation beside effort and time."""

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import planner
from planner.methods.collocation.transcription.form import objective
from planner.methods.collocation.transcription.interval import EDGE_MARGIN
from planner.plan.measures import INTEGRALS, TERMS, Objective
from planner.problem.tables.method_options import CollocationOptions

PROBLEMS = Path(__file__).parents[3] / "problems"

TIMES = np.linspace(0, 10, 20001)


def effort(plan: planner.Plan) -> float:
    return float(np.trapezoid(np.sum(plan.u(TIMES) ** 2, axis=1), TIMES))


def smoothness(plan: planner.Plan) -> float:
    middle = (TIMES[1:] + TIMES[:-1]) / 2
    slopes = (plan.u(middle + 1e-6) - plan.u(middle - 1e-6)) / 2e-6
    return float(np.sum(slopes**2) * (TIMES[1] - TIMES[0]))


def closeness(plan: planner.Plan) -> float:
    """Mean over time of the sum over θ₁, θ₂ of exp(−sin²/0.05) + exp(−cos²/0.05)."""
    theta = plan.q(TIMES)[:, 1:3]
    terms = np.exp(-(np.sin(theta) ** 2) / EDGE_MARGIN) + np.exp(
        -(np.cos(theta) ** 2) / EDGE_MARGIN
    )
    return float(np.trapezoid(np.sum(terms, axis=1), TIMES) / 10)


def regularised_closeness(plan: planner.Plan) -> float:
    return closeness(plan) + 0.01 * effort(plan)


MEASURES = {"effort": effort, "smooth": smoothness, "edge": regularised_closeness}
"""Of each objective for a fixed duration, its value by a second code path."""

KINDS = get_args(CollocationOptions.model_fields["objective"].annotation)


@pytest.fixture(scope="module")
def plans(paper: planner.Problem) -> dict[str, planner.Plan]:
    assert {*KINDS} - {*MEASURES} == {"auto", "time", "mixed"}, "give the new one a measure here"
    return {kind: planner.solve(paper, "collocation", objective=kind) for kind in MEASURES}


def test_each_objective_is_what_it_says_and_the_least_of_all(
    plans: dict[str, planner.Plan],
) -> None:
    for kind, measure in MEASURES.items():
        values = {name: measure(plan) for name, plan in plans.items()}
        assert plans[kind].objective == pytest.approx(values[kind], rel=1e-3)
        assert values[kind] < 0.99 * min(v for name, v in values.items() if name != kind)


@pytest.mark.parametrize("kind", MEASURES)
def test_the_value_is_that_of_the_motion_in_any_units(paper: planner.Problem, kind: str) -> None:
    """As slow a motion has another natural unit of time (`Units.weights`)."""
    slow = paper.changed({"goal.duration": 10_000.0})
    plan = planner.solve(slow, "collocation", objective=kind, start="straight")
    assert plan.objective == pytest.approx(plan.aim.value(plan.trajectory), rel=1e-6)


@pytest.mark.parametrize("kind", MEASURES)
def test_the_mesh_is_refined_until_the_objective_has_settled(
    paper: planner.Problem, kind: str
) -> None:
    """From a mesh so coarse that motions from rest to rest cost much more (`_savings` of
    `planner/methods/collocation/between_nodes.py` must see every integral)."""
    options = {"objective": kind, "rest": True, "start": "straight"}
    plan = planner.solve(paper, "collocation", intervals=6, accuracy=1e-3, **options)
    fine = planner.solve(paper, "collocation", intervals=120, **options)
    assert plan.objective < 1.002 * fine.objective


def test_a_mix_lies_between(paper: planner.Problem, plans: dict[str, planner.Plan]) -> None:
    plan = planner.solve(
        paper,
        "collocation",
        objective="mixed",
        effort_weight=0.5,
        smoothness_weight=2.0,
        edge_weight=3.0,
    )
    expected = 10 + 0.5 * effort(plan) + 2.0 * smoothness(plan) + 3.0 * closeness(plan)
    assert plan.objective == pytest.approx(expected, rel=1e-3)
    for other in plans.values():
        mixed = 10 + 0.5 * effort(other) + 2.0 * smoothness(other) + 3.0 * closeness(other)
        assert plan.objective < mixed
    for part in ("duration", "0.5 x", "2 x integral of (du1/dt)^2", "3 x mean closeness"):
        assert part in plan.objective_name


@pytest.mark.parametrize("kind", ["smooth", "edge"])
def test_what_is_better_the_slower_needs_a_duration(paper: planner.Problem, kind: str) -> None:
    with pytest.raises(planner.InputError, match=f"'{kind}'.*goal.duration"):
        planner.solve(paper.changed({"goal.duration": "free"}), "collocation", objective=kind)


def test_smoothness_refuses_inputs_that_jump(paper: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match="reads the inputs' rates"):
        planner.solve(paper, "collocation", objective="smooth", input="constant")


@pytest.mark.parametrize("duration", [40.0, 17.5])
def test_the_smoothest_path_need_not_be_the_shortest(duration: float) -> None:
    """The default start is no worse than random loops alone. In 17.5 s the smoothest path must be
    driven faster than at constant speed, which would take 17.75 s."""
    parking = planner.load_problem(PROBLEMS / "parking.toml").changed({"goal.duration": duration})
    usual, loops = (
        planner.solve(parking, objective="smooth", start=start) for start in ("auto", "wander")
    )
    assert usual.objective <= 1.001 * loops.objective


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "auto"])
def test_every_objective_consists_of_terms_that_are_minimised_and_measured(
    paper: planner.Problem, kind: str
) -> None:
    options = CollocationOptions(objective=kind, smoothness_weight=0.1, edge_weight=0.1)
    found = objective(paper, options)
    assert found.kind == kind
    assert found.terms.keys() <= TERMS.keys()
    assert re.search(
        rf"\b{kind}[:,]", str(CollocationOptions.model_fields["objective"].description)
    )
    assert np.count_nonzero(found.weights) >= len(found.terms)


def test_a_term_that_collocation_cannot_minimise_is_refused() -> None:
    """Without its integral in the programme it would be left out in silence."""
    assert Objective("own", {"of the method": 1.0}).weights.tolist() == [0.0] * INTEGRALS
    with pytest.raises(ValueError, match="'chart peak'"):
        _ = Objective("new", {"effort": 1.0, "chart peak": 1.0}).weights
