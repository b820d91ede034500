"""Commands that allow for the machine, each part by itself against what it is for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from handmade import K, arm_problem, inputs, plan_from
from hypothesis import given, settings
from hypothesis import strategies as st

import planner
from planner import Plan
from planner.machine.feedforward.follow import follow, with_prediction
from planner.machine.feedforward.legs import preparation
from planner.machine.feedforward.shaping import CommandShape, round_to_grid
from planner.problem.tables.problem_file import CompensationTable

NONE: dict[str, Any] = {
    "correction": False,
    "take_up": False,
    "preparation": False,
    "back_off": False,
    "lag": False,
    "gearheads": False,
}


@pytest.fixture(scope="module")
def plan(paper: planner.Problem) -> Plan:
    return planner.solve(paper, "collocation")


@pytest.fixture(scope="module")
def compensated(plan: Plan) -> Plan:
    return planner.compensate(plan)


def shape(plan: Plan, machine: planner.Machine, **options: Any) -> CommandShape:
    table = CompensationTable(**{**NONE, **options})
    return CommandShape(plan, plan.problem.system, machine, table)  # type: ignore[arg-type]


def told(plan: Plan, machine: planner.Machine, **options: Any) -> np.ndarray:
    """Commands without a correction, (K, 2)."""
    nothing = np.zeros((2, 2, 1)), np.array([0.0, 1.0])
    return shape(plan, machine, **options).commands(*nothing)[:, :, 0]


def missed_deg(plan: Plan, machine: planner.Machine, after_s: float = 0.0, **options: Any) -> float:
    """Largest error after a time on the nominal machine, of a plan's commands shaped like that."""
    table = CompensationTable(**{**NONE, **options})
    made = follow(plan, machine, table)
    run = planner.replay(made, machine.nominal())
    errors = np.abs(run.q[0] - plan.trajectory.q(run.t))[run.t >= after_s, 1:]
    return float(np.rad2deg(np.max(errors)))


def test_the_lag_of_servos_and_delay_is_taken_off(plan: Plan) -> None:
    machine = planner.Machine.ideal(servo_bandwidth_rad_s=20.0, delay_s=0.03, control_period_s=0.01)
    before = missed_deg(plan, machine, after_s=1.0)  # by then what is lost at the start is made up
    after = missed_deg(plan, machine, after_s=1.0, lag=True)
    assert before > 0.7  # 0.08 s of lag at 0.18 rad/s and more
    assert after < before / 10


def test_commands_that_are_linear_pass_through_the_inputs_at_the_ticks(
    paper: planner.Problem,
) -> None:
    """Commands that are held have their means over the ticks."""
    plan = planner.solve(paper.changed({"limits.input_rate_rad_s2": 1.0}), "collocation")
    machine = planner.Machine.ideal()
    later = slice(100, -100)  # at the ends the half tick is made up at the largest rate
    t, sent = shape(plan, machine).t[:-1], told(plan, machine)
    np.testing.assert_allclose(
        sent[later], plan.u(t[later]), atol=5e-5
    )  # half a tick off it is 2e-4
    held = told(plan, machine.with_(control_period_s=0.01))
    np.testing.assert_allclose(held[later], plan.u(t[later] + 0.005), atol=5e-5)


def test_a_prediction_covers_the_plan_and_no_more(plan: Plan) -> None:
    machine = planner.Machine.ideal(servo_bandwidth_rad_s=20.0)
    predicted = with_prediction(plan, machine)
    assert (predicted.t[0], predicted.t[-1]) == (0.0, plan.duration)
    assert set(plan.t) <= set(predicted.t)


def test_gearheads_are_crossed_at_each_reversal(plan: Plan) -> None:
    machine = planner.Machine.ideal(gearhead_backlash_deg=1.0)
    assert missed_deg(plan, machine) > 0.5  # it starts in the middle: half of it, either way
    assert missed_deg(plan, machine, gearheads=True) < 0.25  # while it is crossed
    assert missed_deg(plan, machine, after_s=9.0, gearheads=True) < 0.02


@pytest.mark.parametrize("states", [("forward", "backward"), ("backward", "forward")])
def test_gearheads_are_crossed_from_where_each_stood(plan: Plan, states: tuple[str, str]) -> None:
    """Joint 1 stands apart from the others, whose side is that of motor 1."""
    start = [states[0], states[1], states[1]]
    machine = planner.Machine.ideal(gearhead_backlash_deg=1.0, start_state=start)
    assert missed_deg(plan, machine, after_s=9.0, gearheads=True) < 0.02


