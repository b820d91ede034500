"""The paper's example with the constants exactly as its printed z(0) gives them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.chained import chained_form
from planner.convex.frame import Frame
from planner.convex.shape import input_shape


def printed_constants() -> tuple[float, float]:
    """K₂ and K₃ from z(0) = (−0.0324, 0.7113, …) at one degree."""
    c, s = np.cos(np.deg2rad(1)), np.sin(np.deg2rad(1))
    K3 = 0.7113 / c**3
    return 0.0324 / (3 * K3 * c**4 * s), K3


@pytest.fixture(scope="session")
def printed(paper: planner.Problem) -> planner.Problem:
    return paper.changed({"system.K": list(printed_constants())})


@pytest.fixture(scope="session")
def frame_at(printed: planner.Problem) -> Callable[..., Frame]:
    """Frames of the example: (travel, pieces, degree) → Frame."""
    form = chained_form(printed.system)
    start, goal = form.z(printed.start), form.z(np.nan_to_num(printed.goal))

    def make(travel: float, pieces: int = 60, degree: int = 0) -> Frame:
        return Frame(input_shape(pieces, degree), start, goal, 1.0).at(travel)

    return make


@pytest.fixture(scope="session")
def reachable() -> Callable[..., planner.Problem]:
    return reachable_by_half


def reachable_by_half(joints: int, seed: int, travel: float | None = None) -> planner.Problem:
    """A goal that a known smooth motion of travel ½ reaches."""
    rng = np.random.default_rng([joints, seed])
    start, K = rng.uniform(5, 25, joints), [0.9**i for i in range(joints - 1)]
    system = planner.Manipulator(K, 0.7)

    def slope(s: float, passive: np.ndarray) -> np.ndarray:
        theta1 = np.deg2rad(start[0] + 10 * s + 30 * np.sin(np.pi * s) ** 2)
        return 0.5 * system.slopes(np.array([0.0, theta1, *passive]))

    end = solve_ivp(slope, (0, 1), np.deg2rad(start[1:]), rtol=1e-10).y[:, -1]
    return planner.Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": joints, "K": K, "k_g": 0.7},
            "start": {"theta_deg": start.tolist()},
            "goal": {
                "theta_deg": [float(start[0] + 10), *np.rad2deg(end).tolist()],
                "travel": "free" if travel is None else travel,
            },
        }
    )
