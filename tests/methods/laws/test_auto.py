"""The paper's hand work done by the program: points, travel and amplitude."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import planner
from planner.methods.laws.scores import (
    SLACK,
    Scores,
    end_margin,
    end_slack,
    evolve,
    score,
    search_candidates,
)
from planner.plan.trajectory import ChainedTrajectory
from planner.solve import solve_and_check
from planner.support.calculus.bernstein import Bernstein


@pytest.fixture(scope="module")
def auto(paper: planner.Problem) -> planner.Plan:
    return planner.solve(paper, "polynomial", points="auto")


def _peaks(plan: planner.Plan) -> np.ndarray:
    return np.asarray(np.max(np.abs(plan.u(np.linspace(0, plan.duration, 20001))), axis=0))


def test_beats_the_hand_by_far(auto: planner.Plan, unlimited: planner.Problem) -> None:
    """Within the file's limits of 0.5 rad/s; the hand-chosen middle travel needs 80 rad/s."""
    by_hand = planner.solve(unlimited, "polynomial", travel="middle")
    assert auto.verified
    assert auto.domain.ok
    assert _peaks(by_hand)[1] > 80
    assert _peaks(auto)[1] < _peaks(by_hand)[1] / 400
    assert np.max(_peaks(auto)) < 0.18


def test_more_points_lower_the_peak(auto: planner.Plan) -> None:
    costs = auto.notes["auto_cost_with_0_1_2_points"]
    peaks = [cost / (1 - cost) * 0.5 for cost in costs]
    assert peaks[0] == pytest.approx(0.5825, abs=1e-3)  # no travel alone keeps 0.5 rad/s
    assert peaks[0] > peaks[1] > peaks[2]
    assert peaks[2] == pytest.approx(np.max(_peaks(auto)), rel=1e-3)
    assert len(auto.notes["points"]) == 2


def test_chosen_points_are_ordinary_points(auto: planner.Plan, paper: planner.Problem) -> None:
    again = planner.solve(
        paper.changed({"goal.travel": auto.travel}), "polynomial", points=auto.notes["points"]
    )
    t = np.linspace(0, 10, 60)
    np.testing.assert_allclose(again.z(t), auto.z(t), rtol=0, atol=1e-12)


def test_a_little_off_the_choice_is_worse(auto: planner.Plan, paper: planner.Problem) -> None:
    """Local optimality, by plans made without the search."""
    best = np.max(_peaks(auto))
    (t1, v1), (t2, v2) = auto.notes["points"]
    for d_travel, d1, d2 in ((2e-4, 0, 0), (-2e-4, 0, 0), (0, 1e-3, 0), (0, 0, -2e-3)):
        problem = paper.changed({"limits": {}, "goal.travel": auto.travel + d_travel})
        plan = planner.solve(
            problem, "polynomial", points=[[t1, v1 + d1], [t2, v2 + d2]], allow_singular=True
        )
        assert not plan.domain.ok or np.max(_peaks(plan)) > best


def test_largest_margin(unlimited: planner.Problem) -> None:
    """At this travel the smallest peak comes ten times closer to the edge than the ends do."""
    problem = unlimited.changed({"goal.travel": 0.8})
    plan = planner.solve(problem, "polynomial", points="auto", criterion="margin")
    # To what 6000 samples see: a dip between two of them is a few 1e-8 deep here.
    assert plan.domain.margin == pytest.approx(end_margin(problem), rel=1e-3)


def test_says_when_nothing_is_found(unlimited: planner.Problem) -> None:
    """π/4 lies outside the window of one-way motions, so no points can help."""
    problem = unlimited.changed({"goal.travel": np.pi / 4})
    with pytest.raises(planner.SingularError, match=r"best polynomial plan of \d+") as caught:
        planner.solve(problem, "polynomial", points="auto")
    plan = caught.value.plan
    assert plan is not None
    assert plan.notes["auto_found_inside"] is False
    assert not plan.domain.ok


LAWS = ("polynomial", "piecewise", "sinusoid", "sinusoid_steps")


