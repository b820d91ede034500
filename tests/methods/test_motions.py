"""Excitation and homing: motions within the limits that do what they are for."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from planner import (
    HomingRule,
    InputError,
    InputWarning,
    Machine,
    Player,
    Problem,
    VerificationError,
    check_run,
    compensate,
    emulate_log,
    excitation,
    export,
    homing,
    load_plan,
    load_problem,
    load_samples,
    replay,
    seating,
    solve,
)

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("make", [excitation, check_run, homing, seating])
@pytest.mark.parametrize(
    "name",
    [
        "paper",
        "obstacle",
        pytest.param("four-joint", marks=pytest.mark.campaign),
        pytest.param("crossing", marks=pytest.mark.campaign),
    ],
)
def test_a_motion_is_a_verified_plan_from_the_start(
    name: str, make: object, tmp_path: Path
) -> None:
    problem = load_problem(PROBLEMS / f"{name}.toml", {"limits.input_rate_rad_s2": 2.0})
    plan = make(problem)  # type: ignore[operator]
    assert plan.verified
    np.testing.assert_array_equal(plan.q(0.0), problem.start)
    t = np.linspace(0, plan.duration, 20001)
    u = plan.u(t)
    assert np.all(np.abs(u).max(axis=0) <= 0.9 * problem.limits.input + 1e-9)
    assert np.all(np.abs(np.diff(u, axis=0)).max(axis=0) / np.diff(t)[0] <= 0.9 * 2.0 + 1e-6)
    np.testing.assert_array_equal(u[[0, -1]], 0.0)
    assert load_plan(plan.save(tmp_path / "a.json"), strict=True) == plan
    samples = load_samples(export(plan, tmp_path / "a.csv"))
    np.testing.assert_allclose(samples.u[-1], 0.0)


def test_in_a_check_run_every_joint_reverses_more_than_once(paper: Problem) -> None:
    """On machines, too: their joints stand still until the axis has crossed the lost motion."""
    q = replay(check_run(paper), Machine.prototype(), 20).q
    for theta in np.moveaxis(np.rad2deg(q[:, :, 1:]), 2, 0):
        for course in theta:
            turns, way, last = 0, 0, course[0]
            for angle in course:
                if abs(angle - last) > 1.0:
                    turns += way * (angle - last) < 0
                    way, last = np.sign(angle - last), angle
            assert turns >= 2


def test_an_excitation_reverses_the_drive_and_swings_joint_1(paper: Problem) -> None:
    plan = excitation(paper)
    assert plan.duration == pytest.approx(30.0)
    t = np.linspace(0, 30, 3001)
    u, q = plan.u(t), np.rad2deg(plan.q(t))
    moving = np.sign(u[:, 0])[np.abs(u[:, 0]) > 0.2]
    assert np.sum(np.diff(moving) != 0) == 11  # a period of 5.3 s
    assert np.ptp(q[:, 1]) > 60
    assert np.ptp(q[:, 2:], axis=0).min() > 20


def test_an_excitation_is_made_smaller_until_the_joints_keep_their_limits(paper: Problem) -> None:
    narrow = paper.changed({"limits.joint_deg": 35, "goal.theta_deg": [20, 20, 20]})
    plan = excitation(narrow)
    assert plan.notes["size"] < 1
    assert np.rad2deg(np.abs(plan.q(plan.t)[:, 1:])).max() <= 35
    with pytest.raises(InputError, match="the excitation motion has an end that is not allowed"):
        excitation(paper.changed({"limits.joint_deg": 5, "goal.theta_deg": [2, 2, 2]}))
    with pytest.raises(VerificationError, match="the homing motion breaks 1 requirement"):
        homing(
            paper.changed(
                {
                    "start.theta_deg": [1, -8, 1],
                    "limits": {"joint_deg": [80, 22, 80]},
                    "goal.theta_deg": [2, 2, 2],
                }
            )
        )


@pytest.mark.parametrize("make", [excitation, homing, seating])
def test_a_motion_is_for_arms_with_friction_disks(make: object) -> None:
    with pytest.raises(InputError, match="is for arms with friction disks"):
        make(load_problem(PROBLEMS / "car.toml"))  # type: ignore[operator]


def test_homing_wants_axes_that_turn(paper: Problem) -> None:
    with pytest.raises(InputError, match="bring joints 1 to n-1 nearer to 0 degrees"):
        homing(paper.changed({"start.theta_deg": [60, 1, 1], "limits.z2_margin": None}))


def test_joints_with_inertia_rest_when_homing_has_pushed_them(paper: Problem) -> None:
    """They ran ahead of their axes by 0.9 degrees when joint 1 stopped quickly."""
    arm = Machine.prototype(fidelity="dynamic").nominal()
    run = replay(homing(paper), arm, feedback=HomingRule(), record_s=0.01)
    stopped = np.max(np.flatnonzero(np.abs(run.motor_rates[0, :, 0]) > 0.01))
    theta = np.rad2deg(run.q[0, :, 2:])
    assert np.max(np.abs(theta[-1] - theta[stopped])) < 0.2


def test_homing_by_the_encoders_pushes_every_joint_of_every_machine(paper: Problem) -> None:
    """Spreads and starts in the backlash far beyond the prototype's; nobody tells the rule of w."""
    plan = homing(paper)
    machine = Machine.prototype(
        backlash_deg={"value": 4.0, "spread": 2.0}, initial_play={"value": 0.0, "spread": 5.0}
    )
    run = replay(plan, machine, samples=40, feedback=HomingRule(), record_s=0.01)
    theta = np.rad2deg(run.q[:, :, 1:])
    after = run.t > plan.notes["until"]["count_from_s"]
    risen = theta[:, -1, 1:] - theta[:, after, 1:].min(axis=1)
    assert plan.notes["end_state"] == [1, 1, 1, 1]
    assert run.end_state[:, 2:].min() > 0.9  # drift turns gearheads back at rest
    assert risen.min() > 1.3  # 1.5, less the encoder's resolution twice
    slowing = np.rad2deg(0.075 * 0.75 / 2) * 0.476  # of the last axis, in its ramp
    assert np.median(risen.min(axis=1)) < 2.0 + slowing  # it ends as soon as all have risen
    # Joint 1 moves last, when the drive stands.
    last = np.argmax(np.abs(theta[:, :, 0] - theta[:, -1:, 0]) < 0.1, axis=1)
    drive = np.array([np.max(np.flatnonzero(np.abs(u) > 0.01)) for u in run.motor_rates[:, :, 0]])
    assert np.all(drive < last)


