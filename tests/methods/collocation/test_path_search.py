"""How many starts a search tries."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import planner
from planner.methods.collocation import best, path, pipeline, task
from planner.methods.collocation.best import Candidate, Exactness, Record
from planner.methods.collocation.guesses import seeds
from planner.methods.collocation.path import Enough, Paths, SeedPath, search
from planner.methods.collocation.pipeline import Pipeline
from planner.methods.collocation.solvers import Settings
from planner.methods.collocation.task import Solution
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress
from planner.support.progress import Progress

PROBLEMS = Path(__file__).parents[3] / "problems"


def _problem(start: list[float], goal: list[float]) -> planner.Problem:
    return planner.Problem.manipulator(
        start, goal, duration=None, K=[0.87, 0.71], k_g=0.67, input_rad_s=0.5, joint_deg=80
    )


ONE_WAY = _problem([1.0, 1.0, 1.0], [30.0, 30.0, 30.0])
TURNS = _problem([20.0, 40.0, -30.0], [-30.0, 20.0, 10.0])


def test_a_path_whose_drive_never_turns_back_ends_the_search() -> None:
    plan = planner.solve(ONE_WAY, "collocation")
    assert len(plan.notes["tried"]) == 1
    assert plan.u(plan.t)[:, 0].min() >= -1e-6


def test_where_the_drive_turns_back_more_starts_are_tried() -> None:
    plan = planner.solve(TURNS, "collocation", starts=4)
    solved = [entry for entry in plan.notes["tried"] if entry["path_effort"] is not None]
    assert len(solved) == 4
    objectives = {e["start"]: e["objective"] for e in solved if e.get("objective")}
    assert objectives[plan.notes["start"]] == min(objectives.values())


def test_a_search_among_random_starts_does_not_end_early() -> None:
    plan = planner.solve(ONE_WAY, "collocation", start="wander", starts=5, attempts=5)
    assert len(plan.notes["tried"]) == 5


def test_paths_that_differ_are_counted_once() -> None:
    efforts: list[Any] = [SimpleNamespace(objective=effort) for effort in (3.0, 1.0, 2.0, 3.0, 2.0)]
    found = Paths(tuple(SeedPath(str(k), effort, True) for k, effort in enumerate(efforts)))
    assert [path.seed for path in found.distinct] == ["1", "2", "0"]


def test_of_the_loops_only_the_shortest_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    guesses, loops = [9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0], [2.5, 1.5, 0.9, 2.7, 0.8]
    efforts = itertools.chain(guesses, loops, itertools.repeat(1.7))
    free: Any = SimpleNamespace(curve=lambda iterate: None)

    def found(job: Any, free: Any, seed: Any, *_: Any) -> SeedPath:
        no_iterate: Any = None
        return SeedPath(seed.name, Solution(no_iterate, next(efforts), 0.0, True, "", 0), True)

    for name, stub in (("path_task", lambda job: free), ("_try", found)):
        monkeypatch.setattr(path, name, stub)
    monkeypatch.setattr(path, "path_intervals", lambda *_: 20)
    monkeypatch.setattr(path, "MOST_FAILURES", 3)
    job: Any = SimpleNamespace(problem=SimpleNamespace(system=SimpleNamespace(size=5)))
    paths = search(job, seeds("auto", 9), Enough(9, simple=True))
    assert [each.solution.objective for each in paths.solved] == [*guesses, 0.8]
    assert len(paths.log) == len(guesses) + len(loops) + 3
    assert paths.distinct[0].seed.endswith(", moved")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Enough]:
    """The rules that searches of a route's paths are given; they find nothing."""
    rules: list[Enough] = []

    def nothing(job: Any, guesses: Any, enough: Enough, *_: Any) -> Paths:
        rules.append(enough)
        return Paths()

    monkeypatch.setattr(pipeline, "search", nothing)
    monkeypatch.setattr(pipeline.RoutePaths, "of", lambda *_: None)
    return rules


def _find_paths(
    monkeypatch: pytest.MonkeyPatch, run: Pipeline, proof: str | None, ladder: bool
) -> None:
    monkeypatch.setattr(pipeline, "why_too_short", lambda _: proof)
    monkeypatch.setattr(pipeline, "has_ladder", lambda _: ladder)
    job: Any = SimpleNamespace(mesh=SimpleNamespace(marks=()))
    run._find_paths(0, job)


