"""Replays with feedback: when it reads, what it reads, and when its corrections arrive."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine import Machine
from planner.machine.loop import Correct
from planner.plan import Plan
from planner.replay import Replay, replay
from planner.systems.base import Array

PERIOD = 0.1
RAMP = inputs(([0.3, 0.1], [-0.2, 0.4]), breaks=[0.0, 2.0])


class Script:
    """Adds what a table says, whatever is read; keeps what was read."""

    period_s = PERIOD

    def __init__(self, table: Array) -> None:
        self.table = table  # (readings, 2)
        self.read: list[tuple[float, Array]] = []

    def start(self, plan: Plan, numbers: NDArray[np.int64]) -> Correct:
        steps = iter(self.table)

        def correct(t: float, measured: Array) -> Array:
            self.read.append((t, measured))
            return np.repeat(next(steps)[:, None], len(numbers), axis=1)

        return correct


class Proportional:
    """Drives joint 1 to the plan by motor 2, at once and in a simple way."""

    period_s = PERIOD

    def start(self, plan: Plan, numbers: NDArray[np.int64]) -> Correct:
        def correct(t: float, measured: Array) -> Array:
            gap = plan.q(t)[1] - measured[1]
            return np.stack([np.zeros_like(gap), 4.0 * gap])

        return correct


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_from(arm_problem([10, 20, 15], end=2.0), RAMP, pieces=100)


def table() -> Array:
    return np.random.default_rng(1).uniform(-0.3, 0.3, (20, 2))


def turned(run: Replay) -> Array:
    """Travel of joint 1, which is the integral of motor 2, (S,)."""
    return np.asarray(run.q[:, -1, 1] - run.q[:, 0, 1])


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"control_period_s": 0.01},
        {"delay_s": 0.0137},
        {"control_period_s": 0.02, "delay_s": 0.033},
        {"control_period_s": 0.01, "delay_s": {"value": 0.02, "spread": 0.01}},
        {"delay_s": {"value": 0.02, "spread": 0.01}},
    ],
    ids=str,
)
def test_a_correction_holds_from_its_reading_to_the_next(plan: Plan, effects: Any) -> None:
    script, machine = Script(table()), Machine.ideal(**effects)
    free = replay(plan, machine, samples=3)
    run = replay(plan, machine, samples=3, feedback=script)
    assert [t for t, _ in script.read] == pytest.approx(PERIOD * np.arange(20))
    assert np.array_equal(run.corrections, np.broadcast_to(table(), (3, 20, 2)))
    assert free.corrections.shape == (3, 0, 2)
    # A delay that differs between samples is seen at the next point of the grid.
    loose = 2e-3 if "spread" in str(effects) else 1e-9
    assert turned(run) - turned(free) == pytest.approx(table()[:, 1].sum() * PERIOD, abs=loose)


def test_corrections_pass_sample_and_hold_and_delay(plan: Plan) -> None:
    """Readings 0.1 s apart, a period of 0.04 s: 0.1 waits for 0.12, and 0.03 s more on its way."""
    machine = Machine.ideal(control_period_s=0.04, delay_s=0.03)
    steps = np.zeros((20, 2))
    steps[1:, 1] = 0.2
    run = replay(plan, machine, feedback=Script(steps), record_s=1e-3)
    free = replay(plan, machine, record_s=1e-3)
    added = np.interp(run.t, run.t, run.motor_rates[0, :, 1]) - np.interp(
        run.t, free.t, free.motor_rates[0, :, 1]
    )
    assert np.max(np.abs(added[run.t < 0.15 - 1e-9])) < 1e-12
    assert added[(run.t > 0.1505) & (run.t < 2.029)] == pytest.approx(0.2, abs=1e-9)
    assert np.max(np.abs(added[run.t > 2.0305])) < 1e-12


def test_corrections_are_commands_like_any_other(plan: Plan) -> None:
    machine = Machine.ideal(velocity_resolution_rad_s=0.1, control_period_s=0.01)
    run = replay(plan, machine, feedback=Script(table()), record_s=0.01)
    assert run.motor_rates / 0.1 == pytest.approx(np.round(run.motor_rates / 0.1), abs=1e-9)
    limited = replay(plan, Machine.ideal(velocity_limit_rad_s=0.25), feedback=Script(table() + 1.0))
    assert np.max(np.abs(limited.motor_rates)) <= 0.25
    assert limited.saturated_s[0] == pytest.approx([2.0, 2.0], abs=1e-6)


def test_readings_are_what_the_encoders_say(plan: Plan) -> None:
    script = Script(np.zeros((20, 2)))
    machine = Machine.ideal(encoder_resolution_deg=0.5, initial_angle_error_deg=1.0)
    run = replay(plan, machine, samples=2, feedback=script, record_s=PERIOD)
    for k, (_, read) in enumerate(script.read):
        assert read.shape == (4, 2)
        assert np.allclose(read, run.measured[:, k].T, atol=1e-12)
        assert np.allclose(np.rad2deg(read[1:]) / 0.5, np.round(np.rad2deg(read[1:]) / 0.5))


def test_a_loop_takes_out_what_open_loop_keeps(plan: Plan) -> None:
    machine = Machine.prototype().only("control_period_s", "delay_s", "initial_angle_error_deg")
    free = replay(plan, machine, samples=20)
    run = replay(plan, machine, samples=20, feedback=Proportional())
    # What differs from machine to machine goes; the lag by the delay, alike for all, stays.
    assert np.ptp(run.terminal_error[:, 1]) < 1e-4 * np.ptp(free.terminal_error[:, 1])


def test_chunks_do_not_matter_in_closed_loop(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine.prototype(step_s=0.005)
    whole = replay(plan, machine, samples=5, feedback=Proportional())
    monkeypatch.setattr(sys.modules["planner.machine.simulate"], "CHUNK", 2)
    parts = replay(plan, machine, samples=5, feedback=Proportional())
    assert np.array_equal(whole.q, parts.q)
    assert np.array_equal(whole.corrections, parts.corrections)


def test_a_correction_that_is_no_number_is_refused(plan: Plan) -> None:
    steps = np.zeros((20, 2))
    steps[3, 0] = np.nan
    with pytest.raises(InputError, match=r"not finite at t = 0\.3 s"):
        replay(plan, Machine.ideal(), feedback=Script(steps))
