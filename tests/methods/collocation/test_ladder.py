"""Paths by way of shorter arms: motions that obey the kinematics and every limit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner import NotConvergedError, TriangularSystem
from planner.methods.collocation import pipeline
from planner.methods.collocation.best import Candidate, Exactness, polish
from planner.methods.collocation.between_nodes import inspect
from planner.methods.collocation.long_arms import ladder
from planner.methods.collocation.long_arms.bridges import ChainEnds, PieceChain
from planner.methods.collocation.long_arms.bridges import ends_of as ends
from planner.methods.collocation.long_arms.exact_motion import exact_motion, has_only_limits
from planner.methods.collocation.long_arms.ladder import find_arm_path, time_arm_path
from planner.methods.collocation.pipeline import collocation_task
from planner.methods.collocation.task import Solution, Task
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.tables.method_options import CollocationOptions

PROBLEM = planner.Problem.manipulator(
    [10, -20, 30], [-40, 50, -10], travel=0.0, duration=None, input_rad_s=0.5, joint_deg=80
)


@pytest.fixture
def no_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "seeds", lambda *_, **__: [])


@pytest.fixture(scope="module")
def chain() -> PieceChain:
    """A path of the arm."""
    found = ladder.lift_shorter_path(collocation_task(PROBLEM, CollocationOptions(), 40))
    assert found is not None
    return found[0]


def test_what_is_climbed_is_a_motion_within_the_limits() -> None:
    job = collocation_task(PROBLEM, CollocationOptions(), 40)
    path = find_arm_path(job)
    assert path is not None
    found = time_arm_path(job, path[0])
    assert found is not None
    solution = found[1]
    assert solution.ok
    assert solution.residual < 1e-7
    assert np.max(np.abs(solution.iterate.inputs)) <= 0.5 + 1e-9
    assert solution.iterate.nodes[-1] == pytest.approx([0.0, *np.deg2rad([-40.0, 50.0, -10.0])])


@pytest.mark.usefixtures("no_guesses")
def test_a_plan_grows_from_a_shorter_arm_where_guesses_fail() -> None:
    plan = planner.solve(PROBLEM, "collocation")
    assert plan.notes["start"] == "lifted from 2 joints"
    assert plan.notes["stage"] == "ladder"
    assert planner.verify(plan).ok


def test_a_motion_that_turns_out_to_be_none_gives_way_to_a_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    climbs: list[Task] = []

    def climbing(job: Task) -> tuple[PieceChain, int] | None:
        climbs.append(job)
        return find_arm_path(job)

    def doubted(*given: Any) -> Candidate:
        done = polish(*given)
        return done if climbs else replace(done, checked=Exactness.SOLVED)

    monkeypatch.setattr(pipeline, "find_arm_path", climbing)
    monkeypatch.setattr(pipeline, "polish", doubted)
    plan = planner.solve(PROBLEM, "collocation", attempts=4)
    assert plan.notes["start"] == "lifted from 2 joints"
    assert any(each.get("objective") for each in plan.notes["tried"][:-1])
    assert planner.verify(plan).ok
    as_given = planner.solve(PROBLEM, "collocation", start="straight", intervals=60)
    assert as_given.notes["start"] == "straight"


def test_a_kept_path_errs_less_than_its_own_steps_show(chain: PieceChain) -> None:
    """Were it made exact in the very steps by which it is judged, any error would pass for none."""
    job = collocation_task(PROBLEM, CollocationOptions(), 40)
    found = exact_motion(job, chain, 5e-6)
    assert found is not None
    own, solution = found
    times, q = own.mesh.edges * solution.iterate.duration, PROBLEM.start
    fine = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    for k, u in enumerate(solution.iterate.inputs):
        span = times[k], times[k + 1]
        q = solve_ivp(lambda _, y, u=u: PROBLEM.system.rates(y, u), span, q, **fine).y[:, -1]
    true = np.max(np.abs(q - solution.iterate.nodes[-1]))
    assert true < inspect(own, solution).end_error < 5e-6


@pytest.mark.usefixtures("no_guesses")
def test_the_fastest_of_a_kept_path_is_told_where_the_duration_is_too_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ladder, "MOST_SOLVED_INTERVALS", 10)
    with pytest.raises(NotConvergedError) as caught:
        planner.solve(PROBLEM.changed({"goal.duration": 8.0}), "collocation")
    assert caught.value.changes[0].keys["goal.duration"] > 8.0


@pytest.mark.parametrize(
    ("start", "goal", "limit", "travel"),
    [
        ([30.0, -40.0, 20.0, -30.0, 10.0], [-40.0, 50.0, -20.0, 30.0, -15.0], 80.0, 0.0),
        # the path of the shorter arm runs along its limits; what joint 1 adds needs room there
        ([4.6, -27.8, 34.2, -30.3], [-7.4, 12.2, 29.5, -3.1], 40.0, "free"),
    ],
)
def test_long_arms_climb_by_several_joints_within_their_limits(
    start: list[float], goal: list[float], limit: float, travel: float | str
) -> None:
    n, K = len(start), [0.87, 0.71, 0.58, 0.48][: len(start) - 1]
    arm = {"kind": "manipulator", "joints": n, "K": K, "k_g": 0.67}
    asked = {"goal.theta_deg": goal, "goal.travel": travel, "limits.joint_deg": limit}
    problem = PROBLEM.changed({"system": arm, "start.theta_deg": start, **asked})
    found = ladder.lift_shorter_path(collocation_task(problem, CollocationOptions(), 40))
    assert found is not None
    assert found[1] in (n - 2, n - 1)
    q, u = found[0].q, found[0].u
    end = np.where(np.isnan(problem.goal), q[-1], problem.goal)
    assert q[[0, -1]] == pytest.approx(np.stack([problem.start, end]), abs=1e-9)
    assert np.max(np.abs(q[:, 1:])) <= np.deg2rad(limit) + 1e-9
    assert ends(problem.system, q[:-1], u) == pytest.approx(q[1:], abs=2e-6)


def test_what_is_no_arm_has_no_shorter_one() -> None:
    car = planner.load_problem(Path(__file__).parents[3] / "problems" / "car.toml")
    assert find_arm_path(collocation_task(car, CollocationOptions(), 40)) is None


@pytest.mark.usefixtures("no_guesses")
def test_a_path_too_long_for_the_solver_is_kept_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ladder, "MOST_SOLVED_INTERVALS", 10)
    plan = planner.solve(PROBLEM, "collocation")
    assert plan.notes["tried"][-1]["status"] == "a motion, not the best"
    assert planner.verify(plan).ok


def test_a_mesh_too_fine_for_the_solver_leaves_the_path_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solve = Task.solve

    def fails_when_near(task: Task, start: Iterate, near: bool = False) -> Solution:
        solution = solve(task, start, near)
        return replace(solution, ok=False) if near else solution

    monkeypatch.setattr(Task, "solve", fails_when_near)
    coarse = planner.solve(PROBLEM, "collocation", intervals=20)
    assert len(coarse.notes["intervals"]) == 2
    assert planner.verify(coarse).ok


def test_a_path_is_not_kept_where_more_is_asked_than_limits() -> None:
    job = collocation_task(PROBLEM, CollocationOptions(), 40)
    assert has_only_limits(job)
    assert not has_only_limits(collocation_task(PROBLEM, CollocationOptions(rest=True), 40))
    for limit in ({"z2_margin": 0.01}, {"input_rate": np.ones(2)}):
        asked = replace(PROBLEM, limits=replace(PROBLEM.limits, **limit))
        assert not has_only_limits(collocation_task(asked, CollocationOptions(), 40))


def test_a_path_too_slow_for_the_duration_is_not_kept(chain: PieceChain) -> None:
    job = collocation_task(PROBLEM, CollocationOptions(), 40)
    found = exact_motion(job, chain, 5e-6)
    assert found is not None
    shortest = found[1].iterate.duration
    for wanted, fits in ((0.9 * shortest, False), (1.5 * shortest, True)):
        timed = collocation_task(
            PROBLEM.changed({"goal.duration": wanted}), CollocationOptions(), 40
        )
        assert (exact_motion(timed, chain, 5e-6) is not None) == fits


@pytest.mark.parametrize(("share", "asked"), [(0.0, 1), (0.4, len(ladder.LARGEST_GAPS))])
def test_smaller_gaps_are_asked_for_only_where_some_of_them_are_closed(
    share: float, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    gaps, inner = [], ladder.close_gaps

    def closed(
        system: TriangularSystem, path: PieceChain, ends: ChainEnds
    ) -> tuple[PieceChain | None, float]:
        return inner(system, path, ends) if system.size == 3 else (None, share)

    def lifted(*given: Any) -> PieceChain:
        gaps.append(given[-1])
        return inner_lift(*given)

    inner_lift = ladder.lift
    monkeypatch.setattr(ladder, "close_gaps", closed)
    monkeypatch.setattr(ladder, "lift", lifted)
    assert ladder.lift_shorter_path(collocation_task(PROBLEM, CollocationOptions(), 40)) is None
    assert len(gaps) == asked
