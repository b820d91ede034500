"""Plans that end at the goal in the ideal kinematics and on the nominal machine."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import planner
from planner import Plan
from planner.machine.feedback.means import mean_passing
from planner.methods.collocation.machine_end import MACHINES
from planner.methods.collocation.transcription.follower import PARTS, Contacts, Follower

PAPER = planner.load_problem("problems/paper.toml", {"machine.step_s": 0.002})


@pytest.fixture(scope="module")
def turning() -> Plan:
    return planner.solve(PAPER, end="machine")


def nominal(plan: Plan) -> planner.Replay:
    return planner.replay(plan, planner.Machine.from_table(plan.problem.machine).nominal())


def test_the_ideal_motion_and_the_nominal_machine_end_at_the_goal(turning: Plan) -> None:
    """A plan that turns beyond the goal by the lost motion ends as well as a compensated one."""
    ideal = turning.compensates
    assert ideal is not None
    assert ideal.verified
    assert turning.verified
    assert planner.verify(ideal).ok
    np.testing.assert_allclose(np.rad2deg(ideal.theta(10.0)), 30.0, atol=1e-3)
    run = nominal(turning)
    assert np.abs(np.rad2deg(run.q[0, -1, 1:]) - 30).max() < 0.05
    assert turning.duration == 10
    assert 0.5 < turning.effort < 0.62  # 0.591 by finite differences on the simulator
    np.testing.assert_allclose(ideal.u([0.0, 10.0]), 0.0, atol=1e-12)
    beyond = np.rad2deg(ideal.theta(np.linspace(0.0, 10.0, 400)).max(axis=0))
    assert np.all(beyond[1:] > 33)  # joints 2 and 3 of the plan go on by the lost motion
    assert np.rad2deg(run.q[0, :, 2:].max()) < 30.1  # those of the machine do not
    plain = planner.replay(planner.solve(PAPER), samples=100, motions=0)
    runs = planner.replay(turning, samples=100, motions=0)
    assert np.percentile(runs.terminal_E_deg, 95) < 0.5 * np.percentile(plain.terminal_E_deg, 95)


def test_errors_are_measured_from_the_predicted_motion(turning: Plan, tmp_path: Path) -> None:
    """The joints lag behind their axes, whatever the path; from the ideal motion that is an error
    of several degrees."""
    run = nominal(turning)
    assert run.index_E_deg[0] < 0.05
    assert 4 < turning.notes["from_ideal_deg"] < 7
    np.testing.assert_allclose(turning.reference(5.0), turning.q(5.0))
    loaded = planner.load_plan(turning.save(tmp_path / "plan.json"))
    assert loaded == turning
    np.testing.assert_allclose(loaded.reference(5.0), turning.reference(5.0))
    assert turning.label == "collocation"
    state = PAPER.after(turning).machine.start_state
    assert np.abs(state[2:]).max() < 0.35  # as it started: near the middle
    assert planner.retime(turning).verified
    assert planner.sensitivity(turning).plan == turning.compensates


def test_a_weight_of_the_spread_draws_the_ends_of_machines_together(turning: Plan) -> None:
    near = planner.solve(PAPER, end="machine", spread_weight=50)
    assert near.objective == pytest.approx(near.effort, rel=1e-6)  # without the spread
    assert turning.effort < near.effort < 3 * turning.effort
    spread, less = (
        np.std(planner.replay(plan, samples=200, motions=0).terminal_error_deg[:, 1:])
        for plan in (turning, near)
    )
    assert less < 0.97 * spread
    assert np.abs(np.array(near.notes["end_theta_deg"]) - 30).max() < 0.05


def test_an_arm_that_was_homed_hardly_turns() -> None:
    homed = planner.solve(PAPER.changed({"machine.start_state": "forward"}), end="machine")
    assert homed.effort < 0.45
    assert np.abs(np.array(homed.notes["end_theta_deg"]) - 30).max() < 0.05


def test_links_with_inertia_end_at_the_goal_too() -> None:
    inert = PAPER.changed({"machine.fidelity": "dynamic"})
    plan = planner.solve(inert, end="machine")
    assert plan.verified
    assert np.abs(np.array(plan.notes["end_theta_deg"]) - 30).max() < 0.05


def test_the_machine_keeps_the_limits_too() -> None:
    """Without the machine's joints in the programme θ1 would reach 38 degrees on both."""
    narrow = PAPER.changed({"limits.joint_deg": 36})
    plan = planner.solve(narrow, end="machine")
    assert np.rad2deg(np.abs(nominal(plan).q[0, :, 1:]).max()) <= 36.001
    assert plan.compensates is not None
    assert np.rad2deg(np.abs(plan.compensates.theta(np.linspace(0, 10, 500))).max()) <= 36.001


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_without_lost_motion_the_plan_is_the_usual_one(spread: float) -> None:
    """That of the nominal machine: others may have some."""
    play = {"value": 0.0, "spread": spread}
    ideal = PAPER.changed({"machine": {"preset": "ideal", "backlash_deg": play}})
    plan = planner.solve(ideal, end="machine")
    usual = planner.solve(ideal, rest=True)
    assert plan.compensates is not None
    np.testing.assert_array_equal(plan.compensates.u(plan.t), usual.u(plan.t))


