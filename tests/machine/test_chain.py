"""The disk chain: gear law, order of integration, creep, slip, gearheads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import arm, start
from handmade import draws_of
from scipy.integrate import solve_ivp

from planner import Manipulator
from planner.machine.disk_chain import DiskChain
from planner.machine.stepwise import KinematicPlant

T = 1.0


def speed(t: np.ndarray | float) -> np.ndarray:
    """Of both motors, (2, …)."""
    t = np.asarray(t)
    return np.stack([0.6 * np.cos(2 * t), 0.5 * np.sin(3 * t) + 0.2])


def travel(t: float) -> np.ndarray:
    """Its integral from 0."""
    return np.array([0.3 * np.sin(2 * t), (1 - np.cos(3 * t)) / 6 + 0.2 * t])


def ran(plant: DiskChain | KinematicPlant, steps: int, points: int = 3) -> np.ndarray:
    """Coordinates (N, S) after so many steps under `speed`, given at so many points of each."""
    h = T / steps
    for k in range(steps):
        t = k * h + np.linspace(0, h, points)
        ways = np.array([travel(later) - travel(t[0]) for later in t[1:]])
        plant.step(speed(t).T[:, :, None], ways[:, :, None], h)
    return plant.q


def exact(system: Manipulator, q: np.ndarray) -> np.ndarray:
    motion = solve_ivp(
        lambda t, q: system.rates(q, speed(t)), (0, T), q[:, 0], "DOP853", rtol=1e-13, atol=1e-14
    )
    return motion.y[:, -1:]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_ideal_chain_is_the_kinematics_to_fourth_or_second_order(n: int) -> None:
    system, q = arm(n), start(n)
    truth = exact(system, q)
    steps = np.array([8, 16, 32, 64])
    for plant in (lambda: DiskChain(system, draws_of(n), q), lambda: KinematicPlant(system, q)):
        for points, order in ((3, 4), (2, 2)):
            errors = [np.max(np.abs(ran(plant(), int(m), points) - truth)) for m in steps]
            slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
            assert slope == pytest.approx(-order, abs=0.3)
    assert np.max(np.abs(ran(DiskChain(system, draws_of(n), q), 1000) - truth)) < 1e-11


def test_gear_ratio_errors_scale_one_joint_each() -> None:
    system, q = arm(3), start(3)
    off = Manipulator(system.K * [1.1, 0.8], system.k_g)
    draws = draws_of(gear_ratio_error=[0.1, -0.2])
    assert ran(DiskChain(system, draws, q), 100) == pytest.approx(
        ran(KinematicPlant(off, q), 100), abs=1e-8
    )


def first_rates(n: int, **effects: Any) -> np.ndarray:
    """Rates of all coordinates under unit motor speeds, at the start, over the ideal ones."""
    system, q = arm(n), start(n)
    plant = DiskChain(system, draws_of(n, **effects), q)
    h = 1e-6
    plant.step(np.ones((3, 2, 1)), np.full((2, 2, 1), h) * [[[0.5]], [[1.0]]], h)
    return np.asarray((plant.q - q)[:, 0] / h / system.rates(q[:, 0], np.ones(2)))


@pytest.mark.parametrize("n", [2, 3, 5])
def test_creep_is_lost_at_every_contact(n: int) -> None:
    """Two in a joint's branch, one in each stage before it; φ is behind stages 1 ... n-2."""
    xi = 0.03
    ratios = first_rates(n, creep=xi)
    kept = np.full(n - 1, 1 - xi)
    through = np.cumprod(kept)
    assert ratios[0] == pytest.approx(through[-2] if n > 2 else 1.0, abs=1e-6)
    assert ratios[1] == pytest.approx(1, abs=1e-6)  # joint 1: no contact
    assert ratios[2:] == pytest.approx(through * kept**2, abs=1e-5)


def constant(plant: DiskChain, u1: float, steps: int, h: float = 1e-3) -> np.ndarray:
    """History (steps+1, N) of sample 0 with motor 1 at constant speed and motor 2 at rest."""
    points = np.zeros((3, 2, 1))
    points[:, 0] = u1
    ways = np.zeros((2, 2, 1))
    ways[:, 0, 0] = [u1 * h / 2, u1 * h]
    out = [plant.q[:, 0].copy()]
    for _ in range(steps):
        plant.step(points, ways, h)
        out.append(plant.q[:, 0].copy())
    return np.array(out)


def rim_loads(
    system: Manipulator, q: np.ndarray, friction: list[float]
) -> tuple[np.ndarray, np.ndarray]:
    """By power, where nothing slides: loads at P1 of each stage, and at P3, forces at rims · r₁."""
    rates = system.rates(q, np.array([1.0, 0.0]))[2:]
    k, c = system.k_g * system.K, np.cos(q[1:-1])
    disks = k / k[0] * np.concatenate([[1.0], np.cumprod(c[:-1])])
    powers = rates * np.array(friction)
    return np.cumsum(powers[::-1])[::-1] / (disks * c), powers / (disks * c**3)


