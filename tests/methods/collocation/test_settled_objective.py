"""A mesh is refined until the objective has settled, not only until the motion is accurate."""

from __future__ import annotations

from typing import Any

import pytest

import planner
from planner.methods.collocation.between_nodes import SAVING

ENDS = [1.0, 1.0, 1.0], [30.0, 30.0, 30.0]


def _plan(duration: float, rate: float | None, **options: Any) -> planner.Plan:
    problem = planner.Problem.manipulator(
        *ENDS,
        duration=duration,
        K=[0.870125, 0.711625],
        k_g=0.668811,
        input_rad_s=0.5,
        joint_deg=80,
        input_rate_rad_s2=rate,
    )
    return planner.solve(problem, "collocation", **options)


@pytest.mark.parametrize(
    ("duration", "rate", "options"),
    [
        (20.0, 0.05, {"rest": True}),
        (15.0, 0.1, {"rest": True}),
        (60.0, 0.5, {}),
        (20.0, None, {"rest": True}),
        (20.0, 0.05, {"objective": "smooth"}),
    ],
)
def test_a_finer_mesh_saves_less_than_promised(
    duration: float, rate: float | None, options: dict[str, Any]
) -> None:
    plan = _plan(duration, rate, **options)
    fine = _plan(duration, rate, intervals=200, **options)
    assert plan.objective <= fine.objective * (1 + SAVING)


def test_a_smooth_input_needs_no_finer_mesh() -> None:
    assert _plan(10.0, None).notes["intervals"] == [14]
