"""The linear model against the nonlinear system, and what is known of delay, play and rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.machine.feedback.estimate import Estimate, Forecast, History
from planner.machine.feedback.reference import _direction
from planner.machine.feedback.run_up import hindrance, lost_motion
from planner.machine.feedback.tracker import Design, design
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

PROBLEMS = Path(__file__).parents[3] / "problems"


def moved(plan: Plan, task: Design, k: int, dq: Array, v: Array) -> Array:
    """True deviation one period later, from deviation dq under the correction v."""
    s, system = task.ref.s, plan.problem.system

    def rates(t: float, q: Array) -> Array:
        return system.rates(q, plan.u(t) + v)

    start = plan.q(s[k]) + dq
    end = solve_ivp(rates, (s[k], s[k + 1]), start, rtol=1e-11, atol=1e-13).y[:, -1]
    return np.asarray(end - plan.q(s[k + 1]))


@pytest.mark.parametrize("k", [3, 40, 90])
def test_the_linear_model_is_the_derivative_of_the_motion(
    smooth: Plan, plain: Design, k: int
) -> None:
    ref, h = plain.ref, 1e-5
    for i in range(4):
        step = h * np.eye(4)[i]
        slope = (
            moved(smooth, plain, k, step, np.zeros(2)) - moved(smooth, plain, k, -step, np.zeros(2))
        ) / (2 * h)
        assert ref.A[k][:, i] == pytest.approx(slope, abs=2e-5)
    for i in range(2):
        step = h * np.eye(2)[i]
        slope = (
            moved(smooth, plain, k, np.zeros(4), step) - moved(smooth, plain, k, np.zeros(4), -step)
        ) / (2 * h)
        assert ref.B[k][:, i] == pytest.approx(slope, abs=2e-5)


def test_commands_come_early_by_the_known_delay(smooth: Plan) -> None:
    """Without any other effect the tracker adds nothing, and the motion is the plan's."""
    machine = Machine.ideal(delay_s=0.03, servo_bandwidth_rad_s=50.0, control_period_s=0.01)
    run = planner.replay(smooth, machine, feedback=True, record_s=0.1)
    late = planner.replay(smooth, machine, record_s=0.1)
    inside = (run.t > 1.0) & (run.t < 9.5)
    gap = np.abs(run.q - smooth.trajectory.q(run.t))[0, inside, 1:]
    behind = np.abs(late.q - smooth.trajectory.q(late.t))[0, inside, 1:]
    assert gap.max() < 0.02 * behind.max()


def test_a_direction_of_the_drive_goes_on_where_it_stands() -> None:
    least = np.array([0.0, 0.1, 0.0, 0.2, 0.0, -0.3, 0.0, -0.1])
    most = np.array([0.0, 0.2, 0.0, 0.2, 0.0, -0.1, 0.0, 0.1])
    assert _direction(least, most).tolist() == [1, 1, 1, 1, 0, -1, 0, 0]


def test_a_reversing_motor_first_crosses_its_play(smooth: Plan) -> None:
    system = smooth.problem.system
    play = np.deg2rad([[0.0], [0.5]])
    forecast = Forecast(system, play, tick=0.01)
    told = np.zeros((20, 2))
    told[:10, 1], told[10:, 1] = 0.2, -0.2
    history = History(0.01, told, 1)
    q, side = np.zeros((4, 1)), play * np.array([[0.0], [0.5]])  # in contact upwards
    zero = np.zeros(2)
    q, side = forecast(q, side, zero, zero + 0.1, history)
    assert q[1, 0] == pytest.approx(0.02)
    q, side = forecast(q, side, zero + 0.1, zero + 0.2, history)
    assert q[1, 0] == pytest.approx(0.02 - (0.02 - np.deg2rad(0.5)))
    assert side[1, 0] == pytest.approx(-np.deg2rad(0.25))


def test_each_motor_carries_out_what_it_was_told_until_its_own_time(smooth: Plan) -> None:
    history = History(0.1, np.array([[1.0, 10.0], [2.0, 20.0]]), 1)
    travel = history.travel(np.array([0.15, -0.3]))
    assert travel[:, 0] == pytest.approx([0.2, 0.0])
    assert history.travel(np.array([9.0, 0.1]))[:, 0] == pytest.approx([0.3, 1.0])


