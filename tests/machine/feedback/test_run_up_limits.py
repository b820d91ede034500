"""The preparatory motion of feedback keeps the limits that the plan keeps, on the machines too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import planner
from planner import InputError, Machine, Plan, Replay, Tracker
from planner.machine.feedback import run_up as module
from planner.machine.feedback.run_up import hindrance, run_up
from planner.problem.tables.problem_file import FeedbackTable

PAPER = Path(__file__).parents[3] / "problems/paper.toml"
MACHINE = Machine.prototype(step_s=0.005)
RADIUS_M, REACH_M = 0.15, 3.0


@pytest.fixture(scope="module")
def plan() -> Plan:
    problem = planner.load_problem(PAPER)
    return planner.solve(problem, "collocation", intervals=20)


@pytest.fixture(scope="module")
def back() -> Plan:
    """Straightens joint 2."""
    ends = {"start.theta_deg": [30, 30, 30], "goal.theta_deg": [1, 1, 1]}
    problem = planner.load_problem(PAPER, {**ends, "limits.z2_margin": None})
    return planner.solve(problem, "collocation", intervals=20)


def beside(plan: Plan, r: float, angle_deg: float) -> Plan:
    """The plan with a post at polar coordinates."""
    place = r * np.cos(np.deg2rad(angle_deg)), r * np.sin(np.deg2rad(angle_deg))
    post = {"centre_m": [float(x) for x in place], "radius_m": RADIUS_M}
    return replace(plan, problem=plan.problem.changed({"obstacles": [post]}))


def room(plan: Plan, q: np.ndarray) -> np.ndarray:
    """Distance of links at q (…, N) from the post, by points on them; smallest over links."""
    points = plan.problem.system.arm_points(q[..., 1:])[..., None, :]  # type: ignore[attr-defined]
    share = np.linspace(0, 1, 101)[:, None]
    on_links = points[..., :-1, :, :] + share * (points[..., 1:, :, :] - points[..., :-1, :, :])
    (post,) = plan.problem.obstacles
    return np.asarray(np.linalg.norm(on_links - post.centre, axis=-1).min(axis=(-1, -2)) - RADIUS_M)


def followed(plan: Plan, samples: int = 8) -> Replay:
    return planner.replay(plan, MACHINE, samples, feedback=True, record_s=0.05)


def test_a_post_in_the_usual_swing_is_passed_on_the_other_side(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = beside(plan, 3.0, 57).problem
    hit = planner.solve(task, "collocation", intervals=20)
    usual, found = (run_up(each, MACHINE, FeedbackTable()) for each in (plan, hit))
    assert usual is not None
    assert found is not None
    assert room(hit, usual.q).min() < -0.14
    assert room(hit, found.q).min() > 2
    assert np.rad2deg(found.q[:, 1].min()) < -60
    run = followed(hit)
    assert run.t[0] == pytest.approx(Tracker().design(hit, MACHINE).ref.timing.begin)
    assert run.t[0] < -8
    assert room(hit, run.q[:, run.t < 0]).min() > 2
    assert run.joint_1_range_deg[0] == pytest.approx(-62.5, abs=0.5)
    assert np.rad2deg(run.q[:, run.t < 0, 1].max()) == pytest.approx(1.4, abs=0.5)
    assert run.percentile(95) < 1.5 * followed(plan).percentile(95)  # 3.8 degrees without a run-up
    monkeypatch.setattr(module, "_breach", lambda *given: "")
    run = followed(hit)
    assert run.physical_share == 1
    worst = min((each for each in run.limits if each.requirement.physical), key=lambda m: m.worst)
    assert worst.broken == len(run.numbers)
    assert -4 < worst.t_s < -2
    assert worst.worst == pytest.approx(room(hit, run.q).min(), abs=1e-3)
    assert worst.worst < -0.1
    assert f"{worst}" in run.limit_words
    assert "clearance_m" not in run.limit_words  # it is for the plan


def test_where_no_swing_fits_there_is_none_and_the_reason_is_told(plan: Plan) -> None:
    shut = beside(plan, 2.4, -10)
    assert room(shut, plan.q(np.linspace(0, plan.duration, 400))).min() > 0.3
    assert run_up(shut, MACHINE, FeedbackTable()) is None
    why = hindrance(shut, MACHINE)
    told = "there is no room to take up the play before the start: clearance of link 3 from"
    assert why.startswith(told)
    with pytest.raises(InputError, match=r"feedback\.run_up = true: "):
        Tracker(run_up=True).design(shut, MACHINE)
    assert followed(shut, 2).t[0] == 0
    result = planner.compare(shut.problem, ["collocation"], samples=2, feedback=True)
    assert result.rows[1].note.startswith(told)
    assert f"{result.rows[1].label}: {told}" in result.markdown()
    assert "swings" not in result.headline


def test_a_clearance_that_is_told_is_kept(back: Plan) -> None:
    near = beside(back, 2.4, 100)
    (post,) = near.problem.to_dict()["obstacles"]
    wide = {"obstacles": [{**post, "clearance_m": 0.3}]}
    told = replace(back, problem=back.problem.changed(wide))
    swings = [run_up(each, MACHINE, FeedbackTable()) for each in (near, told)]
    nearest = [room(near, swing.q).min() for swing in swings if swing]
    assert 0.05 * REACH_M <= nearest[0] < 0.3 <= nearest[1]


def test_a_plan_that_straightens_joint_2_swings_to_the_side_of_its_start(back: Plan) -> None:
    """On the other side one machine in sixteen missed by twelve degrees."""
    hit = beside(back, 1.8, 80)
    usual, found = (run_up(each, MACHINE, FeedbackTable()) for each in (back, hit))
    assert usual is not None
    assert found is not None
    assert room(hit, usual.q).min() < -0.1 < 0.05 * REACH_M < room(hit, found.q).min()
    assert -1 < np.rad2deg(found.q[:, 1].min()) < np.rad2deg(found.q[:, 1].max()) < 51
    assert room(hit, followed(hit, 4).q).min() > 0


def test_before_the_start_theta1_stays_near_the_range_of_the_run_up(back: Plan) -> None:
    """The tracker's corrections of theta1 took it several degrees beyond."""
    found = run_up(back, MACHINE, FeedbackTable())
    assert found is not None
    run = followed(back, 12)
    early = np.rad2deg(run.q[:, run.t < 0, 1])
    low, high = np.rad2deg([found.q[:, 1].min(), found.q[:, 1].max()])
    assert early.min() > low - 1.5
    assert early.max() < high + 1.5


