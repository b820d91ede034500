"""What is seen of a curve between its samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import planner
from planner.methods.collocation import best, pipeline
from planner.methods.collocation.best import Candidate, Exactness
from planner.methods.collocation.between_nodes import limit_excess, peaks

TAU = np.linspace(0, 1, 13)


@pytest.mark.parametrize("vertex", [0.01, 0.03, 0.3, 0.51, 0.97, 0.99])
def test_a_parabola_s_peak_is_found_wherever_it_lies(vertex: float) -> None:
    curve = 1.0 - (TAU - vertex) ** 2
    assert peaks(curve[None]) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("vertex", [-0.2, 1.3])
def test_a_peak_outside_the_interval_does_not_count(vertex: float) -> None:
    curve = 1.0 - (TAU - vertex) ** 2
    assert peaks(curve[None]) == max(curve[0], curve[-1])


def test_a_limit_passed_between_samples_is_seen() -> None:
    """The quick look at all samples overlooks none of what the parabolas show."""
    rng = np.random.default_rng(4)
    for _ in range(500):
        vertex, bend = rng.uniform(-0.1, 1.1), rng.uniform(0.1, 5.0)
        curve = 1.0 - bend * (TAU - vertex) ** 2
        top = peaks(curve[None])[0]
        for limit in (top - 1e-6, top + 1e-6):
            over = limit_excess(curve[None, None], np.array(limit), np.array(1.0))
            assert bool(over[0] > 0) == (top > limit)


def test_a_cubic_s_peak_is_bounded_closely() -> None:
    rng, fine = np.random.default_rng(5), np.linspace(0, 1, 4001)
    for _ in range(300):
        cubic = np.polynomial.Polynomial(rng.uniform(-1, 1, 4))
        bound, true = peaks(cubic(TAU)[None])[0], np.max(cubic(fine))
        assert true - 1e-7 <= bound <= true + 1e-3


def test_a_motion_that_leaves_its_limits_between_the_nodes_is_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where limits cannot be drawn in, the search goes on to the next best motion."""
    problem = planner.load_problem("problems/crossing.toml")
    first = planner.solve(problem, "collocation")
    seen = list[float]()

    def polish(*given: Any) -> Candidate:
        done = best.polish(*given)
        seen.append(done.solution.objective)
        return done if len(seen) > 1 else replace(done, checked=Exactness.SOLVED)

    monkeypatch.setattr(pipeline, "polish", polish)
    plan = planner.solve(problem, "collocation")
    assert len(seen) == 2
    assert plan.objective >= first.objective
    assert plan.notes["start"] != first.notes["start"]


@pytest.mark.campaign
def test_limits_that_cannot_be_drawn_in_on_the_shortest_path() -> None:
    """A case of `make stress` (n3 zero x1.02 87), refused before: theta3 reached 81 of 80 deg."""
    problem = planner.Problem.manipulator(
        start_deg=[18.425, 51.833, 22.374],
        goal_deg=[-26.461, -26.487, 56.379],
        travel=0.0,
        duration=34.2264,
        K=[0.870125, 0.711588225],
        input_rad_s=0.5,
        joint_deg=80.0,
    )
    assert planner.solve(problem, "collocation").verified
