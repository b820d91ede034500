"""Chains of pieces: each part against an independent computation."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.methods.collocation.long_arms.bridges import (
    ChainEnds,
    PieceChain,
    chain_programme,
    close_gaps,
    cut_finer,
    make_exact,
)
from planner.methods.collocation.long_arms.bridges import ends_of as ends
from planner.support.solver_calls import NlpCall

LIMIT_DEG = 80.0


def _problem(start: list[float], goal: list[float], travel: float | None = None) -> planner.Problem:
    return planner.Problem.manipulator(
        start, goal, travel=travel, duration=None, input_rad_s=0.5, joint_deg=LIMIT_DEG
    )


HARD = _problem([10.0, -20.0, 30.0], [-40.0, 50.0, -10.0], 0.0)


def _walk(pieces: int, seed: int, longest: float = 0.5) -> PieceChain:
    """A random motion from the start within the limits, in pieces of constant input."""
    rng, q, us = np.random.default_rng(seed), [HARD.start], list[np.ndarray]()
    while len(us) < pieces:
        u = rng.uniform(-longest, longest, 2)
        after = ends(HARD.system, q[-1][None], u[None])[0]
        if np.all(np.abs(after[1:]) < np.deg2rad(LIMIT_DEG - 5.0)):
            q.append(after)
            us.append(u)
    return PieceChain(np.array(q), np.array(us), np.zeros((pieces, 4)))


def _true_end(problem: planner.Problem, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    found = solve_ivp(
        lambda t, y: problem.system.rates(y, u), (0, 1), q, method="DOP853", rtol=1e-11, atol=1e-12
    )
    return np.asarray(found.y[:, -1])


def test_a_piece_is_the_motion_under_its_inputs() -> None:
    q, u = HARD.start[None], np.array([[0.4, -0.3]])
    assert ends(HARD.system, q, u)[0] == pytest.approx(_true_end(HARD, q[0], u[0]), abs=1e-6)


def test_the_programmes_derivatives_are_those_of_its_functions() -> None:
    problem, options = chain_programme(HARD.system, 3)
    rng = np.random.default_rng(0)
    x, near = rng.normal(size=(2, problem["x"].numel()))
    dual = rng.normal(size=problem["g"].numel())
    lagrangian = 1.7 * problem["f"] + ca.dot(dual, problem["g"])
    outputs = [
        ca.jacobian(problem["g"], problem["x"]),
        ca.triu(ca.hessian(lagrangian, problem["x"])[0]),
    ]
    jacobian, hessian = ca.Function("check", [problem["x"], problem["p"]], outputs)(x, near)
    ours = options["jac_g"](x, near)[1], options["hess_lag"](x, near, 1.7, dual)
    assert jacobian.full() == pytest.approx(ours[0].full(), abs=1e-12)
    assert hessian.full() == pytest.approx(ours[1].full(), abs=1e-12)


def fail(*_: object, **__: object) -> None:
    raise RuntimeError("Error in Function::call:\n.../nlpsol.cpp:1: out of order")


@pytest.mark.parametrize("raises", [False, True])
def test_a_gap_is_closed_within_the_limits(raises: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that raises has closed nothing."""
    walked = _walk(20, seed=3)
    q, u = walked.q.copy(), walked.u
    gap = np.zeros((20, 4))
    gap[10, 2:] = 0.05
    q[11:] += gap[10]
    whole = PieceChain(q, u, q[1:] - ends(HARD.system, q[:-1], u))
    goal = q[-1].copy()
    goal[0] = np.nan
    limit = np.array([np.inf, *np.full(3, np.deg2rad(LIMIT_DEG))])
    if raises:
        monkeypatch.setattr(NlpCall, "__call__", fail)
    found, share = close_gaps(HARD.system, whole, ChainEnds(HARD.start, goal, limit))
    if raises:
        assert (found, share) == (None, 0)
        return
    assert found is not None
    assert share == 1
    assert found.q[1:] == pytest.approx(ends(HARD.system, found.q[:-1], found.u), abs=2e-6)
    assert found.q[-1, 1:] == pytest.approx(goal[1:], abs=1e-9)
    assert np.max(np.abs(found.q[:, 1:])) <= np.deg2rad(LIMIT_DEG) + 1e-9


def test_what_one_piece_cannot_do_is_not_found() -> None:
    goal = HARD.start + np.array([0.0, 0.0, 0.0, 0.5])
    chain = PieceChain(np.stack([HARD.start, goal]), np.zeros((1, 2)), (goal - HARD.start)[None])
    limit = np.array([np.inf, *np.full(3, np.deg2rad(LIMIT_DEG))])
    found, share = close_gaps(HARD.system, chain, ChainEnds(HARD.start, goal, limit))
    assert found is None
    assert share == 0


def test_finer_chains_say_what_the_coarse_ones_got_wrong() -> None:
    chain = _walk(6, seed=5, longest=1.0)
    fine = cut_finer(HARD.system, chain, [1, 2, 3], 0.2)
    assert len(fine.u) > 6
    assert np.sum(fine.u, axis=0) == pytest.approx(np.sum(chain.u, axis=0))
    assert fine.q[1:] - ends(HARD.system, fine.q[:-1], fine.u) == pytest.approx(fine.gap)


def _check_way(problem: planner.Problem, chain: PieceChain, tolerance: float = 2e-2) -> None:
    assert chain.q[0] == pytest.approx(problem.start, abs=1e-9)
    known = ~np.isnan(problem.goal)
    assert chain.q[-1, known] == pytest.approx(problem.goal[known], abs=1e-9)
    q = problem.start
    for u in chain.u:
        q = _true_end(problem, q, u)
        assert np.max(np.abs(q[1:])) <= np.deg2rad(LIMIT_DEG) + tolerance / 2
    assert np.max(np.abs(q - chain.q[-1])) < tolerance


def test_an_exact_chain_is_a_motion_to_many_digits() -> None:
    rough = _walk(20, seed=7)
    problem = replace(HARD, user_goal=rough.q[-1])
    places = ChainEnds(problem.start, problem.goal, HARD.limits.joint)
    short = cut_finer(HARD.system, rough, [1, 2, 3], 0.2)
    chain = make_exact(HARD.system, short, places)
    assert chain is not None
    _check_way(problem, chain, tolerance=1e-6)