def test_all_axes_take_up_their_play_at_one_angle(plan: Plan) -> None:
    machine = planner.Machine.prototype(coulomb_friction_nm=0.19)  # as much lost by each
    names = ("backlash_deg", "coulomb_friction_nm", "shaft_stiffness_nm_per_rad")
    backlash, friction, stiffness = (machine.mean(name, 3) for name in names)
    lost = np.deg2rad(backlash / 2) + friction / stiffness
    leg = preparation(plan, plan.problem.system, machine, 1.0, np.full(2, lost), 0.01)  # type: ignore[arg-type]
    theta1, theta2 = plan.q(0.0)[1] + np.max(leg.angles[:, 1]), plan.q(0.0)[2]
    assert K[0] * np.cos(theta1) ** 2 == pytest.approx(K[1] * np.cos(theta2) ** 3, rel=5e-3)
    assert leg.uneven_rad < np.deg2rad(0.02)
    rate = K[0] * 0.668811 * np.cos(theta1) ** 3
    assert leg.angles[-1, 0] == pytest.approx(lost / rate, rel=1e-2)
    assert leg.angles[-1, 1] == pytest.approx(0.0, abs=1e-12)  # joint 1 is back


@pytest.mark.parametrize("theta1", [8.0, -8.0])
def test_joint_1_swings_to_the_side_on_which_it_stands(theta1: float) -> None:
    """On which side of straight joint 2 stands is nothing to the rates of the axes."""
    machine, lost = planner.Machine.ideal(), np.full(2, 0.02)
    angles = []
    for theta2 in (30.0, -30.0):
        problem = arm_problem([theta1, theta2, 5.0], limits={"input_rad_s": 0.5})
        stands = driven(problem, [0.1] * 3)
        leg = preparation(stands, stands.problem.system, machine, 1.0, lost, 0.01)  # type: ignore[arg-type]
        angles.append(leg.angles)
    swing = np.sign(theta1) * angles[0][:, 1]
    assert np.min(swing) >= 0
    assert np.max(swing) > np.deg2rad(10)
    np.testing.assert_allclose(angles[1], angles[0], atol=1e-12)


def test_the_preparation_moves_no_passive_joint_and_never_back(plan: Plan) -> None:
    machine = planner.Machine.prototype().nominal()
    made = follow(plan, machine, CompensationTable(correction=False))
    assert 1.0 < made.lead_s < 6.0
    before = made.t < made.lead_s
    assert np.max(np.abs(made.q(made.t[before])[:, 2:] - plan.q(0.0)[2:])) < np.deg2rad(0.1)
    assert np.min(made.u(made.t[before])[:, 0]) >= 0
    # and takes up all that there is: half a second on, both joints follow
    follows = made.q(made.lead_s + 0.5)[2:] - plan.q(0.5)[2:]
    assert np.max(np.abs(follows)) < np.deg2rad(0.4)


def test_loaded_joints_of_an_arm_with_inertia_hardly_slip_in_the_preparation(plan: Plan) -> None:
    heavy, light = (planner.Machine.prototype(fidelity=f) for f in ("dynamic", "quasi-static"))
    made, other = (follow(plan, m, CompensationTable(correction=False)) for m in (heavy, light))
    slips = np.abs(made.theta(made.lead_s) - made.theta(0.0))[1:]
    assert np.rad2deg(np.max(slips)) < 0.5 < 1.0 < made.lead_s - other.lead_s < 3.0


def test_backing_off_moves_no_joint_of_the_nominal_machine(plan: Plan, compensated: Plan) -> None:
    made = compensated
    assert 0.5 < made.tail_s < 2.0
    assert made.duration == pytest.approx(made.lead_s + plan.duration + made.tail_s)
    after = made.t[made.t > made.lead_s + plan.duration + 0.1]
    assert np.min(made.u(after[:-1])[:, 0]) < -0.3
    assert np.max(np.abs(made.q(after)[:, 2:] - made.q(made.duration)[2:])) < np.deg2rad(0.02)


def test_backing_off_takes_back_the_joints_that_have_gone_too_far(
    plan: Plan, compensated: Plan
) -> None:
    both = (planner.compensate(plan, back_off=False), compensated)
    machine = planner.Machine.prototype(step_s=0.01)
    runs = [planner.replay(each, machine, samples=200, seed=5, record_s=None) for each in both]
    highs = [np.percentile(run.terminal_error_deg[:, 1], 90) for run in runs]
    assert highs[1] < highs[0] - 0.3
    ends = [np.percentile(run.terminal_E_deg, 95) for run in runs]
    assert ends[1] < ends[0]
    assert runs[1].percentile(95) < runs[0].percentile(95) + 0.05


def test_it_does_not_back_off_where_that_would_harm(paper: planner.Problem) -> None:
    asked = paper.changed({"goal.travel": 0.82})
    assert planner.compensate(planner.solve(asked, "collocation")).tail_s == 0