def test_what_the_option_cannot_do_is_refused(turning: Plan) -> None:
    with pytest.raises(planner.InputError, match="arms with friction disks"):
        planner.solve(planner.load_problem("problems/car.toml"), end="machine")
    with pytest.raises(planner.InputError, match="one of the two"):
        planner.solve(PAPER.changed({"compensation.on": True}), end="machine")
    with pytest.raises(planner.InputError, match="incline_deg"):
        planner.solve(PAPER.changed({"machine.incline_deg": 10}), end="machine")
    with pytest.raises(planner.InputError, match="spread_weight"):
        planner.solve(PAPER, spread_weight=10)
    with pytest.raises(planner.NoPlanError):
        planner.solve(PAPER.changed({"goal.duration": 3.0}), end="machine")


def test_a_follower_is_a_play_operator() -> None:
    """With a small smoothing it does what a play does, part by part of an interval."""
    contacts = Contacts((0.58, 0.48), (0.0, 0.0), 0.0, 1e30, 0.01, 0.0)
    follower = Follower(((0.01, 0.06, 0.08),), (0.0, 0.0, 0.0), contacts)
    system, start = PAPER.system, PAPER.start
    ways = np.random.default_rng(0).normal(0.0, 0.05, (200, PARTS, 2))
    states = follower.run(system, start, ways, 1e-6)
    joint, axis = states[0, [0, 3]]
    for k, parts in enumerate(ways):
        for way in parts[:, 1]:
            axis += way
            joint = min(max(joint, axis - 0.01), axis + 0.01)
        np.testing.assert_allclose(states[k + 1, [0, 3]], [joint, axis], atol=1e-4)


@pytest.mark.parametrize("name", ["paper", "four-joint"])
def test_contacts_pass_what_those_of_the_machine_pass(name: str) -> None:
    """The same formulas in CasADi and in NumPy."""
    problem = planner.load_problem(f"problems/{name}.toml")
    n, machine = problem.system.n, planner.Machine.from_table(problem.machine)
    contacts = MACHINES["machine"](problem)[0].contacts
    joints = ca.SX.sym("q", n)
    passing = ca.Function("f", [joints], contacts.passing_expr(ca.vertsplit(joints)))
    q = np.random.default_rng(0).uniform(0.2, 1.35, (20, n)) * np.sign(np.arange(n) - 1.5)
    expected = mean_passing(problem.system, machine, np.insert(q, 0, 0.0, axis=1))
    np.testing.assert_allclose(
        np.array([passing(each) for each in q])[..., 0, 0], expected, atol=5e-5
    )
    assert expected[:, 1:].min() < 0.87


def test_four_joints_end_at_the_goal_on_the_nominal_machine() -> None:
    """One of ten random pairs of 120 s, in which motors round slow speeds."""
    problem = planner.load_problem("problems/four-joint.toml").changed(
        {
            "start.theta_deg": [11.9, -1.3, -7.9, -8.9],
            "goal.theta_deg": [-9.8, -2.2, 0.2, 2.1],
            "goal.duration": 120.0,
        }
    )
    plan = planner.solve(problem, end="machine")
    assert plan.verified
    assert plan.effort < 0.7
    end = np.rad2deg(nominal(plan).q[0, -1, 1:])
    assert np.abs(end - [-9.8, -2.2, 0.2, 2.1]).max() < 0.05
