"""Energy of the dynamic manipulator, and the sign of torques through play, over random motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import EVENTS, SOFT, chain, drive, swung
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.support.arrays import Array


@pytest.mark.parametrize("name", EVENTS)
def test_work_is_stored_or_lost_the_better_the_shorter_the_step(name: str) -> None:
    steps = (250, 500, 1000, 4000)
    missing = [abs(swung(name, count)[1]) for count in steps]
    assert missing[2] < 1e-3  # at a millisecond
    order = -np.polyfit(np.log(steps), np.log(missing), 1)[0]
    assert order > (1.7 if name in ("smooth", "creep") else 0.9)


@pytest.mark.parametrize("name", EVENTS)
def test_free_arms_never_gain_energy(name: str) -> None:
    """Motors without torque, everything else thrown into motion: energy falls at every step."""
    count = 40
    if name == "inclined":
        pytest.skip("it falls: see test_incline.py")
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
    assert np.all(after < 0.9 * begin)
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

    def speed(t: float) -> Array:
        wave = np.sin(np.array(rate) * t)
        return np.array(size) * (np.sign(wave) if square else wave)

    def look() -> Array:
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
