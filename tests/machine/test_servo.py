"""Each effect of the servos against an analytic answer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from handmade import draws_of
from scipy.integrate import solve_ivp

from planner.machine.servos import Servos

H = 1e-3


def run(
    servos: Servos,
    command: Callable[[float], tuple[float, float]],
    steps: int,
    running: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (steps+1, 2) and travels (steps+1, 2) of sample 0 under a command of time."""
    speeds, travels = [np.zeros(2)], [np.zeros(2)]
    for k in range(steps):
        points = np.array([command((k + part) * H) for part in (0, 0.5, 1 - 1e-12)])
        speed, travel = servos.step(points[:, :, None], H, running)
        speeds.append(speed[2, :, 0])
        travels.append(travels[-1] + travel[1, :, 0])
    return np.array(speeds), np.array(travels)


def test_without_effects_the_motor_is_the_command() -> None:
    speeds, travels = run(Servos(draws_of()), lambda t: (np.sin(t), t**3), 500)
    t = np.arange(501) * H
    assert speeds[1:, 0] == pytest.approx(np.sin(t[1:]), abs=1e-11)
    assert travels[:, 0] == pytest.approx(1 - np.cos(t), abs=1e-14)
    assert travels[:, 1] == pytest.approx(t**4 / 4, abs=1e-13)


def test_first_order_step_response() -> None:
    b = np.array([60.0, 15.0])
    speeds, travels = run(Servos(draws_of(servo_bandwidth_rad_s=b)), lambda t: (1.0, -2.0), 200)
    t = np.arange(201)[:, None] * H
    final = np.array([1.0, -2.0])
    assert speeds == pytest.approx(final * (1 - np.exp(-b * t)), abs=1e-13)
    assert travels == pytest.approx(final * (t - (1 - np.exp(-b * t)) / b), abs=1e-13)


def test_first_order_ramp_response_is_exact_too() -> None:
    b = 60.0
    speeds, travels = run(Servos(draws_of(servo_bandwidth_rad_s=b)), lambda t: (t, 0.0), 200)
    t = np.arange(201) * H
    lag = (1 - np.exp(-b * t)) / b
    assert speeds[:, 0] == pytest.approx(t - lag, abs=1e-12)
    assert travels[:, 0] == pytest.approx(t**2 / 2 - t / b + lag / b, abs=1e-12)


@pytest.mark.parametrize("damping", [0.3, 1.0, 1.0 + 1e-9, 2.5])
def test_second_order_step_and_ramp(damping: float) -> None:
    b = 40.0
    servos = Servos(draws_of(servo_bandwidth_rad_s=b, servo_damping=damping))
    speeds, travels = run(servos, lambda t: (1.0, 3 * t), 150)

    def rates(t: float, x: np.ndarray, reference: Callable[[float], float]) -> np.ndarray:
        return np.array([x[1], x[2], b * b * (reference(t) - x[1]) - 2 * damping * b * x[2]])

    t = np.arange(151) * H
    for i, reference in enumerate([lambda t: 1.0, lambda t: 3 * t]):
        exact = solve_ivp(
            rates, (0, t[-1]), np.zeros(3), "DOP853", t, args=(reference,), rtol=1e-12, atol=1e-13
        )
        assert travels[:, i] == pytest.approx(exact.y[0], abs=1e-10)
        assert speeds[:, i] == pytest.approx(exact.y[1], abs=1e-9)


def test_damping_below_one_overshoots_and_without_bandwidth_does_nothing() -> None:
    low = Servos(draws_of(servo_bandwidth_rad_s=40, servo_damping=0.3))
    assert run(low, lambda t: (1.0, 1.0), 150)[0].max() > 1.3
    alone = Servos(draws_of(servo_damping=0.3))
    assert np.all(run(alone, lambda t: (1.0, 1.0), 3)[0][1:] == 1.0)


def test_acceleration_limit_makes_a_ramp() -> None:
    servos = Servos(draws_of(acceleration_limit_rad_s2=[10.0, 25.0]))
    speeds, travels = run(servos, lambda t: (1.0, -1.0), 200)
    t = np.arange(201)[:, None] * H
    a = np.array([10.0, 25.0])
    ramp = np.minimum(a * t, 1.0)
    assert speeds == pytest.approx(ramp * [1, -1], abs=1e-12)
    reached = 1 / a
    travelled = np.where(t < reached, a * t**2 / 2, t - reached / 2)
    assert travels == pytest.approx(travelled * [1, -1], abs=1e-12)


@pytest.mark.parametrize("damping", [False, 0.7])
def test_lag_and_acceleration_limit_together(damping: float) -> None:
    servos = Servos(
        draws_of(acceleration_limit_rad_s2=10, servo_bandwidth_rad_s=60, servo_damping=damping)
    )
    speeds = run(servos, lambda t: (1.0, -1.0), 400)[0][:, 0]
    assert np.max(np.abs(np.diff(speeds))) <= 10 * H * (1 + 1e-9)
    assert speeds[50] == pytest.approx(10 * 0.05, rel=0.02 if damping is False else 0.15)
    assert speeds[-1] == pytest.approx(1.0, abs=1e-3)


def test_velocity_limit_clips_and_counts_the_time() -> None:
    servos = Servos(draws_of(velocity_limit_rad_s=[3.0, 2.0]))
    speeds, _ = run(servos, lambda t: (5.0 if t < 0.02 else 1.0, -1.5), 50)
    assert speeds[1:20, 0] == pytest.approx(3.0)
    assert speeds[21:, 0] == pytest.approx(1.0)
    assert np.all(speeds[1:, 1] == -1.5)
    assert servos.saturated_s[:, 0] == pytest.approx([0.02, 0.0], abs=1e-12)


def test_velocity_limit_holds_against_overshoot() -> None:
    servos = Servos(draws_of(velocity_limit_rad_s=1.1, servo_bandwidth_rad_s=40, servo_damping=0.2))
    speeds, travels = run(servos, lambda t: (1.0, 0.0), 300)
    assert speeds.max() == pytest.approx(1.1, abs=1e-12)
    assert speeds[-1, 0] == pytest.approx(1.0, abs=0.1)
    assert travels[:, 0] == pytest.approx(
        np.cumsum(np.append(0, (speeds[1:, 0] + speeds[:-1, 0]) / 2 * H)), abs=2e-5
    )


def test_gain_and_bias() -> None:
    servos = Servos(draws_of(input_gain_error=[0.1, -0.2], input_bias_rad_s=[0.05, 0.0]))
    speeds, _ = run(servos, lambda t: (1.0, 2.0), 5)
    assert speeds[1:] == pytest.approx(np.tile([1.15, 1.6], (5, 1)))
    still, _ = run(servos, lambda t: (0.0, 0.0), 5, running=False)
    assert np.all(still == 0)
