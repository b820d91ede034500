"""Requirements at samples, against the system's own code and against differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.convex.judge import judge
from planner.convex.local import Setting
from planner.convex.look import Samples
from planner.convex.sampled import Sampled
from planner.convex.task import Task
from planner.methods.chart import chart_ends
from planner.methods.convex import _trajectory
from planner.schema.methods import ConvexOptions
from planner.trajectory import ChainedTrajectory

Ready = Callable[[str, int], tuple[Task, np.ndarray]]


@pytest.fixture
def ready(paper: planner.Problem, reachable: Callable[..., planner.Problem]) -> Ready:
    """A task and a path well inside the chart: of the paper's arm, or of one with four joints."""

    def make(name: str, degree: int) -> tuple[Task, np.ndarray]:
        problem = paper.changed({"goal.travel": 0.82})
        if name == "four":
            limits = {"input_rad_s": [0.3, 0.2], "joint_deg": 70}
            problem = reachable(4, 0, travel=0.5).changed({"limits": limits})
        options = ConvexOptions(pieces=30, input="linear" if degree else "constant")
        task = Task.of(problem, options, *chart_ends(problem, problem.travel or 1.0))
        return task, 0.01 * np.random.default_rng(5).normal(size=task.frame.size)

    return make


def sampled(task: Task, samples: Samples | None = None) -> Sampled:
    samples = Samples.dense(task.frame.shape.pieces, 4) if samples is None else samples
    return task.setting.sampled(task.frame, samples)


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("name", ["paper", "four"])
def test_look_agrees_with_the_trajectory(ready: Ready, name: str, degree: int) -> None:
    task, y = ready(name, degree)
    trajectory: ChainedTrajectory = _trajectory(task.problem, task.frame, y)
    samples = Samples(np.array([0, 3, 11, 29]), np.array([0.3, 0.5, 0.01, 0.99]))
    times = (samples.piece + samples.local) / 30 * trajectory.duration
    at = sampled(task, samples).look(y)
    assert at is not None
    np.testing.assert_allclose(at.q, trajectory.q(times), atol=1e-12)
    u = np.stack([at.v[:, 0] / at.drive, at.turned / at.slope], axis=1)
    np.testing.assert_allclose(u, trajectory.u(times), rtol=1e-9)
    rates = task.problem.system.rates(at.q, u)  # the verifier's own kinematics
    h = 1e-6
    slope = (trajectory.q(times + h) - trajectory.q(times - h)) / (2 * h)
    np.testing.assert_allclose(rates, slope, atol=1e-6)


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("name", ["paper", "four"])
def test_derivatives_against_differences(ready: Ready, name: str, degree: int) -> None:
    task, y = ready(name, degree)
    task = replace(
        task, setting=replace(task.setting, margin=np.full(len(task.setting.nearest), 1e-3))
    )
    at = sampled(task)
    scale = at.turn_scale(y)
    rows = at.rows(y, 0.9, np.inf, scale)
    assert rows is not None
    assert len(rows.near) == len(rows.h)
    rng = np.random.default_rng(1)
    for _ in range(3):
        step = 1e-6 * rng.normal(size=len(y))
        ahead, behind = (at.rows(y + s, 0.9, np.inf, scale) for s in (step, -step))
        assert ahead is not None
        assert behind is not None
        change = rows.J @ (2 * step)
        error = np.abs(ahead.h - behind.h - change)
        assert error.max() < 2e-4 * np.abs(change).max() + 1e-9
    up, down = (at.rows(y, t, np.inf, scale) for t in (0.901, 0.899))
    assert up is not None
    assert down is not None
    np.testing.assert_allclose((up.h - down.h) / 0.002, rows.k, atol=1e-9)


def test_values_are_excesses_over_limits(ready: Ready) -> None:
    task, y = ready("four", 0)
    at = sampled(task)
    h = at.values(y)
    look = at.look(y)
    assert h is not None
    assert look is not None
    table = h.reshape(-1, len(look.q))
    u2 = look.turned / look.slope
    np.testing.assert_allclose(np.maximum(table[1], table[2]), np.abs(u2) / 0.2 - 1, atol=1e-12)
    theta = np.abs(look.q[:, 1:5]) / np.deg2rad(70) - 1
    np.testing.assert_allclose(table[3:7], theta.T, atol=1e-12)
    assert np.array_equal(table[0] > 0, 0.3 * look.drive < 0.5 / 10)


def test_judge_finds_a_peak_between_the_grid_points(ready: Ready) -> None:
    task, y = ready("paper", 1)
    verdict = task.setting.judge(task.frame, y)
    dense = sampled(task, Samples.dense(30, 2001)).values(y)
    assert dense is not None
    assert verdict.worst == pytest.approx(dense.max(), rel=1e-6)
    assert len(verdict.breaches.piece) > 0
    at_breach = sampled(task, verdict.breaches).values(y)
    assert at_breach is not None
    assert at_breach.reshape(-1, len(verdict.breaches.piece)).max(axis=0).min() > 0


def test_judge_says_where_the_domain_is_left(ready: Ready) -> None:
    task, _ = ready("paper", 0)
    outside = task.frame.at(0.80)
    far = 3.0 * np.random.default_rng(0).normal(size=outside.size)
    verdict = task.setting.judge(outside, far)
    assert verdict.worst == np.inf
    at = task.setting.sampled(outside, verdict.breaches)
    assert at.lost(far).all()


def test_limits_left_out_where_they_do_not_apply(paper: planner.Problem) -> None:
    free = paper.changed({"goal.duration": "free", "goal.travel": 0.82})
    task = Task.of(free, ConvexOptions(pieces=30), *chart_ends(free, 0.82))
    assert np.all(np.isinf(task.setting.limits.input))
    assert np.isfinite(task.setting.limits.joint[1])
    assert isinstance(task.setting, Setting)
    assert judge(lambda s: sampled(task, s), 30, np.zeros(task.frame.size)).worst < 0
