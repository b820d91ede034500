"""The classical Runge–Kutta method of order 4, for numbers, arrays and expressions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def step(rate: Callable[[Any, int], Any], x: Any, h: Any) -> Any:
    """x after one step.

    Args:
        rate: dx/dt of (x, k) at the step's start (k = 0), middle (1) and end (2).
        x: At the step's start.
        h: The step.
    """
    k1 = rate(x, 0)
    k2 = rate(x + h / 2 * k1, 1)
    k3 = rate(x + h / 2 * k2, 1)
    k4 = rate(x + h * k3, 2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
