"""The control step against the same programme written out in full and solved another way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import osqp
import pytest
import scipy.sparse as sp

import planner
from planner import Machine, Plan
from planner.machine.feedback.programme import TrackingProgramme, change_range
from planner.machine.feedback.reference import Reference, regulator
from planner.machine.feedback.tracker import TrackerDesign, cost_weights, design
from planner.problem.tables.problem_file import FeedbackTable

OPTIONS = FeedbackTable(run_up=False)


def weights(plan: Plan, ref: Reference, machine: Machine) -> Any:
    return cost_weights(plan, machine, ref, OPTIONS)


def programme(
    plan: Plan, ref: Reference, machine: Machine, horizon: int = 10, iterations: int = 0
) -> TrackingProgramme:
    law = regulator(ref, weights(plan, ref, machine))
    return TrackingProgramme(ref, law, horizon, iterations or OPTIONS.max_iterations)


def fail(*_: object, **__: object) -> None:
    raise osqp.OSQPException(1)


def written_out(
    task: TrackerDesign, plan: Plan, machine: Machine, k: int, state: np.ndarray, horizon: int
) -> np.ndarray:
    """Corrections of every period to the end, (K−k, 2), from the cost as it is defined.

    Nothing is eliminated: unknowns are all deviations and all corrections, limits hold for the
    first `horizon` periods.
    """
    ref = task.ref
    w = weights(plan, ref, machine)
    size, count = ref.q.shape[1], len(ref.feed) - k
    wide = size + 2
    P, lower, upper = np.zeros((wide * count, wide * count)), [], []
    q = np.zeros(wide * count)
    A = np.zeros((size * count, wide * count))
    b = np.zeros(size * count)
    tau = ref.timing.period
    for j in range(count):
        i = k + j
        x = slice(wide * j, wide * j + size)  # deviation after period i
        v = slice(wide * j + size, wide * (j + 1))
        last = slice(wide * (j - 1) + size, wide * j)
        weight = w.goal if i == len(ref.feed) - 1 else tau * w.path[i + 1]
        P[x, x] += np.diag(weight)
        P[v, v] += np.diag(tau * w.size[i] + w.step[i])
        rows = slice(size * j, size * (j + 1))
        A[rows, x], A[rows, v] = np.eye(size), -ref.B[i]
        b[rows] = ref.E[i] @ state[size + 2 :]
        if j:
            P[last, last] += np.diag(w.step[i])
            P[v, last] -= np.diag(w.step[i])
            P[last, v] -= np.diag(w.step[i])
            A[rows, wide * (j - 1) : wide * (j - 1) + size] = -ref.A[i]
        else:
            q[v] = -w.step[i] * state[size : size + 2]
            b[rows] += ref.A[i] @ state[:size]
        free = np.full(2, np.inf)
        lower += [ref.low[i] if j < horizon else -free]
        upper += [ref.high[i] if j < horizon else free]
    bounds = np.kron(np.eye(count), np.hstack([np.zeros((2, size)), np.eye(2)]))
    scale = 1 / np.sqrt(np.maximum(np.diag(P), 1.0))
    solver = osqp.OSQP()
    matrices = (sp.csc_matrix(np.triu(P * np.outer(scale, scale))), q * scale)
    rows = sp.csc_matrix(np.vstack([A, bounds]) * scale)
    limits = (np.concatenate([b, *lower]), np.concatenate([b, *upper]))
    exact = {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 200_000, "polishing": True}
    solver.setup(*matrices, rows, *limits, verbose=False, **exact)
    found = solver.solve(raise_error=True)
    return np.asarray((found.x * scale).reshape(count, wide)[:, size:])


def error(task: TrackerDesign, theta_deg: list[float], rate: float = 0.0) -> np.ndarray:
    """A state ξ, (n, 1), with these deviations."""
    size = task.ref.q.shape[1]
    state = np.zeros((size + 2 + task.ref.E.shape[-1], 1))
    state[1 : len(theta_deg) + 1, 0] = np.deg2rad(theta_deg)
    state[size : size + 2, 0] = [0.004, -0.003]
    state[size + 2 :] = rate
    return state


@pytest.mark.parametrize("k", [20, 60, 75])
def test_without_active_limits_it_is_the_regulator(
    smooth: Plan, machine: Machine, plain: TrackerDesign, k: int
) -> None:
    state = error(plain, [0.02, 0.01, -0.01], rate=0.002)
    before = plain.programme.solve_count
    answer = plain.programme(k, state, plain.programme.empty_decision(1))
    assert plain.programme.solve_count == before
    full = written_out(plain, smooth, machine, k, state[:, 0], horizon=20)
    H = min(plain.programme.horizon, len(full))
    assert answer.corrections[:H, :, 0] == pytest.approx(full[:H], abs=1e-6)
    assert not answer.fallback[0]


@pytest.mark.parametrize("k", [5, 50, 97])
def test_with_active_limits_it_is_the_whole_programme(
    smooth: Plan, machine: Machine, plain: TrackerDesign, k: int
) -> None:
    state = error(plain, [9.0, -12.0, -12.0])
    law = regulator(plain.ref, weights(smooth, plain.ref, machine))
    unlimited = -law.gain[k] @ state[:, 0]
    assert np.any((unlimited < plain.ref.low[k]) | (unlimited > plain.ref.high[k]))
    before = plain.programme.solve_count
    answer = plain.programme(k, state, plain.programme.empty_decision(1))
    assert plain.programme.solve_count == before + 1
    full = written_out(plain, smooth, machine, k, state[:, 0], plain.programme.horizon)
    H = min(plain.programme.horizon, len(full))
    assert answer.corrections[:H, :, 0] == pytest.approx(full[:H], abs=1e-7)


def after(task: TrackerDesign, k: int, state: np.ndarray, corrections: np.ndarray) -> np.ndarray:
    """Deviations of θ₁ after each period, (H,)."""
    q, out = state[:4, 0], []
    for j, v in enumerate(corrections[:, :, 0]):
        q = task.ref.A[k + j] @ q + task.ref.B[k + j] @ v
        out.append(q[1])
    return np.array(out)


def test_a_joint_limit_bites_and_is_kept(
    smooth: Plan, machine: Machine, plain: TrackerDesign
) -> None:
    k, most = 30, float(np.deg2rad(0.3))
    state = error(plain, [0.0, -2.0, 2.0])
    free = plain.programme(k, state, plain.programme.empty_decision(1))
    assert after(plain, k, state, free.corrections).min() < -most  # θ₁ swings without the limit
    floor = np.full_like(plain.ref.floor, -9.0)
    floor[:, 0] = -most
    kept = programme(smooth, replace(plain.ref, floor=floor), machine)
    answer = kept(k, state, kept.empty_decision(1))
    assert after(plain, k, state, answer.corrections).min() == pytest.approx(-most, abs=1e-5)
    assert not answer.fallback[0]


def test_a_state_limit_that_cannot_be_kept_is_widened_and_counted(
    smooth: Plan, machine: Machine, plain: TrackerDesign
) -> None:
    ceiling = plain.ref.ceiling.copy()
    ceiling[:, 0] = -1.0  # θ₁ one radian below its course, at once
    tight = programme(smooth, replace(plain.ref, ceiling=ceiling), machine)
    state = error(plain, [0.0, 0.0, 0.0])
    answer = tight(30, state, tight.empty_decision(1))
    assert answer.fallback.tolist() == [True]
    v = answer.corrections[:, :, 0]
    assert np.all(v >= plain.ref.low[30:40])
    assert np.all(v <= plain.ref.high[30:40])


@pytest.mark.parametrize("raises", ["", "solve", "setup"])
def test_when_the_solver_is_late_or_raises_the_last_decision_goes_on(
    smooth: Plan,
    machine: Machine,
    plain: TrackerDesign,
    raises: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hasty = programme(smooth, plain.ref, machine, plain.programme.horizon, iterations=10)
    state = error(plain, [9.0, -12.0, -12.0])
    last = plain.programme(49, error(plain, [0.1, 0.1, 0.1]), plain.programme.empty_decision(1))
    if raises:
        monkeypatch.setattr(f"osqp.OSQP.{raises}", fail)
    answer = hasty(50, state, last)
    assert answer.fallback.tolist() == [True]
    assert answer.corrections[:-1] == pytest.approx(last.corrections[1:], abs=1e-12)
    assert np.all(answer.corrections[-1] == 0)


def test_rates_of_the_inputs_are_limited(unlimited: planner.Problem, machine: Machine) -> None:
    limits = {"input_rad_s": [1.0, 1.0], "input_rate_rad_s2": [0.5, 0.5]}
    plan = planner.solve(unlimited.changed({"limits": limits}), "collocation", intervals=20)
    task = design(plan, machine, OPTIONS)
    assert task.ramp
    k, state = 30, error(task, [3.0, -4.0, -4.0])
    answer = task.programme(k, state, task.programme.empty_decision(1))
    steps = np.diff(np.concatenate([state[None, 4:6], answer.corrections]), axis=0)[:, :, 0]
    ranges = np.array([change_range(task.ref, k + j) for j in range(len(steps))])
    low, high = ranges[:, 0], ranges[:, 1]
    assert np.all(steps <= high + 1e-5)
    assert np.all(steps >= low - 1e-5)
    assert np.any(np.abs(steps - high) < 1e-5)


def test_limited_rates_alone_are_no_reason_for_a_fallback(unlimited: planner.Problem) -> None:
    limits = {"input_rad_s": [0.5, 0.5], "input_rate_rad_s2": [2.0, 2.0], "z2_margin": 0.01}
    plan = planner.solve(unlimited.changed({"limits": limits}), "collocation", intervals=20)
    machine = Machine.prototype(step_s=0.005, encoder_noise_deg=False)
    run = planner.replay(plan, machine, 10, seed=0, feedback=True, record_s=None)
    assert run.fallbacks.sum() == 0