def test_seating_without_readings_leaves_an_arm_as_homing_does(paper: Problem) -> None:
    arm = Machine.prototype(start_state="unknown")
    plan = seating(paper, arm)
    assert plan.duration < 5.5 < 8 < homing(paper).notes["until"]["to_s"]
    shares = replay(plan, arm, samples=300, seed=1, record_s=None).end_state[:, 2:]
    assert np.mean(shares.min(axis=1) > 0.999) > 0.98
    assert plan.notes["end_state"] == [1, 1, 1, 1]
    known = arm.nominal()
    sure = seating(paper, known)
    assert sure.duration < plan.duration - 0.5
    assert replay(sure, known, samples=100, record_s=None).end_state[:, 2:].min() > 0.999


def test_seating_wants_axes_that_turn(paper: Problem) -> None:
    with pytest.raises(InputError, match="bring joints 1 to n-1 nearer to 0 degrees"):
        seating(paper.changed({"start.theta_deg": [60, 1, 1], "limits.z2_margin": None}))


def test_noise_of_the_encoders_does_not_end_homing_early(paper: Problem) -> None:
    """Readings of a joint at rest differ by 3 degrees here, twice the usual rise."""
    late = Machine.prototype(step_s=0.005, backlash_deg=10.0)
    plan, machine = homing(paper), late.with_(encoder_noise_deg=0.5)
    run = replay(plan, machine, samples=20, feedback=HomingRule(), record_s=0.01)
    theta = np.rad2deg(run.q[:, run.t > plan.notes["until"]["count_from_s"], 2:])
    assert (theta[:, -1] - theta.min(axis=1)).min() > 0.5


def test_the_homing_rule_refuses_other_plans(paper: Problem) -> None:
    with pytest.raises(InputError, match=r"not made by planner\.homing"):
        replay(solve(paper, "collocation"), feedback=HomingRule())


