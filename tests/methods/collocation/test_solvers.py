"""Two solvers behind one option: the same optimum, and each the other's fallback."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import planner
from planner import Problem
from planner.methods.collocation import task as module
from planner.methods.collocation.method import plan_collocation
from planner.methods.collocation.solvers import (
    SHORT_CHAIN,
    SOLVERS,
    STRATEGIES,
    Settings,
    SolverAnswer,
    attempts,
    strategy,
)
from planner.methods.collocation.transcription.form import Form
from planner.methods.collocation.transcription.transcription import transcription
from planner.problem.requirements.places import Obstacle
from planner.problem.tables.method_options import CollocationOptions, SolverName

PROBLEMS = Path(__file__).parents[3] / "problems"


@pytest.mark.parametrize(
    ("name", "changes", "options"),
    [
        ("paper", {}, {}),
        ("paper", {"limits.input_rad_s": [0.5, 0.12]}, {}),
        ("paper", {"limits.input_rate_rad_s2": 0.1}, {"rest": True}),
        ("paper", {"goal.duration": "free"}, {"start": "straight"}),
        ("crossing", {}, {"start": "straight"}),
        ("trailers", {}, {"start": "straight"}),
    ],
)
def test_solvers_agree_and_print_nothing(
    name: str, changes: Any, options: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    """On one mesh: one that is refined to settle the objective differs by the rounding it sees."""
    problem = planner.load_problem(PROBLEMS / f"{name}.toml", changes)
    found = {}
    for solver in SOLVERS:
        options = {**options, "solver": solver, "refinements": 0}
        plan = plan_collocation(problem, CollocationOptions(**options))
        found[solver] = plan.objective
        assert planner.verify(plan).ok
        assert capfd.readouterr() == ("", ""), solver
    assert list(found.values()) == pytest.approx([found["ipopt"]] * len(found), rel=1e-6)


@pytest.mark.parametrize("when", ["made", "asked"])
@pytest.mark.parametrize("broken", sorted(SOLVERS))
def test_a_solver_that_raises_has_not_finished(
    broken: SolverName, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other takes over; alone it is a refusal, never a traceback."""

    def fail(*_: Any) -> SolverAnswer:
        raise RuntimeError("Error in Function::call:\n.../nlpsol.cpp:1: out of order")

    inner = module.backend

    def backend(made: Any, settings: Settings) -> Any:
        if settings.solver != broken:
            return inner(made, settings)
        return fail if when == "asked" else fail()

    monkeypatch.setattr(module, "backend", backend)
    problem = planner.load_problem(PROBLEMS / "paper.toml", {"goal.duration": 9.87})
    with pytest.raises(planner.NotConvergedError):
        plan_collocation(problem, CollocationOptions(solver=broken, starts=1))
    if broken == "fatrop":
        assert planner.verify(plan_collocation(problem, CollocationOptions())).ok


def test_who_is_first() -> None:
    def order(name: str, free: bool = False, discs: int = 0, **settings: Any) -> tuple[str, ...]:
        system = planner.load_problem(PROBLEMS / f"{name}.toml").system
        kept = tuple(Obstacle(k, 3, 0.0, 0.0, 0.0) for k in range(discs))
        form = Form(3, free_duration=free, kept=kept)
        tries = attempts(transcription(system, form), Settings(**settings))
        return tuple(each.solver for each in tries)

    assert order("paper") == ("ipopt",)
    assert order("paper", direct=True) == ("fatrop", "ipopt")
    assert order("paper", near=True) == ("fatrop", "ipopt")
    assert order("paper", free=True) == ("ipopt",)
    assert order("paper", free=True, near=True) == ("fatrop", "ipopt")
    assert order("paper", discs=1) == ("fatrop", "ipopt")
    assert order("paper", discs=1, near=True) == ("fatrop", "fatrop", "ipopt")
    assert order("paper", free=True, solver="fatrop") == ("fatrop",)
    assert order("paper", near=True, solver="ipopt") == ("ipopt",)
    assert order("trailers") == ("ipopt",)
    assert order("trailers", near=True) == ("ipopt",)


