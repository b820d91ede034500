import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.problem.feasibility import least_duration, refuse_too_short


def test_bound_of_the_paper_example_by_hand(paper: planner.Problem) -> None:
    # theta3 turns 29 degrees at no more than k3 max|u1| = K3 k_g 0.5.
    expected = np.deg2rad(29) / (0.711625 * 0.668811 * 0.5)
    bound = least_duration(paper)
    assert bound.seconds == pytest.approx(expected, rel=1e-12)
    assert bound.reason.startswith("theta3 must move 29 deg and moves at most 13.63 deg/s")


def test_the_input_that_turns_joint_1_bounds_it_too(paper: planner.Problem) -> None:
    bound = least_duration(paper.changed({"limits.input_rad_s": [100.0, 0.1]}))
    assert bound.seconds == pytest.approx(np.deg2rad(29) / 0.1)
    assert bound.reason.startswith("theta1")


def test_a_given_travel_bounds_it_too(paper: planner.Problem) -> None:
    bound = least_duration(paper.changed({"goal.travel": 3.0}))
    assert bound.seconds == pytest.approx(3.0 / (0.668811 * 0.5))
    assert bound.reason.startswith("phi2")


def test_no_limit_no_bound(unlimited: planner.Problem) -> None:
    assert least_duration(unlimited).seconds == 0
    assert least_duration(unlimited).reason == ""
    refuse_too_short(unlimited.changed({"goal.duration": 1e-6}))


def test_refusal_is_sharp(paper: planner.Problem) -> None:
    bound = least_duration(paper).seconds
    refuse_too_short(paper.changed({"goal.duration": bound * 1.001}))
    with pytest.raises(planner.InfeasibleError, match=r"no plan of any kind exists: theta3"):
        refuse_too_short(paper.changed({"goal.duration": bound * 0.999}))


@pytest.mark.parametrize("n", [2, 3, 5])
def test_no_motion_beats_the_bound(n: int) -> None:
    """Drive hard for a second from any start; to arrive must have been possible in a second."""
    rng = np.random.default_rng(n)
    K = rng.uniform(0.3, 1.5, n - 1)
    system = planner.Manipulator(K, 0.7)
    for _ in range(5):
        start = np.concatenate([[0.0], rng.uniform(-0.5, 0.5, n)])
        u = rng.choice([-0.5, 0.5], 2)
        end = solve_ivp(lambda t, q, u=u: system.rates(q, u), (0, 1), start, rtol=1e-9).y[:, -1]
        problem = planner.Problem.from_dict(
            {
                "system": {"kind": "manipulator", "joints": n, "K": K.tolist(), "k_g": 0.7},
                "start": {"theta_deg": np.rad2deg(start[1:]).tolist()},
                "goal": {"theta_deg": np.rad2deg(end[1:]).tolist(), "travel": float(end[0])},
                "limits": {"input_rad_s": 0.5},
            }
        )
        assert 0.2 < least_duration(problem).seconds <= 1 + 1e-6
