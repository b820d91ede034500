"""Goals in a row without homing: each plan begins in the state in which the last left the arm."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from planner import InputError, InputWarning, Machine, Manipulator, Plan, Problem, Replay, replay
from planner.machine.feedback.means import lost_motion
from planner.machine.feedforward.legs import unknown_rad

GOALS = [32.0, 32.0, 21.0], [11.0, 2.0, 15.0], [40.0, 26.0, 9.0]
KNOWN = Machine.prototype().nominal()


@pytest.fixture(scope="module")
def tasks(paper: Problem) -> list[Problem]:
    keys = {"limits.z2_margin": None, "goal.travel": "free", "goal.duration": 20.0}
    keys |= {"machine": KNOWN.to_dict(), "compensation.on": True}
    return [paper.changed({**keys, "goal.theta_deg": goal}) for goal in GOALS]


@pytest.fixture(scope="module")
def plans(tasks: list[Problem]) -> list[Plan]:
    out = [planner.solve(tasks[0], "collocation")]
    for task in tasks[1:]:
        out.append(planner.solve(task.after(out[-1]), "collocation"))
    return out


def run_all(plans: list[Plan]) -> list[Replay]:
    """The same machine under one plan after the other."""
    out: list[Replay] = []
    for plan in plans:
        out.append(replay(plan, KNOWN, after=out[-1] if out else None))
    return out


def test_the_goal_again_is_aimed_off_by_the_error(paper: Problem) -> None:
    """The arm rubs more than its machine; it ends nearer the goal each time it starts alike."""
    model = Machine.prototype(encoder_noise_deg=0).nominal().with_(start_state="forward")
    arm = model.with_(coulomb_friction_nm=[0.5, 0.55])
    wanted = paper.changed({"goal.travel": "free", "limits.z2_margin": None})
    goal, task, errors = np.rad2deg(wanted.goal[1:]), wanted, []
    for _ in range(3):
        plan = planner.compensate(planner.solve(task, "collocation"), model)
        pose = np.rad2deg(replay(plan, arm).q[0, -1, 1:])
        errors.append(np.max(np.abs(pose - goal)))
        task = wanted.again(plan, pose)
        np.testing.assert_allclose(task.start, wanted.start, atol=1e-12)
    assert errors[0] > 0.8
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[0] / 6
    with pytest.raises(InputError, match="every joint angle"):
        wanted.again(plan, [1.0, 2.0])


def test_every_goal_is_reached_by_the_machine_that_is_carried_over(plans: list[Plan]) -> None:
    runs = run_all(plans)
    for before, plan, after in zip([None, *runs], plans, runs, strict=False):
        assert after.terminal_E_deg[0] < 0.05
        assert after.end_state[0] == pytest.approx(plan.notes["end_state"], abs=0.01)
        assert np.rad2deg(after.q[0, -1, 1:]) == pytest.approx(
            plan.notes["end_theta_deg"], abs=0.05
        )
        if before is not None:
            assert np.array_equal(after.q[0, 0, 1:], before.q[0, -1, 1:])
            assert np.array_equal(after.draws.start, before.end_state.T)
            assert np.array_equal(after.again([0]).q, after.q)


def test_who_is_not_told_misses_by_more_than_a_degree(
    tasks: list[Problem], plans: list[Plan]
) -> None:
    poses = [plan.notes["end_theta_deg"] for plan in plans]
    not_told = [
        planner.solve(task.from_pose(pose), "collocation")
        for task, pose in zip(tasks[1:], poses, strict=False)
    ]
    for at, plan in enumerate(not_told, start=1):
        runs = run_all([*plans[:at], plan])
        assert runs[-1].terminal_E_deg[0] > 1


def test_a_run_is_carried_over_to_the_same_machines_only(plans: list[Plan]) -> None:
    varied = Machine.prototype()
    before = replay(plans[0], varied, 3, seed=2, record_s=None)
    after = replay(plans[1], varied, [2, 0], seed=2, record_s=None, after=before)
    assert np.array_equal(after.draws.start[:, 1], before.end_state[0])
    assert np.array_equal(after.q[1, 0, 1:], before.q[0, -1, 1:])
    for wrong in ({"seed": 3}, {"samples": 4}, {"machine": KNOWN}):
        given = {"machine": varied, "samples": 3, "seed": 2, **wrong}
        with pytest.raises(InputError, match=r"^after: "):
            replay(plans[1], **given, after=before)  # type: ignore[arg-type]


def test_after_wants_a_plan_that_tells_how_it_leaves_the_arm(
    tasks: list[Problem], plans: list[Plan], paper: Problem
) -> None:
    plain = plans[0].compensates
    assert plain is not None
    with pytest.raises(InputError, match="does not tell the state in which it leaves the arm"):
        tasks[1].after(plain)
    homing = planner.homing(paper)
    with pytest.raises(InputError, match="give the pose read after it, too"):
        tasks[1].after(homing)
    homed = tasks[1].after(homing, [3.0, 4.0, 5.0])
    assert Machine.from_table(homed.machine) == KNOWN.with_(start_state=[1, 1, 1, 1])
    assert np.rad2deg(homed.start[1:]) == pytest.approx([3, 4, 5])
    other = paper.changed({"system.k_g": 0.5})
    with pytest.raises(InputError, match="of another arm"):
        other.after(plans[0])
    softer = tasks[1].changed({"machine.backlash_deg": 5.0})
    with pytest.raises(InputError, match="backlash_deg"):
        softer.after(plans[0])
    assert softer.after(homing, [3.0, 4.0, 5.0]).machine.start_state == [1, 1, 1, 1]


def test_an_arm_of_any_past_is_seated_read_once_and_ends_at_the_goal(tasks: list[Problem]) -> None:
    """Where a plan that is told nothing is off by the lost motion: up to 4.7 degrees."""
    anyhow = KNOWN.with_(start_state="unknown")
    seat = planner.seating(tasks[0])
    seated = replay(seat, anyhow, 3, seed=4, record_s=None)
    assert np.ptp(seated.draws.start[2], axis=-1) > 0.5
    for sample in range(3):
        task = tasks[0].after(seat, np.rad2deg(seated.q[sample, -1, 1:]))
        plan = planner.solve(task, "collocation")
        run = replay(plan, anyhow, [sample], seed=4, record_s=None, after=seated)
        assert run.terminal_E_deg[0] < 0.1


def test_an_unknown_state_is_said_with_its_bound(tasks: list[Problem]) -> None:
    arm = tasks[0].system
    assert isinstance(arm, Manipulator)
    task = tasks[0].changed({"machine.start_state": "unknown"})
    with pytest.warns(InputWarning, match=r"\b4\.7 deg"):
        plan = planner.solve(task, "collocation")
    known = KNOWN.with_(start_state="unknown")
    ends = replay(plan, known, 100, record_s=None).terminal_E_deg
    bound = plan.notes["compensation"]["unknown_deg"]
    assert 0.7 * bound < ends.max() < 1.2 * bound
    for state, joint in ((["unknown", "unknown", "forward"], 0), ([0, 1, 0, "unknown"], 1)):
        part = unknown_rad(KNOWN.with_(start_state=state), arm)
        assert part == lost_motion(arm, KNOWN)[joint] > 0
    assert unknown_rad(KNOWN.with_(start_state=["unknown", "unknown", 1, -1]), arm) == 0
