"""Replays with feedback: when it reads, what it reads, and when its commands arrive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from

from planner import InputError, Machine, Plan, Replay, replay

PERIOD, TICK, END = 0.1, 0.02, 2.0
RAMP = inputs(([0.3, 0.1], [-0.2, 0.4]), breaks=[0.0, END])


class Scripted:
    """A controller and its own maker: `rule` from times (M,) and readings (N, S) to commands."""

    period_s, tick_s = PERIOD, TICK

    def __init__(
        self,
        rule: Callable[[np.ndarray, np.ndarray], np.ndarray],
        lead: float = 0.0,
        end: float = END,
    ) -> None:
        self.rule, self.lead_s, self.end_s = rule, lead, end
        self.read: list[tuple[float, np.ndarray]] = []
        self.fallbacks = np.zeros(0, dtype=np.int64)

    def start(self, plan: Plan, machine: Machine, numbers: np.ndarray) -> Scripted:
        self.fallbacks = numbers + 7
        return self

    def __call__(self, t: float, measured: np.ndarray) -> np.ndarray:
        self.read.append((t, measured.copy()))
        return self.rule(t + TICK * np.arange(round(PERIOD / TICK)), measured)


def wave(times: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Differs from tick to tick and from sample to sample."""
    factor = 1 + np.arange(measured.shape[1])
    u = np.stack([0.3 * np.cos(3 * times), 0.2 * np.sin(5 * times) + 0.1], axis=-1)
    return u[:, :, None] * factor


def to_plan(plan: Plan) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The plan's input, and joint 1 driven towards the plan by motor 2."""

    def rule(times: np.ndarray, measured: np.ndarray) -> np.ndarray:
        u = np.repeat(plan.u(times)[:, :, None], measured.shape[1], axis=2)
        u[:, 1] += 4.0 * (plan.trajectory.q(times[0])[1] - measured[1])
        return u

    return rule


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_from(arm_problem([10, 20, 15], end=END), RAMP, pieces=100)


@pytest.fixture(params=["compiled", "numpy"], autouse=True)
def _both_ways(request: pytest.FixtureRequest, use: Any) -> None:
    """To replay a manipulator."""
    use(request.getfixturevalue("library") if request.param == "compiled" else None)


def turned(run: Replay) -> np.ndarray:
    """Travel of joint 1, which is the integral of motor 2, (S,)."""
    return np.asarray(run.q[:, -1, 1] - run.q[:, 0, 1])


@pytest.mark.parametrize(
    "effects",
    [{}, {"delay_s": 0.0137}, {"delay_s": {"value": 0.02, "spread": 0.01}}],
)
def test_a_command_holds_for_its_tick_and_none_is_lost(plan: Plan, effects: Any) -> None:
    run = replay(plan, Machine.ideal(step_s=0.005, **effects), samples=3, feedback=Scripted(wave))
    ticks = TICK * np.arange(100)
    told = wave(ticks, np.empty((4, 3)))
    # A delay that differs between samples is seen at the next point of the grid.
    loose = 5e-3 if "spread" in str(effects) else 1e-9
    assert turned(run) == pytest.approx(told[:, 1].sum(axis=0) * TICK, abs=loose)
    assert run.effort == pytest.approx(np.sum(told**2, axis=(0, 1)) * TICK)
    assert run.fallbacks.tolist() == [7, 8, 9]
    assert replay(plan, Machine.ideal(), samples=3).effort is None


def test_each_command_comes_when_it_should(plan: Plan) -> None:
    delay = 0.033
    run = replay(plan, Machine.ideal(delay_s=delay), feedback=Scripted(wave), record_s=1e-3)
    inside = (run.t >= delay) & (run.t < END + delay)
    tick = TICK * np.floor((run.t[inside] - delay) / TICK + 1e-6)
    assert run.motor_rates[0, inside] == pytest.approx(wave(tick, np.empty((4, 1)))[..., 0])
    assert not np.any(run.motor_rates[0, ~inside])


def test_commands_pass_resolution_and_limits(plan: Plan) -> None:
    machine = Machine.ideal(velocity_resolution_rad_s=0.1, velocity_limit_rad_s=0.25, step_s=0.005)
    run = replay(plan, machine, samples=2, feedback=Scripted(wave), record_s=0.01)
    free = np.abs(run.motor_rates) < 0.25
    rates = run.motor_rates[free] / 0.1
    assert rates == pytest.approx(np.round(rates), abs=1e-9)
    assert np.max(np.abs(run.motor_rates)) == 0.25
    assert np.all(run.saturated_s[1] > run.saturated_s[0])


