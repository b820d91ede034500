"""Effort, peak inputs and path length of every kind of plan: the same quantities for all."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.plan.measures import effort_unit

PROBLEMS = Path(__file__).parents[2] / "problems"


def by_sums(plan: planner.Plan) -> tuple[float, np.ndarray, float]:
    """Effort, peaks, and the integral of the speed of the joints, or of a vehicle's position."""
    count = max(200, 100_000 // len(plan.t))
    t = np.concatenate([np.linspace(a, b, count) for a, b in pairwise(plan.t)])
    t = np.clip(t, 0.0, np.nextafter(plan.duration, 0.0))
    q, u, system = plan.trajectory.q(t), plan.trajectory.u(t), plan.problem.system
    moved = [0, 3] if system.kind == "car" else [1, 2, 3]
    way = np.trapezoid(np.linalg.norm(system.rates(q, u)[:, moved], axis=1), t)
    if plan.compensates:  # its motion is that of a machine and does not follow the kinematics
        way = np.sum(np.linalg.norm(np.diff(q[:, moved], axis=0), axis=1))
    return float(np.trapezoid(np.sum(u**2, axis=1), t)), np.max(np.abs(u), axis=0), float(way)


@pytest.fixture(scope="module")
def plans(paper: planner.Problem, tmp_path_factory: pytest.TempPathFactory) -> list[planner.Plan]:
    """One plan of each kind."""
    slow = paper.changed({"goal.duration": 14.0})
    convex = planner.solve(slow, "convex", objective="peak")
    loaded = planner.load_plan(convex.save(tmp_path_factory.mktemp("plans") / "plan.json"))
    return [
        planner.solve(slow, "polynomial"),
        planner.solve(planner.load_problem(PROBLEMS / "car.toml"), "polynomial"),
        planner.solve(slow, "desensitised"),
        planner.retime(convex, {"input_rate_rad_s2": 0.2}),
        planner.compensate(convex),
        convex,
        loaded,
    ]


def test_every_plan_has_the_same_figures(plans: list[planner.Plan]) -> None:
    for plan in plans:
        effort, peaks, path = by_sums(plan)
        assert plan.effort == pytest.approx(effort, rel=1e-4)
        assert plan.peak_u == pytest.approx(peaks, rel=1e-4)
        assert plan.path_length == pytest.approx(path, rel=1e-4)
        first, second = (each.unit for each in plan.problem.system.inputs)
        unit = "m" if plan.problem.system.kind == "car" else "rad"
        told = f", effort {plan.effort:.4g} {effort_unit(plan.problem.system)}, peaks"
        told += f" {plan.peak_u[0]:.4g} {first} and {plan.peak_u[1]:.4g} {second}"
        assert f"{told}, path {plan.path_length:.4g} {unit}, " in repr(plan)
        assert f"  objective {plan.objective:.4g}, {plan.objective_name}\n" in str(plan)


def test_the_objective_is_what_was_minimised_and_effort_is_effort(
    plans: list[planner.Plan],
) -> None:
    *_, compensated, convex, loaded = plans
    assert convex.objective != pytest.approx(convex.effort, rel=0.1)
    assert loaded.objective == convex.objective
    assert (loaded.effort, loaded.path_length) == (convex.effort, convex.path_length)
    assert compensated.objective == convex.objective
    assert compensated.effort != convex.effort  # that of its commands
    assert not plans[0].peak_u.flags.writeable


def test_a_path_that_leaves_the_chart_has_none() -> None:
    problem = planner.load_problem(PROBLEMS / "paper-fig4.toml")
    plan = planner.solve(problem, "polynomial", allow_singular=True)
    assert not plan.executable
    assert np.isnan([plan.effort, *plan.peak_u, plan.path_length]).all()
    assert "effort" not in repr(plan)


def test_a_coin_goes_a_way_in_metres() -> None:
    plan = planner.solve(planner.load_problem(PROBLEMS / "coin.toml"), "polynomial")
    t = np.linspace(0.0, plan.duration, 100_001)
    rolled = np.trapezoid(np.abs(plan.trajectory.u(t)[:, 1]), t)
    radius = plan.problem.system.to_dict()["radius_m"]
    assert plan.path_length == pytest.approx(rolled * radius, rel=1e-5)
