"""Newton's method near the answer: the solvers' own optimum, or nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.methods.collocation import collocation_task
from planner.ocp.backends import Answer, Settings
from planner.ocp.bounds import Bounds
from planner.ocp.guess import guess, seeds
from planner.ocp.newton import Newton
from planner.ocp.solver import Solution
from planner.ocp.task import Task
from planner.problem import Problem
from planner.schema.methods import CollocationOptions
from planner.systems.base import Array

IPOPT = Settings(solver="ipopt")


def _task(problem: Problem) -> Task:
    return replace(collocation_task(problem, CollocationOptions(), 14), settings=IPOPT)


def _solved(job: Task) -> Solution:
    return job.solve(guess(job.problem, job.made, job.mesh, seeds("straight")[0]))


def _newton(job: Task, start: Array, data: Bounds | None = None) -> Answer:
    return Newton(job.made, Settings())(start, job.bounds if data is None else data)


@pytest.fixture(scope="module")
def limited(paper: Problem) -> Problem:
    """An input comes to its limit."""
    return paper.changed({"limits": {"input_rad_s": [0.5, 0.09]}, "goal.theta_deg": [20, 30, 30]})


@pytest.mark.parametrize("goal", [[31, 30, 29], [28, 31, 30]])
def test_three_steps_to_the_optimum_that_ipopt_finds(paper: Problem, goal: list[float]) -> None:
    moved = _task(paper.changed({"goal.theta_deg": goal}))
    start = np.clip(_solved(_task(paper)).vector, moved.bounds.lower, moved.bounds.upper)
    answer, ipopt = _newton(moved, start), _solved(moved)
    assert answer.finished
    assert answer.iterations == 3
    assert answer.vector == pytest.approx(ipopt.vector, abs=1e-6)
    objective, rows, _ = moved.made.outcome(answer.vector, moved.bounds.parameters)
    assert objective == pytest.approx(ipopt.objective, abs=1e-9)
    data = moved.bounds
    assert np.all(rows >= data.row_lower - 1e-9)
    assert np.all(rows <= data.row_upper + 1e-9)


def test_limits_that_are_met_stay_met(limited: Problem) -> None:
    job = _task(limited)
    moved = _task(limited.changed({"goal.theta_deg": [20, 30, 30.01]}))
    start = _solved(job).vector
    at_limit = np.abs(start - job.bounds.upper) < 1e-6
    assert np.sum(at_limit & (job.bounds.upper > job.bounds.lower)) >= 3
    answer = _newton(moved, np.clip(start, moved.bounds.lower, moved.bounds.upper))
    assert answer.finished
    assert answer.vector == pytest.approx(_solved(moved).vector, abs=1e-6)


def test_a_limit_that_pushes_the_wrong_way_is_not_held(paper: Problem) -> None:
    """The start touches a limit that the answer does not, so that holding it would cost."""
    job = _task(paper)
    start = _solved(job).vector
    touching = job.made.layout.inputs[5, 1]
    start[touching] = job.bounds.upper[touching]
    _refused(_newton(job, start), start)


def test_a_step_that_breaks_a_limit_is_not_taken(paper: Problem, limited: Problem) -> None:
    start = _solved(_task(paper.changed({"goal.theta_deg": [20, 30, 30]}))).vector
    job = _task(limited)
    assert np.any(start > job.bounds.upper)
    data, inside = job.bounds, 0.99 * np.clip(start, job.bounds.lower, job.bounds.upper)
    inside = np.where(data.lower == data.upper, data.lower, inside)
    _refused(_newton(job, inside), inside)


def test_a_greatest_value_is_no_answer(paper: Problem) -> None:
    """Where minus the objective is greatest its slope vanishes too."""
    job = _task(paper)
    start, data = _solved(job).vector, job.bounds
    assert _newton(job, start).finished
    parameters = data.parameters.copy()
    parameters[1:3] *= -1
    _refused(_newton(job, start, replace(data, parameters=parameters)), start)


def _refused(answer: Answer, start: Array) -> None:
    assert not answer.finished
    assert np.array_equal(answer.vector, start)
