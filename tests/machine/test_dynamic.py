"""The dynamic manipulator: ideal limit, quasi-static limit, and mechanics known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import INERTIA, SOFT, arm, chain, constant, drive, start
from handmade import arm_problem, draws_of, inputs, plan_from

from planner import Machine, Plan, Problem, replay
from planner.machine.disk_chain import DiskChain


@pytest.fixture(scope="module")
def jumping() -> Plan:
    """A plan of 1 s whose inputs jump at 0.5 s and are not zero at either end."""
    u = inputs(([0.3], [0.5, 0.1]), ([-0.2], [-0.4, 0.2]), breaks=[0.0, 0.5, 1.0])
    return plan_from(arm_problem([10, 20, 15], end=1.0), u, pieces=100)


# -- limits --------------------------------------------------------------------------------


def test_without_effects_it_is_the_plan_to_second_order(jumping: Plan) -> None:
    errors, steps = [], (1e-2, 5e-3, 2.5e-3, 1e-3)
    for step in steps:
        machine = Machine.ideal(fidelity="dynamic", step_s=step)
        run = replay(jumping, machine, settle_s=0.02, record_s=None)
        errors.append(np.max(np.abs(run.terminal_error)))
    assert errors[-1] < 5e-8
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2, abs=0.3)


def test_with_inertia_but_rigid_the_motors_still_go_where_they_should(jumping: Plan) -> None:
    machine = Machine.ideal(fidelity="dynamic", **INERTIA)
    run = replay(jumping, machine, settle_s=0.1, record_s=None)
    assert np.max(np.abs(run.terminal_error)) < 1e-5
    assert np.max(np.abs(run.motor_rates[0, -1])) < 1e-6


def test_without_inertia_it_is_the_quasi_static_model(smooth_plan: Plan) -> None:
    massless = Machine.prototype(step_s=0.002).nominal()
    massless = massless.without(*INERTIA, "torque_limit_nm", "servo_gain_nms_per_rad")
    massless = massless.without("shaft_damping_nms_per_rad", "base_friction_nm")
    still, moving = (
        replay(smooth_plan, massless.with_(fidelity=f)) for f in ("quasi-static", "dynamic")
    )
    assert still.index_E_deg[0] > 4
    assert np.max(np.abs(still.q - moving.q)) < np.deg2rad(0.01)
    assert np.max(np.abs(still.motor_rates - moving.motor_rates)[0, 1:-1]) < 2e-3


def test_the_slower_the_motion_the_less_inertia_matters(smooth_plan: Plan) -> None:
    machine = Machine.prototype(step_s=0.005).nominal()
    machine = machine.without("torque_limit_nm", "servo_gain_nms_per_rad")
    ends, means = [], []
    for slower in (1, 2, 4):
        plan = slowed(smooth_plan, slower)
        still, moving = (
            replay(plan, machine.with_(fidelity=f), record_s=0.04 * slower).q[0]
            for f in ("quasi-static", "dynamic")
        )
        ends.append(np.rad2deg(np.max(np.abs(still - moving)[-1])))
        means.append(np.rad2deg(np.sqrt(np.mean((still - moving) ** 2))))
    assert ends[0] < 0.5  # of 30 degrees, at the paper's speed
    assert np.polyfit(np.log([1, 2, 4]), np.log(ends), 1)[0] == pytest.approx(-1, abs=0.2)
    assert np.polyfit(np.log([1, 2, 4]), np.log(means), 1)[0] < -1.0


def slowed(plan: Plan, factor: int) -> Plan:
    if factor == 1:
        return plan
    problem = plan.problem.changed({"goal.duration": plan.duration * factor})
    return Plan(problem, "by hand", {}, plan.trajectory.slowed(factor))


def test_creep_costs_the_same_travel_in_both() -> None:
    effects: dict[str, Any] = {
        "creep": 0.003,
        "creep_per_nm": 0.01,
        "viscous_friction_nms_per_rad": 2.0,
    }
    quasi = DiskChain(arm(3), draws_of(**effects), start(3))
    moving, free = chain(**effects), chain()
    for _ in range(300):
        speed = np.tile(np.array([[0.3], [0.0]]), (3, 1, 1))
        for plant in (quasi, moving, free):
            plant.step(speed, speed[1:] * np.array([[[5e-4]], [[1e-3]]]), 1e-3)
    lost = (free.q - quasi.q)[[0, 2, 3], 0]
    assert np.all(lost > 3e-4)
    assert (free.q - moving.q)[[0, 2, 3], 0] == pytest.approx(lost, rel=0.02)


def test_other_systems_are_the_same_in_both() -> None:
    data = {
        "system": {"kind": "car", "wheelbase_m": 1.0},
        "start": {"heading_deg": 10, "steering_deg": 5},
        "goal": {"heading_deg": 10, "steering_deg": 5, "x_m": "free", "y_m": 0.0, "duration": 1.0},
    }
    u = inputs(([0.3], [0.5, 0.1]), breaks=[0.0, 1.0])
    plan = plan_from(Problem.from_dict(data), u, pieces=20)
    still, moving = (
        replay(plan, Machine.prototype(fidelity=f, step_s=0.01), record_s=None)
        for f in ("quasi-static", "dynamic")
    )
    assert np.array_equal(still.q, moving.q)


@pytest.mark.parametrize(("fidelity", "most"), [("quasi-static", 3e-6), ("dynamic", 1e-5)])
def test_a_millisecond_is_a_short_step_for_the_prototype(
    smooth_plan: Plan, fidelity: str, most: float
) -> None:
    """Two are four times the error of the shorter one off."""
    ends = []
    for step in (2e-3, 1e-3):
        machine = Machine.prototype(step_s=step, fidelity=fidelity).nominal()
        ends.append(replay(smooth_plan, machine, record_s=None).q[0, -1])
    assert np.max(np.abs(ends[0] - ends[1])) < most


def test_steps_of_any_length_follow_each_other() -> None:
    """A very short step with a jump in it, as where a jump lies close to the grid."""
    ends = []
    for short in ([], [1e-9]):
        plant = chain(creep_per_nm=0.05, coulomb_friction_nm=0.1)
        for k, h in enumerate([1e-3] * 50 + short + [1e-3] * 50):
            u = np.array([0.1 if k < 50 else 1.0, 0.1])
            plant.step(np.tile(u[None, :, None], (2, 1, 1)), h * u[None, :, None], h)
        ends.append(plant.q[:, 0].copy())
    assert ends[0] == pytest.approx(ends[1], abs=2e-5)


def test_a_delay_shifts_the_motion(jumping: Plan) -> None:
    machine = Machine.prototype(fidelity="dynamic", initial_play=0.5, step_s=2e-3).nominal()
    machine = machine.without("initial_angle_error_deg")
    soon, late = (
        replay(jumping, machine.with_(delay_s=delay), settle_s=0.5, record_s=0.01).q[0]
        for delay in (False, 0.1)
    )
    assert np.max(np.abs(soon[:-11] - late[10:-1])) < 1e-9
    assert np.max(np.abs(soon - late)) > 0.01


# -- mechanics in closed form --------------------------------------------------------------


def test_at_rest_it_stays_at_rest() -> None:
    plant = chain(**SOFT, backlash_deg=2.0)
    drive(plant, 5, constant(0, 0))
    assert np.array_equal(plant.q, start(3))
    assert plant.stored_J == 0


def test_a_torque_limit_sets_the_acceleration() -> None:
    plant = chain(2, motor_inertia_kgm2=0.02, torque_limit_nm=0.1, link_inertia_kgm2=[0.03, 0.0])
    rates = drive(plant, 100, constant(1.0, 1.0), 0.1, lambda: plant.motor_rates[:, 0].copy())
    t = np.arange(1, 101) * 1e-3
    assert rates[:, 0] == pytest.approx(0.1 / 0.02 * t, rel=0.02)
    assert plant.limited_s[:, 0] == pytest.approx(0.1)
    assert rates[10:, 1] == pytest.approx(0.1 / (0.02 + 0.03) * t[10:], rel=0.02)


def test_the_load_acts_back_on_the_motor() -> None:
    gain, load = 2.0, 0.4
    effects = {**INERTIA, "servo_gain_nms_per_rad": gain, "base_friction_nm": load}
    plant = chain(**effects)
    drive(plant, 1000, constant(0.0, 0.5), 1.0)
    assert plant.motor_rates[1, 0] == pytest.approx(0.5 - load / gain, rel=1e-4)
    healed = chain(**effects, servo_integral_time_s=0.05)
    drive(healed, 1500, constant(0.0, 0.5), 1.5)
    assert healed.motor_rates[1, 0] == pytest.approx(0.5, rel=1e-4)
    behind = 0.75 - (healed.q[1, 0] - start(3)[1, 0])
    assert behind == pytest.approx(load * 0.05 / gain, rel=1e-2)


def test_a_link_on_its_shaft_swings_as_an_oscillator_should() -> None:
    k, c, inertia = 4.0, 0.02, 0.03
    plant = chain(
        2,
        shaft_stiffness_nm_per_rad=k,
        shaft_damping_nms_per_rad=c,
        link_inertia_kgm2=inertia,
    )
    lever = arm(2).k_g * arm(2).K[0] * np.cos(start(2)[1, 0]) ** 3
    t = np.arange(1, 1001) * 1e-3
    theta = drive(plant, 1000, constant(0.3, 0.0))[:, 2] - start(2)[2, 0]
    damping, omega = c / 2 / inertia, np.sqrt(k / inertia)
    fast = np.sqrt(omega**2 - damping**2)
    fading = np.exp(-damping * t) / fast
    behind = fading * np.sin(fast * t)
    assert theta == pytest.approx(0.3 * lever * (t - behind), abs=1e-4 * 0.3 * lever)


def test_a_free_link_coasts_through_its_play() -> None:
    gap, viscous, inertia = np.deg2rad(20.0), 0.05, 0.03
    plant = chain(
        2,
        backlash_deg=20.0,
        shaft_stiffness_nm_per_rad=50.0,
        shaft_damping_nms_per_rad=1.0,
        link_inertia_kgm2=inertia,
        viscous_friction_nms_per_rad=viscous,
        initial_play=1.0,
    )
    drive(plant, 500, constant(0.6, 0.0), 0.5)
    assert plant.gap[0, 0] == pytest.approx(gap / 2)
    seen = drive(plant, 400, constant(0.0, 0.0), 0.4, lambda: record(plant))
    free = np.flatnonzero(np.abs(seen[:, 1]) < gap / 2 * (1 - 1e-9))
    assert len(free) > 100
    assert np.all(seen[free, 2] == 0)
    speed = np.diff(seen[free, 0]) / 1e-3
    decay = np.exp(-viscous / inertia * 1e-3 * np.arange(len(speed)))
    assert speed == pytest.approx(speed[0] * decay, rel=2e-3)


def record(plant: Any) -> np.ndarray:
    """Link 2, its place in the play, and the torque of its shaft."""
    return np.array([plant.q[2, 0], plant.gap[0, 0], plant.shaft_torque[0, 0]])


def test_a_contact_slips_at_its_capacity_and_the_motor_goes_on() -> None:
    capacity = 0.1
    plant = chain(2, friction_capacity_nm=capacity, coulomb_friction_nm=5.0, **SOFT)
    drive(plant, 1000, constant(0.5, 0.0))
    lever = arm(2).k_g * arm(2).K[0]  # of P3, which is loaded most
    assert plant.q[2, 0] == pytest.approx(start(2)[2, 0], abs=1e-7)
    assert plant.shaft_torque[0, 0] * lever == pytest.approx(capacity, rel=1e-3)
    assert plant.motor_rates[0, 0] == pytest.approx(0.5, rel=1e-3)
    assert plant.lost_J[0] > 0.3 * capacity * 0.5


def test_it_steps_under_commands_that_depend_on_what_it_does() -> None:
    """Proportional control of θ₁ from its own reading brings it where it is told."""
    plant, goal = chain(**SOFT, torque_limit_nm=1.0), 0.7
    for _ in range(400):
        u = np.array([0.0, 4.0 * (goal - plant.q[1, 0])])
        for _ in range(10):
            plant.step(np.tile(u[None, :, None], (2, 1, 1)), 1e-3 * u[None, :, None], 1e-3)
    assert plant.q[1, 0] == pytest.approx(goal, abs=1e-3)
