"""Whoever has a plan of T seconds has every longer one: paths do not know their durations."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import planner
from planner.methods.collocation import best, machine_end, pipeline, route_paths
from planner.methods.collocation.between_nodes import inspect
from planner.methods.collocation.guesses import seeds
from planner.methods.collocation.long_arms.bridges import PieceChain, cut_finer, ends_of
from planner.methods.collocation.path import (
    Enough,
    clock,
    needed_duration,
    path_intervals,
    path_task,
    refine_path,
    search,
)
from planner.methods.collocation.pipeline import collocation_task
from planner.methods.collocation.task import Solution, Task, stretch_to, transfer
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline

OPTIONS = CollocationOptions()
ARM = planner.Problem.manipulator(
    [30, -20, 10], [-25, 30, -15], duration=None, input_rad_s=[0.5, 0.4], joint_deg=40
)


@pytest.fixture(scope="module")
def fastest() -> planner.Plan:
    return planner.solve(ARM, "collocation")


@pytest.fixture(scope="module")
def job() -> Task:
    return collocation_task(ARM, OPTIONS, 40)


@pytest.fixture(scope="module")
def found(job: Task) -> Any:
    """What six guesses lead to."""
    return search(job, seeds("auto", 6), Enough(6))


def test_the_same_guesses_find_the_same_paths_whatever_the_duration_is() -> None:
    problems = [ARM, *(ARM.changed({"goal.duration": T}) for T in (20.0, 200.0))]
    jobs = [collocation_task(problem, OPTIONS, 40) for problem in problems]
    kept: list[list[Solution]] = [[] for _ in jobs]
    ends = [
        search(job, seeds("auto", 2), Enough(2), lambda _, motion, name, to=to: to.append(motion))
        for job, to in zip(jobs, kept, strict=True)
    ]
    assert ends[0].log == ends[1].log == ends[2].log
    needed = needed_duration(ARM, jobs[0].mesh, ends[0].solved[-1].solution.iterate)
    assert 20 < needed < 200
    held = [motions[-1].iterate.duration if motions else None for motions in kept]
    assert held == [pytest.approx(needed), None, 200.0]


@pytest.mark.parametrize(
    "share",
    [
        pytest.param(1.0, marks=pytest.mark.campaign),
        1.02,
        pytest.param(3.0, marks=pytest.mark.campaign),
    ],
)
def test_a_duration_that_the_fastest_motion_keeps_has_a_plan(
    fastest: planner.Plan, share: float
) -> None:
    problem = ARM.changed({"goal.duration": fastest.duration * share})
    plan = planner.solve(problem, "collocation")
    assert plan.verified
    assert plan.duration == pytest.approx(fastest.duration * share)


def test_a_plan_is_held_as_slowly_as_is_asked_for(fastest: planner.Plan) -> None:
    """Its effort falls with the duration; what comes back is no worse."""
    T = fastest.duration
    slower = planner.solve(ARM.changed({"goal.duration": 1.02 * T}), "collocation", warm=fastest)
    assert slower.verified
    assert slower.objective <= fastest.effort / 1.02 * (1 + 1e-6)


def test_a_refined_path_keeps_between_its_nodes_what_a_coarse_one_leaves(
    job: Task, found: Any
) -> None:
    free = path_task(job)
    coarse = [inspect(free, path.solution) for path in found.distinct]
    left = [float(inspection.excess.max()) for inspection in coarse]
    worst = int(np.argmax(left))
    refined = refine_path(free, found.distinct[worst].solution)
    assert refined is not None
    inspection = inspect(*refined)
    assert left[worst] > 0.05  # rad, of 0.7
    assert inspection.excess.max() < left[worst] / 5


def test_a_path_that_is_its_true_motion_is_refined_no_further() -> None:
    problem = planner.Problem.manipulator([1, 1, 1], [30, 30, 30], duration=None, joint_deg=80)
    job = collocation_task(problem, OPTIONS, 40)
    found = search(job, seeds("straight"), Enough(1))
    free, solution = path_task(job), found.solved[0].solution
    assert refine_path(free, solution) == (free, solution)


def test_a_path_wants_intervals_by_how_far_its_inputs_turn(job: Task, found: Any) -> None:
    """Where joints have 40 degrees a quarter of a radian each; by 20, so that paths share them."""
    turned, path = 30.5, found.distinct[0].solution.iterate
    inputs = np.tile([turned / path.duration, 0.0], (len(path.inputs), 1))
    count = path_intervals(path_task(job), replace(path, inputs=inputs))
    assert count % 20 == 0
    assert turned / count <= 0.25 < turned / (count - 20)


@pytest.mark.parametrize(("intervals", "most"), [(150, 1), (60, 3)])
def test_long_paths_that_cannot_be_refined_are_given_up_soon(
    job: Task, found: Any, monkeypatch: pytest.MonkeyPatch, intervals: int, most: int
) -> None:
    tries: list[Any] = []
    monkeypatch.setattr(route_paths, "path_intervals", lambda *_: intervals)
    monkeypatch.setattr(route_paths, "refine_path", lambda *path: tries.append(path))
    assert route_paths.RoutePaths.of(job, found, mesh_given=False).refined == []
    assert len(found.distinct) > most == len(tries)


@pytest.mark.parametrize(("most", "tried"), [(80, False), (220, True)])
def test_a_path_that_the_ladder_replaces_is_not_refined(
    job: Task, found: Any, monkeypatch: pytest.MonkeyPatch, most: int, tried: bool
) -> None:
    tries: list[Any] = []
    monkeypatch.setattr(route_paths, "path_intervals", lambda *_: 100)
    monkeypatch.setattr(route_paths, "refine_path", lambda *path: tries.append(path))
    route_paths.RoutePaths.of(job, found, False, most)
    assert bool(tries) == tried


def test_a_search_ends_after_five_paths_that_the_ladder_replaces() -> None:
    problem = planner.Problem.manipulator(
        [20, -30, 30, -20], [-30, 20, -10, 30], duration=None, joint_deg=40
    )
    job = collocation_task(problem, OPTIONS, 40)
    found = search(job, seeds("auto", 16), Enough(9, simple=True, longest=40))
    assert len(found.solved) == 5


def test_by_its_clock_an_input_of_a_path_is_at_its_limit_all_the_time(
    job: Task, found: Any
) -> None:
    refined = refine_path(path_task(job), found.distinct[0].solution)
    assert refined is not None
    free, solution = refined
    own, motion = clock(job, free, solution.iterate)
    share = np.max(np.abs(motion.inputs) / ARM.limits.input, axis=1)
    assert share.max() <= 1 + 1e-9
    assert np.median(share) > 0.99
    assert np.diff(own.mesh.edges) == pytest.approx(1 / len(own.mesh.widths))
    assert len(own.mesh.widths) >= max(100, 1.5 * len(free.mesh.widths))
    assert motion.nodes[0, : ARM.system.size] == pytest.approx(ARM.start, abs=1e-9)
    # At the path's own constant speed the whole would wait for its steepest place.
    rates = np.abs(solution.iterate.inputs) / ARM.limits.input
    assert motion.duration < solution.iterate.duration * rates.max()


@pytest.mark.parametrize("rate", [0.3, 0.01])
def test_a_path_run_as_fast_as_its_limits_let_it_is_at_one_of_them(
    job: Task, found: Any, rate: float
) -> None:
    problem = ARM.changed({"limits.input_rate_rad_s2": rate})
    own = collocation_task(problem, OPTIONS, 40)
    path = transfer(path_task(job), found.distinct[0].solution.iterate, own)
    motion = stretch_to(path, needed_duration(problem, own.mesh, path))
    left, right = motion.input_ends()
    rates = (right - left) / (own.mesh.widths * motion.duration)[:, None]
    shares = np.abs(left) / ARM.limits.input, np.abs(right) / ARM.limits.input, np.abs(rates) / rate
    assert max(float(share.max()) for share in shares) == pytest.approx(1.0)


def test_all_pieces_of_a_path_are_halved_where_little_turns_in_them() -> None:
    system, u = ARM.system, np.tile([[0.05, 0.01]], (4, 1))
    q = np.empty((5, system.size))
    q[0] = ARM.start
    for k in range(4):
        q[k + 1] = ends_of(system, q[k][None], u[k][None])[0]
    halved = cut_finer(
        system, PieceChain(q, u, np.zeros((4, system.size))), [1, 2, 3], 0.4, least=2
    )
    assert len(halved.u) == 8
    assert halved.u.sum(axis=0) == pytest.approx(u.sum(axis=0))
    assert np.abs(halved.gap).max() < 1e-7


@pytest.mark.parametrize(
    ("fastest_s", "wanted_s", "found"),
    [
        (10.0, 20.0, [True, False]),
        (10.0, 10.0, [True, False]),
        (0.1, 0.101, [True, False]),
        (10.0, 9.6, [False]),
        (10.0, 9.0, []),
    ],
)
def test_the_fastest_motion_is_slowed_down_as_it_is_where_no_solver_betters_it(
    monkeypatch: pytest.MonkeyPatch, fastest_s: float, wanted_s: float, found: list[bool]
) -> None:
    """As it is, and bettered. One a little too slow may become faster; one far too slow is left."""

    def solution(iterate: Iterate, ok: bool) -> Solution:
        return Solution(iterate, 0.0, 0.0, ok, "", 0)

    own: Any = SimpleNamespace(objective=None, for_problem=lambda *_: own)
    own.solve, own.judge = (partial(solution, ok=ok) for ok in (False, True))
    quick = own.judge(Iterate(fastest_s, np.zeros((2, 4)), np.zeros((1, 1, 4)), np.ones((1, 2))))
    motion = best.Candidate(own, quick, "straight", "guesses")
    monkeypatch.setattr(pipeline.Pipeline, "run", lambda _: [motion])
    monkeypatch.setattr(pipeline, "collocation_task", lambda *_: own)
    asked = replace(ARM, duration=wanted_s)
    hasty = pipeline.Pipeline([asked], OPTIONS, best.Record(None))
    slower = [motion.solution for motion in hasty._slower_motions()]
    assert [each.ok for each in slower] == found
    assert all(each.iterate.duration == wanted_s for each in slower)


def test_the_fastest_motion_is_no_answer_where_time_is_up_before_it_is_slowed_down(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(*_: object) -> None:
        raise deadline.time_up()

    monkeypatch.setattr(pipeline, "polish", ended)
    with pytest.raises(planner.TimeLimitError, match="before it had found a motion"):
        planner.solve(paper.changed({"goal.duration": 2.5}), time_limit_s=600)


def test_a_longer_duration_is_tried_with_the_motion_that_was_refused(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One search is enough: whoever has a motion has every slower one."""
    searches, usual = [], machine_end.plan_collocation

    def plan(problem: planner.Problem, options: CollocationOptions) -> planner.Plan:
        searches.append(problem.duration)
        return usual(problem, options)

    monkeypatch.setattr(machine_end, "plan_collocation", plan)
    with pytest.raises(planner.NoPlanError) as caught:
        planner.solve(paper.changed({"goal.duration": 2.5}))
    assert caught.value.has_remedy
    assert 3.1 <= caught.value.changes[0].keys["goal.duration"] < 3.2
    assert searches == [2.5]
