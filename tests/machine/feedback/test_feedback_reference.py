"""The linear model against the nonlinear system, and what is known of delay, play and rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner import Machine, Manipulator, Plan
from planner.machine.feedback.estimate import (
    Forecast,
    History,
    Pose,
    StateEstimate,
    reading_variance,
)
from planner.machine.feedback.means import gearhead_play, lost_motion, noise_of
from planner.machine.feedback.reference import drive_direction
from planner.machine.feedback.run_up import STEP_S, hindrance, run_up
from planner.machine.feedback.tracker import TrackerDesign, design
from planner.problem.tables.problem_file import FeedbackTable

PROBLEMS = Path(__file__).parents[3] / "problems"


def moved(plan: Plan, task: TrackerDesign, k: int, dq: np.ndarray, v: np.ndarray) -> np.ndarray:
    """True deviation one period later, from deviation dq under the correction v."""
    s, system = task.ref.s, plan.problem.system

    def rates(t: float, q: np.ndarray) -> np.ndarray:
        return system.rates(q, plan.u(t) + v)

    start = plan.q(s[k]) + dq
    end = solve_ivp(rates, (s[k], s[k + 1]), start, rtol=1e-11, atol=1e-13).y[:, -1]
    return np.asarray(end - plan.q(s[k + 1]))


@pytest.mark.parametrize("k", [3, 40, 90])
def test_the_linear_model_is_the_derivative_of_the_motion(
    smooth: Plan, plain: TrackerDesign, k: int
) -> None:
    for i, step in enumerate(1e-5 * np.eye(6)):
        sides = [moved(smooth, plain, k, *np.split(s * step, [4])) for s in (1, -1)]
        found = np.hstack([plain.ref.A[k], plain.ref.B[k]])[:, i]
        assert found == pytest.approx((sides[0] - sides[1]) / 2e-5, abs=2e-5)


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
    assert drive_direction(least, most).tolist() == [1, 1, 1, 1, 0, -1, 0, 0]


def test_a_reversing_motor_first_crosses_its_play(smooth: Plan) -> None:
    """Motor 2 that of its gearhead, and motor 1 that of its own and then those of the joints."""
    system, half = smooth.problem.system, np.deg2rad(0.25)
    lost = np.deg2rad([[0.25], [1.0], [2.0]])
    forecast = Forecast(system, 2 * half, tick=0.01)
    told = np.zeros((20, 2))
    told[:10], told[10:] = 0.2, -0.2
    history, zero, all_passed = History(0.01, told, 1), np.zeros(2), np.ones((3, 1))
    q = np.zeros((4, 1))
    exact = np.zeros((4, 1))
    known = StateEstimate(q, exact, exact, lost, np.full((3, 1), 1e-18))
    known.pose = Pose(q, q[1:] + lost, np.full(1, half))  # in contact upwards
    before = known.pose = forecast(known, zero, zero + 0.1, history, all_passed)
    assert before.q[1, 0] == pytest.approx(0.02)
    assert np.all(before.q[2:] > 0.008)
    after = forecast(known, zero + 0.1, zero + 0.2, history, all_passed)
    assert after.q[1, 0] == pytest.approx(0.02 - (0.02 - 2 * half))
    assert after.side == pytest.approx(-half)
    assert np.all(after.axis[1:] < before.axis[1:])
    assert np.all(after.q[2:] == before.q[2:])  # both axes are still on their way through play


def test_each_motor_carries_out_what_it_was_told_until_its_own_time(smooth: Plan) -> None:
    history = History(0.1, np.array([[1.0, 10.0], [2.0, 20.0]]), 1)
    travel = history.travel(np.array([0.15, -0.3]))
    assert travel[:, 0] == pytest.approx([0.2, 0.0])
    assert history.travel(np.array([9.0, 0.1]))[:, 0] == pytest.approx([0.3, 1.0])


def estimate(
    resolution_deg: float, lost_deg: float = 0.0, noise_deg: float = 0.0, count: int = 1
) -> StateEstimate:
    resolution = np.deg2rad([[np.inf], [resolution_deg], [resolution_deg], [resolution_deg]])
    noise = np.deg2rad([[0.0], [noise_deg], [noise_deg], [noise_deg]])
    lost = np.full((3, 1), np.deg2rad(lost_deg))
    variance = reading_variance(resolution, noise, False)
    return StateEstimate(np.zeros((4, count)), resolution, noise, lost, variance)


def forecast_by(found: StateEstimate, advance: np.ndarray) -> None:
    """The axes turn by `advance` (3, 1), and joints follow as the estimate has it."""
    axis = found.pose.axis + (1 + found.rate_error) * advance
    q = found.pose.q.copy()
    q[1:] = np.clip(q[1:], axis - found.lost_motion, axis + found.lost_motion)
    found.take_forecast(Pose(q, axis, found.pose.side))


def test_an_angle_is_known_to_a_step_and_rates_are_learnt() -> None:
    found, step = estimate(0.088), np.deg2rad(0.088)
    true, rng = np.zeros((4, 1)), np.random.default_rng(1)
    errors = []
    for k in range(80):
        advance = np.array([[0.005], [0.01], [0.008]]) * rng.uniform(0.8, 1.2)
        true[1:] += advance * np.array([[1.0], [1.01], [0.985]])
        if k:
            forecast_by(found, advance)
        found.read(np.round(true / step) * step)
        errors.append(np.abs(found.pose.q - true)[2:, 0])
        assert np.all(np.abs(found.pose.q - true)[1:] <= step * (1 + 1e-9))
    late = np.array(errors[40:])
    assert np.rad2deg(late.mean()) < 0.5 * 0.088 / 4  # half of what rounding alone would leave
    assert found.rate_error[:, 0] == pytest.approx([0.0, 0.01, -0.015], abs=2e-3)


def joints_that_are_pushed(
    noise_deg: float, rate_deg: float, told_deg: float, jump_deg: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the estimate, degrees: of 300 axes before they reach their joints, at reading 60 of
    120, and of the joints, the largest of each. In each period the axes turn by `rate_deg`."""
    count, rng = 300, np.random.default_rng(2)
    found = estimate(0.088, 60 * rate_deg, told_deg, count)
    off_joint, off_axis = np.zeros(count), np.zeros(count)
    for k in range(120):
        if k:
            forecast_by(found, np.full((3, 1), np.deg2rad(rate_deg)))
        joint = rate_deg * max(0, k - 60)
        read = joint + noise_deg * rng.normal(size=(4, count)) + jump_deg * (k == 30)
        found.read(np.deg2rad(0.088 * np.round(read / 0.088)))
        off_joint = np.maximum(off_joint, np.abs(np.rad2deg(found.pose.q[3]) - joint))
        if k == 59:
            off_axis = np.abs(np.rad2deg(found.pose.axis[2]) - rate_deg * k)
    return off_axis, off_joint