def test_load_creep_follows_the_transmitted_torque() -> None:
    n, friction, slope = 4, [0.3, 0.5, 0.2], 0.04
    q = start(n)[:, 0]
    first, third = rim_loads(arm(n), q, friction)
    second = third * np.cos(q[1:-1])
    ratios = first_rates(n, creep_per_nm=slope, coulomb_friction_nm=friction, creep=0.01)
    through = np.cumprod(0.99 - slope * first)
    branch = (0.99 - slope * second) * (0.99 - slope * third)
    assert ratios[2:] == pytest.approx(through * branch, abs=1e-5)
    assert ratios[0] == pytest.approx(through[-2], abs=1e-5)


@pytest.mark.parametrize("stiffness", [False, 200.0])
def test_slip_stops_what_needs_more_than_the_contacts_carry(stiffness: float) -> None:
    system, q = arm(3), start(3)
    load = [0.1, 0.5]
    stage, _ = rim_loads(system, q[:, 0], load)
    assert stage[0] > 0.1 * system.k_g

    def moved(capacity: float) -> np.ndarray:
        effects: dict[str, Any] = {
            "friction_capacity_nm": capacity,
            "coulomb_friction_nm": load,
            "shaft_stiffness_nm_per_rad": stiffness,
        }
        history = constant(DiskChain(system, draws_of(**effects), q), 0.3, 300)
        return history[-1] - history[0]

    free = moved(10.0)
    assert np.all(free[[0, 2, 3]] > 0.02)
    # Stage 1 cannot drive both joints: nothing behind it moves, not even disk 2
    stuck = moved(0.7 * stage[0])
    # (but for what moves while the shaft of the last joint is still being wound up).
    assert stuck[3] == 0
    assert np.all(stuck[[0, 2]] <= (0 if stiffness is False else 0.1 * free[[0, 2]]))


def test_slip_in_a_branch_leaves_the_rest_moving() -> None:
    system = arm(3)
    q = start(3)
    stage, branch = rim_loads(system, q[:, 0], [0.0, 0.5])
    assert stage[0] < branch[1]  # the ratio of a stage is below one
    capacity = (stage[0] + branch[1]) / 2
    draws = draws_of(friction_capacity_nm=capacity, coulomb_friction_nm=[0.0, 0.5])
    moved = np.ptp(constant(DiskChain(system, draws, q), 0.1, 100), axis=0)
    assert moved[3] == 0
    assert moved[2] > 0
    assert moved[0] > 0


def test_a_soft_shaft_winds_up_to_the_capacity_and_no_further() -> None:
    system, q = arm(2), start(2)
    k, capacity = 20.0, 0.2
    draws = draws_of(
        2, friction_capacity_nm=capacity, coulomb_friction_nm=5.0, shaft_stiffness_nm_per_rad=k
    )
    plant = DiskChain(system, draws, q)
    history = constant(plant, 0.3, 1000)
    assert np.ptp(history[:, 2]) == 0
    lever = system.k_g * system.K[0]  # of P3, which is loaded most
    joint = plant._joints[1]
    twist = (joint.axis - joint.theta)[0]
    overshoot = twist * k * lever / capacity - 1
    assert 0 <= overshoot < k * 0.3 * lever**2 * 1e-3 / capacity  # one step's winding
    # Backwards the motor meets no torque until the shaft is unwound the other way.
    constant(plant, -0.3, 2000)
    assert (joint.axis - joint.theta)[0] == pytest.approx(-twist, rel=5e-3)


def test_viscous_overload_slows_to_what_the_capacity_drives() -> None:
    system, q = arm(2), start(2)
    viscous, coulomb, capacity = 4.0, 0.05, 0.2
    lever = system.k_g * system.K[0]
    expected = (capacity / lever - coulomb) / viscous
    effects = {
        "friction_capacity_nm": capacity,
        "coulomb_friction_nm": coulomb,
        "viscous_friction_nms_per_rad": viscous,
    }
    assert 0.3 * lever > expected
    rigid = constant(DiskChain(system, draws_of(2, **effects), q), 0.3, 200)[:, 2]
    assert (rigid[-1] - rigid[0]) / 0.2 == pytest.approx(expected, rel=1e-9)
    soft = draws_of(2, **effects, shaft_stiffness_nm_per_rad=500.0)
    errors = []
    for h in (1e-3, 2.5e-4):
        theta = constant(DiskChain(system, soft, q), 0.3, round(0.2 / h), h)[:, 2]
        errors.append((theta[-1] - theta[len(theta) // 2]) / 0.1 / expected - 1)
    assert abs(errors[0]) < 0.04
    assert abs(errors[1]) < abs(errors[0]) / 2


def test_gearhead_play_is_taken_up_before_the_motion() -> None:
    system, q = arm(2), start(2)
    gap = np.deg2rad(2.0)
    plant = DiskChain(system, draws_of(2, gearhead_backlash_deg=[2.0, 0.0]), q)
    history = constant(plant, 0.5, 1000)
    assert history[-1, 0] == pytest.approx(system.k_g * (0.5 - gap / 2), abs=1e-12)
    back = constant(plant, -0.5, 1000)
    assert back[-1, 0] == pytest.approx(system.k_g * gap / 2, abs=1e-12)
