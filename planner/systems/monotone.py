"""Scalar equations f(x) = y on the stretch of an interval where f rises, or falls; many at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.systems.base import Array

Function = Callable[[Array], tuple[Array, Array]]
"""From x (M,) to f(x) and f'(x), each (M,)."""

INSET = 1e-10
"""How far inside an open interval its ends are evaluated, relative to its width."""

_STEPS = 200


@dataclass(frozen=True)
class Stretch:
    """Where f' has the wanted sign.

    Attributes:
        low: Left ends, shape (M,).
        high: Right ends, shape (M,); NaN, like `low`, where f' never has that sign.
        turns_low: Whether the left end is a turning point of f rather than the interval's end.
        turns_high: The same for the right end.
    """

    low: Array
    high: Array
    turns_low: NDArray[np.bool_]
    turns_high: NDArray[np.bool_]


def stretch(function: Function, low: float, high: float, sign: float, count: int) -> Stretch:
    """Find where sign·f' > 0 in the open interval, f having at most one turning point there."""
    inset = INSET * (high - low)
    a, b = np.full(count, low + inset), np.full(count, high - inset)
    at_a, at_b = sign * function(a)[1] > 0, sign * function(b)[1] > 0
    left, right = a.copy(), b.copy()
    turns = bool(np.any(at_a != at_b))
    for _ in range(60 if turns else 0):  # bisection on f', down to neighbouring numbers
        middle = 0.5 * (left + right)
        like_a = (sign * function(middle)[1] > 0) == at_a
        left, right = np.where(like_a, middle, left), np.where(like_a, right, middle)
    none = ~at_a & ~at_b
    starts = np.where(at_a, a, right)
    ends = np.where(at_b, b, left)
    return Stretch(
        np.where(none, np.nan, starts), np.where(none, np.nan, ends), ~at_a & at_b, at_a & ~at_b
    )


def solve(function: Function, value: Array, where: Stretch, sign: float) -> Array:
    """Solve f(x) = value on the stretch by Newton's method, with bisection where that is unsafe.

    Args:
        function: f and f'.
        value: Right-hand sides, shape (M,).
        where: From `stretch`.
        sign: The sign of f' on it.

    Returns:
        x, shape (M,); NaN where the stretch does not reach the value.
    """
    low, high = where.low.copy(), where.high.copy()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        reached = (sign * (value - function(low)[0]) >= 0) & (
            sign * (function(high)[0] - value) >= 0
        )
        x, last, open_ = 0.5 * (low + high), high - low, reached.copy()
        for _ in range(_STEPS):
            f, slope = function(x)
            too_far = sign * (f - value) > 0
            low, high = np.where(too_far, low, x), np.where(too_far, x, high)
            newton = x - (f - value) / slope
            safe = (newton >= low) & (newton <= high) & (np.abs(newton - x) < 0.5 * np.abs(last))
            following = np.where(safe, newton, 0.5 * (low + high))
            open_ &= np.abs(f - value) > 1e-16 * np.abs(value)
            last, x = np.where(open_, following - x, 0.0), np.where(open_, following, x)
            open_ &= np.abs(last) > 2e-16 * (1e-6 + np.abs(x))
            if not np.any(open_):
                break
    return np.where(reached, x, np.nan)