def test_readings_are_what_the_encoders_say(plan: Plan) -> None:
    controller = Scripted(to_plan(plan))
    noise = {"encoder_noise_deg": [0.3, 1.0, 0.5], "encoder_resolution_deg": 0.5}
    machine = Machine.ideal(**noise, initial_angle_error_deg=1.0, step_s=0.005)
    run = replay(plan, machine, samples=2, feedback=controller, record_s=PERIOD)
    assert [t for t, _ in controller.read] == pytest.approx(PERIOD * np.arange(20))
    for k, (_, read) in enumerate(controller.read):
        assert read.shape == (4, 2)
        assert np.allclose(read, run.measured[:, k].T, atol=1e-12)
        steps = np.rad2deg(read[1:]) / 0.5
        assert np.allclose(steps, np.round(steps))


def test_noise_depends_on_seed_machine_and_time_only(plan: Plan) -> None:
    machine = Machine.ideal(encoder_noise_deg=[0.3, 0.2, 0.1], step_s=0.005)
    runs = replay(plan, machine, samples=400, seed=5, record_s=0.25)
    noise = np.rad2deg(runs.measured - runs.q)[..., 1:]
    assert noise.std(axis=(0, 1)) == pytest.approx([0.3, 0.2, 0.1], rel=0.05)
    assert np.abs(noise.mean(axis=(0, 1))).max() < 0.02
    flat = noise.reshape(400, -1)  # readings, joints and machines differ independently
    assert np.abs(np.corrcoef(flat.T) - np.eye(flat.shape[1])).max() < 0.25
    assert np.abs(np.corrcoef(flat[:20]) - np.eye(20)).max() < 0.8
    some = replay(plan, machine, samples=[7, 3], seed=5, record_s=0.05)
    common = np.isin(np.round(some.t, 6), np.round(runs.t, 6))
    assert np.array_equal(some.measured[:, common], runs.measured[[7, 3]])
    assert np.array_equal(runs.again([3]).measured[0], runs.measured[3])
    other = replay(plan, machine, samples=[7], seed=6, record_s=0.25)
    assert np.all(other.measured[0, :, 1:] != runs.measured[7, :, 1:])


def test_a_controller_may_begin_before_and_end_after_the_plan(plan: Plan) -> None:
    rest = Scripted(lambda times, read: 0.1 + np.zeros((len(times), 2, read.shape[1])), 0.5, 2.3)
    machine = Machine.ideal(input_bias_rad_s=0.01, step_s=0.005)
    run = replay(plan, machine, feedback=rest, record_s=0.1, settle_s=0.5)
    assert rest.read[0][0] == -0.5
    assert rest.read[-1][0] == pytest.approx(2.2)
    later, rate = run.t >= 0, 0.11  # the drive runs, bias and all, as long as the controller
    assert run.q[0, 0, 1] == pytest.approx(np.deg2rad(10))
    assert run.q[0, later, 1][0] == pytest.approx(np.deg2rad(10) + 0.5 * rate)
    assert run.q[0, -1, 1] == pytest.approx(np.deg2rad(10) + 2.8 * rate)
    assert run.t[:7] == pytest.approx([-0.5, -0.4, -0.3, -0.2, -0.1, 0.0, 0.1])
    assert run.t[-1] == 2.5
    apart = np.abs(run.q[0, later, 1] - plan.trajectory.q(run.t[later])[:, 1])
    assert run.deviation[0, 0] == pytest.approx(np.max(apart), abs=1e-3)


def test_a_loop_takes_out_what_open_loop_keeps(plan: Plan) -> None:
    machine = Machine.prototype(step_s=0.005).only(
        "control_period_s", "delay_s", "initial_angle_error_deg"
    )
    free = replay(plan, machine, samples=20)
    run = replay(plan, machine, samples=20, feedback=Scripted(to_plan(plan)))
    # What differs from machine to machine goes; the lag by the delay, alike for all, stays.
    assert np.ptp(run.terminal_error[:, 1]) < 1e-3 * np.ptp(free.terminal_error[:, 1])


@pytest.mark.parametrize(
    ("value", "text"), [(np.nan, r"not finite at t = 0\.3 s"), (np.zeros(2), "shape")]
)
def test_commands_that_are_none_are_refused(plan: Plan, value: Any, text: str) -> None:
    def rule(times: np.ndarray, measured: np.ndarray) -> np.ndarray:
        if times[0] < 0.29:
            return np.zeros((len(times), 2, 1))
        return np.asarray(value) * np.ones((len(times), 2, 1)) if np.ndim(value) == 0 else value

    with pytest.raises(InputError, match=text):
        replay(plan, Machine.ideal(), feedback=Scripted(rule))
