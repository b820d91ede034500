"""The prototype shows the paper's error on a plan of the paper's kind (Figs 9 and 10)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import planner
from planner import Machine, Plan, Replay, replay
from planner.machine import machine


@pytest.fixture(scope="module")
def run(smooth_plan: Plan) -> Replay:
    return replay(smooth_plan, Machine.prototype(step_s=0.005), samples=300)


def test_the_prototype_is_a_machine_file_to_copy() -> None:
    file = Path(machine.__file__).with_name("prototype.toml")
    assert planner.load_machine(file) == Machine.prototype()


def test_the_plan_is_one_that_its_motors_can_follow(smooth_plan: Plan) -> None:
    assert np.rad2deg(smooth_plan.q(10.0)[1:]) == pytest.approx([30, 30, 30], abs=1e-6)
    assert np.all(smooth_plan.peak_u < 0.25)
    assert np.max(np.abs(replay(smooth_plan, Machine.ideal()).terminal_error)) < 1e-9


def test_theta_3_is_off_by_five_degrees_though_motors_follow(
    run: Replay, smooth_plan: Plan
) -> None:
    assert np.median(run.largest_error_deg[:, 2]) == pytest.approx(5.0, abs=0.4)
    low, high = np.percentile(run.index_E_deg, [5, 95])
    assert 3.0 < low < high < 10.0
    assert high - low > 1.5
    moving = (run.t > 0.5) & (run.t < 9.9)
    commanded = smooth_plan.u(run.t[moving])
    gap = np.abs(run.motor_rates[:, moving] - commanded)
    assert np.percentile(gap, 99) < 0.03 * np.max(np.abs(commanded))
    assert np.all(run.saturated_s == 0)
    assert np.median(run.largest_error_deg[:, 0]) < 1.0


def test_play_and_soft_shafts_are_the_larger_part(smooth_plan: Plan) -> None:
    machine = Machine.prototype(step_s=0.005).nominal()
    whole = replay(smooth_plan, machine).largest_error_deg[0, 2]
    stiff = replay(smooth_plan, machine.without("backlash_deg", "shaft_stiffness_nm_per_rad"))
    assert stiff.largest_error_deg[0, 2] < 0.25 * whole
