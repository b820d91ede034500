"""Paths of long arms: Fatrop with the goal as a term of the objective, then IPOPT to the goal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import planner
from planner.methods.collocation import task as module
from planner.methods.collocation.guesses import guess, seeds
from planner.methods.collocation.path import path_task
from planner.methods.collocation.pipeline import collocation_task
from planner.methods.collocation.solvers import (
    STRATEGIES,
    Settings,
    SolverAnswer,
    attempts,
    backend,
    strategy,
)
from planner.methods.collocation.task import ACCEPTED_RESIDUAL, SOFT_RESIDUAL, Task
from planner.problem.tables.method_options import CollocationOptions

PROBLEMS = Path(__file__).parents[3] / "problems"


def paths(name: str = "four-joint", changes: Any = None, **options: Any) -> Task:
    problem = planner.load_problem(PROBLEMS / f"{name}.toml", changes or {})
    return path_task(collocation_task(problem, CollocationOptions(**options), 40))


def test_only_long_arms_without_more_have_a_soft_goal() -> None:
    free = paths()
    assert free.nlp.form.soft_goal
    assert [each.solver for each in attempts(free.nlp, free.settings)] == ["fatrop", "ipopt"]
    assert strategy(free.nlp, Settings(near=True)) is STRATEGIES["near"]
    post = [{"centre_m": [0.3, 0.3], "radius_m": 0.05}]
    hard = [paths("paper"), paths("trailers"), paths(changes={"obstacles": post})]
    hard += [paths(solver="fatrop"), paths(solver="ipopt"), paths(intervals=500)]
    assert not any(each.nlp.form.soft_goal for each in hard)


def test_the_answer_ends_at_the_goal_where_fatrop_alone_is_a_little_off() -> None:
    free = paths()
    start = guess(free.problem, free.nlp, free.mesh, seeds("bump")[0])
    data = free.bounds
    packed = free.nlp.layout.pack(start, data.widths) / data.units
    alone = backend(free.nlp, replace(free.settings, solver="fatrop"))(packed, data)
    last, fixed = free.nlp.layout.nodes[-1], data.lower == data.upper
    last = last[fixed[last]]
    assert alone.finished
    assert len(last) == 4
    assert ACCEPTED_RESIDUAL < np.abs(alone.vector - data.lower)[last].max() < SOFT_RESIDUAL
    solution = free.solve(start)
    assert solution.ok
    assert solution.iterations > alone.iterations
    assert solution.iterate.nodes[-1, 1:].tolist() == free.problem.goal[1:].tolist()
    assert solution.residual <= ACCEPTED_RESIDUAL


def test_the_answer_is_an_optimum_where_fatrop_alone_meets_all_rows() -> None:
    """Fatrop stops early: its path to such a goal costs 3 % more than the least."""
    ends = {"goal.theta_deg": ["free", "free", 30, "free"]}
    free, hard = paths(changes=ends), paths(changes=ends, solver="ipopt")
    found = free.solve(guess(free.problem, free.nlp, free.mesh, seeds("bump")[0]))
    again = hard.solve(found.iterate, near=True)
    assert (free.nlp.form.soft_goal, found.ok, again.ok) == (True, True, True)
    assert found.objective == pytest.approx(again.objective, rel=1e-6)


def test_where_fatrop_fails_ipopt_searches_from_the_guess(monkeypatch: pytest.MonkeyPatch) -> None:
    free, asked = paths(), list[tuple[str, bool]]()

    def fails(made: Any, settings: Settings) -> Any:
        asked.append((settings.solver, settings.near))
        if settings.solver == "fatrop":
            return lambda start, _: SolverAnswer(start, False, "Broken", 1)
        return backend(made, settings)

    monkeypatch.setattr(module, "backend", fails)
    assert free.solve(guess(free.problem, free.nlp, free.mesh, seeds("bump")[0])).ok
    assert asked == [("fatrop", False), ("ipopt", False)]


def test_the_term_of_the_goal_has_exact_derivatives() -> None:
    program = paths().nlp.program
    x, p, f = (program.problem[key] for key in ("x", "p", "f"))
    rng = np.random.default_rng(0)
    at, numbers = rng.normal(size=x.numel()), rng.uniform(0.5, 1.5, p.numel())
    slope = ca.Function("slope", [x, p], [ca.gradient(f, x)])(at, numbers)
    assert program.gradient(at, numbers).full() == pytest.approx(slope.full(), rel=1e-9, abs=1e-9)
    duals = rng.normal(size=program.problem["g"].numel())
    lagrangian = 1.7 * f + ca.dot(duals, program.problem["g"])
    bend = ca.Function("bend", [x, p], [ca.hessian(lagrangian, x)[0]])(at, numbers).full()
    _, whole = program.gradient_and_hessian(at, numbers, 1.7, duals)
    upper = program.triangle(at, numbers, 1.7, duals)
    assert whole.full() == pytest.approx(bend, rel=1e-9, abs=1e-8)
    assert upper.full() == pytest.approx(np.triu(bend), rel=1e-9, abs=1e-8)
