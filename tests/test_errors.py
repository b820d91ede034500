"""What refusals read like."""

from __future__ import annotations

import numpy as np

from planner.errors import Violation


def violation(value: float, limit: float, unit: str) -> Violation:
    return Violation("joint theta1", 7.0, value, limit, unit, 1.0)


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