@pytest.mark.parametrize(
    ("branches", "proof", "enough"),
    [(1, None, 7), (2, None, 4), (3, None, 3), (9, None, 1), (1, "too short", 1)],
)
def test_branches_of_a_goal_share_the_starts_and_a_proven_refusal_needs_one(
    monkeypatch: pytest.MonkeyPatch,
    asked: list[Enough],
    branches: int,
    proof: str | None,
    enough: int,
) -> None:
    goal: Any = SimpleNamespace(free=(2,), divided=False, system=None, obstacles=())
    options = CollocationOptions(starts=7, attempts=9)
    _find_paths(monkeypatch, Pipeline([goal] * branches, options, Record(1e-6)), proof, False)
    assert [each.clear for each in asked] == [enough]


@pytest.mark.parametrize(
    ("start", "ladder", "proof", "rule"),
    [
        ("auto", True, None, "best"),
        ("auto", True, "too short", "soon"),
        ("auto", False, None, None),
        ("auto", False, "too short", None),
        ("wander", True, None, None),  # the ladder serves no start that is given
    ],
)
def test_a_search_is_told_how_long_a_path_may_be_where_a_ladder_can_find_another(
    monkeypatch: pytest.MonkeyPatch,
    asked: list[Enough],
    start: Any,
    ladder: bool,
    proof: str | None,
    rule: str | None,
) -> None:
    longest = math.inf if rule is None else pipeline.LADDER_INTERVALS[rule]
    refined: list[float] = []
    monkeypatch.setattr(pipeline.RoutePaths, "of", lambda *given: refined.append(given[3]))
    goal: Any = SimpleNamespace(free=(), divided=False, system=None, obstacles=())
    run = Pipeline([goal], CollocationOptions(start=start), Record(1e-6))
    _find_paths(monkeypatch, run, proof, ladder)
    assert [each.longest for each in asked] == refined == [longest]


@pytest.mark.parametrize(("ways", "guesses"), [(0, 9), (1, 4), (2, 4)])
def test_beside_paths_found_leg_by_leg_half_of_the_guesses_are_tried(
    monkeypatch: pytest.MonkeyPatch, ways: int, guesses: int
) -> None:
    asked: list[int] = []
    origin, free = SimpleNamespace(seed="", stage=""), SimpleNamespace(mesh=None)
    legs = [SimpleNamespace(free=free, solution=None, origin=origin)] * ways
    monkeypatch.setattr(pipeline, "seeds", lambda _, count, *__: asked.append(count))
    monkeypatch.setattr(pipeline, "search", lambda *_: Paths())
    monkeypatch.setattr(pipeline, "why_too_short", lambda _: None)
    monkeypatch.setattr(pipeline, "paths_of_legs", lambda _: iter(legs))
    monkeypatch.setattr(pipeline, "at_constant_speed", lambda *_: None)
    monkeypatch.setattr(pipeline.RoutePaths, "of", lambda *given: asked.append(len(given[4])))
    monkeypatch.setattr(pipeline, "has_ladder", lambda _: False)
    goal: Any = SimpleNamespace(free=(), divided=False, system=None, obstacles=(1,), waypoints=())
    job: Any = SimpleNamespace(mesh=SimpleNamespace(marks=()), on_mesh=lambda _: None)
    Pipeline([goal], CollocationOptions(attempts=9), Record(1e-6))._find_paths(0, job)
    assert asked == [guesses, ways]


@pytest.mark.parametrize(
    ("free", "timed"), [((2,), [1.0, 2.0, 3.0]), ((), [1.0, 2.0, 1.0 + 1e-8, 3.0])]
)
def test_a_path_to_which_two_branches_of_a_goal_lead_is_timed_once(
    monkeypatch: pytest.MonkeyPatch, free: tuple[int, ...], timed: list[float]
) -> None:
    """Paths through waypoints in another order are others, if as long."""
    no_iterate: Any = None
    mesh, system = SimpleNamespace(marks=()), SimpleNamespace(has_user_coordinates=True, size=4)
    job: Any = SimpleNamespace(objective=SimpleNamespace(kind="effort"), requirements=[], mesh=mesh)
    asked: list[float] = []

    def paths(*efforts: float) -> Any:
        found = [Solution(no_iterate, effort, 0.0, True, "", 0) for effort in efforts]
        starts = [(SeedPath("", one, True), job, one) for one in found]
        return SimpleNamespace(search=Paths(), starts=lambda *_: starts)

    def motion(job: Any, start: Any) -> Solution:
        asked.append(start.objective)
        return start

    monkeypatch.setattr(pipeline, "solve_timing", motion)
    monkeypatch.setattr(pipeline, "collocation_task", lambda *_: job)
    goal: Any = SimpleNamespace(free=free, divided=False, system=system)
    found = {0: paths(1.0, 2.0), 1: paths(1.0 + 1e-8, 3.0)}
    run = Pipeline([goal, goal], CollocationOptions(), Record(1e-6), paths=found)
    with progress.progress_listener(None):
        motions = run._path_motions()
    assert asked == [each.solution.objective for each in motions] == timed


