"""Any system whose inputs are the motors themselves, with nothing between motor and motion."""

from __future__ import annotations

import numpy as np

from planner.systems.base import Array, TriangularSystem


class Direct:
    """S copies of a system, integrated by the classical Runge–Kutta method (order 4).

    Args:
        system: The system.
        q: Coordinates at the start, (N, S).
    """

    def __init__(self, system: TriangularSystem, q: Array) -> None:
        self._system = system
        self._q = q.T.copy()

    @property
    def q(self) -> Array:
        """Coordinates, shape (N, S)."""
        return self._q.T

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by h seconds under motor speeds (P, 2, S) at the step's points.

        Without a middle point (P = 2) the speeds are taken as linear between. `travel` is there for
        systems with gears and is not used.
        """
        points = np.swapaxes(speed, 1, 2)
        start, end = points[0], points[-1]
        middle = points[1] if len(points) > 2 else (start + end) / 2
        rates, q = self._system.rates, self._q
        k1 = rates(q, start)
        k2 = rates(q + h / 2 * k1, middle)
        k3 = rates(q + h / 2 * k2, middle)
        k4 = rates(q + h * k3, end)
        self._q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
