"""What is shown and exported of a system with coordinates of its user's is in those."""

from pathlib import Path

import numpy as np
import pytest

import planner
from planner.explorer.controls import motion_controls
from planner.explorer.state import State
from planner.report.figures.arm import body_points, can_draw, tips_to_pass
from planner.report.page.words import task_facts
from planner.report.panels import PLAN_FIGURES, PlanCurves
from planner.verification.summary import plan_summary

ROOT = Path(__file__).parents[2]
NAMES = ["x", "y", "heading", "roll"]


@pytest.fixture(scope="module")
def problem() -> planner.Problem:
    way = {"q": {"x": 0.5, "y": 0.5}, "time": 4.0}
    return planner.load_problem(ROOT / "problems/coin.toml", {"waypoints": [way]})


@pytest.fixture(scope="module")
def plan(problem: planner.Problem) -> planner.Plan:
    return planner.solve(problem)


def test_figures_show_user_coordinates_with_their_limits_and_waypoints(plan: planner.Plan) -> None:
    t = np.linspace(0.0, plan.duration, 101)
    panels = PLAN_FIGURES["joints"].panels([PlanCurves(0, plan, t)])
    assert [panel.title for panel in panels] == NAMES
    x, y, heading, roll = panels
    np.testing.assert_array_equal(x.series[0].y, plan.user(t)[:, 0])
    np.testing.assert_allclose(roll.series[0].y, np.rad2deg(plan.user(t)[:, 3]))
    assert (x.stops, y.stops) == ([[4.0, 0.5]], [[4.0, 0.5]])
    assert heading.stops == []
    assert (y.ends, y.limits) == ([0.0, 1.0], [1.3])
    assert heading.ends == pytest.approx([0.0, np.rad2deg(3.0)])


def test_the_coin_is_drawn_where_it_rolls(plan: planner.Plan, problem: planner.Problem) -> None:
    assert can_draw(problem.system)
    front, rear, contact = body_points(problem, plan.q(4.0))
    np.testing.assert_allclose(contact, [0.5, 0.5], atol=1e-4)
    np.testing.assert_allclose((front + rear) / 2, contact)
    heading = plan.user(4.0)[2]
    np.testing.assert_allclose(front - contact, [0.1 * np.cos(heading), 0.1 * np.sin(heading)])
    np.testing.assert_array_equal(tips_to_pass(problem), [[0.5, 0.5]])


@pytest.mark.filterwarnings("ignore:this .* plan does not start at rest")
def test_exports_hold_user_coordinates_and_a_plan_file_gives_the_plan_back(
    plan: planner.Plan, tmp_path: Path
) -> None:
    columns = ["x_m", "y_m", "heading_rad", "roll_rad"]
    for name in ("plan.csv", "plan.mat"):
        planner.export(plan, tmp_path / name)
        samples = planner.load_samples(tmp_path / name)
        assert list(samples.coordinates) == columns
        np.testing.assert_allclose(samples.q, plan.user(samples.t), atol=1e-12)
    assert list(plan.to_frame().columns[:4]) == columns
    assert list(plan.to_xarray().coordinate.values) == NAMES
    plan.save(tmp_path / "plan.json")
    again = planner.load_plan(tmp_path / "plan.json")
    assert again == plan
    np.testing.assert_array_equal(again.user(1.0), plan.user(1.0))


def test_a_summary_and_a_page_name_user_coordinates(plan: planner.Plan) -> None:
    assert list(plan_summary(plan)["terminal_error"]) == NAMES
    check = planner.verify(plan)
    np.testing.assert_allclose(check.terminal_error, 0.0, atol=5e-5)
    assert check.terminal_error_deg.shape == (2,)
    comparison = planner.compare(plan.problem, ["polynomial"], samples=1)
    facts = task_facts(comparison)
    assert dict(facts)["limits.q.x"].startswith("at most 0.8 m")


def test_the_explorer_has_a_slider_of_the_travel_where_that_is_given(
    problem: planner.Problem,
) -> None:
    follows = planner.load_problem(ROOT / "problems/front-axle.toml")
    for each, wanted in ((problem, True), (follows, False)):
        keys = [c.key for c in motion_controls(State(each, "collocation"), each, None)]
        assert ("goal.travel" in keys) == wanted