@pytest.mark.parametrize("state", ["forward", "backward"])
def test_joints_that_stood_at_their_axes_are_not_pulled_back(state: str) -> None:
    """They have not gone too far on any machine: backing off would take them off the goal."""
    drive = 1.0 if state == "forward" else -1.0
    goal = [10.0, 20.0 + 15.0 * drive]
    problem = arm_problem([10.0, 20.0], goal=goal, limits={"input_rad_s": 0.5})
    plan = planner.solve(problem.changed({"machine.start_state": state}), "collocation")
    homed = planner.compensate(plan)
    runs = [planner.replay(each, samples=200, record_s=None) for each in (plan, homed)]
    assert homed.tail_s == 0
    assert runs[1].percentile(95) < runs[0].percentile(95)


def test_without_lost_motion_there_is_nothing_to_prepare(plan: Plan) -> None:
    told = shape(plan, planner.Machine.ideal(), preparation="forward", back_off=True, take_up=True)
    assert told.clock.lead_s == told.clock.tail_s == 0


@pytest.mark.parametrize(("joints", "most"), [(2, 0.1), (3, 0.1), (4, 0.7)])
def test_no_axis_is_driven_beyond_its_lost_motion(joints: int, most: float) -> None:
    """Of four joints one has too little by as much as another has too much."""
    problem = arm_problem([10.0] * joints, goal=[25.0] * joints, limits={"input_rad_s": 0.5})
    plan = planner.solve(problem, "collocation")
    machine = planner.Machine.prototype().nominal()
    made = follow(plan, machine, CompensationTable(correction=False))
    moved = made.q(made.lead_s)[2:] - plan.q(0.0)[2:]
    assert made.lead_s > 0
    assert np.max(np.abs(moved)) < np.deg2rad(most)


@settings(max_examples=15)
@given(
    st.lists(st.floats(-0.6, 0.6).map(lambda v: round(v, 6)), min_size=3, max_size=8),
    st.sampled_from([np.inf, 2.0, 0.7]),
    st.booleans(),
)
def test_commands_keep_every_limit_whatever_the_plan(
    speeds: list[float], rate: float, prepared: bool
) -> None:
    """Also where the plan itself asks for more, at its ends and where gearheads are crossed."""
    limits: dict[str, Any] = {"input_rad_s": [0.5, 0.4]}
    if np.isfinite(rate):
        limits["input_rate_rad_s2"] = rate
    problem = arm_problem([5.0, 5.0, 5.0], limits=limits)
    plan = driven(problem, speeds)
    table: dict[str, Any] = {"lag": True, "gearheads": True, "back_off": True, "take_up": True}
    table["preparation"] = "forward" if prepared else False
    u = told(plan, planner.Machine.prototype(), **table)
    assert np.all(np.max(np.abs(u), axis=0) <= np.array([0.5, 0.4]) * (1 + 1e-9))
    jumps = np.abs(np.diff(np.concatenate([np.zeros((1, 2)), u]), axis=0))
    assert np.max(jumps) <= rate * 0.01 * (1 + 1e-6)
    assert np.max(np.abs(u / 0.001 - np.round(u / 0.001))) < 1e-6  # the motors' resolution


def driven(problem: planner.Problem, speeds: list[float]) -> Plan:
    """A plan with piecewise constant inputs, of both motors the same."""
    breaks = np.linspace(0.0, 10.0, len(speeds) + 1).tolist()
    return plan_from(problem, inputs(*[([v], [v]) for v in speeds], breaks=breaks), pieces=10)


def test_rounding_of_one_tick_is_made_good_in_the_next(plan: Plan) -> None:
    machine = planner.Machine.ideal(velocity_resolution_rad_s=0.05, control_period_s=0.01)
    turned = np.cumsum(told(plan, machine) * 0.01, axis=0)
    t = np.linspace(0.0, 10.0, 100_001)
    asked = np.cumsum(plan.u((t[:-1] + t[1:]) / 2) * 1e-4, axis=0)[99::100]
    assert np.max(np.abs(turned - asked)) < 0.05 * 0.01


def test_speeds_keep_their_limits_where_the_motors_resolution_is_coarser() -> None:
    """The multiple of 1 next to a value that lies between the limits, or else the value itself."""
    value = np.array([0.4, 0.6, 0.5, 2.5])
    low, high = np.array([0.0, 0.0, 0.45, 2.2]), np.array([0.9, 0.9, 0.55, 2.6])
    found = round_to_grid(value, low, high, np.ones(4))
    assert found.tolist() == [0.0, 0.0, 0.5, 2.5]
    assert round_to_grid(value, low, high, np.zeros(4)).tolist() == value.tolist()
