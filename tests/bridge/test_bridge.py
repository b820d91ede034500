"""Paths from random motions: each part against an independent computation, and the whole."""

from __future__ import annotations

from itertools import islice

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.bridge import bridge, bridges
from planner.bridge.closing import Chain, Ends, _programme, closed, exact, finer
from planner.bridge.pairing import pairs
from planner.bridge.piece import ends, slopes
from planner.bridge.walks import room, walks

LIMIT_DEG = 80.0


@pytest.fixture(autouse=True)
def _few_walks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three joints do not need as many as long chains do."""
    monkeypatch.setattr(bridge, "WALKS", 100)
    monkeypatch.setattr(bridge, "PIECES", 30)


def _problem(start: list[float], goal: list[float], travel: object = "free") -> planner.Problem:
    K = [0.870125, 0.711625, 0.581997][: len(start) - 1]
    return planner.Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": len(start), "K": K, "k_g": 0.668811},
            "start": {"theta_deg": start},
            "goal": {"theta_deg": goal, "travel": travel, "duration": "free"},
            "limits": {"input_rad_s": [0.5, 0.5], "joint_deg": LIMIT_DEG},
        }
    )


HARD = _problem([10.0, -20.0, 30.0], [-40.0, 50.0, -10.0], 0.0)


def _true_end(problem: planner.Problem, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    found = solve_ivp(
        lambda t, y: problem.system.rates(y, u), (0, 1), q, method="DOP853", rtol=1e-11, atol=1e-12
    )
    return np.asarray(found.y[:, -1])


def test_a_piece_is_the_motion_under_its_inputs() -> None:
    q, u = HARD.start[None], np.array([[0.4, -0.3]])
    assert ends(HARD.system, q, u)[0] == pytest.approx(_true_end(HARD, q[0], u[0]), abs=1e-6)


def test_slopes_are_those_of_the_ends() -> None:
    q, u, h = HARD.start[None], np.array([[0.4, -0.3]]), 1e-6
    by_q, by_u = slopes(HARD.system, q, u)
    for column, slope in [*enumerate(by_q[0].T), *((k + 4, s) for k, s in enumerate(by_u[0].T))]:
        shift = np.zeros(6)
        shift[column] = h
        up = ends(HARD.system, q + shift[:4], u + shift[4:])[0]
        down = ends(HARD.system, q - shift[:4], u - shift[4:])[0]
        assert slope == pytest.approx((up - down) / (2 * h), abs=1e-8)


def test_the_programmes_derivatives_are_those_of_its_functions() -> None:
    problem, options = _programme(HARD.system, 3)
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


def test_walks_are_motions_that_keep_the_limits() -> None:
    space = room(HARD)
    out = walks(HARD.system, HARD.start, space, 50, 20, np.random.default_rng(1))
    assert np.all(np.abs(out.q[..., 1:]) <= space.limit[1:] + 1e-12)
    assert np.max(np.abs(space.limit[1:])) < np.deg2rad(LIMIT_DEG)
    for k in range(20):
        assert ends(HARD.system, out.q[k], out.u[k]) == pytest.approx(out.q[k + 1], abs=1e-12)
    assert np.ptp(out.q[-1, :, 2]) > 0.2


def test_pairs_share_no_walk_and_come_cheapest_first() -> None:
    space, rng = room(HARD), np.random.default_rng(2)
    forth = walks(HARD.system, HARD.start, space, 60, 20, rng)
    back = walks(HARD.system, np.nan_to_num(HARD.goal), space, 60, 20, rng)
    chosen = pairs(HARD.system, forth, back, True, 4)
    assert len({p.forth for p in chosen}) == len({p.back for p in chosen}) == len(chosen) == 4
    assert [p.cost for p in chosen] == sorted(p.cost for p in chosen)


def test_a_gap_is_closed_within_the_limits() -> None:
    out = walks(HARD.system, HARD.start, room(HARD), 20, 20, np.random.default_rng(3))
    q, u = out.q[:, 0].copy(), out.u[:, 0]
    gap = np.zeros((20, 4))
    gap[10, 2:] = 0.05
    q[11:] += gap[10]
    whole = Chain(q, u, q[1:] - ends(HARD.system, q[:-1], u))
    goal = q[-1].copy()
    goal[0] = np.nan
    limit = np.array([np.inf, *np.full(3, np.deg2rad(LIMIT_DEG))])
    found, made = closed(HARD.system, whole, Ends(HARD.start, goal, limit))
    assert found is not None
    assert made > 0
    assert found.q[1:] == pytest.approx(ends(HARD.system, found.q[:-1], found.u), abs=2e-6)
    assert found.q[-1, 1:] == pytest.approx(goal[1:], abs=1e-9)
    assert np.max(np.abs(found.q[:, 1:])) <= np.deg2rad(LIMIT_DEG) + 1e-9


def test_what_one_piece_cannot_do_is_not_found() -> None:
    goal = HARD.start + np.array([0.0, 0.0, 0.0, 0.5])
    chain = Chain(np.stack([HARD.start, goal]), np.zeros((1, 2)), (goal - HARD.start)[None])
    limit = np.array([np.inf, *np.full(3, np.deg2rad(LIMIT_DEG))])
    found, made = closed(HARD.system, chain, Ends(HARD.start, goal, limit))
    assert found is None
    assert made > 0


def test_finer_chains_say_what_the_coarse_ones_got_wrong() -> None:
    out = walks(HARD.system, HARD.start, room(HARD), 4, 6, np.random.default_rng(5))
    chain = Chain(out.q[:, 0], out.u[:, 0], np.zeros((6, 4)))
    fine = finer(HARD.system, chain, [1, 2, 3], 0.2)
    assert len(fine.u) > 6
    assert np.sum(fine.u, axis=0) == pytest.approx(np.sum(chain.u, axis=0))
    assert fine.q[1:] - ends(HARD.system, fine.q[:-1], fine.u) == pytest.approx(fine.gap)


@pytest.mark.parametrize("problem", [HARD, _problem([70.0, -65.0], [-70.0, 60.0])])
def test_bridges_lead_from_start_to_goal(problem: planner.Problem) -> None:
    _check_way(problem, next(islice(bridges(problem, 2), 1)).chain)


def _check_way(problem: planner.Problem, chain: Chain, tolerance: float = 2e-2) -> None:
    assert chain.q[0] == pytest.approx(problem.start, abs=1e-9)
    known = ~np.isnan(problem.target)
    assert chain.q[-1, known] == pytest.approx(problem.target[known], abs=1e-9)
    q = problem.start
    for u in chain.u:
        q = _true_end(problem, q, u)
        assert np.max(np.abs(q[1:])) <= np.deg2rad(LIMIT_DEG) + tolerance / 2
    assert np.max(np.abs(q - chain.q[-1])) < tolerance


def test_the_same_seed_gives_the_same_path() -> None:
    first, second = (next(islice(bridges(HARD, 2, seed=7), 1)).chain for _ in range(2))
    assert np.array_equal(first.q, second.q)
    assert not np.array_equal(first.q, next(islice(bridges(HARD, 2, seed=8), 1)).chain.q)


def test_an_exact_chain_is_a_motion_to_many_digits() -> None:
    rough = next(islice(bridges(HARD, 2), 1)).chain
    places = Ends(HARD.start, HARD.target, HARD.limits.joint)
    short = finer(HARD.system, rough, [1, 2, 3], 0.2)
    chain = exact(HARD.system, short, places)
    assert chain is not None
    _check_way(HARD, chain, tolerance=1e-6)
