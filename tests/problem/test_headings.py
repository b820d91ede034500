"""Headings are a circle: the nearest turn by default, whole turns by a key; units of waypoints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planner import METHODS, InputError, Problem, load_problem, solve

KINDS: dict[str, dict[str, Any]] = {
    "unicycle": {"kind": "unicycle"},
    "car": {"kind": "car", "wheelbase_m": 0.5},
    "trailers": {"kind": "trailers", "wheelbase_m": 0.5, "trailer_lengths_m": [0.6, 0.7]},
}


def vehicle(
    start_deg: float,
    goal_deg: float,
    kind: str = "unicycle",
    waypoints: tuple[dict[str, Any], ...] = (),
    limit_deg: float | None = None,
    **goal: Any,
) -> Problem:
    steering = "turn" if kind == "unicycle" else "steering"
    limits: dict[str, Any] = {"speed_m_s": 1.0, f"{steering}_rate_rad_s": 1.0}
    if limit_deg is not None:
        limits["heading_deg"] = limit_deg
    return Problem.from_dict(
        {
            "system": KINDS[kind],
            "start": {"heading_deg": start_deg},
            "goal": {"x_m": 2.0, "y_m": 1.0, "heading_deg": goal_deg, "duration": "free", **goal},
            "limits": limits,
            "waypoints": list(waypoints),
        }
    )


def heading_of(problem: Problem) -> int:
    return [c.name for c in problem.system.coordinates].index("heading")


def ends(problem: Problem) -> tuple[float, float]:
    i = heading_of(problem)
    first, last = np.rad2deg([problem.start[i], problem.goal[i]]).tolist()
    return first, last


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("start", "goal", "turn"),
    [(350, 10, 20), (10, 350, -20), (370, 10, 0), (0, 370, 10), (-170, 170, -20), (90, 1000, -170)],
)
def test_the_heading_turns_the_nearest_way(
    kind: str, start: float, goal: float, turn: float
) -> None:
    first, last = ends(vehicle(start, goal, kind))
    assert first == pytest.approx(start)
    assert last - first == pytest.approx(turn)


@pytest.mark.parametrize(("start", "goal"), [(0, 180), (0, -180), (190, 10), (10, 190)])
def test_half_a_turn_goes_the_way_it_is_written(start: float, goal: float) -> None:
    first, last = ends(vehicle(start, goal))
    assert last - first == pytest.approx(goal - start)


@pytest.mark.parametrize(("turns", "turn"), [(0, 20), (1, 380), (-1, -340), (2, 740)])
def test_a_key_asks_for_whole_turns(turns: int, turn: float) -> None:
    problem = vehicle(350, 10, turns=turns)
    assert np.subtract(*ends(problem)[::-1]) == pytest.approx(turn)
    assert f"{turn} deg" in problem.heading_turn
    assert ("goal.turns" in problem.heading_turn) == (turns != 0)


def test_a_limit_of_the_heading_decides_between_turns() -> None:
    assert ends(vehicle(160, -160, limit_deg=170)) == pytest.approx((160, -160))
    assert ends(vehicle(350, 10, limit_deg=80)) == pytest.approx((-10, 10))
    with pytest.raises(InputError, match="heading"):
        vehicle(160, -160, limit_deg=170, turns=0)


def test_headings_of_waypoints_follow_each_other() -> None:
    three = tuple({"q": {"heading_deg": angle}} for angle in (120, -120, 350))
    problem = vehicle(0, 0, waypoints=three)
    i = heading_of(problem)
    passed = [np.rad2deg(point.q[i]) for point in problem.waypoints]
    assert passed == pytest.approx([120, 240, 350])
    assert ends(problem) == pytest.approx((0, 360))
    assert "by way of the waypoints" in problem.heading_turn
    timed = tuple(
        {"q": {"heading_deg": angle}, "time": time} for angle, time in ((-120, 4.0), (120, 2.0))
    )
    problem = vehicle(0, 0, waypoints=timed, duration=6.0)
    passed = [np.rad2deg(point.q[i]) for point in problem.waypoints]
    assert passed == pytest.approx([240, 120])


def test_the_plan_takes_no_longer_than_from_the_same_heading_written_otherwise() -> None:
    turned, plain = (solve(vehicle(start, 10)) for start in (350, -10))
    assert turned.duration == pytest.approx(plain.duration, rel=1e-3)
    assert turned.duration < 2.35
    times = np.linspace(0, 1, 9)
    turn = turned.q(times * turned.duration)[:, 1] - plain.q(times * plain.duration)[:, 1]
    assert turn == pytest.approx(np.full(9, 2 * np.pi), abs=1e-2)


@pytest.mark.parametrize("method", [m for m in METHODS if m != "desensitised"])
def test_every_method_plans_where_the_chart_is_turned(method: str) -> None:
    plans = [solve(vehicle(start, 5, duration=20.0), method) for start in (355, -5)]
    assert all(plan.verified for plan in plans)
    assert plans[0].objective == pytest.approx(plans[1].objective, rel=1e-5)


def test_keys_of_waypoints_have_the_units_of_start_and_goal() -> None:
    keys = {"x_m": 1.0, "heading_deg": 90, "hitch_deg": [10, -20], "steering_deg": 5}
    plain = {
        "x": 1.0,
        "heading": np.pi / 2,
        "hitch1": np.deg2rad(10),
        "hitch2": np.deg2rad(-20),
        "steering": np.deg2rad(5),
    }
    one, two = (vehicle(0, 0, "trailers", ({"q": q},)).waypoints[0].q for q in (keys, plain))
    np.testing.assert_allclose(one, two)
    np.testing.assert_array_equal(np.isnan(one), [c == "y" for c in ("x", *"abcd", "y")])


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ({"heading": 90}, "waypoints[0].q.heading = 90 is in radians"),
        ({"heading": 90}, "heading_deg = 90"),
        ({"steering": -30}, "steering_deg = -30"),
        ({"steering": 3}, "steering_deg = 3"),
        ({"hitch2": 5}, "hitch2_deg = 5"),
        ({"heading_dg": 90}, "did you mean 'heading_deg'"),
        ({"heading_m": 90}, "has no coordinate 'heading_m'"),
        ({"x_deg": 1}, "has no coordinate 'x_deg'"),
        ({"heading": 1.0, "heading_deg": 90}, "gives 'heading' twice"),
        ({"hitch_deg": [1, 2, 3]}, "has 3 values; it gives 2: hitch1, hitch2"),
    ],
)
def test_a_wrong_key_or_unit_of_a_waypoint_is_named(q: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        vehicle(0, 0, "trailers", ({"q": q},))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_waypoints_of_a_coin_may_be_in_degrees() -> None:
    tables = load_problem("problems/coin.toml").to_dict()
    point = Problem.from_dict({**tables, "waypoints": [{"q": {"roll_deg": 90}}]}).waypoints[0]
    assert np.nanmax(point.user) == pytest.approx(np.pi / 2)
