"""What refusals read like."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import planner
from planner import Violation
from planner.errors import Part


def violation(value: float, limit: float, unit: str) -> Violation:
    return Violation(Part("joint theta1", unit), value, limit, 7.0)


def test_angles_are_told_in_degrees() -> None:
    text = str(violation(np.deg2rad(81.25), np.deg2rad(80), "rad"))
    assert text == "joint theta1 reaches 81.25 deg at t = 7 s, allowed 80 deg"
    assert str(violation(0.61, 0.5, "rad/s")).endswith(
        "reaches 0.61 rad/s at t = 7 s, allowed 0.5 rad/s"
    )


def test_a_small_excess_is_still_seen() -> None:
    assert "80.0001 deg" in str(violation(np.deg2rad(80.00012), np.deg2rad(80), "rad"))
    assert violation(1.0, 1.0, "").shown(3) == ("1", "1", "")
    assert violation(float("nan"), 1.0, "m").shown(3) == ("nan", "1", " m")


LONG = "x" * 100_000


@pytest.mark.parametrize(
    "call",
    [
        lambda problem: planner.load_problem(LONG),
        lambda problem: planner.compare(problem, f"polynomial:{LONG}"),
        lambda problem: planner.compare(problem, "polynomial", samples=[-1] * 50_000),
        lambda problem: planner.load_samples(LONG),
    ],
    ids=["file", "method", "samples", "samples' file"],
)
def test_what_a_message_quotes_is_cut_in_its_middle(
    paper: planner.Problem, call: Callable[..., Any]
) -> None:
    with pytest.raises(planner.InputError) as refused:
        call(paper)
    assert len(str(refused.value)) <= 5000


def test_a_cut_message_keeps_its_beginning_and_its_end() -> None:
    text = str(planner.InputError(f"cannot read {LONG}: no such file\nsecond line"))
    assert text.startswith("cannot read xxx")
    assert text.endswith("xxx: no such file\nsecond line")
    assert len(text) < 1100
    assert len(str(planner.InputError("a line\n" * 50_000))) <= 5000
    assert str(planner.InputError("as it is")) == "as it is"
