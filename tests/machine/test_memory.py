"""Replays of many machines: errors of all, motions of some, in memory that is bounded."""

from __future__ import annotations

import re
import sys
import tracemalloc
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from planner import InputError, Machine, Plan, Replay, Tracker, replay
from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.feedback.tracker import COURSE_BYTES, design
from planner.report import plot_replays

SIMULATE = sys.modules["planner.machine.simulate"]
COARSE: dict[str, Any] = {"step_s": 0.01}
ALL = {"samples": 7, "seed": 3, "record_s": 0.5}
TRACKER = Tracker(run_up=False, period_s=0.5)
Case = tuple[dict[str, Any], bool | Tracker, bool]
"""Effects of the machine, feedback, and whether the compiled kernel runs."""


def slowed(plan: Plan, factor: float) -> Plan:
    """The same path in `factor` times the time."""
    problem = plan.problem.changed({"goal.duration": factor * plan.duration})
    return replace(plan, problem=problem, trajectory=plan.trajectory.slowed(factor))


def same(one: Replay, other: Replay) -> None:
    """All that is kept of every machine, to the last bit; a sum over ticks to rounding."""
    for name in ("terminal_error", "deviation", "saturated_s", "fallbacks", "peak_rates"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert (one.effort is None) == (other.effort is None)
    if one.effort is not None and other.effort is not None:
        np.testing.assert_allclose(one.effort, other.effort, rtol=1e-13)


@pytest.mark.parametrize(
    "case",
    [
        ({}, False, True),
        ({}, False, False),
        ({"fidelity": "dynamic"}, False, True),
        ({"delay_s": {"value": 0.005, "spread": 0.002}}, False, True),
        ({}, TRACKER, True),
        ({"delay_s": {"value": 0.005, "spread": 0.002}}, TRACKER, True),
    ],
)
def test_errors_are_those_of_a_replay_that_keeps_every_motion(
    smooth_plan: Plan, monkeypatch: pytest.MonkeyPatch, use: Any, case: Case
) -> None:
    effects, feedback, kernel = case
    if not kernel:
        use(None)
    plan = smooth_plan if kernel else slowed(smooth_plan, 0.2)
    machine = Machine.prototype(**COARSE, **effects)
    whole = replay(plan, machine, feedback=feedback, **ALL)
    monkeypatch.setattr(SIMULATE, "CHUNK_SAMPLES", 3)
    some = replay(plan, machine, feedback=feedback, motions=4, **ALL)
    none = replay(plan, machine, feedback=feedback, motions=0, **ALL)
    same(whole, some)
    same(whole, none)
    assert np.array_equal(some.q, whole.q[:4])
    assert np.array_equal(some.motor_rates, whole.motor_rates[:4])
    assert np.array_equal(some.measured, whole.measured[:4])
    assert none.q.shape == (0, *whole.q.shape[1:])
    assert np.array_equal(whole.terminal_error, whole.q[:, -1] - plan.q(plan.duration))
    assert np.array_equal(whole.peak_rates, np.abs(whole.motor_rates).max(axis=1))
    assert np.array_equal(some.motion(3), whole.q[3])
    if "delay_s" not in effects:  # alone, a machine's delay lies on the grid of the simulation
        assert np.array_equal(some.motion(6), whole.q[6])
    for name, values in whole.draws.values.items():
        assert np.array_equal(none.draws.values[name], values)


def test_memory_is_that_of_a_block_and_of_errors(smooth_plan: Plan) -> None:
    """Motions of these machines take 17 kB each, errors and parameters half a kB."""
    machine = Machine.prototype(step_s=0.01)

    def peak(samples: int) -> int:
        tracemalloc.start()
        replay(smooth_plan, machine, samples=samples, motions=100, record_s=0.03)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(10)
    assert peak(4000) - peak(2000) < 2000 * 1500


def test_motions_that_take_too_much_are_refused_with_what_fits(
    smooth_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine.ideal(step_s=0.01)
    with pytest.raises(InputError, match=r" 1000000 .* 25\.3 GB"):
        replay(smooth_plan, machine, samples=1_000_000)
    with pytest.raises(InputError, match=r"record_s = 0\.001 .*record_s = None"):
        replay(smooth_plan, machine, record_s=1e-9)
    monkeypatch.setattr(SIMULATE, "MOST_BYTES", 100_000)
    with pytest.raises(InputError) as caught:
        replay(smooth_plan, machine, samples=100)
    told = re.search(r"motions = (\d+) or fewer.*record_s = ([\d.]+) or more", str(caught.value))
    assert told is not None
    count, record = int(told[1]), float(told[2])
    few = replay(smooth_plan, machine, samples=100, motions=count)
    assert few.q.nbytes + few.motor_rates.nbytes <= 100_000
    rough = replay(smooth_plan, machine, samples=100, record_s=record)
    assert 50_000 < rough.q.nbytes + rough.motor_rates.nbytes <= 100_000
    assert replay(smooth_plan, machine, samples=100, record_s=None).q.shape[:2] == (100, 3)
    with pytest.raises(InputError):
        replay(smooth_plan, machine, samples=100, motions=count + 1)


def test_blocks_are_smaller_where_motions_are_long(
    smooth_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine.prototype(**COARSE)
    whole = replay(smooth_plan, machine, **ALL)
    monkeypatch.setattr(SIMULATE, "BLOCK_BYTES", whole.q.nbytes // 2)
    seen = []
    usual = SIMULATE._at_start
    monkeypatch.setattr(
        SIMULATE, "_at_start", lambda *given: (seen.append(given[2].count), usual(*given))[1]
    )
    same(whole, replay(smooth_plan, machine, motions=0, **ALL))
    assert seen == [2, 2, 2, 1]


@pytest.mark.parametrize(
    "case",
    [
        ({"delay_s": 0.0137}, False, True),
        ({"delay_s": 0.0137, "friction_capacity_nm": 0.1, "creep_per_nm": 0.1}, False, False),
        ({"control_period_s": False}, False, True),
        ({"control_period_s": False, "delay_s": {"value": 0.005, "spread": 0.002}}, False, True),
        ({"fidelity": "dynamic"}, False, True),
        ({"delay_s": 0.0137}, TRACKER, True),
        ({"delay_s": {"value": 0.105, "spread": 0.05}}, TRACKER, False),
    ],
)
def test_stretches_of_time_are_one_run(
    smooth_plan: Plan, monkeypatch: pytest.MonkeyPatch, use: Any, case: Case
) -> None:
    """Cuts lie on the grid, so that rounding of times is all that differs."""
    effects, feedback, kernel = case
    if not kernel:
        use(None)
    plan = slowed(smooth_plan, 0.2)
    machine = Machine.prototype(**COARSE, **effects)
    given = {**ALL, "samples": 3, "record_s": 0.02, "feedback": feedback}
    whole = replay(plan, machine, **given)
    monkeypatch.setattr(SIMULATE, "STRETCH_STEPS", 33)
    cut = replay(plan, machine, **given)
    assert np.array_equal(cut.t, whole.t)
    close = partial(np.testing.assert_allclose, rtol=1e-7, atol=1e-9)
    for name in (
        *("q", "motor_rates", "peak_rates", "saturated_s", "slip_s", "slip_begin", "slip_contact"),
        *("margin", "margin_s", "terminal_error", "deviation", "fallbacks"),
    ):
        close(getattr(cut, name), getattr(whole, name), err_msg=name)
    assert cut.run_s == whole.run_s
    assert feedback is False or bool(np.all(cut.effort == pytest.approx(whole.effort)))


@pytest.mark.parametrize("period", [0.01, False])
def test_memory_does_not_grow_with_the_duration(
    smooth_plan: Plan, monkeypatch: pytest.MonkeyPatch, period: float | bool
) -> None:
    monkeypatch.setattr(SIMULATE, "STRETCH_STEPS", 3000)
    machine = Machine.prototype(step_s=0.01, control_period_s=period)

    def peak(factor: float) -> int:
        plan = slowed(smooth_plan, factor)
        tracemalloc.start()
        replay(plan, machine, record_s=1.0)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(10)
    short, long = peak(20), peak(60)
    assert long - short < 400 * 200  # of which each recorded instant takes 56 bytes


def test_feedback_that_takes_too_much_is_refused_beforehand(smooth_plan: Plan) -> None:
    day = slowed(smooth_plan, 86_400 / smooth_plan.duration)
    with pytest.raises(InputError) as caught:
        replay(day, Machine.prototype(), samples=1, record_s=None, feedback=True)
    told = re.search(r"86400 s takes 13 GB of memory.*plan of (\d+)", str(caught.value))
    assert told is not None
    assert 10_000 < int(told[1]) < 20_000


def test_a_course_takes_no_more_memory_than_is_said(smooth_plan: Plan) -> None:
    machine, options = Machine.prototype(), TRACKER.options

    def peak(factor: float) -> int:
        plan = slowed(smooth_plan, factor)
        tracemalloc.start()
        design(plan, machine, options)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    seconds = 20 * smooth_plan.duration
    assert peak(40) - peak(20) < COURSE_BYTES * seconds / DEFAULT_TICK_S


def test_motions_is_a_number(smooth_plan: Plan) -> None:
    for wrong in (-1, 1.5, "all"):
        with pytest.raises(InputError, match="motions = "):
            replay(smooth_plan, Machine.ideal(), motions=wrong)  # type: ignore[arg-type]


def test_a_figure_shows_the_machines_whose_motions_there_are(smooth_plan: Plan) -> None:
    run = replay(smooth_plan, Machine.prototype(**COARSE), samples=9, motions=2)
    axes = plot_replays(run)[1]
    labels = axes[0, 0].get_legend_handles_labels()[1]
    assert "90 % of the first 2 machines" in labels
    assert run.to_xarray()["q"].shape == run.q.shape
    assert len(run.to_frame()) == 9
