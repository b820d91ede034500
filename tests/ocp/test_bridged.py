"""Random paths timed: motions that obey the kinematics and every limit."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

import planner
from planner.methods import collocation
from planner.ocp.bridged import crossings
from planner.schema.methods import CollocationOptions

PROBLEM = planner.Problem.from_dict(
    {
        "system": {"kind": "manipulator", "joints": 3, "K": [0.870125, 0.711625], "k_g": 0.668811},
        "start": {"theta_deg": [10.0, -20.0, 30.0]},
        "goal": {"theta_deg": [-40.0, 50.0, -10.0], "travel": 0.0, "duration": "free"},
        "limits": {"input_rad_s": [0.5, 0.5], "joint_deg": 80.0},
    }
)


def test_a_crossing_is_a_motion_within_the_limits() -> None:
    job = collocation.collocation_task(PROBLEM, CollocationOptions(), 40)
    found = next(islice(crossings(job, 3), 1))
    solution = found.timed.solution
    assert solution.ok
    assert solution.residual < 1e-7
    assert np.max(np.abs(solution.iterate.inputs)) <= 0.5 + 1e-9
    assert solution.iterate.nodes[-1] == pytest.approx([0.0, *np.deg2rad([-40.0, 50.0, -10.0])])


def test_a_plan_grows_from_random_paths_where_guesses_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collocation, "_guesses", lambda job, options: 0)
    plan = planner.solve(PROBLEM, "collocation")
    assert plan.notes["start"].startswith("bridge")
    assert planner.verify(plan).ok
