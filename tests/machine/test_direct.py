"""Every system replays by its own rates, to fourth order; the arm by its chain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from every_system import NAMES, SYSTEMS
from handmade import draws_of
from scipy.integrate import solve_ivp

from planner import Machine
from planner.machine.disk_chain import DiskChain
from planner.machine.stepwise import KinematicPlant, plant


def speed(t: float) -> np.ndarray:
    return np.array([0.5 * np.cos(2 * t), 0.4 * np.sin(3 * t) + 0.1])


@pytest.mark.parametrize("name", NAMES)
def test_against_an_adaptive_integrator(name: str) -> None:
    system = SYSTEMS[name]
    q = np.linspace(0.2, 0.4, system.size)
    start = np.stack([q, q + 0.05], axis=1)
    plan = SimpleNamespace(problem=SimpleNamespace(system=system))
    draws = draws_of(system.size - 1, samples=2)
    moved = plant(plan, Machine.ideal(), draws, start)  # type: ignore[arg-type]
    assert isinstance(moved, DiskChain if name.startswith("manipulator") else KinematicPlant)
    h = 0.01
    for k in range(50):
        points = np.array([speed((k + part) * h) for part in (0, 0.5, 1)])
        simpson = h / 24 * (5 * points[0] + 8 * points[1] - points[2])
        ways = np.array([simpson, h / 6 * (points[0] + 4 * points[1] + points[2])])
        both = np.repeat(points[:, :, None], 2, axis=2)
        moved.step(both, np.repeat(ways[:, :, None], 2, axis=2), h)
    for i in range(2):
        exact = solve_ivp(
            lambda t, x: system.rates(x, speed(t)), (0, 0.5), start[:, i], rtol=1e-11, atol=1e-12
        )
        assert moved.q[:, i] == pytest.approx(exact.y[:, -1], abs=2e-8)