@pytest.mark.parametrize("method", LAWS)
def test_what_no_law_finds_is_not_called_infeasible(
    unlimited: planner.Problem, method: str
) -> None:
    """No motion one way exists, and none is found out and back; the second proves nothing."""
    problem = unlimited.changed({"goal.theta_deg": [30.0, 30.0, 0.5]})
    with pytest.raises(planner.SingularError, match=r"the best .* leaves the domain") as caught:
        solve_and_check(problem, method, advice=False)
    assert "travel" not in str(caught.value.advice)  # it is free


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ([23.1, 16.2, 15.5], [23.1, 16.21, 15.5]),  # at the start itself a plan stays: test_stay
        ([26.7, 19.1, 36.6], [26.78, 19.4, 36.4]),
    ],
    ids=["start is nearly the goal", "passive joints apart"],
)
@pytest.mark.parametrize("method", LAWS)
def test_a_free_travel_turns_back(
    unlimited: planner.Problem, method: str, start: list[float], goal: list[float]
) -> None:
    turned = {"start.theta_deg": start, "goal.theta_deg": goal, "goal.travel": "free"}
    problem = unlimited.changed({**turned, "goal.duration": 40.0})
    plan = planner.solve(problem, method)
    assert plan.verified
    assert plan.problem == problem
    assert np.ptp(np.sign(plan.u(np.linspace(0, 40, 801))[:, 0])) == 2  # out and back


def test_a_sinusoid_is_not_bound_to_the_window(unlimited: planner.Problem) -> None:
    """Within the window of one-way motions this law leaves the chart at every travel tried."""
    ends = {
        "start.theta_deg": [25.0, 17.0, 10.0],
        "goal.theta_deg": [29.0, 17.3, 10.6],
        "goal.travel": "free",
    }
    problem = unlimited.changed(ends)
    plan = planner.solve(problem, "sinusoid")
    window = planner.travel_window(problem)
    assert window is not None
    assert not window.empty
    assert plan.verified
    assert plan.travel not in window


def test_free_duration(paper: planner.Problem) -> None:
    """Points are found as shares of a duration that follows from the limits."""
    problem = paper.changed({"goal.duration": "free", "goal.travel": 0.83286})
    plan = planner.solve(problem, "polynomial", points="auto")
    assert np.max(_peaks(plan)) == pytest.approx(0.5, rel=1e-6)
    assert plan.duration == pytest.approx(3.4998, abs=2e-3)
    for t, value in plan.notes["points"]:
        assert plan.z(t)[1] == pytest.approx(value, abs=1e-12)


def test_two_legs(unlimited: planner.Problem) -> None:
    """With travel zero an offset is chosen, and points beside it."""
    start, goal = [40.0, 50.0, 30.0], [40.0, 50.0, 30.4]
    turned = {"start.theta_deg": start, "goal.theta_deg": goal, "goal.travel": 0.0}
    plan = planner.solve(unlimited.changed(turned), "polynomial", points="auto")
    assert plan.verified
    assert plan.z(5.0)[0] - plan.z(0.0)[0] == pytest.approx(plan.notes["offset"])
    assert plan.notes["points"]
    for t, value in plan.notes["points"]:
        assert plan.z(t)[1] == pytest.approx(value, rel=1e-9)


# -- the parts -------------------------------------------------------------------------------------


def test_what_is_worse_in_kind_costs_more() -> None:
    nan = np.nan
    scores = Scores(
        margin=np.array([0.5, 0.5, 0.5, 1e-3, -1e-9, -1.0, nan]),
        slack=np.array([np.inf, 0.1, -0.2, 0.1, nan, nan, nan]),
        peak=np.array([0.1, 1e9, 0.1, 0.1, nan, nan, nan]),
    )
    for criterion in ("peak", "margin"):
        cost = scores.cost(criterion, ends=0.6)
        assert np.all(cost[:2] < 1)
        assert np.all((cost[2:4] > 1) & (cost[2:4] < 2))
        assert 2 < cost[4] < cost[5] < 3
        assert cost[6] == 3
    assert scores.cost("peak", 0.6)[0] < scores.cost("peak", 0.6)[1]


def test_scores_agree_with_the_plan(auto: planner.Plan, paper: planner.Problem) -> None:
    found = score(paper, _curves(auto), samples=8000)
    assert found.margin[0] == pytest.approx(auto.domain.margin, rel=1e-6)
    assert found.peak[0] == pytest.approx(np.max(_peaks(auto)) / 0.5, rel=1e-5)
    sure = np.linspace(0, 10, 20001)
    joints = 1 - np.max(np.abs(auto.q(sure)[:, 1:])) / np.deg2rad(80)
    z2 = (np.min(-auto.z(sure)[:, 1]) - 0.01) / 0.01
    assert found.slack[0] == pytest.approx(min(joints, z2), abs=1e-6)
    assert np.isnan(found.margin[1])
    assert list(found.inside) == [True, False]