def test_long_chains_have_rows_of_their_own() -> None:
    """Fatrop is of no use for them, and their paths are looked for with a longer reference."""
    long = transcription(planner.Manipulator([0.9, 0.8, 0.7, 0.6], 1.0), Form(3))
    assert long.system.size == SHORT_CHAIN + 1
    for settings in (Settings(near=True), Settings(direct=True), Settings()):
        assert [each.solver for each in attempts(long, settings)] == ["ipopt"]
    assert strategy(long, Settings()) is STRATEGIES["far, long chain"]
    short = transcription(planner.Manipulator([0.9, 0.8, 0.7], 1.0), Form(3))
    assert strategy(short, Settings()).reference_s < STRATEGIES["far, long chain"].reference_s


def test_far_from_the_answer_fatrop_is_asked_beside_posts_only() -> None:
    """Elsewhere it is hardly faster, and it may never return."""
    far = {kind: row for kind, row in STRATEGIES.items() if kind.startswith("far")}
    assert far.pop("far, posts").order == ("fatrop", "ipopt")
    assert len(far) > 1
    assert all(row.order == ("ipopt",) for row in far.values())


def test_solvers_live_as_long_as_their_transcription(paper: Problem) -> None:
    made = transcription(paper.system, Form(5, input="linear", free_duration=False))
    first = module.backend(made, Settings(solver="ipopt"))
    assert module.backend(made, Settings(solver="ipopt")) is first
    assert module.backend(made, Settings(solver="ipopt", near=True)) is not first
    kept = weakref.ref(first)
    transcription.cache_clear()
    del made, first
    gc.collect()
    assert kept() is None


class _Broken:
    """A solver that stops at its start, or at a point next to the answer."""

    def __init__(self, near: Any = None) -> None:
        self.calls = 0
        self.near = near

    def __call__(self, start: Any, data: Any) -> SolverAnswer:
        self.calls += 1
        return SolverAnswer(start if self.near is None else self.near, False, "Broken", 7)


@pytest.mark.parametrize("first", ["fatrop", "ipopt"])
def test_the_other_takes_over(paper: Problem, monkeypatch: pytest.MonkeyPatch, first: Any) -> None:
    reference = plan_collocation(paper, CollocationOptions())
    inner, broken = module.backend, _Broken()

    def backend(made: Any, settings: Settings) -> Any:
        return broken if settings.solver == first else inner(made, settings)

    order: list[SolverName] = ["fatrop", "ipopt"] if first == "fatrop" else ["ipopt", "fatrop"]

    def both(_: Any, settings: Settings) -> list[Settings]:
        return [replace(settings, solver=name) for name in order]

    monkeypatch.setattr(module, "backend", backend)
    monkeypatch.setattr(module, "attempts", both)
    transcription.cache_clear()
    plan = plan_collocation(paper, CollocationOptions())
    transcription.cache_clear()
    assert broken.calls == 1
    assert plan.iterations > 7
    assert plan.objective == pytest.approx(reference.objective, rel=1e-6)


def test_a_solver_named_is_the_only_one(paper: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = _Broken()
    monkeypatch.setattr(module, "backend", lambda *_: broken)
    transcription.cache_clear()
    options = CollocationOptions(solver="fatrop", start="straight", attempts=1)
    with pytest.raises(planner.NotConvergedError, match="Broken"):
        plan_collocation(paper.changed({"limits": {"input_rad_s": 0.5}}), options)
    transcription.cache_clear()


def test_fatrop_keeps_its_options_when_bounds_come_and_go(paper: Problem) -> None:
    """CasADi's interface forgets them in one memory; ours has one for each pattern of bounds."""
    options = CollocationOptions(solver="fatrop", start="straight")
    objectives = []
    for travel in ("free", 0.83, "free", 0.83):
        plan = plan_collocation(paper.changed({"goal.travel": travel}), options)
        objectives.append((plan.objective, plan.iterations))
    assert objectives[:2] == objectives[2:]


def test_bounds_hold_exactly(paper: Problem) -> None:
    """Fatrop relaxes bounds a little; they are drawn in by as much before."""
    limited = paper.changed({"limits.input_rad_s": [0.5, 0.12]})
    plan = plan_collocation(limited, CollocationOptions(solver="fatrop"))
    assert np.max(np.abs(plan.u(plan.t)[:, 1])) <= 0.12
    assert np.max(np.abs(plan.u(plan.t)[:, 1])) > 0.12 * (1 - 1e-6)


def test_what_users_may_name_is_what_there_is() -> None:
    assert set(get_args(SolverName)) == set(SOLVERS)
    assert {name for row in STRATEGIES.values() for name in row.order} <= set(SOLVERS)