@pytest.mark.parametrize("rate", [0.06, 0.3])
@pytest.mark.parametrize(
    ("noise", "told"), [(0.03, 0.03), (0.03, 0.02), (0.1, 0.1), (0.01, 0.022), (0.004, 0.022)]
)
def test_noise_pushes_no_resting_joint(noise: float, told: float, rate: float) -> None:
    """Of ten steps in 300 readings one was taken for a push, and the axis moved to the joint."""
    off_axis, off_joint = joints_that_are_pushed(noise, rate, told)
    assert np.mean(off_axis > 0.5) < 0.02
    assert np.percentile(off_joint, 95) < 0.15 + 6 * noise + 2 * rate  # the push is seen


def test_noise_far_below_a_step_counts_as_a_quarter_of_the_step(paper: planner.Problem) -> None:
    machine = Machine.prototype(encoder_noise_deg=[0.004, 0.05, 0.0])
    assumed = np.rad2deg(noise_of(paper.system, machine))[:, 0]
    assert assumed == pytest.approx([0.0, 0.022, 0.05, 0.0])


def test_a_reading_that_jumps_pushes_no_resting_joint() -> None:
    off_axis, _ = joints_that_are_pushed(0.03, 0.3, 0.03, jump_deg=8.0)
    assert np.mean(off_axis > 0.5) < 0.02


def test_a_lost_reading_leaves_the_forecast() -> None:
    found = estimate(0.02)
    forecast_by(found, np.full((3, 1), 0.3))
    found.read(np.full((4, 1), np.nan))
    assert np.all(found.pose.q[1:] == 0.3)
    assert np.all(found.rate_error == 0)
    found.read(np.full((4, 1), 0.1))
    assert found.pose.q[1:, 0] == pytest.approx(np.full(3, 0.1), abs=np.deg2rad(0.0101))


@pytest.mark.parametrize("true_deg", [2.6, 3.9])
def test_lost_motion_is_learnt_by_going_back_and_forth(true_deg: float) -> None:
    """Told 3 degrees, from an unknown place in it: after both contacts it is known to a step."""
    found, step, lost = estimate(0.02, 3.0), np.deg2rad(0.02), np.deg2rad(true_deg)
    joint, axis = np.zeros((4, 1)), np.full((3, 1), np.deg2rad(0.7))
    for k in range(100):
        if k:
            advance = np.full((3, 1), np.deg2rad(-0.3 if k < 40 else 0.3))
            axis += advance
            joint[1:] = np.clip(joint[1:], axis - lost, axis + lost)
            forecast_by(found, advance)
        found.read(np.round(joint / step) * step)
        assert found.pose.q[1:] == pytest.approx(joint[1:], abs=1.01 * step)
    assert np.rad2deg(found.lost_motion[:, 0]) == pytest.approx(np.full(3, true_deg), abs=0.02)
    assert np.abs(found.rate_error).max() < 0.002


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
    assert -8.5 < begin < -5
    assert task.ref.q[0, :2] == pytest.approx(smooth.q(0.0)[:2], abs=2e-2)
    assert task.ref.joints[0] == pytest.approx(smooth.q(0.0)[2:], abs=1e-2)
    # pushed back at first, from the middle of its play
    assert task.ref.q[0, 2:] == pytest.approx(
        task.ref.joints[0] + task.ref.lost_motion[:, 0], abs=1e-2
    )
    at_start = int(np.argmin(np.abs(task.ref.s)))
    assert task.ref.q[at_start][1:] == pytest.approx(smooth.q(task.ref.s[at_start])[1:], abs=1e-2)
    drive = task.ref.feed[:at_start, :, 0]
    assert drive.min() < -0.1
    assert drive.max() > 0.1
    assert np.all(np.abs(task.ref.feed) <= smooth.problem.limits.input + 1e-12)
    assert np.all(np.abs(task.ref.q[:, 1:]) <= np.deg2rad(80))


