"""The plan's clock while a machine runs its commands."""

from __future__ import annotations

import numpy as np
import pytest

from planner.plan.clock import Clock


def test_it_is_held_before_on_the_way_and_after() -> None:
    clock = Clock.with_holds(10.0, [(10.0, 1.0), (0.0, 3.0), (4.0, 1.5)])
    assert clock.t == (0.0, 3.0, 7.0, 8.5, 14.5, 15.5)
    assert clock.s == (0.0, 0.0, 4.0, 4.0, 10.0, 10.0)
    assert (clock.lead_s, clock.tail_s, clock.seconds) == (3.0, 1.0, 10.0)
    assert clock.holds == ((7.0, 8.5),)
    assert clock([-1.0, 1.0, 5.0, 8.0, 9.5, 20.0]).tolist() == [0.0, 0.0, 2.0, 4.0, 5.0, 10.0]
    assert [clock.when(s) for s in (0.0, 2.0, 4.0, 5.0, 10.0)] == [3.0, 5.0, 8.5, 9.5, 14.5]
    assert clock.flaw == ""


def test_a_plan_without_holds_has_its_own_time() -> None:
    clock = Clock.running(4.0)
    assert clock == Clock.with_holds(4.0, [(0.0, 0.0), (2.0, 0.0)])
    assert (clock.lead_s, clock.tail_s, clock.holds) == (0.0, 0.0, ())
    assert np.array_equal(clock(np.arange(5.0)), np.arange(5.0))


@pytest.mark.parametrize(
    ("t", "s", "why"),
    [
        ((0.0, 1.0), (0.0, 1.0, 2.0), "from 0"),
        ((1.0, 2.0), (0.0, 1.0), "from 0"),
        ((0.0, 1.0, 1.0), (0.0, 1.0, 1.0), "must increase"),
        ((0.0, 1.0), (0.0, 0.5), "run at the machine's rate or be held"),
        ((0.0, 1.0, 2.0), (0.0, 1.0, 0.0), "run at the machine's rate or be held"),
    ],
)
def test_what_is_no_clock_says_why(t: tuple[float, ...], s: tuple[float, ...], why: str) -> None:
    assert why in Clock(t, s).flaw