IN_THE_WAY = [(1.2, 50), (1.2, 60), (1.8, 60), (2.4, 60), (2.9, 350), (1.27, 64), (3.08, 57)]
IN_THE_WAY_BACK = [(1.2, 70), (1.2, 80), (1.8, 80), (2.4, 100), (2.8, 100), (1.62, 91)]
"""Posts that the plan clears and its usual run-up hits, or nearly: of grids and random places."""


def test_without_limits_of_the_inputs_the_run_up_is_no_faster_than_the_servos_follow() -> None:
    """It went at the motors' 3 rad/s, and E was 14.5 degrees; limits of 0.5 rad/s give 0.2."""
    problem = planner.load_problem(PAPER, {"limits.input_rad_s": None})
    run = followed(planner.solve(problem, "collocation", intervals=20))
    assert run.percentile(50) < 0.4
    assert run.run_s > run.plan.duration + 3.0


def test_no_machine_touches_a_post_before_the_start(plan: Plan, back: Plan) -> None:
    passed = 0
    for each, places in ((plan, IN_THE_WAY), (back, IN_THE_WAY_BACK)):
        for place in places:
            other = beside(each, *place)
            if run_up(other, MACHINE, FeedbackTable()) is not None:
                run = followed(other, 3)
                assert room(other, run.q[:, run.t < 0]).min() > 0
                passed += 1
    assert passed > 8
