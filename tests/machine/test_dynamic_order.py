"""Order of convergence of the dynamic manipulator, against finer steps and LSODA."""

from __future__ import annotations

import numpy as np
import pytest
from driven import EVENTS, chain, drive, swung
from scipy.integrate import solve_ivp

STEPS = (125, 250, 500, 1000)
FINE = 4000


@pytest.mark.parametrize("name", EVENTS)
def test_first_order_at_least_through_events_and_second_between(name: str) -> None:
    marks = STEPS[0]
    exact, *motions = (
        swung(name, steps)[0][steps // marks - 1 :: steps // marks] for steps in (FINE, *STEPS)
    )
    errors = [np.max(np.abs(motion - exact)) for motion in motions]
    order = -np.polyfit(np.log(STEPS), np.log(errors), 1)[0]
    if name in ("smooth", "creep"):
        assert order == pytest.approx(2, abs=0.2)
    else:
        assert order > 1.0
    assert errors[-1] < 1e-4  # rad, at a millisecond


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