@pytest.mark.parametrize("joints", [2, 3])
def test_the_run_up_moves_as_is_forecast_step_by_step(joints: int) -> None:
    """All coordinates at once, as the tracker forecasts, give what one after the other does."""
    ends = [1.0] * joints, [30.0] * joints
    problem = planner.Problem.manipulator(*ends, duration=10, input_rad_s=0.5)
    plan, machine = planner.solve(problem), Machine.prototype()
    found = run_up(plan, machine, FeedbackTable())
    assert found is not None
    play = gearhead_play(problem.system, machine)
    lost = np.concatenate([play[1:] / 2, lost_motion(problem.system, machine)])[:, None]
    forecast, start = Forecast(problem.system, play[0], STEP_S), plan.q(0.0)[:, None]
    poses = [Pose(start, start[1:], np.zeros(1))]
    for u in found.u:
        poses.append(forecast.predict(poses[-1], STEP_S * u[:, None], lost, np.ones_like(lost)))
    q = np.stack([pose.q[:, 0] for pose in poses])
    assert found.q[-1] == pytest.approx(plan.q(0.0))
    assert found.q == pytest.approx(
        q + np.linspace(0.0, 1.0, len(q))[:, None] * (plan.q(0.0) - q[-1]), abs=1e-12
    )


def test_a_run_up_is_made_only_where_it_helps(smooth: Plan, machine: Machine) -> None:
    for other in (Machine.ideal(), machine.without("backlash_deg", "coulomb_friction_nm")):
        assert design(smooth, other, FeedbackTable()).ref.timing.begin == 0
    assert design(smooth, machine, FeedbackTable(run_up=False)).ref.timing.begin == 0


def test_why_play_cannot_be_taken_up_first(smooth: Plan, machine: Machine) -> None:
    problem = planner.load_problem(PROBLEMS / "paper-fig4.toml")
    turning = planner.solve(problem, "collocation", intervals=20)
    assert "reverses" in hindrance(turning, machine)
    assert design(turning, machine, FeedbackTable()).ref.timing.begin == 0.0
    assert hindrance(smooth, machine) == hindrance(turning, Machine.ideal()) == ""
    assert design(smooth, machine, FeedbackTable()).ref.timing.begin < -5.0


def test_joints_with_inertia_coast_little_during_the_run_up(smooth: Plan) -> None:
    """A swing leaves them at its speed, a drive at up to twice its own."""
    rigid, swinging = (
        run_up(smooth, Machine.prototype(fidelity=fidelity), FeedbackTable())
        for fidelity in ("quasi-static", "dynamic")
    )
    assert rigid is not None
    assert swinging is not None
    speed = np.max(np.abs(swinging.u), axis=0) * [2, 1]
    coasts = np.rad2deg(0.0316 * speed**2 / (2 * 0.187))
    np.testing.assert_array_less(coasts, 0.25 + 1e-9)
    assert np.rad2deg(0.0316 * np.max(rigid.u[:, 1]) ** 2 / (2 * 0.187)) > 0.5
    slow = Machine.prototype(fidelity="dynamic", coulomb_friction_nm=0.0)
    longest = run_up(smooth, slow, FeedbackTable())
    assert longest is not None
    assert -rigid.t[0] < -swinging.t[0] < -longest.t[0] < -5 * rigid.t[0]


def test_the_run_up_goes_back_further_where_lost_motion_spreads_more(smooth: Plan) -> None:
    def back(times: float) -> float:
        spreads = {
            "backlash_deg": {"value": 2.69, "spread": 0.538 * times},
            "coulomb_friction_nm": {"value": 0.187, "spread": 0.0374 * times},
            "shaft_stiffness_nm_per_rad": {"value": 3.22, "spread": 0.322 * times},
        }
        motion = run_up(smooth, Machine.prototype(**spreads), FeedbackTable())
        assert motion is not None
        return float(np.rad2deg(motion.q[0, 3] - motion.q[:, 3].min()))

    assert back(0.0) == pytest.approx(back(1.0))
    assert 7.0 < back(2.0) - back(1.0) < 8.5