def test_paths_are_timed_on_a_mesh_that_is_given() -> None:
    given: Any = {"start": "wander", "starts": 1, "intervals": 30, "refinements": 0}
    assert len(planner.solve(ONE_WAY, "collocation", **given).t) == 31


def test_where_time_is_short_the_best_exact_motion_is_held(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One is made as soon as there is a path; else there is time for it at the end."""
    job: Any = SimpleNamespace(objective=SimpleNamespace(kind="effort"), requirements=[])
    no_iterate: Any = None

    def solution(objective: float) -> Solution:
        return Solution(no_iterate, objective, 0.0, True, "", 0)

    made, kept = iter([2.0, 3.0, 1.0]), Record(1e-6)
    monkeypatch.setattr(best, "has_only_limits", lambda _: True)
    monkeypatch.setattr(best, "chain_of", lambda *_: None)
    monkeypatch.setattr(best, "exact_motion", lambda *_: (job, solution(next(made))))

    def held() -> float | None:
        exact = kept.candidates.get(Exactness.EXACT)
        return exact and exact.solution.objective

    with deadline.time_limit(100.0):
        kept.take(Candidate(job, solution(0.9)))
    assert held() is None
    with deadline.time_limit(20.0):
        kept.take(Candidate(job, solution(0.8)))
    assert held() == 2.0
    kept.make_exact()
    assert held() == 2.0
    kept.make_exact()
    assert held() == 1.0


def test_a_search_leaves_fatrop_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    backend = task.backend

    def noted(made: Any, settings: Settings) -> Any:
        asked.append(settings.solver)
        return backend(made, settings)

    monkeypatch.setattr(task, "backend", noted)
    planner.solve(TURNS, "collocation", starts=2)
    assert "ipopt" in asked
    assert "fatrop" not in asked
    asked.clear()
    planner.solve(TURNS, "collocation", starts=2, solver="fatrop")
    assert set(asked) == {"fatrop"}


def test_a_motion_in_hand_gives_way_to_a_better_one_alone() -> None:
    problem = planner.load_problem(PROBLEMS / "crossing.toml", {"goal.duration": "free"})
    told: list[Progress] = []
    plan = planner.solve(problem, progress=told.append)
    held = list(dict.fromkeys(float(each.best.split()[-1]) for each in told if each.best))
    assert len(held) > 1
    assert held == sorted(held, reverse=True)
    assert plan.objective <= held[-1] * (1 + 1e-3)  # told with four digits


@pytest.mark.parametrize(("held", "delivered"), [(1.0, 1.0), (1.9999, 2.0), (3.0, 2.0)])
def test_nothing_worse_is_delivered_than_was_held(
    monkeypatch: pytest.MonkeyPatch, held: float, delivered: float
) -> None:
    """What a stage has on the way is refined too, if it saves more than a thousandth."""
    job: Any = SimpleNamespace(objective=SimpleNamespace(kind="effort"), requirements=[])
    no_iterate: Any = None

    def motion(objective: float) -> Candidate:
        return Candidate(
            job, Solution(no_iterate, objective, 0.0, True, "", 0), "straight", "guesses"
        )

    routes: Any = [SimpleNamespace()]
    search = Pipeline(routes, CollocationOptions(), Record(1e-6))

    def on_the_way() -> list[Candidate]:
        search.record.take(motion(held))
        return []

    answers = [motion(2.0), motion(2.5)]
    stages = on_the_way, lambda: [search.record.take(each) for each in answers]
    monkeypatch.setattr(Pipeline, "_stages", lambda _: iter(stages))
    monkeypatch.setattr(pipeline, "polish", lambda each, *_: replace(each, checked=Exactness.EXACT))
    with progress.progress_listener(None):
        found = search.run()
    assert max(found, key=lambda each: each.rank).solution.objective == delivered
