"""A vehicle's problem has the same answer in every frame."""

import math
from typing import Any

import pytest

import planner

RATES: dict[str, Any] = {"speed_m_s": 2.0, "acceleration_m_s2": 20.0}
STEERED = {**RATES, "steering_rate_rad_s": 0.5, "steering_acceleration_rad_s2": 20.0}
VEHICLES: dict[str, Any] = {
    "unicycle": {
        "system": {"kind": "unicycle"},
        "goal": (3.0, 2.0, 60.0),
        "limits": {**RATES, "turn_rate_rad_s": 1.0, "turn_acceleration_rad_s2": 20.0},
    },
    "car": {
        "system": {"kind": "car", "wheelbase_m": 2.7},
        "goal": (6.0, 4.0, 30.0),
        "limits": {**STEERED, "steering_deg": 35},
    },
    "trailers": {
        "system": {"kind": "trailers", "wheelbase_m": 2.7, "trailer_lengths_m": [3.0]},
        "goal": (10.0, 4.0, 0.0),
        "limits": {**STEERED, "steering_deg": 35, "hitch_deg": 60},
    },
}


def turned(kind: str, degrees: float) -> planner.Problem:
    """The fastest motion to the goal, from the origin, all turned by an angle."""
    (x, y, heading), table = VEHICLES[kind]["goal"], VEHICLES[kind]
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    goal = {"x_m": c * x - s * y, "y_m": s * x + c * y, "heading_deg": degrees + heading}
    return planner.Problem.from_dict(
        {
            "system": table["system"],
            "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": degrees},
            "goal": {**goal, "duration": "free"},
            "limits": table["limits"],
        }
    )


@pytest.mark.parametrize(
    ("kind", "turns"),
    [
        ("unicycle", 10),
        ("car", 10),
        ("trailers", 5),
        pytest.param("trailers", 10, marks=pytest.mark.campaign),
    ],
)
def test_a_turned_problem_takes_as_long(kind: str, turns: int) -> None:
    """Two of five turns bring the trailers' drive below a third of what it is along x."""
    angles = [360.0 * k / turns for k in range(turns)]
    times = [planner.solve(turned(kind, angle)).objective for angle in angles]
    assert max(times) <= (1 + 2e-4) * min(times)
