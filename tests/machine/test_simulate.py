"""Whole replays of handmade plans: the ideal limit, and what each effect does to a motion."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, draws_of, inputs, plan_from
from outside import integrate

from planner import InputError, Machine, Plan, Problem, replay
from planner.machine.machine import draw
from planner.machine.simulate import PROGRESS_PARTS
from planner.machine.stepwise import REPORT_EVERY

JUMPS = inputs(
    ([0.3], [0.5, 0.1]), ([-0.2], [0.3]), ([0.1], [-0.4, 0.2]), breaks=[0.0, 0.5, 1.2, 2]
)

CAR = {
    "system": {"kind": "car", "wheelbase_m": 1.0},
    "start": {"heading_deg": 10, "steering_deg": 5},
    "goal": {"heading_deg": 10, "steering_deg": 5, "x_m": "free", "y_m": 0.0, "duration": 2.0},
}


@pytest.fixture(scope="module")
def jumping() -> Plan:
    """A plan of 2 s whose inputs jump at 0.5 and 1.2 s and are not zero at either end."""
    return plan_from(arm_problem([10, 20, 15], end=2.0), JUMPS, pieces=100)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_ideal_replay_is_the_plan(n: int) -> None:
    plan = plan_from(arm_problem(list(range(10, 10 + n)), end=2.0), JUMPS, pieces=100)
    run = replay(plan, Machine.ideal())
    assert np.max(np.abs(run.terminal_error)) < 1e-10
    motion, _ = integrate(plan, rtol=1e-10, atol=1e-12)
    inside = run.t <= plan.duration
    assert np.max(np.abs(run.q[0, inside] - motion(run.t[inside]))) < 1e-9
    assert np.max(run.deviation) < 1e-6  # of the plan's own cubic interpolation
    assert np.array_equal(run.motor_rates[0, inside][:-1], plan.u(run.t[inside][:-1]))


def test_ideal_replay_of_other_systems_goes_by_their_own_rates(jumping: Plan) -> None:
    plan = plan_from(Problem.from_dict(CAR), JUMPS, pieces=100)
    run = replay(plan, Machine.ideal())
    assert run.q.shape[2] == 4
    assert np.max(np.abs(run.terminal_error)) < 1e-9
    assert run.angles == (1, 2)
    assert run.terminal_error_deg.shape == (1, 2)
    # The gear chain is the arm's; servos and initial angles are everybody's.
    gears = Machine.ideal(backlash_deg=3, creep=0.1, gear_ratio_error=0.1)
    assert np.array_equal(replay(plan, gears).q, run.q)
    late = replay(plan, Machine.ideal(delay_s=0.1, initial_angle_error_deg=[1.0, 0.0, 0.0]))
    assert late.q[0, 0, 1] - run.q[0, 0, 1] == pytest.approx(np.deg2rad(1))
    assert late.deviation.max() > 0.01


def test_converges_with_the_step_when_the_servos_are_real(jumping: Plan) -> None:
    effects: dict[str, Any] = {
        "servo_bandwidth_rad_s": 40,
        "servo_damping": 0.7,
        "velocity_limit_rad_s": 0.45,
        "control_period_s": 0.02,
        "backlash_deg": 1,
        "shaft_stiffness_nm_per_rad": 5,
        "coulomb_friction_nm": 0.1,
        "viscous_friction_nms_per_rad": 0.2,
        "creep": 0.01,
    }
    ends = [
        replay(jumping, Machine.ideal(step_s=h, **effects), record_s=None).q[0, -1]
        for h in (4e-3, 1e-3, 2.5e-4)
    ]
    assert np.max(np.abs(ends[1] - ends[2])) < 2e-5
    assert np.max(np.abs(ends[1] - ends[2])) < 0.3 * np.max(np.abs(ends[0] - ends[1]))


# -- one effect at a time, on the whole motion ---------------------------------------------


def end_of(plan: Plan, **effects: Any) -> Any:
    return replay(plan, Machine.ideal(**effects), record_s=None)


def test_delay_alone_costs_nothing_at_the_end(jumping: Plan) -> None:
    run = end_of(jumping, delay_s=0.123)
    assert np.max(np.abs(run.terminal_error)) < 1e-9
    ahead = jumping.q(np.linspace(0, 2, 4001))[:, 1]
    behind = jumping.trajectory.q(np.linspace(0, 2, 4001) - 0.123)[:, 1]
    assert run.deviation[0, 0] == pytest.approx(np.max(np.abs(ahead - behind)), rel=1e-3)


def test_lag_costs_little_at_the_end_once_settled(jumping: Plan) -> None:
    for effects in (
        {"servo_bandwidth_rad_s": 60.0},
        {"servo_bandwidth_rad_s": 60.0, "servo_damping": 1},
    ):
        settled, cut = (
            np.abs(replay(jumping, Machine.ideal(**effects), settle_s=s).terminal_error[0, 1])
            for s in (0.5, 0.0)
        )
        assert settled < 1e-9  # joint 1 is the integral of its motor
        assert cut > 1e-4


def test_gain_and_bias_move_joint_1_as_they_should(jumping: Plan) -> None:
    travel = jumping.q(2.0)[1] - jumping.q(0.0)[1]
    gain = end_of(jumping, input_gain_error=[0.0, 0.01]).terminal_error[0, 1]
    assert gain == pytest.approx(0.01 * travel, abs=1e-9)
    bias = end_of(jumping, input_bias_rad_s=[0.0, 0.003]).terminal_error[0, 1]
    assert bias == pytest.approx(0.003 * 2.0, abs=1e-9)  # none while it settles


def test_sample_and_hold_loses_what_happens_between_samples(jumping: Plan) -> None:
    period = 0.05
    ticks = period * np.arange(40)
    held = np.sum(jumping.u(ticks + 1e-9)[:, 1]) * period
    run = end_of(jumping, control_period_s=period)
    assert run.q[0, -1, 1] - run.q[0, 0, 1] == pytest.approx(held, abs=1e-7)


def test_velocity_limit_takes_its_share_and_says_how_long(jumping: Plan) -> None:
    run = end_of(jumping, velocity_limit_rad_s=0.25)
    clipped = np.clip(jumping.u(np.linspace(0, 2, 200001)), -0.25, 0.25)
    expected = jumping.q(0.0)[1] + np.trapezoid(clipped[:, 1], dx=1e-5)
    assert run.q[0, -1, 1] == pytest.approx(expected, abs=2e-4)
    over = np.mean(np.abs(jumping.u(np.linspace(0, 2, 200001))) > 0.25, axis=0) * 2
    assert run.saturated_s[0] == pytest.approx(over, abs=2e-3)


def test_backlash_leaves_half_the_gap_behind(jumping: Plan) -> None:
    run = end_of(jumping, gearhead_backlash_deg=[0.0, 0.8])
    assert abs(run.terminal_error_deg[0, 0]) == pytest.approx(0.4, abs=1e-9)


def test_initial_angle_errors_stay_in_joint_1(jumping: Plan) -> None:
    run = end_of(jumping, initial_angle_error_deg=[0.5, 0.0, -0.25])
    assert run.terminal_error_deg[0, 0] == pytest.approx(0.5, abs=1e-9)
    assert abs(run.terminal_error_deg[0, 1]) > 1e-4  # through cos(theta1)
    assert np.all(run.largest_error_deg[0] >= np.array([0.5, 0.0, 0.25]) - 1e-9)


def test_encoders_round_what_is_measured_not_what_is(jumping: Plan) -> None:
    run = replay(jumping, Machine.ideal(encoder_resolution_deg=0.5))
    ideal = replay(jumping, Machine.ideal())
    assert np.array_equal(run.q, ideal.q)
    measured = np.rad2deg(run.measured[0, :, 1:])
    assert np.max(np.abs(measured / 0.5 - np.round(measured / 0.5))) < 1e-9
    off = np.abs(measured - np.rad2deg(run.q[0, :, 1:]))
    assert 0.2 < off.max() <= 0.25 + 1e-9
    assert np.array_equal(run.measured[..., 0], run.q[..., 0])
    assert np.array_equal(ideal.measured, ideal.q)


# -- bookkeeping ---------------------------------------------------------------------------


def test_index_of_error_is_the_maximum_over_all_steps(jumping: Plan) -> None:
    machine = Machine.ideal(delay_s=0.0435, servo_bandwidth_rad_s=20)
    fine = replay(jumping, machine, record_s=1e-3)
    errors = np.rad2deg(np.abs(fine.q - jumping.trajectory.q(fine.t))[0, :, 1:])
    assert fine.largest_error_deg[0] == pytest.approx(errors.max(axis=0), abs=2e-3)
    assert fine.index_E_deg[0] == fine.largest_error_deg[0].max()
    coarse = replay(jumping, machine, record_s=None)
    assert coarse.t.tolist() == [0.0, 2.0, 2.5]
    assert coarse.index_E_deg == pytest.approx(fine.index_E_deg, abs=1e-3)
    assert coarse.terminal_error == pytest.approx(fine.terminal_error, abs=1e-9)


def test_samples_are_paired_between_plans_and_numbers(jumping: Plan) -> None:
    machine = Machine.prototype()
    machine = machine.with_(step_s=0.005)
    many = replay(jumping, machine, samples=5, seed=2, record_s=None)
    few = replay(jumping, machine, samples=2, seed=2, record_s=None)
    again = replay(jumping, machine, samples=[4, 1], seed=2, record_s=None)
    other = replay(jumping, machine, samples=5, seed=3, record_s=None)
    assert np.array_equal(many.q[:2], few.q)
    assert np.array_equal(many.q[[4, 1]], again.q)
    assert not np.any(many.terminal_error == other.terminal_error)
    assert many.worst == many.numbers[np.argmax(many.index_E_deg)]
    slower = Plan(
        jumping.problem.changed({"goal.duration": 4.0}), "by hand", {}, jumping.trajectory.slowed(2)
    )
    paired = replay(slower, machine, samples=5, seed=2, record_s=None)
    own = draw(machine, 3, many.numbers, 2).values  # for the arm's three joints
    for name, values in many.draws.values.items():
        assert np.array_equal(values, paired.draws.values[name]), name
        assert np.array_equal(values, own[name]), name


def test_how_far_it_is_is_told_in_steps_that_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[int, int]] = []
    seen: list[tuple[int, int]] = []
    module = sys.modules["planner.machine.simulate"]
    monkeypatch.setattr(module, "_tell_steps", lambda *given: told.append((given[4], given[3])))
    plan = plan_from(Problem.from_dict(CAR), JUMPS, pieces=100)
    replay(
        plan,
        Machine.ideal(step_s=0.002),
        record_s=None,
        progress=lambda *how_far: seen.append(how_far),
    )
    every, (steps,) = REPORT_EVERY, {steps for _, steps in told}
    assert steps >= 1000
    assert [done for done, _ in told] == [*range(every, steps + 1, every)]
    assert seen[-1] == (PROGRESS_PARTS, PROGRESS_PARTS)


def test_the_machine_must_fit_the_arm(jumping: Plan) -> None:
    with pytest.raises(InputError, match=r"machine\.backlash_deg \D*4 "):
        replay(jumping, Machine.ideal(backlash_deg=[1, 2, 3, 4]))


def test_draws_say_what_each_sample_was() -> None:
    draws = draws_of(samples=4, backlash_deg={"value": 2, "spread": 0.5})
    part = draws.part(slice(1, 3))
    assert part.count == 2
    assert part.numbers.tolist() == [1, 2]
    assert np.array_equal(part["backlash_deg"], draws["backlash_deg"][:, 1:3])
