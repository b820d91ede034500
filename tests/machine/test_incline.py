"""An arm on an inclined plane: gravity on the links, in both fidelities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import INERTIA, chain, drive
from handmade import arm_problem, draws_of, inputs, plan_from

from planner import InputError, Machine, Manipulator, replay
from planner.machine.disk_chain import DiskChain
from planner.machine.friction.contact_load import GRAVITY_M_S2
from planner.systems.manipulator import gravity_torques

SLOPE, MOMENT = 12.0, [0.3, 0.2, 0.1]
GRAVITY: dict[str, Any] = {"incline_deg": SLOPE, "link_moment_kgm": MOMENT}
ARM = Manipulator([0.87, 0.7], 0.67)
Q = np.deg2rad(np.array([[0.0], [10], [20], [-25]]))


def potential(theta: np.ndarray) -> float:
    """Height of three point masses at the ends of links of length 1, 2, 3, times their weights.

    Masses are such that every link carries the moment of `MOMENT` about its own joint.
    """
    lengths = np.array([1.0, 2.0, 3.0])
    beyond = np.array(MOMENT) / lengths  # mass at or beyond each link's end
    masses = beyond - np.append(beyond[1:], 0.0)
    heights = np.cumsum(lengths * np.sin(np.cumsum(theta)))
    return float(GRAVITY_M_S2 * np.sin(np.deg2rad(SLOPE)) * masses @ heights)


def test_torques_are_the_slope_of_the_height_of_the_masses() -> None:
    theta = np.array([0.4, -0.9, 0.7])
    weights = GRAVITY_M_S2 * np.sin(np.deg2rad(SLOPE)) * np.array(MOMENT)
    for i, torque in enumerate(gravity_torques(weights, theta)):
        step = 1e-6 * np.eye(3)[i]
        slope = (potential(theta + step) - potential(theta - step)) / 2e-6
        assert torque == pytest.approx(-slope, rel=1e-8)


def moved(plant: DiskChain, u: list[float], steps: int) -> np.ndarray:
    """Coordinates of sample 0 after so many milliseconds at constant speeds of the motors."""
    speed = np.tile(np.array(u)[None, :, None], (3, 1, 1))
    for _ in range(steps):
        plant.step(speed, speed[1:] * np.array([[[5e-4]], [[1e-3]]]), 1e-3)
    return plant.q[:, 0].copy()


def loads(q: np.ndarray) -> np.ndarray:
    """Of gravity on joints 2 and 3, N m."""
    weights = GRAVITY_M_S2 * np.sin(np.deg2rad(SLOPE)) * np.array(MOMENT)
    return np.asarray(gravity_torques(weights, q[1:])[1:])


def test_an_arm_starts_settled_and_stays() -> None:
    plant = DiskChain(ARM, draws_of(**GRAVITY, backlash_deg=2, shaft_stiffness_nm_per_rad=5.0), Q)
    assert moved(plant, [0, 0], 50) == pytest.approx(Q[:, 0], abs=1e-15)


def test_a_soft_shaft_sags_by_load_over_stiffness() -> None:
    stiff = 50.0
    sagging = DiskChain(ARM, draws_of(**GRAVITY, shaft_stiffness_nm_per_rad=stiff), Q)
    sagging.step(np.zeros((2, 2, 1)), np.zeros((1, 2, 1)), 1e-3)
    moved(sagging, [0.3, 0.2], 1000)
    ahead = (sagging.axes - sagging.q[1:])[1:, 0]
    assert ahead == pytest.approx(-loads(sagging.q[:, 0]) / stiff, rel=2e-3)


@pytest.mark.parametrize(("friction", "falls"), [(0.05, True), (5.0, False)])
def test_gravity_beyond_friction_takes_the_link_through_its_play(
    friction: float, falls: bool
) -> None:
    """Driven downwards, a heavy link runs ahead; one held by friction has to be pushed."""
    effects = {**GRAVITY, "backlash_deg": 2.0, "coulomb_friction_nm": friction}
    plant = DiskChain(ARM, draws_of(**effects), Q)
    assert np.all(loads(Q[:, 0]) < -0.05)
    moved(plant, [-0.5, 0.0], 400)  # both joints go down by more than their play
    ahead = np.rad2deg(plant.axes - plant.q[1:])[1:, 0]
    assert ahead == pytest.approx([1.0, 1.0] if falls else [-1.0, -1.0])


def test_what_runs_down_does_not_load_the_contacts() -> None:
    """Up the slope the contacts carry friction and weight, down it friction less weight."""

    def creep(u1: float) -> float:
        effects = {**GRAVITY, "coulomb_friction_nm": 0.6, "creep_per_nm": 0.1}
        plant, free = DiskChain(ARM, draws_of(**effects), Q), DiskChain(ARM, draws_of(), Q)
        return float(
            1 - (moved(plant, [u1, 0], 1) - Q[:, 0])[2] / (moved(free, [u1, 0], 1) - Q[:, 0])[2]
        )

    up, down = creep(1.0), creep(-1.0)
    assert up > 3 * down > 0


def test_the_energy_of_the_links_height_is_accounted_for() -> None:
    plant = chain(3, **INERTIA, **GRAVITY, torque_limit_nm=1e-12)
    before, start = plant.stored_J, plant.q.copy()
    lows = drive(plant, 1500, lambda t: np.zeros(2), 0.3, lambda: plant.q[1:, 0].copy())
    fallen = potential(start[1:, 0]) - potential(lows[-1])
    assert fallen > 0.01  # it does fall, by itself
    gained = plant.stored_J[0] - before[0]
    assert abs(gained + plant.lost_J[0] - plant.work_J[0]) < 2e-3 * fallen


def test_both_fidelities_agree_the_better_the_slower() -> None:
    machine = Machine.prototype(step_s=0.002, incline_deg=6.0).nominal()
    machine = machine.without("torque_limit_nm", "servo_gain_nms_per_rad", "gearhead_backlash_deg")
    apart = []
    for slower in (2, 8):
        end, u = 8.0 * slower, inputs(([0.15 / slower], [0.1 / slower]), breaks=[0.0, 8.0 * slower])
        plan = plan_from(arm_problem([10, 20, -25], end=end), u, pieces=50)
        change = []
        for fidelity in ("quasi-static", "dynamic"):
            sloped, level = (
                replay(plan, m.with_(fidelity=fidelity), record_s=None).q[0, -1, 1:]
                for m in (machine, machine.without("incline_deg"))
            )
            change.append(np.rad2deg(sloped - level))
        assert np.max(np.abs(change[0])) > 3  # gravity matters
        apart.append(np.max(np.abs(change[0] - change[1])))
    assert apart[0] < 0.1
    assert apart[1] < apart[0] / 3


def test_gravity_that_friction_cannot_hold_is_refused() -> None:
    plan = plan_from(arm_problem([10, 20, 15], end=1.0), inputs(([0.1], [0.1]), breaks=[0.0, 1.0]))
    with pytest.raises(InputError, match=r" N m.* N m.*incline_deg"):
        replay(plan, Machine.prototype(incline_deg=90.0, link_moment_kgm=2.0))
    moving = Machine.prototype(incline_deg=90.0, link_moment_kgm=2.0, fidelity="dynamic")
    slid = replay(plan, moving.nominal()).terminal_error_deg
    assert np.min(slid[0, 1:]) < -10  # it slides down


def test_each_machine_is_held_by_its_own_friction() -> None:
    plan = plan_from(arm_problem([10, 20, 15], end=1.0), inputs(([0.1], [0.1]), breaks=[0.0, 1.0]))
    machine = Machine.ideal(
        incline_deg=90.0,
        link_moment_kgm=1.0,
        friction_capacity_nm=2.0,
        coulomb_friction_nm={"value": 30.0, "spread": 15.0},
    )
    replay(plan, machine.nominal())
    with pytest.raises(InputError, match=r"incline_deg.*fidelity"):
        replay(plan, machine, samples=50, record_s=None)
