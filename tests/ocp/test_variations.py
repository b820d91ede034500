"""A motion found is bettered by variations of it."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from planner.methods.collocation import collocation_task
from planner.ocp.guess import seeds
from planner.ocp.improve import Motion, finer
from planner.ocp.search import search
from planner.ocp.timing import timed
from planner.ocp.variation import variation
from planner.schema.methods import CollocationOptions
from planner.systems.base import Array

TURNS = planner.Problem.from_dict(
    {
        "system": {
            "kind": "manipulator",
            "joints": 3,
            "K": [0.870125, 0.711588],
            "k_g": 0.668811,
        },
        "start": {"theta_deg": [-2.883, 61.632, -27.093]},
        "goal": {"theta_deg": [56.121, 9.597, 73.422], "travel": 0.0, "duration": "free"},
        "limits": {"input_rad_s": [0.5, 0.5], "joint_deg": 80.0},
    }
)
SHORT = TURNS.changed({"goal.theta_deg": [0.0, 65.0, -20.0], "goal.travel": "free"})


def _path(s: Array) -> Array:
    return np.stack([2 * np.sin(5 * s), 0.8 * np.cos(7 * s), s, s**2], axis=-1)


@pytest.mark.parametrize("number", range(20))
def test_a_variation_keeps_the_ends_and_the_limits(number: int) -> None:
    s = np.linspace(0.0, 1.0, 1001)
    seed = variation("it", TURNS, _path, 3.0, np.random.default_rng(number))
    assert seed.states is not None
    q = seed.states(s)
    assert q is not None
    assert q.shape == (1001, 4)
    assert np.allclose(q[[0, -1]], _path(s[[0, -1]]))
    assert np.all(np.abs(q[:, 1]) <= 1.3 + 1e-12)
    assert np.max(np.abs(q - _path(s))) > 0.01


def test_variations_find_what_one_start_does_not() -> None:
    plain = planner.solve(TURNS, "collocation", starts=1, variations=0)
    plan = planner.solve(TURNS, "collocation", starts=1, variations=12)
    assert planner.verify(plan).ok
    assert plan.objective < 0.985 * plain.objective
    assert "variation" not in plain.notes["start"]
    assert plan.notes["start"] == "variation 8 of straight"
    tried = {entry["start"]: entry for entry in plan.notes["tried"]}
    assert len(tried) == 13
    found = [entry["objective"] for entry in plan.notes["tried"] if entry["objective"]]
    assert tried[plan.notes["start"]]["objective"] == min(found)


def test_none_are_tried_where_the_drive_never_turns_back(paper: planner.Problem) -> None:
    plan = planner.solve(paper.changed({"goal.duration": "free", "goal.travel": "free"}))
    assert [entry["start"] for entry in plan.notes["tried"]] == ["straight"]


def _motion(problem: planner.Problem) -> Motion:
    job = collocation_task(problem, CollocationOptions(), 40)
    paths = search(job, seeds("straight"), 1)
    return Motion("straight", job, timed(job, paths.found[0].solution.iterate).solution, [], 0)


def test_a_long_motion_gets_a_finer_mesh_as_far_as_allowed() -> None:
    found = _motion(TURNS)
    assert finer(found, 79) is found
    closer = finer(found, 80)
    assert len(closer.task.mesh.widths) == 80
    assert closer.solution.ok
    assert closer.solution.objective < 0.99 * found.solution.objective


def test_a_short_motion_keeps_its_mesh() -> None:
    found = _motion(SHORT)
    closer = finer(found, 160)
    assert closer.task is found.task
    assert closer.solution is found.solution
    assert closer.iterations > 0
