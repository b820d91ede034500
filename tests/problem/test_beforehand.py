"""What is known before anything is planned: the least duration, the ends, controllability."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.problem.feasibility import (
    GOAL_MISS,
    LIMIT_MISS,
    chart_ends_report,
    least_duration,
    refuse_too_short,
)
from planner.verification.verify import GOAL_TOLERANCE, LIMIT_TOLERANCE

# -- the least duration ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "seconds", "reason"),
    [
        # theta3 turns 29 degrees at no more than k3 max|u1| = K3 k_g 0.5.
        ({}, np.deg2rad(29) / (0.711625 * 0.668811 * 0.5),
         "theta3 must move 29 deg and moves at most 13.63 deg/s"),
        ({"limits.input_rad_s": [100.0, 0.1]}, np.deg2rad(29) / 0.1, "theta1"),
        ({"goal.travel": 3.0}, 3.0 / (0.668811 * 0.5), "phi2"),
    ],
)  # fmt: skip
def test_bound_of_the_paper_example_by_hand(
    paper: planner.Problem, changes: dict[str, object], seconds: float, reason: str
) -> None:
    bound = least_duration(paper.changed(changes))
    assert bound.seconds == pytest.approx(seconds, rel=1e-12)
    assert bound.reason.startswith(reason)


def test_no_limit_no_bound(unlimited: planner.Problem) -> None:
    assert least_duration(unlimited).seconds == 0
    assert least_duration(unlimited).reason == ""
    refuse_too_short(unlimited.changed({"goal.duration": 1e-6}))


def test_refusal_is_sharp(paper: planner.Problem) -> None:
    bound = least_duration(paper).seconds
    refuse_too_short(paper.changed({"goal.duration": bound * 1.001}))
    with pytest.raises(planner.InfeasibleError, match="theta3"):
        refuse_too_short(paper.changed({"goal.duration": bound * 0.999}))


def test_what_is_verified_is_not_called_infeasible(paper: planner.Problem) -> None:
    """Joint 1 alone turns at its limit: tolerances of goal and limits let it end a little early."""
    turn = paper.changed({"goal.theta_deg": [30, 1, 1], "goal.travel": 0, "limits.z2_margin": None})
    bound = least_duration(turn).seconds
    early = turn.changed({"goal.duration": bound * (1 - 5e-7)})
    assert planner.solve(early).verified
    refuse_too_short(early)
    assert (GOAL_MISS, LIMIT_MISS) == (GOAL_TOLERANCE, LIMIT_TOLERANCE)


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


# -- both ends --------------------------------------------------------------------------------


def test_ends_of_the_paper_example_are_the_printed_ones(paper: planner.Problem) -> None:
    start, goal = chart_ends_report(paper)
    np.testing.assert_allclose(start.z[1:], [-0.0324, 0.7113, 0.0175], atol=5e-5)
    np.testing.assert_allclose(goal.z[1:], [-0.5225, 0.4622, 0.5236], atol=5e-5)
    assert np.isnan(goal.z[0])
    assert start.in_chart
    assert goal.in_chart
    assert min(start.margins.values()) == pytest.approx(np.sin(np.deg2rad(1)) ** 2)
    assert min(goal.margins.values()) == pytest.approx(0.25)


def test_a_joint_on_a_singularity_or_another_branch_is_named(unlimited: planner.Problem) -> None:
    start, goal = chart_ends_report(unlimited.changed({"start.theta_deg": [1, 0, 1]}))
    assert (start.singular, start.in_chart, goal.singular) == (("theta2",), False, ())
    start, goal = chart_ends_report(unlimited.changed({"goal.theta_deg": [-30, 30, 30]}))
    assert (start.in_chart, goal.crossed) == (True, ("theta1",))
    assert min(goal.margins.values()) < 0


def test_a_given_travel_is_part_of_the_goal(paper: planner.Problem) -> None:
    _, goal = chart_ends_report(paper.changed({"goal.travel": 0.8, "start.phi_rad": 0.1}))
    assert goal.z[0] == pytest.approx(0.9)
    assert goal.to_dict()["z"][0] == pytest.approx(0.9)


# -- brackets ---------------------------------------------------------------------------------


def test_regular_start_and_the_drop_at_zero(paper: planner.Problem) -> None:
    found = planner.check(paper, ["polynomial"]).nonholonomy
    growth = {place.name: place.finding.growth for place in found.places if place.finding}
    regular = (2, 3, 4)
    assert growth == {"start": regular, "goal": regular, "start with theta1 = 0": (2, 2, 3, 4)}
    assert "Frobenius: not involutive" in str(found.places[0])
    assert "Chow: controllable" in str(found.places[2])


def test_the_papers_recursion_is_judged(paper: planner.Problem, unlimited: planner.Problem) -> None:
    assert (
        "fails at step 1, 2" in planner.check(paper, ["polynomial"]).nonholonomy.recursion_verdict
    )
    straight = unlimited.changed({"start.theta_deg": [0, 10, 10]})
    verdict = planner.check(straight, ["polynomial"]).nonholonomy.recursion_verdict
    assert "corrected for cos^3 it divides by zero at step 1" in verdict


def test_deep_singularities_are_bounded_and_said(unlimited: planner.Problem) -> None:
    data = unlimited.to_dict()
    data["system"] = {"kind": "manipulator", "joints": 6, "K": [0.8] * 5, "k_g": 0.7}
    data["start"], data["goal"]["theta_deg"] = {"theta_deg": [0.0] * 6}, [10.0] * 6
    found = planner.check(planner.Problem.from_dict(data), ["polynomial"]).nonholonomy.places[0]
    assert found.finding is not None
    assert not found.finding.chow
    assert "not shown up to bracket length 8" in str(found)


def test_other_systems_have_no_recursion(unlimited: planner.Problem) -> None:
    car = planner.load_problem(str(unlimited.source).replace("paper.toml", "car.toml"))
    found = planner.check(car, ["polynomial"]).nonholonomy
    assert found.recursion is None
    assert found.to_dict()["paper_recursion"] is None
    assert [place.name for place in found.places] == ["start", "goal"]
    assert np.all([place.finding is not None for place in found.places])
