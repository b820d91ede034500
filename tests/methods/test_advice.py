"""Changes are data: tried in one place, in order, in bounded time, and blamed only with a plan."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import planner
from planner import METHODS, NoPlanError, NotConvergedError, Plan, Problem, TimeLimitError
from planner.methods import refusal as refusals
from planner.methods.laws import polynomial
from planner.methods.refusal import BY_COLLOCATION, Change, advise, duration_changes, path_changes
from planner.support import deadline
from planner.support.deadline import TimeUpError

CHANGES = [Change({"limits.joint_deg": 80.0 + k}, without=f"limit {k}") for k in range(4)]


@pytest.fixture(scope="module")
def plan(paper: Problem) -> Plan:
    return planner.solve(paper)


def refusal(**given: Any) -> NotConvergedError:
    return NotConvergedError("none", changes=CHANGES, advice="luck", **given)


def narrow(paper: Problem) -> Problem:
    """Of which the paper's plan is none: its theta1 reaches 38.7 degrees."""
    return paper.changed({"limits.joint_deg": 35})


def test_the_first_change_that_works_is_named_with_what_the_plan_breaks(
    paper: Problem, plan: Plan
) -> None:
    asked, error = [], refusal()

    def attempt(change: Change) -> Plan:
        asked.append(change)
        if len(asked) < 3:
            raise [NotConvergedError("none"), planner.InputError("no")][len(asked) - 1]
        return plan

    assert advise(error, narrow(paper), attempt, 1.0) is None
    assert asked == CHANGES[:3]
    assert error.reason == "none; without limit 2 there is a plan, which breaks:"
    assert [v.label for v in error.violations] == ["joint theta1"]
    words = "limits.joint_deg = 38.72 or more (tried with limits.joint_deg = 82.0)"
    assert error.advice == words
    assert str(error).endswith(f"Try: {words}")
    assert error.plan is not None
    assert not error.plan.verified


def test_nothing_is_blamed_without_a_verified_plan(paper: Problem, plan: Plan) -> None:
    error = refusal()
    assert advise(error, narrow(paper), lambda _: replace(plan, verified=False), 1.0) is None
    assert error.reason == "none"
    assert "tried without success: limits.joint_deg = 80.0" in str(error.advice)

    def none(change: Change) -> Plan:
        raise NoPlanError("none")

    assert advise(error, narrow(paper), none, 1.0) is None
    vain = "limits.joint_deg = 80.0, limits.joint_deg = 81.0"
    assert str(error.advice).startswith(f"luck; tried without success: {vain}")


def test_a_plan_found_without_a_requirement_that_keeps_it_is_the_answer(
    paper: Problem, plan: Plan
) -> None:
    assert advise(refusal(), paper, lambda _: plan, 1.0) is plan


def test_tries_take_a_few_times_the_work_of_the_refusal(paper: Problem) -> None:
    """Each does all the work that it may, half of what is left."""
    left = []

    def attempt(change: Change) -> Plan:
        left.append(deadline.remaining())
        deadline.spend(left[-1])
        raise TimeUpError

    error = refusal()
    advise(error, paper, attempt, 10.0)
    most = refusals.MOST_TIMES_REFUSAL * 10
    assert left == [most / 2, most / 4, most / 8, most / 16]
    tried = "limits.joint_deg = 80.0, limits.joint_deg = 81.0, limits.joint_deg = 82.0"
    assert str(error.advice).startswith(f"luck; not tried, or not to the end: {tried}")
    assert "larger time limit" not in str(error.advice)