def _curves(plan: planner.Plan) -> tuple[Bernstein, Bernstein]:
    """Of two candidates: the plan's, and one that has no solution."""
    assert isinstance(plan.trajectory, ChainedTrajectory)
    z, v = plan.trajectory.z_curve, plan.trajectory.v_curve
    return tuple(Bernstein(np.stack([w.c, np.nan * w.c], axis=2), w.x) for w in (z, v))  # type: ignore[return-value]


def test_search_survives_laws_without_solution(
    auto: planner.Plan, unlimited: planner.Problem
) -> None:
    z, v = _curves(auto)

    def nothing(x: np.ndarray) -> tuple[Bernstein, Bernstein]:
        which = np.ones(len(x), dtype=int)
        return Bernstein(z.c[:, :, which], z.x), Bernstein(v.c[:, :, which], v.x)

    found = search_candidates(unlimited, nothing, np.zeros((3, 1)), np.ones(1))
    assert found.cost == 3
    assert not found.inside


CHART_METHODS = ["polynomial", "piecewise", "sinusoid", "sinusoid_steps", "convex"]


@pytest.mark.parametrize("method", CHART_METHODS)
@pytest.mark.parametrize(
    ("drive", "place"), [("sin(heading)", "x = 0 m, heading = 0 deg"), ("1 - x", "x = 1")]
)
def test_a_place_without_drive_is_named(method: str, drive: str, place: str) -> None:
    """At the start, or on every way to the goal."""
    file = Path(__file__).parents[3] / "problems/custom.toml"
    problem = planner.load_problem(file).changed({"system.drive": drive})
    with pytest.raises(planner.SingularError, match=f"drive is zero .*{place}.*speed") as refusal:
        planner.solve(problem, method)
    assert "collocation" in {change.method for change in refusal.value.changes}
    problem = problem.changed({"system.drive": "(x - 0.7)**2"})  # zero between the samples
    with pytest.raises(planner.NoPlanError) as refusal:
        planner.solve(problem, method)
    assert "mesh" not in str(refusal.value)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_search_follows_a_curved_kink(d: int) -> None:
    """The greatest of several functions, with a valley that bends."""

    def cost(x: np.ndarray) -> np.ndarray:
        aside = np.abs(x[:, 1:] - x[:, :1] ** 2).sum(axis=1)
        return np.abs(x[:, 0] - 1.5) + 3 * aside

    x, least = evolve(cost, np.zeros((2, d)), np.ones((2, d)), 400, 1e-12)
    assert least == pytest.approx(0, abs=1e-6)
    assert x[:, 0] == pytest.approx(1.5, abs=1e-6)


def test_a_choice_leaves_what_the_proof_needs_to_a_limit(paper: planner.Problem) -> None:
    """The travel of least peak would bring an angle to its limit, to rounding."""
    free = planner.solve(paper.changed({"limits": {}}), "polynomial")
    angles = np.abs(free.q(np.linspace(0.0, free.duration, 2001))[:, 1])
    ends = max(angles[0], angles[-1])
    limit = float(np.rad2deg(ends + 0.9 * (np.max(angles) - ends)))
    plan = planner.solve(paper.changed({"limits": {"joint_deg": limit}}), "polynomial")
    assert plan.certificate is not None
    assert plan.certificate.ok, str(plan.certificate)
    assert 9e-7 < plan.certificate["joint theta1"].guaranteed / np.deg2rad(limit) < 1e-4


def test_where_an_end_is_at_its_limit_no_choice_leaves_more(paper: planner.Problem) -> None:
    goal = float(np.max(np.abs(np.rad2deg(paper.goal[1:]))))
    assert end_slack(paper.changed({"limits": {"joint_deg": goal}})) == pytest.approx(0, abs=1e-15)
    assert end_slack(paper) == SLACK
    scores = Scores(np.array([0.6]), np.array([1e-7]), np.array([0.5]))
    assert scores.cost("peak", 0.6, slack=0.0)[0] < 1 <= scores.cost("peak", 0.6, slack=SLACK)[0]
