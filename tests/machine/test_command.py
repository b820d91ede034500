"""The command path before the servos, and the time grid."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from handmade import draws_of, inputs
from scipy.interpolate import BPoly

from planner import InputError
from planner.machine.commands import (
    Command,
    CommandVariants,
    ContinuousSource,
    TableSource,
    merge_times,
    refine_times,
    snap_times,
    stretches,
    subdivide,
)

STOPS = np.array([0.0, 1.0, 1.5])


def plan_of(u: BPoly) -> Any:
    """As much of a plan as a command needs."""

    def value(times: np.ndarray) -> np.ndarray:
        t = np.asarray(times)
        on = (t >= 0) & (t <= u.x[-1])
        return np.where(on[..., None], u(np.clip(t, 0, u.x[-1])), 0.0)

    curve = SimpleNamespace(u=value)
    return SimpleNamespace(t=u.x, duration=float(u.x[-1]), u=value, trajectory=curve)


RAMP = plan_of(inputs(([1.0, 0.0], [-2.0, 1.0]), breaks=[0.0, 1.0]))  # u = (t, 1 - 2t)
STEPS = plan_of(
    inputs(*[([float(k)], [-float(k)]) for k in range(1, 5)], breaks=[0.0, 0.25, 0.5, 0.75, 1.0])
)


def values(command: Command, part: int, sample: int = 0) -> np.ndarray:
    """What every step asks for at its first point (0), or at its last (-1), shape (M, 2)."""
    steps = [command.block(k, k + 1)[0] for k in range(len(command.t) - 1)]
    return np.array([s[part, :, min(sample, s.shape[2] - 1)] for s in steps])


def middles(command: Command) -> np.ndarray:
    return (command.t[1:] + command.t[:-1]) / 2


def test_sample_and_hold() -> None:
    command = Command(RAMP, 0.03, draws_of(), 1e-3, STOPS)
    t = middles(command)
    held = 0.03 * np.floor(t / 0.03)
    expected = np.where(t < 1, held, 0.0)
    for part in (0, -1):
        assert values(command, part)[:, 0] == pytest.approx(expected, abs=1e-12)
    ticks = 0.03 * np.arange(1, 34)
    assert np.min(np.abs(command.t[:, None] - ticks), axis=0).max() < 1e-12
    assert np.all(command.running == (t < 1))


@pytest.mark.parametrize("delay", [0.0, 0.0137])
@pytest.mark.parametrize("period", [None, 0.01, 0.04, 0.05, 0.25])
def test_a_sample_on_a_break_reads_what_follows(period: float | None, delay: float) -> None:
    command = Command(STEPS, period, draws_of(delay_s=delay), 1e-3, STOPS)
    t = middles(command) - delay
    tick = t if period is None else period * np.floor(t / period + 1e-9)
    expected = np.where((t > 0) & (t < 1), np.floor(4 * tick + 1e-9) + 1, 0)
    assert np.array_equal(values(command, 0)[:, 0], expected)
    assert np.array_equal(values(command, -1)[:, 1], -expected)
    assert np.min(np.abs(command.t - (1 + delay))) < 1e-12


def test_a_continuous_command_is_the_plans_input() -> None:
    ramp = Command(RAMP, None, draws_of(), 1e-2, STOPS)
    on = middles(ramp) < 1
    assert values(ramp, 0)[:, 0] == pytest.approx(np.where(on, ramp.t[:-1], 0), abs=1e-14)
    assert values(ramp, -1)[:, 0] == pytest.approx(np.where(on, ramp.t[1:], 0), abs=1e-14)


@pytest.mark.parametrize("period", [None, 0.04])
def test_a_delay_for_each_sample(period: float | None) -> None:
    spread = {"value": 0.02, "spread": 0.01}
    draws = draws_of(samples=3, delay_s=spread)
    delays = draws["delay_s"][0]
    assert len(set(delays)) == 3
    command = Command(RAMP, period, draws, 1e-3, STOPS)
    part = command.part(slice(1, 3))
    for i, delay in enumerate(delays):
        t = command.t[:-1] - delay
        tick = t if period is None else period * np.floor(t / period)
        expected = np.where((t >= 0) & (t < 1), tick, 0)
        near_jump = np.min(np.abs(t[:, None] - np.array([0.0, 1.0])), axis=1) < 1e-9
        got = values(command, 0, i)[:, 0]
        assert got[~near_jump] == pytest.approx(expected[~near_jump], abs=1e-9)
        if i:
            assert np.array_equal(values(part, 0, i - 1)[:, 0], got)


@pytest.mark.parametrize("is_linear", [False, True])
def test_each_variant_is_what_its_ticks_say(is_linear: bool) -> None:
    """Held, or straight from one tick's beginning to the next's, and the last held."""
    t, delay = np.array([0.0, 0.3, 0.5, 1.0]), 0.0137
    asked = np.random.default_rng(0).normal(size=(3, 2, 4))
    draws = draws_of(samples=4, delay_s=delay)
    variants = CommandVariants(t, asked, is_linear, draws, 1e-2, STOPS)
    middle = (variants.t[1:] + variants.t[:-1]) / 2 - delay
    on = (middle > 0) & (middle < 1)
    assert np.array_equal(variants.running, middle + delay < 1)
    found = variants.block(0, len(middle))[:, 1]
    for motor, sample in np.ndindex(2, 4):
        ticks = asked[:, motor, sample]
        held = ticks[np.searchsorted(t[1:3], middle)]
        wanted = np.interp(middle, t[:3], ticks) if is_linear else held
        assert found[:, motor, sample] == pytest.approx(np.where(on, wanted, 0), abs=1e-12)


def test_resolution_rounds_to_the_nearest_step() -> None:
    draws = draws_of(velocity_resolution_rad_s=[0.1, 0.0])
    command = Command(RAMP, None, draws, 1e-2, STOPS)
    exact = Command(RAMP, None, draws_of(), 1e-2, STOPS)
    rounded = values(command, 0)[:, 0]
    assert np.max(np.abs(rounded / 0.1 - np.round(rounded / 0.1))) < 1e-12
    assert np.max(np.abs(rounded - values(exact, 0)[:, 0])) == pytest.approx(0.05, abs=0.006)
    assert np.array_equal(values(command, 0)[:, 1], values(exact, 0)[:, 1])


def test_an_infinite_input_is_refused_with_its_time() -> None:
    def value(t: np.ndarray) -> np.ndarray:
        return np.stack([0 * t, np.where(np.asarray(t) < 0.5, 0.0, np.inf)], axis=-1)

    curve = SimpleNamespace(u=value)
    bad = SimpleNamespace(t=np.array([0.0, 1.0]), duration=1.0, u=value, trajectory=curve)
    for period in (None, 0.01):
        with pytest.raises(InputError, match=r"not finite at t = 0\.5 s"):
            Command(bad, period, draws_of(), 1e-2, STOPS)  # type: ignore[arg-type]


def test_tabulated_command_agrees_with_its_source() -> None:
    def wave(times: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(times), times**2], axis=-1)

    wave.jumps = subdivide(np.array([0.0, 1.0]), 1e-3)  # type: ignore[attr-defined]
    wave.parts = (0.0, 0.5, 1.0)  # type: ignore[attr-defined]
    t = np.linspace(0.001, 0.999, 777)
    assert TableSource(wave)(t) == pytest.approx(wave(t), abs=1e-7)  # type: ignore[arg-type]


def test_nothing_is_asked_before_the_start_and_after_the_end() -> None:
    """Whatever the plan's own u says there."""
    ends = np.array([0.0, 1.0])
    always = SimpleNamespace(t=ends, duration=1.0, u=lambda t: np.ones((*np.shape(t), 2)))
    times = np.array([-2.0, -0.5, -1e-9, 0.0, 0.5, 1.0 - 1e-9, 1.0, 1.5])
    on = np.array([[0, 0, 0, 1, 1, 1, 0, 0]] * 2).T
    source = ContinuousSource(always, 0.1)  # type: ignore[arg-type]
    assert np.array_equal(source(times), on)
    table = TableSource(source)
    assert np.array_equal(table(np.array([-2.0, -0.5, 0.5, 1.0 + 1e-9])), on[[0, 1, 4, 7]])


