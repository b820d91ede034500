"""The dynamic manipulator: limits, energy, order, agreement with the quasi-static one."""

from __future__ import annotations

import numpy as np
import pytest
from handmade import arm_problem, draws_of, inputs, plan_from

from planner.machine import Machine
from planner.machine.dynamic import DynamicChain
from planner.plan import Plan
from planner.replay import replay
from planner.systems import Manipulator
from planner.systems.base import Array


def arm(n: int) -> Manipulator:
    return Manipulator([0.87 * 0.8 ** (i - 2) for i in range(2, n + 1)], 0.67)


def start(n: int) -> Array:
    return np.deg2rad(np.array([0.0, *np.linspace(10, 20, n)]))[:, None]


@pytest.fixture(scope="module")
def jumping() -> Plan:
    """A plan of 1 s whose inputs jump at 0.5 s and are not zero at either end."""
    u = inputs(([0.3], [0.5, 0.1]), ([-0.2], [-0.4, 0.2]), breaks=[0.0, 0.5, 1.0])
    return plan_from(arm_problem([10, 20, 15], end=1.0), u, pieces=100)


def test_without_effects_it_is_the_plan_to_second_order(jumping: Plan) -> None:
    errors = []
    for step in (8e-3, 4e-3, 2e-3):
        machine = Machine.ideal(fidelity="dynamic", step_s=step)
        run = replay(jumping, machine, settle_s=0.02, record_s=None)
        errors.append(np.max(np.abs(run.terminal_error)))
    assert errors[2] < 2e-7
    assert np.polyfit(np.log([8, 4, 2]), np.log(errors), 1)[0] == pytest.approx(2, abs=0.3)


def test_at_rest_it_stays_at_rest() -> None:
    effects = {"shaft_stiffness_nm_per_rad": 4.0, "backlash_deg": 2.0, "link_inertia_kgm2": 0.02}
    plant = DynamicChain(arm(3), draws_of(**effects), start(3))
    for _ in range(5):
        plant.step(np.zeros((2, 2, 1)), np.zeros((1, 2, 1)), 1e-3)
    assert np.array_equal(plant.q, start(3))
    assert plant.stored_J == 0
