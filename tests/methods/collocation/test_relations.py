"""What least efforts have to do with each other exposes local optima: no answer need be known.

A motion run backwards or mirrored takes the same effort, and one run half as fast half as much.
"""

from __future__ import annotations

import pytest

import planner

K = [0.870125, 0.711625, 0.582]
RELATED = 1e-3
FOUR = [-25.71, -15.36, 0.11, -3.71], [-5.02, -7.59, 39.53, 27.26]
PAIRS = [
    # θ₁ crosses zero early or late: with one guess alone 63.9 for 59.3
    ([24.45, -37.67, -52.51], [-28.66, 21.94, 51.77]),
    # six guesses in a row led to 9.47 for 8.63
    ([-11.08, 19.6, 23.45], [31.04, 33.51, 24.41]),
    # Fatrop strayed from a path on a finer mesh: 26.1 for 24.8
    ([18.97, -34.22, 15.02, 20.17], [-41.02, 4.75, -31.52, 15.41]),
    # a path that was found three times was taken for the shortest: 6.52 for 6.16
    ([21.93, 40.5, 19.13, 8.87], [10.11, 6.8, -4.75, 4.72]),
]


def _size(start: list[float], goal: list[float], duration: float) -> float:
    """Effort times duration, which the duration does not change."""
    constants = K[: len(start) - 1]
    problem = planner.Problem.manipulator(
        start, goal, duration=duration, K=constants, k_g=0.668811, joint_deg=80
    )
    return planner.solve(problem, "collocation").objective * duration


@pytest.mark.parametrize(("start", "goal"), PAIRS)
def test_the_way_back_and_the_mirrored_one_take_the_same_effort(
    start: list[float], goal: list[float]
) -> None:
    mirrored = [-angle for angle in start], [-angle for angle in goal]
    sizes = [_size(*ends, 30.0) for ends in ((start, goal), (goal, start), mirrored)]
    assert max(sizes) <= min(sizes) * (1 + RELATED)


def test_no_one_way_motion_of_four_joints_ends_the_search() -> None:
    sizes = [_size(*FOUR, duration) for duration in (30.0, 60.0)]
    assert sizes == pytest.approx([39.62] * 2, rel=RELATED)


def test_theta1_stays_on_the_side_of_both_its_ends() -> None:
    ends = [3.79, -41.01, -48.76], [1.3, -45.26, 55.23]
    problem = planner.Problem.manipulator(*ends, duration=60.0, K=K[:2], k_g=0.668811, joint_deg=80)
    plan = planner.solve(problem, "collocation")
    assert plan.q(plan.t)[:, 1].min() > -1e-6