def estimate(resolution_deg: float) -> Estimate:
    system = Manipulator([0.870125, 0.711625], 0.668811)
    resolution = np.deg2rad([[np.inf], [resolution_deg], [resolution_deg], [resolution_deg]])
    return Estimate(system, np.zeros((4, 1)), resolution)


def test_an_angle_is_known_to_a_step_and_rates_are_learnt() -> None:
    found, step = estimate(0.088), np.deg2rad(0.088)
    true, rng = np.zeros((4, 1)), np.random.default_rng(1)
    errors = []
    for k in range(80):
        advance = np.array([[0.01], [0.005], [0.01], [0.008]]) * rng.uniform(0.8, 1.2)
        true += advance * np.array([[1.0], [1.0], [1.01], [0.985]])
        if k:
            found.predicted(found.q + advance)
        found.read(np.round(true / step) * step)
        errors.append(np.abs(found.q - true)[2:, 0])
        assert np.all(np.abs(found.q - true)[1:] <= step * (1 + 1e-9))
    late = np.array(errors[40:])
    assert np.rad2deg(late.mean()) < 0.5 * 0.088 / 4  # half of what rounding alone would leave
    assert found.rate_error[:, 0] == pytest.approx([0.01, -0.015], abs=2e-3)


def test_a_lost_reading_leaves_the_forecast() -> None:
    found = estimate(0.02)
    found.predicted(np.full((4, 1), 0.3))
    found.read(np.full((4, 1), np.nan))
    assert np.all(found.q == 0.3)
    assert np.all(found.rate_error == 0)
    found.read(np.full((4, 1), 0.1))
    assert found.q[1:, 0] == pytest.approx(np.full(3, 0.1), abs=np.deg2rad(0.0101))


def test_a_joint_in_its_play_teaches_nothing() -> None:
    found = estimate(0.02)
    for _ in range(20):
        found.predicted(found.q + 0.004)
        found.read(np.zeros((4, 1)))
    assert np.all(found.rate_error == 0)


def test_lost_motion_is_half_the_backlash_and_what_friction_winds_up() -> None:
    system = Manipulator([0.87, 0.71], 0.67)
    machine = Machine.ideal(
        backlash_deg=[4.0, 2.0], shaft_stiffness_nm_per_rad=4.0, coulomb_friction_nm=0.2
    )
    assert lost_motion(system, machine) == pytest.approx(np.deg2rad([2.0, 1.0]) + 0.05)
    assert np.all(lost_motion(system, Machine.ideal()) == 0)


def test_the_run_up_ends_where_and_as_the_plan_begins(smooth: Plan, machine: Machine) -> None:
    task = design(smooth, machine, FeedbackTable())
    begin = task.ref.timing.begin
    assert -30 < begin < -5
    assert task.ref.q[0] == pytest.approx(smooth.q(0.0), abs=1e-2)
    at_start = int(np.argmin(np.abs(task.ref.s)))
    assert task.ref.q[at_start][1:] == pytest.approx(smooth.q(task.ref.s[at_start])[1:], abs=1e-2)
    drive = task.ref.feed[:at_start, :, 0]
    assert drive.min() < -0.1
    assert drive.max() > 0.1
    assert np.all(np.abs(task.ref.feed) <= smooth.problem.limits.input + 1e-12)
    assert np.all(np.abs(task.ref.q[:, 1:]) <= np.deg2rad(80))


def test_a_run_up_is_made_only_where_it_helps(smooth: Plan, machine: Machine) -> None:
    for other in (Machine.ideal(), machine.without("backlash_deg", "coulomb_friction_nm")):
        assert design(smooth, other, FeedbackTable()).ref.timing.begin == 0
    assert design(smooth, machine, FeedbackTable(run_up=False)).ref.timing.begin == 0


def test_why_play_cannot_be_taken_up_first(smooth: Plan, machine: Machine) -> None:
    problem = planner.load_problem(PROBLEMS / "paper-fig4.toml")
    turning = planner.solve(problem, "collocation", intervals=20)
    assert "turns back" in hindrance(turning, machine)
    assert design(turning, machine, FeedbackTable()).ref.timing.begin == 0.0
    assert hindrance(smooth, machine) == hindrance(turning, Machine.ideal()) == ""
    assert design(smooth, machine, FeedbackTable()).ref.timing.begin < -10.0
