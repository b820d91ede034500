"""The travel window against brute force: it must be exact for n = 3 and never too narrow."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner


def test_paper_window(paper: planner.Problem) -> None:
    window = planner.travel_window(paper)
    assert window is not None
    assert window.exact
    assert window.low == pytest.approx(0.78635, abs=5e-6)
    assert window.high == pytest.approx(0.89664, abs=5e-6)
    assert np.pi / 4 not in window
    assert 0.82 in window


def _case(start: list[float], goal: list[float]) -> planner.Problem:
    K = [0.9**i for i in range(len(start) - 1)]
    return planner.Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": len(start), "K": K, "k_g": 0.7},
            "start": {"theta_deg": start},
            "goal": {"theta_deg": goal},
        }
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_window_contains_every_one_way_motion(n: int, seed: int) -> None:
    """Drive θ₁ by a random curve over a random one-way travel; the window must contain it."""
    rng = np.random.default_rng([n, seed])
    travel = rng.uniform(0.2, 0.6) * rng.choice([-1, 1])
    start = rng.uniform(-0.3, 0.3, n)
    bend = rng.uniform(-0.4, 0.4, 3)

    def theta1(s: float) -> float:
        return start[0] + bend @ np.array([s, s**2, np.sin(5 * s)])

    system = _case([10.0] * n, [20.0] * n).system

    def slope(s: float, passive: np.ndarray) -> np.ndarray:
        q = np.array([0.0, theta1(s), *passive])
        return travel * system.slopes(q)

    end = solve_ivp(slope, (0, 1), start[1:], rtol=1e-10, atol=1e-12).y[:, -1]
    goal = np.array([theta1(1.0), *end])
    window = planner.travel_window(_case(list(np.rad2deg(start)), list(np.rad2deg(goal))))
    assert window is not None
    assert travel in window


@pytest.mark.parametrize("start", [[5, 5, 5], [-20, -30, 10], [40, -10, 0]])
def test_ends_of_the_exact_window_are_approached_by_motions(start: list[float]) -> None:
    """Full speed of θ₂ (θ₁ = 0) but for one dwell (θ₁ = 90°) at the best or worst θ₂."""
    problem = _case([float(a) for a in start], [start[0] + 0.0, start[1] + 25.0, start[2] + 30.0])
    window = planner.travel_window(problem)
    assert window is not None
    system = problem.system
    assert isinstance(system, planner.Manipulator)
    a, b = problem.start[2], problem.goal[2]
    theta3 = problem.goal[3] - problem.start[3]
    angles = np.linspace(a, b, 20001)
    swept = np.trapezoid(np.cos(angles) ** 3, angles) * system.K[1] / system.K[0]
    rates = system.K[1] * np.cos(angles) ** 3
    travels = (b - a) / system.K[0] + (theta3 - swept) / rates
    assert window.low == pytest.approx(travels.min(), rel=1e-6)
    assert window.high == pytest.approx(travels.max(), rel=1e-6)


@pytest.mark.parametrize(
    ("start", "goal", "reason"),
    [
        ([1, 1, 1], [1, 20, -20], "opposite"),
        ([1, 1, 1], [9, 1, 1], "end where they started"),
        ([1, 1, 1], [9, 1, 4], "one passive joint must stay"),
        ([1, 1, 1], [9, 60, 2], "while theta2 moves 59 deg, theta3 moves at least"),
    ],
)
def test_empty_window_says_why(start: list[float], goal: list[float], reason: str) -> None:
    window = planner.travel_window(_case(start, goal))
    assert window is not None
    assert window.empty
    assert reason in window.reason
    assert 0.5 not in window


def test_backward_motion_mirrors_forward() -> None:
    ahead = planner.travel_window(_case([1, 1, 1], [30, 30, 30]))
    back = planner.travel_window(_case([30, 30, 30], [1, 1, 1]))
    assert ahead is not None
    assert back is not None
    assert (back.low, back.high) == (-ahead.high, -ahead.low)