# -- the grid ------------------------------------------------------------------------------


def test_merged_keeps_the_first_named_of_equal_times() -> None:
    third = 0.1 + 0.2
    assert third != 0.3
    assert merge_times(np.array([0.0, 0.3]), np.array([third, 1.0])).tolist() == [0.0, 0.3, 1.0]
    assert merge_times(np.array([0.0, third]), np.array([0.3, 1.0])).tolist() == [0.0, third, 1.0]


def test_subdivided_holds_its_times_and_no_step_is_too_long() -> None:
    times = np.array([0.0, 0.001, 0.0105, 1.0])
    grid = subdivide(times, 1e-3)
    assert np.all(np.isin(times, grid))
    assert np.all(np.diff(grid) > 0)
    assert np.diff(grid).max() <= 1e-3 * (1 + 1e-9)
    assert len(grid) == 1 + 1 + 10 + 990


def test_a_run_of_which_only_the_ends_are_recorded_is_cut_too() -> None:
    times = np.array([0.0, 10.0])
    cut = stretches(times, 0.0, 2.0)
    assert [(grid[0], grid[-1]) for grid, _ in cut] == [(t, t + 2.0) for t in range(0, 10, 2)]
    np.testing.assert_array_equal(np.concatenate([times[rows] for _, rows in cut]), times)


def test_snapped() -> None:
    marks = np.array([0.0, 0.3, 1.0])
    found = snap_times(np.array([-1e-14, 0.1 + 0.2, 0.31, 1 - 1e-14]), marks)
    assert found.tolist() == [0.0, 0.3, 0.31, 1.0]


def test_refined_until_simpson_is_right_on_a_spike() -> None:
    scale = 1e-5  # the derivative of sqrt(scale + t): 158 at first, gone after a few scales

    def spike(times: np.ndarray) -> np.ndarray:
        return np.stack([0.5 / np.sqrt(scale + times), 0 * times], axis=-1)

    def simpson(grid: np.ndarray) -> float:
        middle = (grid[:-1] + grid[1:]) / 2
        weighed = spike(grid[:-1]) + 4 * spike(middle) + spike(grid[1:])
        return float(np.diff(grid) @ weighed[:, 0] / 6)

    coarse, exact = np.linspace(0, 1, 101), np.sqrt(1 + scale) - np.sqrt(scale)
    grid = refine_times(spike, coarse)
    assert abs(simpson(grid) - exact) < 1e-9
    assert abs(simpson(coarse) - exact) > 0.1
    assert len(grid) < 2000
    cubic = refine_times(lambda t: np.stack([t**3 - t, 2 - t**2], axis=-1), coarse)
    assert np.array_equal(cubic, coarse), "Simpson's rule is exact for it"
