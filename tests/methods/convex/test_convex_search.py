"""Search over travels, on stand-ins for the optimum at one travel."""

from __future__ import annotations

import numpy as np
import pytest

from planner.methods.convex.global_optimum import (
    NO_TOUCH,
    BoundAboveCeiling,
    ClassOptimum,
    EmptyClass,
    Touch,
    search_travels,
)
from planner.methods.convex.paths import Frame, input_shape
from planner.methods.convex.programme import Farkas, Optimum, StalledError

FRAME = Frame(input_shape(8, 0), np.zeros(4), np.ones(4), 1.0)
NOTHING = np.zeros(0)


def best(travel: float, value: float) -> ClassOptimum:
    final = Optimum(NOTHING, NOTHING, -1.0, value, value)
    return ClassOptimum(FRAME.at(travel), final, value, NO_TOUCH, 1, -1.0)


def refused(travel: float, margin: float) -> EmptyClass:
    proof = Farkas(NOTHING, 0.0, -margin, 1.0)
    return EmptyClass(FRAME.at(travel), NO_TOUCH, np.zeros((0, 0)), NOTHING, proof)


def test_best_travel_is_refined_far_below_the_scan_step() -> None:
    def solve(travel: float, rows: Touch, ceiling: float) -> ClassOptimum | BoundAboveCeiling:
        value = 1 + (travel - 0.537) ** 2
        return BoundAboveCeiling(value) if value > ceiling else best(travel, value)

    found = search_travels(solve, np.linspace(0.1, 0.9, 9))
    assert found.best is not None
    assert found.best.frame.travel == pytest.approx(0.537, abs=1e-4)
    assert found.range == (0.1, 0.9)


def test_search_never_reaches_travel_zero() -> None:
    tried = []

    def solve(travel: float, rows: Touch, ceiling: float) -> ClassOptimum:
        tried.append(travel)
        return best(travel, abs(travel))  # best at zero, which is another class

    search_travels(solve, np.array([-1.0, -0.5, 0.5, 1.0]))
    assert all(abs(d) >= 1e-4 for d in tried)


def test_a_range_between_two_scanned_travels_is_found() -> None:
    """Only |travel − 0.55| < 0.004 has a path; the certificates' margins lead there."""

    def solve(travel: float, rows: Touch, ceiling: float) -> ClassOptimum | EmptyClass:
        gap = abs(travel - 0.55) - 0.004
        return refused(travel, gap) if gap > 0 else best(travel, 2.0 + gap)

    found = search_travels(solve, np.linspace(0.1, 0.9, 9))
    assert found.best is not None
    assert abs(found.best.frame.travel - 0.55) < 0.004
    assert len(found.refusals) >= 9


def test_nothing_anywhere() -> None:
    found = search_travels(
        lambda travel, rows, ceiling: refused(travel, 1.0), np.linspace(0.1, 0.9, 5)
    )
    assert found.best is None
    assert np.isnan(found.range[0])
    assert len(found.refusals) == found.tried


def test_stalls_are_passed_over() -> None:
    def solve(travel: float, rows: Touch, ceiling: float) -> ClassOptimum:
        if travel < 0.5:
            raise StalledError("no")
        return best(travel, travel)

    found = search_travels(solve, np.linspace(0.1, 0.9, 9))
    assert found.best is not None
    assert 0.5 <= found.best.frame.travel < 0.51
    alone = search_travels(solve, np.array([0.2]))
    assert (alone.best, alone.tried, alone.stalls) == (None, 1, 1)
    outside = search_travels(lambda travel, rows, ceiling: None, np.linspace(0.1, 0.9, 9))
    assert (outside.best, outside.tried, outside.stalls) == (None, 9, 0)
