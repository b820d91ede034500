"""The size of a drive constant, of limits and of durations changes nothing but units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import planner
from planner.support.arrays import Array

K, K_G, ENDS = [0.870125, 0.711625], 0.668811, ([1.0, 1.0, 1.0], [30.0, 30.0, 30.0])
FACTORS = [(factor, 1e-10) for factor in (1e-6, 1e-3, 0.1, 1e3, 1e6)] + [(0.02, 2e-4), (30.0, 2e-4)]
"""Factors, and most that plans differ. A power of ten leaves the programme as it is, but for
rounding. Another one changes it by less than a decade: the same solver then stops elsewhere within
its tolerance, which moves inputs where the objective is flat, and the duration by 3e-7."""


def _plan(time: float, drive: float, changes: dict[str, Any] | None = None) -> planner.Plan:
    """The plan of an arm whose time passes, and whose drive turns, so many times faster."""
    given: dict[str, Any] = {"duration": 10.0, "input": 0.5, "rate": None} | (changes or {})
    inputs = np.array([1 / (time * drive), 1 / time])
    problem = planner.Problem.manipulator(
        *ENDS,
        K=K,
        k_g=K_G * drive,
        duration=None if given["duration"] is None else given["duration"] * time,
        input_rad_s=given["input"] * inputs,
        input_rate_rad_s2=None if given["rate"] is None else given["rate"] * inputs / time,
    )
    return planner.solve(problem, "collocation")


def _normalised(plan: planner.Plan, time: float, drive: float) -> Array:
    """Coordinates along the way, and inputs in the units of those whose factors are one."""
    s = np.linspace(0.0, 1.0, 41) * plan.duration
    return np.hstack([plan.q(s), plan.u(s) * [time * drive, time]])


@pytest.mark.parametrize(("factor", "within"), FACTORS)
@pytest.mark.parametrize(
    "changes",
    [{}, {"rate": 0.2}, {"duration": None}, {"duration": None, "rate": 0.6}],
    ids=["duration", "rates", "fastest", "fastest with rates"],
)
def test_units_of_time_change_nothing_else(
    changes: dict[str, Any], factor: float, within: float
) -> None:
    one, other = _plan(1.0, 1.0, changes), _plan(factor, 1.0, changes)
    assert other.duration / factor == pytest.approx(one.duration, rel=3e-7)
    a, b = _normalised(one, 1.0, 1.0), _normalised(other, factor, 1.0)
    np.testing.assert_allclose(b, a, atol=within)


@pytest.mark.parametrize("time", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("drive", "within"), FACTORS)
def test_the_drive_constant_scales_the_first_input_alone(
    drive: float, within: float, time: float
) -> None:
    changes = {"duration": None}
    one, other = _plan(1.0, 1.0, changes), _plan(time, drive, changes)
    assert other.duration / time == pytest.approx(one.duration, rel=3e-7)
    a, b = _normalised(one, 1.0, 1.0), _normalised(other, time, drive)
    np.testing.assert_allclose(b, a, atol=within)


@pytest.mark.parametrize("drive", [1e-3, 1e-4, 1e-6])
def test_a_slow_drive_takes_its_own_time_and_little_for_joint_1(drive: float) -> None:
    # ∫|u₁| dt is least where joint 1 takes no time: 0.94795 rad of φ₁ for k_g = 1
    problem = planner.Problem.manipulator(*ENDS, K=K, k_g=drive, duration=None, input_rad_s=0.5)
    plan = planner.solve(problem, "collocation")
    assert 0 < plan.duration - 1.8959 / drive < 1.5e-3 * plan.duration


@pytest.mark.parametrize("limits", [[1e9, 1e9], [0.5, 1e9], [1e9, 0.5], [1e-9, 1e-9]])
def test_limits_of_any_size_have_a_plan(limits: list[float]) -> None:
    problem = planner.Problem.manipulator(*ENDS, K=K, k_g=K_G, duration=None, input_rad_s=limits)
    plan = planner.solve(problem, "collocation")
    assert planner.verify(plan).ok
    assert plan.duration >= 0.947 / (K_G * limits[0])


@pytest.mark.parametrize("heading", [89.9999, 90.0, 270.0])
@pytest.mark.parametrize("duration", ["free", 6.0])
def test_a_vehicle_may_head_along_the_y_axis(duration: float | str, heading: float) -> None:
    """The drive vanishes there, yet the fastest drive ahead is the same in every direction."""
    along = np.exp(1j * np.deg2rad(heading))
    for kind, constants, distance, limits in (
        ("unicycle", {}, 2.0, {"speed_m_s": 1.0, "turn_rate_rad_s": 1.0}),
        ("car", {"wheelbase_m": 2.7}, 25.0, {"speed_m_s": 5.0, "steering_rate_rad_s": 0.5}),
    ):
        still = {"steering_deg": 0} if kind == "car" else {}
        x, y = np.round([(distance * along).real, (distance * along).imag], 6).tolist()
        problem = planner.Problem.from_dict(
            {
                "system": {"kind": kind, **constants},
                "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": heading, **still},
                "goal": {"x_m": x, "y_m": y, "heading_deg": heading, "duration": duration, **still},
                "limits": limits,
            }
        )
        plan = planner.solve(problem, "collocation")
        fastest = distance / limits["speed_m_s"]
        assert plan.duration == pytest.approx(fastest if duration == "free" else 6.0, rel=1e-4)
