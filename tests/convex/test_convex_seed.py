"""Shooting for a first path: it must be a motion of the system, inside one branch, to the goal."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import planner
from planner.chained import chained_form
from planner.convex.frame import Frame
from planner.convex.seed import seeds
from planner.convex.shape import input_shape

Reachable = Callable[..., planner.Problem]


@pytest.mark.parametrize("joints", [4, 5, 6])
def test_seed_is_a_motion_to_the_goal(reachable: Reachable, joints: int) -> None:
    problem = reachable(joints, 0)
    (seed,) = seeds(problem, np.array([0.45]), np.array([0.0, 1.0]))
    np.testing.assert_allclose(seed.q[0], problem.start, atol=1e-12)
    np.testing.assert_allclose(seed.q[-1, 1:], problem.goal[1:], atol=1e-6)
    assert seed.q[-1, 0] == pytest.approx(seed.travel)
    assert np.all(problem.system.chart_margins(seed.q, problem.branch) > 0)
    middle = slice(1, -1)
    rates = (seed.q[2:] - seed.q[:-2])[:, 2:] * 30 / seed.travel
    np.testing.assert_allclose(rates, problem.system.slopes(seed.q[middle]), atol=2e-3)


def test_fixed_travel_is_kept(reachable: Reachable) -> None:
    problem = reachable(4, 0, travel=0.5)
    (seed,) = seeds(problem, np.array([0.5]), np.array([0.0, 1.0]))
    assert seed.travel == pytest.approx(0.5, rel=1e-12)
    np.testing.assert_allclose(seed.q[-1, 1:], problem.goal[1:], atol=1e-6)


@pytest.mark.parametrize("degree", [0, 1])
def test_coefficients_follow_the_seed(reachable: Reachable, degree: int) -> None:
    problem = reachable(4, 1)
    (seed,) = seeds(problem, np.array([0.5]), np.array([0.0, 1.0]))
    z = chained_form(problem.system).z(seed.q)
    frame = Frame(input_shape(60, degree), z[0], z[-1], seed.travel)
    y = frame.y(seed.coefficients(frame.shape, z[:, 1]))
    at = frame.bernstein(y)[1][0]
    np.testing.assert_allclose(at, z[:-1, 1], atol=2e-3 * np.abs(z[:, 1]).max())


def test_no_seed_where_none_is_to_be_had() -> None:
    """θ₂ … θ₄ cannot all move 20° from 5°: no one-way motion is known, and none is invented."""
    problem = planner.Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": 4, "K": [1.0, 0.9, 0.81], "k_g": 0.7},
            "start": {"theta_deg": [5.0] * 4},
            "goal": {"theta_deg": [25.0] * 4, "travel": "free"},
        }
    )
    assert seeds(problem, np.array([0.5]), np.array([0.0])) == []