def test_advice_does_not_depend_on_how_fast_the_computer_is(
    paper: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An hour passes between any two looks at the clock, of the wall or of the processor."""
    slow = paper.changed({"goal.duration": 2.9})
    narrow = {"goal.travel": 0.7, "limits.joint_deg": 30}
    cases = [(slow, {}), (paper.changed(narrow), {"start": "straight", "max_iterations": 2})]

    def texts() -> list[str]:
        out = []
        for problem, options in cases:
            with pytest.raises(NoPlanError) as caught:
                planner.solve(problem, **options)  # type: ignore[arg-type]
            out.append(str(caught.value))
        return out

    monkeypatch.setattr(deadline, "DEFAULT_SEARCH_S", 1e9)  # the one limit that is in time
    usual, hours = texts(), count(0, 3600)
    clock = SimpleNamespace(monotonic=lambda: next(hours), process_time=lambda: next(hours))
    monkeypatch.setattr(deadline, "time", clock)
    assert texts() == usual


def test_a_law_is_searched_again_for_a_longer_duration_only_with_points_in_seconds(
    paper: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without them the refused motion, slowed down, is the answer of the law."""
    asked, plan_law = list[float | None](), polynomial.plan_polynomial

    def counted(problem: Problem, options: Any) -> Plan:
        asked.append(problem.duration)
        return plan_law(problem, options)

    monkeypatch.setattr(polynomial, "plan_polynomial", counted)
    quick = paper.changed({"goal.duration": 4.0, "goal.travel": "free"})
    with pytest.raises(NoPlanError) as caught:
        planner.solve(quick, "polynomial")
    assert asked == [4.0]
    advice = re.match(r"goal.duration = ([\d.]+) or more \(tried\)", str(caught.value.advice))
    assert advice is not None
    assert planner.solve(quick.changed({"goal.duration": float(advice[1])}), "polynomial").verified
    asked.clear()
    with pytest.raises(NoPlanError):
        planner.solve(quick, "polynomial", points=[[1.5, -0.2]])
    assert asked == [4.0, pytest.approx(18.89)]


def test_tries_end_with_the_time_limit_given(paper: Problem) -> None:
    asked = []

    def attempt(change: Change) -> Plan:
        asked.append(change)
        deadline._span.get().enclosing.enclosing.end = 0.0  # type: ignore[union-attr]
        raise TimeLimitError("over")

    error = refusal()
    with deadline.time_limit(1000.0):
        advise(error, paper, attempt, 1.0)
    assert asked == CHANGES[:1]
    assert str(error.advice).startswith("a larger time limit")
    tried = "limits.joint_deg = 80.0, limits.joint_deg = 81.0"
    assert f"not tried, or not to the end: {tried}" in str(error)


def test_what_is_in_the_way_is_named_and_never_left_out() -> None:
    """By a method that knows no obstacles, before and after changes are tried, and by `check`."""
    problem = planner.load_problem(Path(__file__).parents[2] / "problems/obstacle.toml")
    with pytest.raises(NoPlanError) as caught:
        planner.solve(problem, "convex")
    assert str(caught.value.advice).startswith("obstacle 1 elsewhere")
    without = [change for change in path_changes(problem) if change.solid]
    assert [change.keys for change in without] == [{"obstacles": []}]
    assert NotConvergedError("none", changes=without, advice="luck").advice == "luck"
    found = planner.check(problem, ["convex"])
    assert found.remedy is None
    assert "Without the obstacles the method 'convex' has a plan, in which clearance of link" in (
        found.verdict
    )
    assert found.to_dict()["in_the_way"] == found.in_the_way


def test_bodies_are_taken_away_last_and_only_to_tell_what_is_in_the_way(
    paper: Problem, plan: Plan
) -> None:
    post = {"obstacles": [{"centre_m": [2.2, 1.0], "radius_m": 0.2}]}
    links = {"system": {**paper.to_dict()["system"], "link_lengths": [1.0, 1.0, 1.0]}}
    problem = paper.changed({**post, **links})
    shown = replace(plan, problem=problem)
    assert [v.value < 0 for v in planner.verify(shown).violations] == [True]
    asked, bodies = [], Change({"obstacles": []}, "", "the obstacles", solid=True)

    def attempt(change: Change) -> Plan:
        asked.append(change)
        if change is bodies:
            return replace(plan, problem=problem)
        raise NoPlanError("none")

    error = NotConvergedError("none", changes=[bodies, CHANGES[0]], advice="luck")
    assert advise(error, problem, attempt, 1.0) is None
    assert asked == [CHANGES[0], bodies]
    assert error.advice == "luck; or obstacle 1 elsewhere"
    assert error.reason == "none; without the obstacles there is a plan, which breaks:"


def test_other_methods_are_named_and_not_called(
    paper: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def called(*_: object) -> Plan:
        raise AssertionError

    monkeypatch.setitem(METHODS, "collocation", replace(METHODS["collocation"], plan=called))
    with pytest.raises(planner.InfeasibleError) as caught:
        planner.solve(paper.changed({"goal.travel": 0.0}), "convex")
    assert caught.value.changes == (BY_COLLOCATION,)
    assert caught.value.advice == str(BY_COLLOCATION)


@pytest.mark.parametrize(
    ("changes", "method", "words"),
    [
        ({"goal.travel": 0.787, "limits.z2_margin": 0.01}, "convex", "goal.travel = 0."),
        ({"goal.travel": 0.82}, "polynomial", "goal.duration = "),
        ({"goal.duration": 2.9}, "collocation", "goal.duration = 3.1"),
    ],
)
def test_every_method_s_changes_are_tried(
    paper: Problem, changes: dict[str, Any], method: str, words: str
) -> None:
    with pytest.raises(NoPlanError) as caught:
        planner.solve(paper.changed(changes), method)
    first = str(caught.value.advice).split(" (tried)")[0]
    assert first.startswith(words)
    value = float(first.split(" = ")[1].split()[0])
    key = first.split(" = ")[0]
    assert planner.solve(paper.changed({**changes, key: value}), method).verified


def test_every_change_of_a_problem_is_one(paper: Problem) -> None:
    """Each can be made, and is in the file's own keys, for every kind of system."""
    problem = paper.changed(
        {
            "goal.travel": 0.8,
            "limits": {"z2_margin": 0.01, "joint_deg": 60, "input_rad_s": 0.5},
            "obstacles": [{"centre_m": [10.0, 0.0], "radius_m": 0.1}],
            "waypoints": [{"theta_deg": ["free", 10.0, "free"]}],
        }
    )
    changes = [*duration_changes(problem), *path_changes(problem)]
    changed = [problem.changed(change.keys) for change in changes]
    assert [each.duration for each in changed] == [None, 10.0, None, *[10.0] * 4]
    assert [each.travel for each in changed[:3]] == [0.8, None, None]
    assert not changed[3].obstacles
    assert not changed[4].waypoints
    assert changed[5].limits.z2_margin is None
    assert changed[6].limits.joint[1] > problem.limits.joint[1]
    for change in changes:
        assert str(change)
