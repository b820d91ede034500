"""Order and energy of the dynamic manipulator; the sign of torques through play, at random."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import EVENTS, SOFT, chain, drive, swung
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp


@pytest.mark.parametrize("name", EVENTS)
def test_order_of_motion_and_energy(name: str) -> None:
    """First order at least through events, and second between them, against much finer steps.

    What is put in is stored or lost the better, the shorter the step.
    """
    steps, fine, smooth = (125, 250, 500, 1000), 4000, name in ("smooth", "creep", "chain")
    exact, *motions = (
        swung(name, count)[0][count // steps[0] - 1 :: count // steps[0]]
        for count in (fine, *steps)
    )
    errors = [np.max(np.abs(motion - exact)) for motion in motions]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2, abs=0.2) if smooth else order > 1.0
    assert errors[-1] < 1e-4  # rad, at a millisecond
    missing = [abs(swung(name, count)[1]) for count in (*steps[1:], fine)]
    assert missing[2] < 1e-3
    order = -np.polyfit(np.log((*steps[1:], fine)), np.log(missing), 1)[0]
    assert order > (1.7 if smooth else 0.9)


def test_it_converges_to_the_differential_equations() -> None:
    """Play and Coulomb friction of one link by an integrator of another kind, in short steps."""
    half, k, c, inertia, viscous, coulomb = np.deg2rad(2.0), 4.0, 0.05, 0.03, 0.05, 0.05
    plant = chain(
        2,
        backlash_deg=4.0,
        shaft_stiffness_nm_per_rad=k,
        shaft_damping_nms_per_rad=c,
        link_inertia_kgm2=[0.0, inertia],
        viscous_friction_nms_per_rad=viscous,
        coulomb_friction_nm=coulomb,
    )
    lever = 0.67 * 0.87 * np.cos(plant.q[1, 0]) ** 3
    begin = plant.q[2, 0]

    def rates(t: float, x: np.ndarray) -> list[float]:
        theta, omega, gap = x
        speed, axis = 0.4 * lever * np.sin(6 * t), 0.4 * lever * (1 - np.cos(6 * t)) / 6
        slip = speed - omega + k / c * (axis - theta - gap)
        if gap >= half:
            slip = min(0.0, slip)
        elif gap <= -half:
            slip = max(0.0, slip)
        torque = k * (axis - theta - gap) + c * (speed - omega - slip)
        drag = viscous * omega + coulomb * np.tanh(omega / 1e-4)
        return [omega, (torque - drag) / inertia, slip]

    times = np.linspace(0, 2, 41)
    exact = solve_ivp(rates, (0, 2), [0.0, 0.0, 0.0], "LSODA", times, max_step=1e-3, rtol=1e-8)
    theta = drive(plant, 2000, lambda t: np.array([0.4 * np.sin(6 * t), 0.0]), 2.0)[:, 2] - begin
    assert np.ptp(theta) > np.deg2rad(2)
    assert theta[49::50] == pytest.approx(exact.y[0, 1:], abs=3e-4)


@pytest.mark.parametrize("name", sorted(EVENTS.keys() - {"inclined"}))  # which falls
def test_free_arms_never_gain_energy(name: str) -> None:
    """Motors without torque, everything else thrown into motion: energy falls at every step."""
    count = 40
    limp = {**EVENTS[name], "torque_limit_nm": 1e-12, "gearhead_backlash_deg": 1.0}
    plant = chain(4, samples=count, **limp)
    speeds = plant._y[plant._place.v]
    speeds[:] = np.random.default_rng(1).normal(size=speeds.shape)
    before = begin = plant.stored_J
    for _ in range(150):
        plant.step(np.zeros((2, 2, 1)), np.zeros((1, 2, 1)), 2e-3)
        after = plant.stored_J
        assert np.all(after <= before * (1 + 1e-12))
        before = after
    assert np.all(after < 0.99 * begin)  # what turns with joint 1, which rubs nowhere, is kept
    assert np.median(after / begin) < 0.9
    assert np.all(after > 0) or "coulomb" in EVENTS[name] or name == "all"


amplitude = st.floats(0.05, 2.0)


@st.composite
def machines(draw: Any) -> dict[str, Any]:
    """Any effects, each on or off, over wide ranges."""
    ranges = {
        "motor_inertia_kgm2": (1e-3, 0.05),
        "servo_gain_nms_per_rad": (0.1, 10),
        "servo_integral_time_s": (0.005, 0.2),
        "torque_limit_nm": (0.05, 3),
        "disk_inertia_kgm2": (1e-6, 1e-3),
        "axis_inertia_kgm2": (1e-7, 1e-4),
        "link_inertia_kgm2": (1e-3, 0.1),
        "shaft_damping_nms_per_rad": (1e-3, 1.0),
        "shaft_stiffness_nm_per_rad": (0.5, 100),
        "viscous_friction_nms_per_rad": (1e-3, 0.3),
        "coulomb_friction_nm": (0.01, 0.5),
        "base_friction_nm": (0.01, 0.5),
        "backlash_deg": (0.1, 5),
        "gearhead_backlash_deg": (0.1, 2),
        "creep_per_nm": (1e-4, 0.05),
        "friction_capacity_nm": (0.05, 2),
    }
    return {
        name: draw(st.floats(low, high))
        for name, (low, high) in ranges.items()
        if draw(st.booleans())
    }


@settings(max_examples=30, deadline=None)
@given(
    effects=machines(),
    n=st.integers(2, 4),
    size=st.tuples(amplitude, amplitude),
    rate=st.tuples(st.floats(1, 20), st.floats(1, 20)),
    square=st.booleans(),
    step=st.sampled_from([5e-4, 1e-3, 5e-3]),
)
def test_the_gap_never_pulls(
    effects: dict[str, Any],
    n: int,
    size: tuple[float, float],
    rate: tuple[float, float],
    square: bool,
    step: float,
) -> None:
    plant = chain(n, **effects)
    half = np.deg2rad(effects.get("backlash_deg", 0.0)) / 2

    def speed(t: float) -> np.ndarray:
        wave = np.sin(np.array(rate) * t)
        return np.array(size) * (np.sign(wave) if square else wave)

    def look() -> np.ndarray:
        return np.stack([plant.gap[:, 0], plant.shaft_torque[:, 0]])

    gap, torque = drive(plant, 150, speed, 150 * step, look).transpose(1, 0, 2)
    assert np.all(np.isfinite(plant.q))
    assert np.all(np.abs(gap) <= half)
    if half:
        assert np.all(torque[np.abs(gap) < half] == 0)
        assert np.all(torque * np.sign(gap) >= 0)
    capacity = effects.get("friction_capacity_nm", np.inf)
    held = plant._march.pieces[2 : 2 + 2 * (n - 1)]
    assert np.all(np.abs(held) <= (1 if np.isfinite(capacity) else 0))


def test_motions_of_that_kind_do_meet_both_sides() -> None:
    """So that the property above is not about shafts that never leave one side."""
    plant = chain(3, **SOFT, backlash_deg=2.0)
    gap = drive(plant, 1000, see=lambda: plant.gap[:, 0].copy())
    half = np.deg2rad(1.0)
    assert np.all(np.any(gap == half, axis=0) & np.any(gap == -half, axis=0))
    assert np.any(np.abs(gap) < half)
