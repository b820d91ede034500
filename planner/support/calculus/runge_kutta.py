"""The classical Runge–Kutta method of order 4, for numbers, arrays and expressions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def step(rate: Callable[[Any, int], Any], x: Any, h: Any) -> Any:
    """Return x after one Runge–Kutta step.

    Args:
        rate: dx/dt as a function of x and k: at the step's start (k = 0), middle (1), end (2).
        x: Value at the start of the step.
        h: Step size.
    """
    k1 = rate(x, 0)
    k2 = rate(x + h / 2 * k1, 1)
    k3 = rate(x + h / 2 * k2, 1)
    k4 = rate(x + h * k3, 2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
