"""Recordings that lie: what is wrong with a run is named, without a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import InputError, Log, Machine, Problem, emulate_log, excitation, identify
from planner.machine.identification.diagnosis import refuse_misfit
from planner.machine.identification.identify import find_warnings

DEG, RPM = 180 / np.pi, 30 / np.pi


@pytest.fixture(scope="module")
def log(paper: Problem) -> Log:
    return emulate_log(excitation(paper), Machine.prototype())


def late(log: Log, rows: int) -> Log:
    """The commands stand `rows` below those in which they act; above, the motors are told zero."""
    u = np.zeros_like(log.u)
    if rows > 0:
        u[rows:] = log.u[:-rows]
    else:
        u[:rows] = log.u[-rows:]
    return replace(log, u=u)


def dead_after(log: Log, joint: int, row: int) -> Log:
    """The encoder of a joint stops to read."""
    theta = log.theta.copy()
    theta[row:, joint] = theta[row, joint]
    return replace(log, theta=theta)


def test_what_arms_do_is_not_refused(paper: Problem, log: Log) -> None:
    refuse_misfit(log, paper.system)
    refuse_misfit(late(log, -8), paper.system)  # a servo, slow as can be
    coarse = Machine.prototype(encoder_resolution_deg=1.0, gear_ratio_error=0.05)
    refuse_misfit(emulate_log(excitation(paper), coarse), paper.system)


def test_an_arm_far_from_the_prototype_is_not_refused(paper: Problem) -> None:
    """Twice the friction and half the stiffness twist the shafts by eight degrees."""
    arm = Machine.prototype(coulomb_friction_nm=[0.3, 0.4], shaft_stiffness_nm_per_rad=1.7)
    log = emulate_log(excitation(paper), arm.nominal())
    refuse_misfit(log, paper.system)
    with pytest.raises(InputError, match="does not turn as the commands"):
        refuse_misfit(replace(log, theta=log.theta[:, [0, 2, 1]]), paper.system)
    refuse_misfit(emulate_log(excitation(paper), arm, noise_deg=0), paper.system)  # stands still


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: replace(x, u=x.u * [-1, 1]), r"fits if u1 has the other sign"),
        (lambda x: replace(x, u=x.u * [1, -1]), r"fits if u2 has the other sign"),
        (lambda x: replace(x, u=x.u * [-1, -1]), r"fits if u1 and u2 have the other sign"),
        (lambda x: replace(x, u=x.u * DEG), r"fits if u1 and u2 are in degrees/s"),
        (lambda x: replace(x, u=x.u * [RPM, 1]), r"fits if u1 is in rpm"),
        (lambda x: replace(x, u=x.u / [DEG, 1]), r"u1 is in radians/s where the header says deg"),
        (lambda x: replace(x, u=x.u / [1, 6]), r"fits if u2 is in rpm where the header says"),
        (lambda x: replace(x, u=x.u[:, ::-1]), r"fits if u1 and u2 are exchanged"),
        (lambda x: replace(x, theta=x.theta * [1, 1, -1]), r"fits if theta3 has the other sign"),
        (
            lambda x: replace(x, theta=x.theta[:, [0, 2, 1]]),
            r"columns of angles belong, .* theta1, theta3, theta2",
        ),
        (
            lambda x: replace(x, theta=x.theta[:, [1, 2, 0]]),
            r"columns of angles belong, .* theta2, theta3, theta1",
        ),
        (lambda x: replace(x, u=x.u[::-1].copy()), r"no sign, unit or order makes the run fit"),
        (lambda x: late(x, 40), r"turn 0\.36 s before the commands"),
        (lambda x: late(x, 10), r"turn 0\.06 s before the commands"),
        (lambda x: replace(x, theta=x.theta * [1, 2, 1]), r"fits if theta2 is read 2 times too l"),
        (lambda x: replace(x, theta=x.theta * [4, 1, 1]), r"fits if theta1 is read 4 times too l"),
        (lambda x: replace(x, u=x.u / [2, 1]), r"motor 1 turns 2 times as far as u1 says"),
        (lambda x: replace(x, u=x.u * [2, 1]), r"motor 1 turns 0\.5 times as far as u1 says"),
        (lambda x: replace(x, u=np.c_[late(x, 40).u[:, 0], x.u[:, 1]]), r"u1 acts 0\.4 s before"),
        (lambda x: replace(x, u=np.c_[late(x, -40).u[:, 0], x.u[:, 1]]), r"u1 acts 0\.4 s after"),
        (lambda x: dead_after(x, 1, 1000), r"theta2 stays at .* from t = 1.* encoder is dead"),
        (lambda x: late(x, -40), r"turn 0\.44 s after the commands"),
    ],
)
def test_a_mistake_is_named(paper: Problem, log: Log, change, words: str) -> None:
    with pytest.raises(InputError, match=words):
        identify(change(log), paper)


def test_a_motor_at_one_speed_shows_no_delay(paper: Problem) -> None:
    """Its angle is a straight line, which fits itself after every delay; noise must not choose."""
    t = 0.01 * np.arange(801)
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(0, 5e-4, 801)
        theta = np.column_stack([0.12 * t + noise, 0 * t, 0 * t])
        refuse_misfit(Log(t, np.tile([0.0, 0.12], (801, 1)), theta), paper.system)


@pytest.mark.parametrize(
    "change",
    [
        lambda x: x,
        lambda x: x.part(0.0, 29.0),
        lambda x: x.part(5.0),
        lambda x: replace(x, theta=np.deg2rad(np.round(x.theta_deg, 1)), u=np.round(x.u, 3)),
    ],
    ids=["same", "cut", "begun later", "rounded"],
)
def test_a_run_is_given_once(paper: Problem, log: Log, change) -> None:
    with pytest.raises(InputError, match="are the same run; give each run once"):
        identify([log, replace(change(log), source="copy")], paper)


def test_a_ratio_that_is_no_tolerance_is_told(paper: Problem, log: Log) -> None:
    found = identify(replace(log, u=log.u * [1.1, 1]), paper, starts=1)
    words = " ".join(found.warnings)
    assert found["ratio2"].value == pytest.approx(100 * (1 / 1.1 - 1), abs=0.2)
    assert f"joint 2 turns {-found['ratio2'].value:.3g} %" in words
    assert "% less far than K and k_g say: a wrong constant" in words


def test_a_coarse_encoder_is_not_blamed_on_inertia(paper: Problem) -> None:
    coarse = emulate_log(
        excitation(paper), Machine.prototype(encoder_resolution_deg=1.0), noise_deg=0
    )
    left, noise = np.full((1, 3), 0.3), np.full((1, 3), 0.1)
    (text, *_) = find_warnings([coarse], [], left, noise)
    assert "read in steps of 1 deg" in text
    assert "inertia" not in text


def test_a_reading_that_stands_still_is_told(log: Log) -> None:
    left, noise = np.array([[0.04, 0.04, 3.0]]), np.full((1, 3), 0.04)
    words = " ".join(find_warnings([dead_after(log, 2, 1500)], [], left, noise))
    assert "theta3 reads exactly the same for 15" in words


def test_rows_whose_times_scatter_are_told(log: Log) -> None:
    late = replace(log, t=log.t + 0.003 * np.random.default_rng(0).random(len(log.t)))
    left = noise = np.full((1, 3), 0.04)
    assert [*find_warnings([log], [], left, noise)] == []
    assert [*find_warnings([late], [], left, noise)] == [late.jitter_words]


def test_a_pose_is_of_an_arm_that_rests() -> None:
    t = 0.01 * np.arange(100)
    theta = np.deg2rad(np.column_stack([np.full(100, 5.0), 20.0 - 0 * t]))
    still = Log(t, np.zeros((100, 2)), theta, source="homed.csv")
    flicker = np.deg2rad(0.088) * (np.arange(100) % 3 == 0)[:, None]
    np.testing.assert_allclose(
        replace(still, theta=theta + flicker).pose_deg, [5.03, 20.03], atol=0.01
    )
    turned = replace(still, theta=theta + np.deg2rad([348.0, 0.0]))
    np.testing.assert_allclose(turned.pose_deg, [-7.0, 20.0], atol=1e-9)
    for rate in (1.5, -10.0):
        moving = theta + np.deg2rad(rate) * np.column_stack([0 * t, t])
        with pytest.raises(InputError, match=rf"homed.csv: .* theta2 .* {abs(rate):g} deg/s"):
            _ = replace(still, theta=moving).pose_deg
    cut = theta.copy()
    cut[-5, 1] = np.deg2rad(18.0)
    with pytest.raises(InputError, match=r" theta2 .* 2 deg "):
        _ = replace(still, theta=cut).pose_deg


def test_a_pose_read_often_is_judged_over_as_long() -> None:
    """Twenty readings at 1 kHz take 20 ms, in which an arm at 3 deg/s moves by 0.06 degrees."""
    t = 0.001 * np.arange(1000)
    moving = Log(t, np.zeros((1000, 2)), np.deg2rad(np.column_stack([0 * t, 3.0 * t])))
    with pytest.raises(InputError, match=r" 200 .* theta2 .* 3 deg/s"):
        _ = moving.pose_deg
