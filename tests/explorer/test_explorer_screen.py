"""The explorer's logic: what a slider does to the plan, the picture and the words."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import InputError
from planner.explorer.outcome import judge, path
from planner.explorer.screen import Screen as PlannerScreen
from planner.explorer.screen import path_line
from planner.explorer.state import State
from planner.report.panels import to_screen_digits
from planner.support.package import how_to_install

ROOT = Path(__file__).parents[2]


class Screen(PlannerScreen):
    """One whose changes are planned at once, as the widget does."""

    def change(self, changes: Sequence[tuple[str, Any]]) -> None:
        self.set(changes)
        self.plan_anew()


def screen(name: str, method: str = "polynomial", samples: int = 2, **changes: Any) -> Screen:
    if name == "paper":  # a fixed travel is planned at once
        changes = {"goal.travel": 0.82, **changes}
    problem = planner.load_problem(ROOT / "problems" / f"{name}.toml", changes)
    return Screen(State.from_problem(problem, method, samples))


def panel(screen: Screen, name: str) -> dict[str, Any]:
    return next(p for p in screen.picture()["panels"] if p["id"] == name)


def test_a_slider_moves_the_plan_and_the_picture() -> None:
    shown = screen("paper")
    shown.change([("goal.travel", 0.80)])
    before = panel(shown, "z2")["series"][0]["y"]
    shown.change([("goal.travel", 0.82)])
    after = panel(shown, "z2")["series"][0]["y"]
    assert shown.outcome.plan.travel == pytest.approx(0.82, abs=1e-12)
    assert np.max(np.abs(np.array(before) - np.array(after))) > 0.01
    low, high = (np.array(panel(shown, "z2")["band"][edge]) for edge in ("low", "high"))
    assert np.all((low < after) & (after < high))  # in the domain at this travel


def test_a_free_slider_shows_what_the_method_chose() -> None:
    shown = screen("paper", **{"goal.travel": "free"})
    control = shown.controls["goal.travel"]
    assert not control.on
    assert control.shown == pytest.approx(shown.outcome.plan.travel)
    shown.change([("goal.travel", 0.82)])
    assert shown.controls["goal.travel"].on
    shown.change([("goal.travel", None)])
    assert not shown.controls["goal.travel"].on


def test_a_slider_stays_where_it_makes_the_problem_impossible() -> None:
    shown = screen("paper")
    shown.change([("start.theta_deg:1", 89.0)])
    assert shown.outcome.kind == "bad input"
    assert "start theta2 = 89 deg" in str(shown.outcome.error)
    assert shown.controls["start.theta_deg:1"].shown == 89.0
    shown.change([("start.theta_deg:1", 1.0)])
    assert shown.outcome.kind != "bad input"


def test_a_goal_of_the_tip_moves_with_its_sliders() -> None:
    shown = screen("tip", "collocation")
    assert [shown.controls[f"goal.tip_m:{k}"].label for k in (0, 1)] == ["tip x", "tip y"]
    assert panel(shown, "plane")["tips"] == [[0.4964, 0.6598]]
    assert None not in np.ravel(panel(shown, "map")["ends"])
    json.dumps(shown.picture(), allow_nan=False)
    shown.change([("goal.tip_m:0", 0.5), ("goal.tip_m:1", 0.64)])
    assert shown.outcome.plan is not None
    poses = panel(shown, "plane")["poses"]
    np.testing.assert_allclose(poses[-1][-1], [0.5, 0.64], atol=1e-6)
    fixed = State.from_problem(
        shown.state.problem().changed({"goal.theta_deg": [20, "free", "free"]}), "auto", 0
    )
    assert fixed.with_value("system.joints", 5).changes["goal.theta_deg"] == [20.0, *["free"] * 4]


def test_the_clearance_of_links_is_a_slider_that_is_off() -> None:
    control = screen("paper").controls["limits.self_clearance_m"]
    assert (control.unit, control.on) == ("m", False)


def test_a_refused_path_is_drawn_with_the_reason_in_words() -> None:
    shown = screen("paper-fig5")
    words = shown.words()
    assert words["kind"] == "singular"
    assert "leaves the domain" in words["text"]
    z2 = panel(shown, "z2")
    assert len(z2["marks"]) == 2
    assert z2["handles"][0]["at"] == [5.0, -0.2]
    assert None in panel(shown, "joints")["series"][0]["y"]
    json.dumps(shown.picture(), allow_nan=False)
    with pytest.raises(planner.SingularError):
        shown.plan()


def test_what_is_proven_impossible_is_drawn_all_the_same() -> None:
    shown = screen("unreachable")
    assert shown.words()["kind"] == "infeasible"
    assert panel(shown, "inputs")["series"][0]["y"]


def test_a_law_that_leaves_the_chart_at_every_travel_is_drawn_at_some_travel() -> None:
    shown = screen("parking", **{"goal.travel": "free"})
    assert shown.words()["kind"] == "singular"
    assert panel(shown, "z2")["series"][0]["y"]


def test_obstacles_are_drawn() -> None:
    shown = screen("obstacle", **{"goal.travel": 0.82})
    assert panel(shown, "plane")["discs"] == [[2.2, 1.75, 0.3]]


def test_obstacles_and_links_have_sliders() -> None:
    shown = screen("obstacle", samples=0, **{"goal.travel": 0.82})
    shown.change([("obstacles:0:centre_m:0", 2.5), ("obstacles:0:centre_m:1", -1.0)])
    shown.change([("obstacles:0:radius_m", 0.2), ("system.link_lengths:2", 1.3)])
    problem = shown.outcome.problem
    assert problem is not None
    assert [[*disc.centre, disc.radius] for disc in problem.obstacles] == [[2.5, -1.0, 0.2]]
    np.testing.assert_allclose(problem.system.link_lengths, [1, 1, 1.3])  # type: ignore[attr-defined]
    plain = screen("paper", samples=0)  # its file has no lengths, which are 1 then
    plain.change([("system.link_lengths:1", 0.5)])
    np.testing.assert_allclose(plain.outcome.problem.system.link_lengths, [1, 0.5, 1])  # type: ignore[union-attr]
    assert "obstacles:0:radius_m" not in plain.controls


def test_start_goal_and_obstacles_have_handles_in_the_plane() -> None:
    shown = screen("obstacle", "collocation", samples=0)
    handles = {tuple(h["names"]): h for h in panel(shown, "plane")["handles"]}
    assert sum(set(names) <= set(shown.controls) for names in handles) == 7
    assert handles["obstacles:0:centre_m:0", "obstacles:0:centre_m:1"]["at"] == [2.2, 1.75]
    elbow = handles[("goal.theta_deg:1",)]
    step = np.subtract(elbow["at"], elbow["pivot"])
    assert np.rad2deg(np.arctan2(*step[::-1])) - elbow["zero"] == pytest.approx(30, abs=1e-6)

    def shown_handles(name: str) -> list[Any]:
        shown = screen(name, "collocation", samples=0)
        found = [h["names"] for h in panel(shown, "plane")["handles"]]
        return [names for names in found if set(names) <= set(shown.controls)]

    start = [[f"start.theta_deg:{k}"] for k in range(3)]
    assert shown_handles("tip") == [*start, ["goal.tip_m:0", "goal.tip_m:1"]], "its angles are free"
    assert shown_handles("car") == [["start.x_m", "start.y_m"], ["goal.x_m", "goal.y_m"]]


def test_an_impossible_setting_is_said_and_can_be_taken_back() -> None:
    shown = screen("paper")
    shown.change([("limits.joint_deg", 10.0)])
    assert shown.words()["kind"] == "bad input"
    assert "theta1 = 30 deg lies outside its limit of 10 deg" in shown.words()["text"]
    assert shown.picture()["panels"] == []
    shown.change([("limits.joint_deg", 80.0)])
    assert shown.words()["kind"] == "not judged yet"


def test_the_verdict_waits_for_the_judge() -> None:
    shown = screen("paper", "collocation")
    assert shown.words()["kind"] == "not judged yet"
    shown.judge()
    assert shown.words()["kind"] == "verified"
    assert shown.plan().verified
    shown.change([("method", "polynomial"), ("goal.travel", 0.8)])
    assert shown.words()["kind"] == "not judged yet"
    shown.judge()
    assert shown.words()["kind"] == "verification failed"
    assert "input u2 reaches" in shown.words()["text"]


def test_constraint_points_start_on_the_path_and_are_dragged_by_both_their_controls() -> None:
    shown = screen("paper", **{"goal.travel": 0.82})
    free = panel(shown, "z2")["series"][0]["y"]
    shown.change([("method.polynomial.points", "one")])
    assert np.allclose(panel(shown, "z2")["series"][0]["y"], free, atol=2e-4)
    (point,) = panel(shown, "z2")["handles"]
    time_name, z2_name = point["names"]
    shown.change([(time_name, 6.0), (z2_name, -0.3)])
    assert shown.state.value("method.polynomial.points") == [[6.0, -0.3]]
    assert shown.outcome.plan.z(6.0)[1] == pytest.approx(-0.3, abs=1e-9)


def test_the_machine_can_be_changed_effect_by_effect() -> None:
    shown = screen("paper", samples=3, **{"goal.travel": 0.8286, "goal.duration": 30.0})
    error = shown.errors()["error"]
    shown.change([("machine.backlash_deg:value", None)])
    assert not shown.controls["machine.backlash_deg:value"].on
    stiffer = shown.errors()["error"]
    assert stiffer["series"][0]["y"][-1] < 0.8 * error["series"][0]["y"][-1]
    shown.change([("machine.backlash_deg:value", 4.0)])
    spread = planner.Machine.prototype().effects["backlash_deg"].spread[0]
    assert shown.state.value("machine.backlash_deg") == {"value": 4.0, "spread": spread}
    shown.change([("samples", 0)])
    assert shown.errors()["error"] is None


@pytest.mark.parametrize("name", ["paper", "car", "custom"])
def test_code_and_problem_file_give_the_plan_on_the_screen(name: str, tmp_path: Path) -> None:
    shown = screen(name, samples=0)
    travel = shown.controls[shown.outcome.problem.travel_key]  # type: ignore[union-attr]
    end = 0.825 if name == "paper" else travel.shown * 1.01
    shown.change([(travel.name, end), ("goal.duration", 30.0)])
    times = np.linspace(0, 30, 50)
    wanted = shown.outcome.plan.z(times)

    text = shown.texts()
    file = tmp_path / "mine.toml"
    file.write_text(text["file"], encoding="utf-8")
    again = path(State(planner.load_problem(file), "polynomial")).plan
    assert np.array_equal(again.z(times), wanted)
    assert tomllib.loads(text["file"])["goal"]["duration"] == 30.0
    assert all("[" not in line or "]" in line for line in text["file"].splitlines())

    names: dict[str, Any] = {}
    exec(text["code"].split("plan =")[0], names)
    assert names["problem"] == shown.outcome.problem


def test_a_problem_without_a_file_is_written_out_in_the_code() -> None:
    problem = planner.load_problem(ROOT / "problems" / "paper.toml")
    problem = planner.Problem.from_dict(problem.with_travel(0.82).to_dict(), "no file")
    state = State.from_problem(problem, "polynomial", 0).with_value("limits.joint_deg", None)
    names: dict[str, Any] = {}
    exec(Screen(state).texts()["code"].split("plan =")[0], names)
    assert names["problem"] == planner.Problem.from_dict(names["data"])
    assert "joint_deg" not in names["data"]["limits"]


@pytest.mark.parametrize("method", list(planner.METHODS))
def test_every_option_control_writes_what_the_method_takes(method: str) -> None:
    problem = planner.load_problem(ROOT / "problems" / "paper.toml", {"goal.travel": 0.82})
    shown = Screen(State.from_problem(problem, "polynomial", 0))
    shown.set([("method", method)])
    for control in shown.controls.values():
        values = control.choices or [control.low, control.high]
        for value in [True, False] if control.kind == "switch" else values:
            state = shown.state.with_value(control.key, control.new_value(value))
            if control.key.startswith(("method.", "machine.", "goal.duration", "goal.travel")):
                state.problem()  # the schema takes it


def test_a_start_state_of_numbers_can_be_left_and_chosen_again() -> None:
    told = [1.0, 0.5, -0.2, 0.25]
    problem = planner.load_problem(
        ROOT / "problems" / "paper.toml", {"goal.travel": 0.82, "machine.start_state": told}
    )
    shown = Screen(State.from_problem(problem, "polynomial", 0))
    control = shown.controls["machine.start_state"]
    assert control.shown == "joint by joint"
    assert control.new_value("joint by joint") == told
    assert control.new_value("backward") == "backward"


def test_start_goal_and_gears_have_sliders_of_their_own() -> None:
    shown = screen("paper", "collocation")
    groups = list(dict.fromkeys(control.group for control in shown.controls.values()))
    assert groups[:3] == ["System", "Start", "Goal"]
    found = {control.name: control for control in shown.controls.values()}
    assert [found[f"start.theta_deg:{k}"].label for k in range(3)] == ["θ₁", "θ₂", "θ₃"]
    shown.change([("start.theta_deg:1", 5.0), ("goal.theta_deg:0", 40.0), ("system.K:0", 0.9)])
    plan = shown.outcome.plan
    np.testing.assert_allclose(np.rad2deg(plan.q(0.0)[1:]), [1, 5, 1], atol=1e-9)
    assert np.rad2deg(plan.q(plan.duration)[1]) == pytest.approx(40, abs=1e-3)
    assert plan.problem.system.K[0] == 0.9  # type: ignore[attr-defined]


def test_gear_geometry_has_sliders_too() -> None:
    gear = {"r1": 20.0, "R": 23.0, "r3": 14.0, "lambda": 1.0, "eta": 1.0}
    data = planner.load_problem(ROOT / "problems" / "paper.toml").to_dict()
    data["system"] = {"kind": "manipulator", "joints": 3, "gear": gear}
    shown = Screen(State.from_problem(planner.Problem.from_dict(data, "geared"), "collocation", 0))
    own = {c.label: c.shown for c in shown.controls.values() if c.key.startswith("system.gear.")}
    assert own == gear
    before = shown.outcome.problem
    shown.change([("system.gear.R", 25.0)])
    after = shown.outcome.problem
    assert after.system.K[0] != before.system.K[0]  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["car", "custom", "trailers", "unicycle", "ball-gear"])
def test_every_kind_has_sliders_for_its_ends(name: str) -> None:
    shown = screen(name, samples=0)
    for table in ("start", "goal"):
        own = [c for c in shown.controls.values() if c.key.startswith(f"{table}.")]
        assert len(own) >= 3
        for control in own:
            assert control.low <= control.shown <= control.high, control.name


def test_a_joint_more_is_like_the_last_one_and_goes_again() -> None:
    shown = screen("paper", "collocation", **{"goal.travel": "free", "limits.z2_margin": None})
    ratio = 0.711625 / 0.870125
    shown.change([("system.joints", 4)])
    problem = shown.outcome.problem
    np.testing.assert_allclose(problem.system.K, [0.870125, 0.711625, 0.711625 * ratio])
    np.testing.assert_allclose(np.rad2deg(problem.goal[1:]), [30, 30, 30, 30])
    assert "goal.theta_deg:3" in shown.controls
    assert panel(shown, "joints")["series"][3]["name"] == "θ₄"
    shown.change([("system.joints", 2)])
    assert "goal.theta_deg:2" not in shown.controls
    shown.change([("system.joints", 3)])
    again = shown.outcome.problem
    np.testing.assert_allclose(again.system.K, [0.870125, 0.711625])
    np.testing.assert_allclose(np.rad2deg(again.start[1:]), [1, 1, 1])


def test_the_map_shows_the_chart_s_edges_and_the_path() -> None:
    chart = panel(screen("paper"), "map")
    assert chart["region"] == [[0.0, 90.0], [0.0, 90.0]]  # of one sign, see `chart_margins`
    np.testing.assert_allclose(chart["ends"], [[1, 1], [30, 30]])
    np.testing.assert_allclose([chart["series"][0][axis][-1] for axis in "xy"], [30, 30], atol=1e-3)
    assert panel(screen("ball-gear"), "map")["region"] == [[-90.0, 90.0], [-90.0, 90.0]]
    assert not any(p["id"] == "map" for p in screen("car").picture()["panels"])
    away = panel(screen("parking", "collocation"), "map")
    assert min(away["series"][0]["y"]) < away["region"][1][0] == 0.0, "the path leaves the chart"


def test_planning_ends_at_the_explorer_s_time_limit() -> None:
    problem = planner.load_problem(ROOT / "problems" / "paper.toml")
    shown = Screen(State.from_problem(problem, "collocation", 0, time_limit_s=1e-4))
    assert shown.words()["kind"] == "time limit"
    assert "the time limit of 0.0001 s ended" in shown.words()["text"]
    own = problem.changed({"method.collocation.time_limit_s": 20.0})
    assert (
        Screen(State.from_problem(own, "collocation", 0, time_limit_s=1e-4)).outcome.plan
        is not None
    )


def test_the_facts_have_units_and_the_time_waited() -> None:
    said = screen("paper", "collocation").words()["facts"]
    assert re.fullmatch(r"planned in [\d.]+ s", said)


def test_a_plan_s_figures_are_those_of_a_comparison_with_its_sensitivity() -> None:
    shown = screen("paper", "collocation", samples=3)
    plan = shown.plan()
    row = {title: (unit, value) for title, unit, value in shown.errors()["row"]}
    run = planner.replay(plan, samples=3, seed=0)
    assert row["effort"] == ("rad²/s", plan.effort)
    assert [row[f"|u{k}|"][1] for k in (1, 2)] == plan.peak_u.tolist()
    assert row["time"] == ("s", 10.0)
    assert row["E 50 %"][1] == pytest.approx(np.median(run.index_E_deg), rel=0.1)  # finer record
    fine = planner.sensitivity(plan).passive_block_deg()
    assert row["sensitivity"] == ("deg", pytest.approx(fine, rel=1e-5))
    shown.change([("samples", 0)])
    alone = {title: value for title, _, value in shown.errors()["row"]}
    assert alone["effort"] == plan.effort
    assert alone["E 50 %"] is None
    assert screen("paper-fig5").errors()["row"] == [], "no real angles"


def test_the_bars_are_the_ends_that_each_error_moves_and_follow_the_weight() -> None:
    shown = screen("paper", "collocation", samples=0)
    plan = shown.plan()
    bars = {name: (size, deg) for name, size, deg in shown.errors()["bars"]}
    found = planner.sensitivity(plan)
    moved = np.zeros(4)
    for name, change in (("start theta1", np.deg2rad(0.5)), ("gain u1", 0.01)):
        moved = np.rad2deg(change * found.terminal[1:, found.parameters.index(name)])
        assert bars[name][1] == pytest.approx(np.linalg.norm(moved), rel=1e-3)
    assert (bars["start theta1"][0], bars["gain u1"][0]) == ("0.5 deg", "1 %")
    assert set(bars) == set(found.parameters)
    shown.change([("method", "desensitised")])
    calm = {name: deg for name, _, deg in shown.errors()["bars"]}
    assert calm["start theta1"] < 0.8 * bars["start theta1"][1]
    assert screen("paper-fig5").errors()["bars"] == [], "no real angles"


def test_feedback_follows_the_plan_and_the_code_says_so() -> None:
    shown = screen("paper", "collocation", samples=2)
    before = shown.errors()
    shown.change([("feedback", True)])
    after = shown.errors()
    e = [title for title, *_ in after["row"]].index("E 50 %")
    assert after["row"][e][2] < 0.1 * before["row"][e][2]
    assert "samples=2, seed=0, feedback=True" in shown.texts()["code"]
    assert "feedback" not in shown.state.changes_from_base()


def test_feedback_that_cannot_follow_says_why_and_the_plan_s_figures_stay() -> None:
    shown = screen("unreachable", "collocation", samples=1)
    shown.change([("feedback", True)])
    said = shown.errors()
    assert "feedback cannot follow" in said["why"]
    assert (said["error"], said["machine"]) == (None, None)
    assert said["row"][0][0] == "effort"


def test_a_system_that_cannot_be_drawn_has_a_machine_s_motion() -> None:
    assert "heading" in screen("front-axle", "collocation", samples=1).errors()["machine"]["names"]


def test_the_median_machine_s_motion_is_that_of_the_replay() -> None:
    motion = screen("paper", "collocation", samples=3).errors()["machine"]
    assert motion["names"] == ["θ₁", "θ₂", "θ₃"]
    assert (motion["t"][0], motion["t"][-1]) == (0.0, 10.0)
    assert len(motion["values"]) == len(motion["t"])
    assert 1 < abs(motion["values"][-1][2] - 30) < 10, "play and torsion"


def test_the_second_plan_is_of_another_method_and_changes_nothing() -> None:
    shown = screen("paper", "collocation", samples=2)
    before = shown.state
    other = shown.second()["second"]
    assert (other["label"], other["kind"]) == ("polynomial", "verified")
    assert shown.state is before
    assert shown.outcome.plan is not None
    assert shown.outcome.plan.method == "collocation"
    z2 = next(p for p in other["panels"] if p["id"] == "z2")
    assert z2["handles"], "its chosen point"
    mine = {title: value for title, _, value in shown.errors()["row"]}
    its = {title: value for title, _, value in other["row"]}
    assert mine["effort"] < its["effort"]
    json.dumps(other, allow_nan=False)
    shown.change([("method", "polynomial"), ("compensation.on", True)])
    assert shown.second()["second"]["label"] == "collocation compensated"


def test_a_car_has_angles_and_an_arm_joints() -> None:
    assert panel(screen("car", samples=0), "joints")["title"] == "angles"
    assert panel(screen("paper", samples=0), "joints")["title"] == "joints"
    places = panel(screen("front-axle", "collocation", samples=0), "joints")
    assert (places["title"], places["unit"]) == ("coordinates", "m")


def test_a_plan_that_may_leave_the_chart_says_so() -> None:
    shown = screen("parking", "collocation")
    shown.judge()
    assert shown.words()["kind"] == "verified"
    assert "leaves the chart, as this method may" in shown.words()["facts"]


def test_what_was_stopped_before_it_was_fine_enough_is_called_stopped() -> None:
    shown = screen("paper")  # its input is too large
    plan = shown.outcome.plan
    assert plan is not None
    early = replace(plan, status="interrupted", notes={"ended_early": "the Stop button ended it"})
    outcome = judge(replace(shown.outcome, plan=early))
    assert outcome.kind == "stopped"
    assert isinstance(outcome.error, planner.TimeLimitError)
    assert outcome.error.advice is None, "no limit was reached that could be larger"


def test_plans_are_compensated_for_the_machine_where_that_is_on() -> None:
    shown = screen("paper", "collocation", samples=3, **{"goal.travel": "free"})
    before = panel(shown, "joints")["series"][0]["y"][-1]
    error = shown.errors()["error"]
    shown.change([("compensation.on", True)])
    assert shown.outcome.kind == "verified"
    assert shown.outcome.plan.compensation is not None
    assert "no better" not in shown.words()["facts"]
    said = {**shown.outcome.plan.notes["compensation"], "plain_E_deg": 0.0}
    worse = replace(shown.outcome.plan, notes={"compensation": said})
    line = path_line(replace(shown.outcome, plan=worse), 1.0)
    assert "no better than 0 deg uncompensated" in line
    effort = shown.errors()["row"][0]
    assert effort[:2] == ["effort", "rad²/s"]
    assert effort[2] == pytest.approx(1.0, abs=0.1), "of the commands, as comparisons have it"
    less = shown.errors()["error"]
    assert max(less["series"][0]["y"]) < 0.5 * max(error["series"][0]["y"])
    assert panel(shown, "joints")["series"][0]["y"][-1] == pytest.approx(before, abs=0.1)
    assert '"compensation.on": True' in shown.texts()["code"].replace("'", '"')
    shown.change([("compensation.on", False)])
    assert shown.outcome.plan.compensation is None
    assert "compensation.on" not in screen("ball-gear").controls


def test_only_an_arm_of_friction_disks_has_a_mechanism_to_draw() -> None:
    assert screen("ball-gear").picture()["system"] == ""
    assert screen("ball-gear").mechanism()["mechanism"] == ""


def test_reset_goes_back_to_what_was_shown_first() -> None:
    shown = screen("paper", samples=2)
    first = shown.state
    shown.change([("goal.travel", 0.81), ("method", "convex"), ("samples", 0)])
    shown.reset()
    assert shown.state == first
    assert shown.outcome.state == first


def test_with_more_joints_a_limit_on_z2_that_no_motion_keeps_is_switched_off() -> None:
    shown = screen("paper", "collocation", samples=0, **{"goal.travel": "free"})
    shown.change([("system.joints", 4)])
    assert shown.outcome.kind != "bad input"
    assert not shown.controls["limits.z2_margin"].on
    assert {"system.K:2", "start.theta_deg:3", "goal.theta_deg:3"} <= set(shown.controls)
    shown.reset()
    shown.change([("system.joints", 5)])
    assert shown.controls["limits.z2_margin"].on, "z2 has the same sign at start and goal"


def test_unknown_controls_and_arguments_are_named(paper: planner.Problem) -> None:
    with pytest.raises(InputError, match=r"goal\.travle.*goal\.travel"):
        screen("paper").change([("goal.travle", 1.0)])
    with pytest.raises(InputError, match="samples = -1"):
        planner.explore(paper, samples=-1)
    with pytest.raises(InputError, match=r"polynomal.*polynomial"):
        planner.explore(paper, "polynomal")


@pytest.mark.parametrize("missing", ["anywidget", "ipywidgets"])
def test_the_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, paper: planner.Problem, missing: str
) -> None:
    import sys

    for name in [each for each in sys.modules if each.split(".")[0] in ("anywidget", "ipywidgets")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "planner.explorer.widget", raising=False)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(InputError, match=re.escape(how_to_install("notebook"))):
        planner.explore(paper)


def test_numbers_are_shortened_without_visible_change() -> None:
    values = np.array([1.0 / 3, np.nan, -200.0, 1e-30, 123456.7, 8.123456e-7])
    assert to_screen_digits(values) == [0.33333, None, -200.0, 0.0, 123460.0, 8.1235e-7]


def test_judging_twice_changes_nothing(paper: planner.Problem) -> None:
    once = judge(path(State(paper, "collocation")))
    assert judge(once) is once
