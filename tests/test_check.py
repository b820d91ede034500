"""Is there a plan, of what kind, and if not, why and what would make one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import planner
from planner import check
from planner.check import VARIANTS
from planner.cli.check import check as check_command
from planner.support.arrays import jsonable

PROBLEMS = Path(__file__).parents[1] / "problems"
QUICK = ["polynomial"]


def test_a_problem_with_a_plan(paper: planner.Problem) -> None:
    analysis = check(paper.changed({"goal.travel": 0.82, "limits": {}}), QUICK)
    assert analysis.has_plan
    assert "polynomial" in analysis.verdict
    assert analysis.reversal.verdict == "not needed"
    assert analysis.window is not None
    assert analysis.window.low == pytest.approx(0.78635, abs=5e-6)
    assert analysis.window.high == pytest.approx(0.89664, abs=5e-6)
    assert analysis.plain_polynomial is None
    assert analysis.remedy is None


def test_by_default_the_polynomial_is_also_tried_with_chosen_points(
    paper: planner.Problem,
) -> None:
    """It said "verification failed, try 28 s" of a motion that `compare` plans in 10 s."""
    analysis = check(paper)
    by_method = {outcome["method"]: outcome for outcome in analysis.outcomes}
    outcome = by_method.pop("polynomial")
    assert outcome["label"] == "polynomial:points=auto"
    assert outcome["verified"]
    assert outcome["duration_s"] == 10
    assert all(other["label"] == method for method, other in by_method.items())
    assert not {"polynomial", outcome["label"]} & set(analysis.refusals)


def test_piecewise_is_tried_with_more_slots_too(paper: planner.Problem) -> None:
    changes = {"start.theta_deg": [13.3, 5.5, 2.8], "goal.theta_deg": [50.5, 45.2, 38.1]}
    problem = paper.changed({**changes, "goal.travel": "free", "goal.duration": 10.0})
    found = planner.check(problem)
    (outcome,) = (o for o in found.outcomes if o["method"] == "piecewise")
    assert (outcome["label"], outcome["verified"]) == ("piecewise:slots=10", True)
    (named,) = planner.check(problem, ["piecewise"]).outcomes
    assert not named["verified"], "what is named is tried as it is"


def test_the_help_names_every_variant_that_is_tried() -> None:
    named = " ".join((check_command.__doc__ or "").split())
    assert all(variant.text in named for variant in VARIANTS)


def test_a_remedy_has_been_tried_and_works(paper: planner.Problem) -> None:
    task = paper.changed({"goal.travel": 0.825})
    analysis = check(task, QUICK)
    assert not analysis.has_plan
    assert not analysis.proven_impossible
    assert analysis.remedy is not None
    assert analysis.remedy.changes == {"goal.duration": "free"}
    assert "(tried)" in analysis.verdict
    again = planner.solve(task.changed(analysis.remedy.changes), analysis.remedy.method)
    assert again.verified
    assert again.duration == pytest.approx(analysis.remedy.plan["duration_s"])


def test_a_duration_too_short_is_proven() -> None:
    problem = planner.load_problem(PROBLEMS / "unreachable.toml")
    analysis = check(problem, QUICK)
    assert analysis.proven_impossible
    assert "theta3 must move 29 deg" in analysis.verdict
    assert [o["status"] for o in analysis.outcomes] == ["infeasible"]
    assert analysis.remedy is not None
    assert analysis.remedy.changes["goal.duration"] == "free"
    remedy = check(problem, ["polynomial", "collocation"]).remedy  # the ablest answers
    assert remedy is not None
    assert remedy.method == "collocation"
    assert remedy.plan["duration_s"] == pytest.approx(3.1, abs=0.05)


def test_paper_figure_4_and_5() -> None:
    for name, count in (("paper-fig4", 2), ("paper-fig5", 0)):
        problem = planner.load_problem(PROBLEMS / f"{name}.toml")
        analysis = check(problem, QUICK)
        assert analysis.reversal.verdict == "needed"
        assert "outside the window" in analysis.reversal.reason
        outcome = analysis.outcomes[0]
        assert outcome["status"] == "singular"
        report = planner.solve(problem, "polynomial", allow_singular=True).domain
        assert len(report.z2_crossings_s) == count
        assert (report.z2_max < 0) == (count == 0)
        assert analysis.plain_polynomial is not None
        travel, plain = analysis.plain_polynomial
        assert travel == pytest.approx(np.pi / 4)
        np.testing.assert_allclose(plain.z2_crossings_s, [0.3057, 2.2975], atol=1e-4)


def test_passive_joints_that_part_ways_need_a_reversal(unlimited: planner.Problem) -> None:
    analysis = check(unlimited.changed({"goal.theta_deg": [30, 0.5, 30]}), QUICK)
    assert analysis.window is not None
    assert analysis.window.empty
    assert analysis.reversal.verdict == "needed"
    assert "opposite directions" in analysis.reversal.reason


def test_other_systems_and_what_a_method_demands(paper: planner.Problem) -> None:
    analysis = check(planner.load_problem(PROBLEMS / "unicycle.toml"), QUICK)
    assert analysis.has_plan
    assert analysis.window is None
    free = paper.changed({"goal.duration": "free", "limits": {}})
    outcome = check(free, QUICK).outcomes[0]
    assert outcome["status"] == "bad_input"
    assert "goal.duration is free" in outcome["reason"]


def test_four_joints_leave_the_question_open() -> None:
    problem = planner.load_problem(PROBLEMS / "four-joint.toml").changed({"limits": {}})
    assert check(problem, QUICK).reversal.verdict == "open"


def test_the_dictionary_is_json(paper: planner.Problem) -> None:
    data = check(paper.changed({"goal.travel": 0.7}), QUICK).to_dict()
    text = json.dumps(jsonable(data), allow_nan=False)
    assert json.loads(text)["travel_window"]["travel_inside"] is False
    assert data["plain_polynomial"]["exits_s"]


def test_progress_is_told_and_methods_are_checked(paper: planner.Problem) -> None:
    lines: list[str] = []
    check(paper.changed({"goal.duration": 2.0, "limits.joint_deg": 31}), QUICK, lines.append)
    assert lines[0] == "trying polynomial"
    assert any('goal.duration = "free"' in line for line in lines)
    with pytest.raises(planner.InputError, match="'polynomial'"):
        check(paper, ["polynomail"])


@pytest.mark.parametrize("name", ["paper-fig4", "paper-fig5"])
def test_collocation_plans_what_the_chart_refuses(name: str) -> None:
    analysis = check(planner.load_problem(PROBLEMS / f"{name}.toml"), ["collocation"])
    assert analysis.has_plan
    assert analysis.outcomes[0]["direction"] == "reverses 2 times"
    assert analysis.outcomes[0]["domain_ok"] is False


def test_without_a_waypoint_that_is_in_the_way_there_is_a_plan(paper: planner.Problem) -> None:
    place = {"theta_deg": [60, -60, 0], "time": 1.0}
    quick = {"attempts": 1, "intervals": 20, "max_iterations": 60}
    problem = paper.changed({"waypoints": [place], "method.collocation": quick})
    remedy = check(problem, ["collocation"]).remedy
    assert remedy is not None
    assert remedy.changes == {"waypoints": []}
    assert remedy.method == "collocation"
    assert "waypoints = []" in str(remedy)


def test_a_goal_of_the_tip_says_what_is_reachable() -> None:
    problem = planner.load_problem(PROBLEMS / "tip.toml")
    analysis = check(problem, [*QUICK, "collocation"])
    assert analysis.has_plan
    assert analysis.reach is not None
    assert len(analysis.reach.branches) == 4
    assert analysis.window is None
    assert [o["status"] for o in analysis.outcomes] == ["no_plan", "solved"]
    found = json.loads(json.dumps(jsonable(analysis.to_dict())))
    assert len(found["reach"]["branches_theta_deg"]) == 4
    assert found["ends"]["goal"]["in_chart"] is False


def test_a_tip_out_of_reach_has_a_remedy_that_was_tried() -> None:
    """Within 50 degrees a joint the tip does not get there; the nearest place is tried first."""
    problem = planner.load_problem(PROBLEMS / "tip.toml")
    asked = {"goal.tip_m": [-0.1, 0.7], "goal.duration": "free", "limits.joint_deg": 50}
    analysis = check(problem.changed(asked), ["collocation"])
    assert not analysis.has_plan
    assert analysis.reach is not None
    assert analysis.reach.branches == ()
    assert analysis.reach.missed_m == pytest.approx(
        float(np.linalg.norm(analysis.reach.tip[:2] - [-0.1, 0.7])), rel=1e-9
    )
    assert analysis.remedy is not None
    (place,) = analysis.remedy.changes.values()
    np.testing.assert_allclose(place, analysis.reach.tip[:2], atol=1e-4)