def test_plans_start_from_the_poses_that_homing_leaves(paper: Problem) -> None:
    """They may have negative angles: z2 then begins on the other side of zero than it ends."""
    for pose in ([3.0, -8.0, -7.0], [2.5, -0.01, 1.0]):
        with pytest.warns(InputWarning, match="limits.z2_margin"):
            there = paper.from_pose(pose)
        np.testing.assert_allclose(np.rad2deg(there.start[1:]), pose)
        assert solve(there, "collocation").verified
    assert paper.from_pose([3.0, 2.0, -9.0]).limits.z2_margin == 0.01


def test_a_player_homes_by_the_encoders_and_ends(paper: Problem) -> None:
    plan, machine = homing(paper), Machine.prototype()
    log = emulate_log(plan, machine, sample=2)
    run = replay(plan, machine, [2], feedback=HomingRule())
    np.testing.assert_allclose(log.pose_deg, np.rad2deg(run.q[0, -1, 1:]), atol=0.03)
    player = Player(plan, noise_deg=machine.encoder_noise_deg)
    played = [player(t, theta) for t, theta in zip(log.t, log.theta_deg, strict=True)]
    sent = np.array([u for u in played if u is not None])
    until = plan.notes["until"]
    assert len(sent) == np.argmax([u is None for u in played]) < 0.6 * plan.duration / 0.01
    assert until["from_s"] < 0.01 * len(sent) - (plan.duration - until["to_s"]) < until["to_s"]
    np.testing.assert_allclose(sent.sum(axis=0), log.u.sum(axis=0), atol=1e-9)


def test_a_player_sends_what_an_export_has(paper: Problem, tmp_path: Path) -> None:
    task = paper.changed({"limits.input_rate_rad_s2": [5.0, 5.0]})
    plan = compensate(solve(task, "collocation"), Machine.prototype().nominal())
    rows = load_samples(export(plan, tmp_path / "a.csv"))
    player = Player(plan)
    sent = [player(t, [0.0, 0.0, 0.0]) for t in rows.t]
    np.testing.assert_allclose(sent, rows.u, atol=1e-12)
    assert not np.any(sent[-1])
    assert player(rows.t[-1] + 0.01, [0.0, 0.0, 0.0]) is None


@pytest.mark.parametrize("period_s", [0.019, 0.3, 20.0])
def test_the_last_command_of_a_player_is_zero_in_a_loop_that_runs_late(
    paper: Problem, period_s: float
) -> None:
    for player in (Player(solve(paper, "collocation")), Player(homing(paper))):
        runs = []
        for _ in "12":  # a second run with the same player, too
            # The joints rise at once, so that a slow turn that waits for this ends as it begins.
            asked = (player(period_s * k, [k, k, k]) for k in itertools.count())
            runs.append([*itertools.takewhile(lambda u: u is not None, asked)])
        np.testing.assert_array_equal(*runs)
        assert len(runs[0]) > 1
        assert not np.any(runs[0][-1])


def test_a_player_needs_a_reading_of_each_joint_but_may_miss_some(paper: Problem) -> None:
    plan = homing(paper)

    def seconds(reading: Callable[[float], float]) -> int:
        player, ticks = Player(plan), 0
        while player(0.01 * ticks, [1.0, rise(0.01 * ticks), reading(0.01 * ticks)]) is not None:
            ticks += 1
        return ticks

    def rise(t: float) -> float:
        return 1.0 + 0.8 * max(0.0, t - 5.0)

    whole = seconds(rise)
    assert whole < 100 * plan.duration
    assert seconds(lambda t: np.nan if 4.895 < t < 4.905 else rise(t)) == whole
    assert (
        seconds(lambda _: np.nan)
        == seconds(lambda _: 1.0)
        == pytest.approx(100 * plan.duration, abs=2)
    )
    for bad in ([], [1.0], [1.0, 1.0], [1.0, 1.0, None], "abc"):
        with pytest.raises(InputError, match="theta_deg"):
            Player(plan)(0.0, bad)
    for bad in (np.nan, "1", None):
        with pytest.raises(InputError, match="t_s"):
            Player(plan)(bad, [1.0, 1.0, 1.0])  # type: ignore[arg-type]
    for bad in (0.0, -1.0, np.nan, "1", True):
        with pytest.raises(InputError, match="period_s"):
            Player(plan, period_s=bad)  # type: ignore[arg-type]
