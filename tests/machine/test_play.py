"""Backlash and shaft against analytic answers."""

from __future__ import annotations

import numpy as np
import pytest
from handmade import draws_of
from scipy.integrate import solve_ivp

from planner.machine.disk_chain import Play

H = 1e-3
ONE = np.zeros(1)


def drive(play: Play, axis: np.ndarray, h: float = H) -> np.ndarray:
    """Joint angles (m,) while the axis goes through angles (m,), from the first of them on."""
    start = play.theta[0]
    moved = [play.move(np.array([travel]), h)[0] for travel in np.diff(axis)]
    return np.array([start, *moved])


def test_nothing_between_means_the_same_angle() -> None:
    axis = np.sin(np.linspace(0, 7, 500))
    assert drive(Play(ONE), axis) == pytest.approx(axis, abs=1e-14)


def test_hysteresis_loop() -> None:
    gap = 0.2
    t = np.linspace(0, 4 * np.pi, 4001)
    axis = np.sin(t)
    theta = drive(Play(ONE, half_gap=gap / 2), axis)
    # Up along m - gap/2, held at the top until m has come back by the gap, down along m + gap/2.
    second = t > 2 * np.pi
    rising = second & (np.cos(t) > 0) & (axis > -1 + gap)
    falling = second & (np.cos(t) < 0) & (axis < 1 - gap)
    top = second & (np.cos(t) < 0) & (axis > 1 - gap)
    assert theta[rising] == pytest.approx(axis[rising] - gap / 2, abs=1e-12)
    assert theta[falling] == pytest.approx(axis[falling] + gap / 2, abs=1e-12)
    assert theta[top] == pytest.approx(1 - gap / 2, abs=1e-5)
    area = -np.trapezoid(theta[second], axis[second])
    assert area == pytest.approx(gap * (2 - gap), rel=1e-3)


@pytest.mark.parametrize(("start", "lost"), [(0.0, 0.1), (1.0, 0.0), (-1.0, 0.2)])
def test_where_the_play_starts(start: float, lost: float) -> None:
    up = Play(ONE, half_gap=0.1, start=start)
    assert drive(up, np.linspace(0, 1, 11))[-1] == pytest.approx(1 - lost)
    down = Play(ONE, half_gap=0.1, start=start)
    assert drive(down, np.linspace(0, -1, 11))[-1] == pytest.approx(-1 + (0.2 - lost))


def test_friction_winds_a_soft_shaft_up() -> None:
    play = Play(ONE, half_gap=0.02, stiffness=10.0, coulomb=0.5)
    theta = drive(play, np.linspace(0, 1, 101))
    rest = 0.02 + 0.5 / 10
    assert theta[-1] == pytest.approx(1 - rest)
    assert drive(play, np.linspace(1, 1 - 2 * rest, 11))[-1] == pytest.approx(1 - rest)
    assert drive(play, np.linspace(1 - 2 * rest, 0, 11))[-1] == pytest.approx(rest)
    rigid = Play(ONE, half_gap=0.02, coulomb=0.5)
    assert drive(rigid, np.linspace(0, 1, 101))[-1] == pytest.approx(1 - 0.02)


def test_wind_up_lags_with_time_constant_d_over_k() -> None:
    k, d, speed = 10.0, 0.4, 0.3
    play = Play(ONE, stiffness=k, viscous=d)
    t = np.arange(401) * H
    theta = drive(play, speed * t)
    behind = speed * d / k * (1 - np.exp(-t * k / d))
    assert theta == pytest.approx(speed * t - behind, abs=1e-13)
    # The motor stops: the shaft unwinds with the same time constant.
    rest = drive(play, np.zeros(401))
    assert rest == pytest.approx(speed * t[-1] - behind[-1] * np.exp(-t * k / d), abs=1e-13)


def test_all_together_converges_to_the_differential_equation() -> None:
    gap, k, c, d = 0.06, 8.0, 0.2, 0.3
    rest = gap / 2 + c / k

    def axis(t: np.ndarray | float) -> np.ndarray:
        return 0.4 * np.sin(3 * np.asarray(t))

    def rate(t: float, theta: np.ndarray) -> np.ndarray:
        e = axis(t) - theta
        return k / d * (e - np.clip(e, -rest, rest))

    marks = np.linspace(0, 4, 1001)
    options = {"rtol": 1e-9, "atol": 1e-11, "max_step": 2e-3}
    exact = solve_ivp(rate, (0, 4), ONE, "RK45", marks, **options).y[0]
    errors = []
    steps = (4e-3, 2e-3, 1e-3, 5e-4)
    for h in steps:
        play = Play(ONE, gap / 2, k, c, d)
        t = np.arange(round(4 / h) + 1) * h
        errors.append(np.max(np.abs(drive(play, axis(t), h)[:: round(4e-3 / h)] - exact)))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2, abs=0.3)
    assert errors[2] < 5e-6


def test_torque_of_a_soft_shaft_is_that_of_its_twist() -> None:
    play = Play(ONE, half_gap=0.1, stiffness=10, coulomb=5)
    up = np.ones(1)
    drive(play, np.array([0, 0.1]))
    assert play.torque(up) == 0
    drive(play, np.array([0.1, 0.3]))
    assert play.torque(up) == pytest.approx(10 * 0.2)
    assert play.torque(-up) == pytest.approx(-10 * 0.2)  # unwinding helps


def test_torque_of_a_rigid_shaft_is_friction_once_in_contact() -> None:
    play = Play(ONE, half_gap=0.1, coulomb=5, viscous=2)
    up = np.ones(1)
    assert play.torque(up) == 0
    assert play.damping(up) == 0
    drive(play, np.array([0, 0.3]))
    assert play.torque(up) == 5
    assert play.damping(up) == 2
    assert play.torque(-up) == 0
    assert play.torque(0 * up) == 0


def test_every_joint_has_its_own_values() -> None:
    draws = draws_of(backlash_deg=[2.0, 4.0], gearhead_backlash_deg=[1.0, 0.5])
    for play, degrees in [
        (Play.passive(draws, 0, ONE), 2.0),
        (Play.passive(draws, 1, ONE), 4.0),
        (Play.gearhead(draws, 0, ONE), 1.0),
        (Play.gearhead(draws, 1, ONE), 0.5),
    ]:
        theta = drive(play, np.linspace(0, 1, 101))
        assert theta[-1] == pytest.approx(1 - np.deg2rad(degrees) / 2)
