"""What is out of reach costs nothing: it is left out, or refused before any work."""

from __future__ import annotations

from typing import Any

import pytest

import planner
from planner.methods.collocation.guesses import routes
from planner.problem.tables.arms import MOST_JOINTS
from planner.problem.tables.method_options import MOST_POINTS
from planner.problem.tables.problem_file import MOST_WAYPOINTS

FAR = [{"centre_m": [10.0 + k / 10, 10.0], "radius_m": 0.1} for k in range(30)]


def test_discs_that_no_link_can_touch_are_no_part_of_the_programme(paper: planner.Problem) -> None:
    alone, among = planner.solve(paper), planner.solve(paper.changed({"obstacles": FAR}))
    assert among.iterations == alone.iterations
    assert among.objective == alone.objective
    assert len(among.problem.obstacles) == len(FAR)
    assert "clearance of link 3 from obstacle 30" in planner.verify(among).margins


def test_a_disc_at_the_edge_of_the_reach_counts(paper: planner.Problem) -> None:
    reach = float(sum(paper.system.link_lengths))  # type: ignore[attr-defined]
    for gap, count in ((-1e-6, 1), (1e-6, 0)):
        disc = {"centre_m": [0.0, reach + 0.1 + gap], "radius_m": 0.1}
        assert len(paper.changed({"obstacles": [disc]}).within_reach().obstacles) == count


def arm(joints: int) -> dict[str, Any]:
    angles = {"theta_deg": [5.0] * joints}
    system = {"kind": "manipulator", "joints": joints, "K": [1.0] * (joints - 1), "k_g": 1.0}
    return {"system": system, "start": angles, "goal": angles}


def test_arms_too_long_for_the_chart_are_refused() -> None:
    assert planner.Problem.from_dict(arm(MOST_JOINTS)).system.size == MOST_JOINTS + 1
    with pytest.raises(planner.InputError, match=f"= 20: .* {MOST_JOINTS}"):
        planner.Problem.from_dict(arm(20))


def test_more_waypoints_than_a_motion_has_parts_are_refused(paper: planner.Problem) -> None:
    places = [{"theta_deg": ["free", 10.0, "free"]}] * 3000
    with pytest.raises(planner.InputError, match=f" {MOST_WAYPOINTS} values"):
        paper.changed({"waypoints": places})


def test_more_points_than_a_polynomial_has_digits_are_refused(paper: planner.Problem) -> None:
    points = [[k / 500, 0.1] for k in range(1, 3000)]
    with pytest.raises(planner.InputError, match=f" {MOST_POINTS} values"):
        paper.changed({"method.polynomial.points": points})


def test_waypoints_in_too_many_orders_are_refused(paper: planner.Problem) -> None:
    free = {"theta_deg": ["free", 10.0, "free"]}
    with pytest.raises(planner.InputError, match=r"\b8 waypoints, 8 "):
        planner.solve(paper.changed({"waypoints": [free] * 8}))


def test_waypoints_with_a_time_have_one_order(paper: planner.Problem) -> None:
    places = [{"theta_deg": ["free", 10.0, "free"], "time": 9.9 - k / 6} for k in range(50)]
    (only,) = routes(paper.changed({"waypoints": places}))
    times = [point.time_s for point in only.waypoints]
    assert times == sorted(times)  # type: ignore[type-var]


def test_gears_as_none_can_be_are_refused(paper: planner.Problem) -> None:
    steep = {**paper.to_dict()["system"], "K": [1e8, 0.7]}
    with pytest.raises(planner.InputError, match=r"= 100000000\.0: .* 1000"):
        paper.changed({"system": steep})


def test_a_long_arm_is_examined_without_the_recursion() -> None:
    found = planner.check(planner.Problem.from_dict(arm(7)), ["polynomial"]).nonholonomy
    assert found.recursion is None
    assert all(place.finding is not None and place.finding.chow for place in found.places)
