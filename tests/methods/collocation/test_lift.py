"""A joint put in front of an arm: the shorter arm's path is followed, and what is missed mended."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner import InputError, Manipulator
from planner.methods.collocation.long_arms.bridges import ChainEnds, PieceChain, close_gaps, ends_of
from planner.methods.collocation.long_arms.ladder import lift

ARM = Manipulator([0.87, 0.71, 0.58], 0.67)
MOVES = np.array([[0.7, -0.4], [0.0, 0.6], [-0.5, 0.0], [0.9, 0.4], [-0.3, 0.5]])
"""Drives and turns of the shorter arm in every ratio: with one angle of joint 1, and with two."""


def _path() -> PieceChain:
    short, q = ARM.shorter(), [np.array([0.0, 0.3, -0.2, 0.5])]
    for u in MOVES:
        q.append(ends_of(short, q[-1][None], u[None])[0])
    return PieceChain(np.array(q), MOVES, np.zeros((len(MOVES), 4)))


def _ends(first: float = 1.4) -> ChainEnds:
    path = _path()
    start, goal = np.insert(path.q[0], 1, 0.6), np.insert(path.q[-1], 1, -0.6)
    return ChainEnds(start, goal, np.array([np.inf, first, 1.45, 1.45, 1.45]))


def test_the_shorter_arm_is_the_arm_with_joint_1_at_rest() -> None:
    """But for joint 2, which its own input turns."""
    q, u = np.array([0.1, 0.7, 0.4, -0.3, 0.9]), np.array([0.8, 0.0])
    long, short = ARM.rates(q, u), ARM.shorter().rates(np.delete(q, 1), u)
    assert np.delete(long, [1, 2]) == pytest.approx(np.cos(0.7) * np.delete(short, 1))


def test_an_arm_of_two_joints_has_no_shorter_one() -> None:
    with pytest.raises(InputError, match="K"):
        Manipulator([0.8]).shorter()


def test_gaps_are_as_small_as_asked_for() -> None:
    chains = [lift(ARM, _path(), _ends(), gap) for gap in (0.2, 0.05, 0.01)]
    assert all(
        np.max(np.abs(c.gap)) <= gap for c, gap in zip(chains, (0.2, 0.05, 0.01), strict=True)
    )
    assert len(chains[0].u) < len(chains[1].u) < len(chains[2].u)
    for chain in chains:
        assert chain.gap == pytest.approx(chain.q[1:] - ends_of(ARM, chain.q[:-1], chain.u))


def test_the_shorter_path_is_followed() -> None:
    chain, path = lift(ARM, _path(), _ends(), 0.005), _path()
    q = chain.q[0]
    for u in chain.u:
        q = solve_ivp(lambda _, y, u=u: ARM.rates(y, u), (0, 1), q, rtol=1e-9).y[:, -1]
    assert q == pytest.approx(np.insert(path.q[-1], 1, -0.6), abs=0.05)
    assert np.max(np.abs(path.q[-1] - path.q[0])) > 0.5


@pytest.mark.parametrize("first", [1.4, 0.7])
def test_gaps_can_be_closed_within_the_limits(first: float) -> None:
    ends = _ends(first)
    chain, _ = close_gaps(ARM, lift(ARM, _path(), ends, 0.2), ends)
    assert chain is not None
    assert chain.q[[0, -1]] == pytest.approx(np.stack([ends.start, ends.goal]))
    assert np.all(np.abs(chain.q) <= ends.limit + 1e-9)
    assert ends_of(ARM, chain.q[:-1], chain.u) == pytest.approx(chain.q[1:], abs=2e-6)


def test_joint_1_stays_on_its_side_and_turns_to_the_goal_last() -> None:
    chain = lift(ARM, _path(), _ends(), 0.2)
    assert np.min(chain.q[:-1, 1]) >= 0.0
    assert chain.u[-1] == pytest.approx([0.0, -0.6 - chain.q[-2, 1]])


def _shares(u: np.ndarray, count: int) -> np.ndarray:
    return np.reshape(np.arange(1, count + 1)[:, None] / count * u[:, None], (-1, 2))


def test_limits_are_hardly_broken_on_the_way() -> None:
    """Two drives in turn swing joint 2 to and fro, by more the longer the stretch."""
    path = _path()
    fine = ends_of(ARM.shorter(), np.repeat(path.q[:-1], 20, axis=0), _shares(path.u, 20))
    limit = np.array([np.inf, 1.2, *np.max(np.abs(fine[:, 1:]), axis=0) + 0.01])
    ends = ChainEnds(_ends().start, _ends().goal, limit)
    chains = [lift(ARM, _path(), ends, gap) for gap in (2.0, 0.1)]
    over = [np.max(np.abs(c.q[1:] - c.gap) - ends.limit) for c in chains]
    assert over[0] > 0.05
    assert over[1] <= 0.1 / 4
