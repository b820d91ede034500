"""Solve f(x) = y on the part of an interval where f rises, or falls; vectorised.

f may have one turning point in the interval, which need not be known: the sign of f' tells whether
a point is beyond the turning point, and such points count as too far. Newton's method runs inside a
shrinking bracket, and bisects if a Newton step leaves the bracket or the part, or does not halve
the last step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.support.arrays import Array

WithSlope = Callable[[Array], tuple[Array, Array]]
"""A function from x (M,) to f(x) and f'(x), each (M,)."""

INSET = 1e-10
"""Distance from the ends of an open interval at which f is evaluated, relative to its width."""

_STEPS = 200


@dataclass(frozen=True)
class Preimage:
    """Solution of f(x) = value on the chosen part of the interval.

    Attributes:
        x: The solution, shape (M,); without one, the nearest point of the part. NaN where f' never
            has the wanted sign, and where the value is NaN.
        exists: Whether there is a solution.
        short_low: Amount by which sign·value is below sign·f at the low end; 0 if it is not.
        short_high: Amount by which sign·value is above sign·f at the high end; 0 if it is not.
        short_turn: Amount by which the value is beyond f at the turning point; 0 if it is not.
    """

    x: Array
    exists: NDArray[np.bool_]
    short_low: Array
    short_high: Array
    short_turn: Array


def inverse(function: WithSlope, value: Array, low: float, high: float, sign: float) -> Preimage:
    """Solve f(x) = value where sign·f' > 0 in the open interval (low, high).

    Args:
        function: f and f', with at most one turning point in the interval.
        value: Right-hand sides, shape (M,).
        low: Lower end of the interval.
        high: Upper end.
        sign: 1 for the part where f rises, −1 where it falls.
    """
    inset = INSET * (high - low)
    a, b = np.full(value.shape, low + inset), np.full(value.shape, high - inset)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        (gap_a, at_a), (gap_b, at_b) = (_newton_step(function, x, value, sign)[:2] for x in (a, b))
        below, above = at_a & (gap_a <= 0), at_b & (gap_b >= 0)
        none = (~at_a & ~at_b) | np.isnan(value)
        outside = none | (at_a & (gap_a > 0)) | (at_b & (gap_b < 0))
        x, under_seen, over_seen = _search(
            function, value, sign, (a, b), (at_a, at_b), (below, above), ~outside
        )
        exists = under_seen & over_seen & ~outside
        x = np.where(at_a & (gap_a > 0), a, np.where(at_b & (gap_b < 0), b, x))
        gap = np.abs(function(x)[0] - value)
    return Preimage(
        x=np.where(none, np.nan, x),
        exists=exists,
        short_low=np.where(~none & at_a & (gap_a > 0), gap_a, 0.0),
        short_high=np.where(~none & at_b & (gap_b < 0), -gap_b, 0.0),
        short_turn=np.where(~exists & ~outside, gap, 0.0),
    )


def _newton_step(
    function: WithSlope, x: Array, value: Array, sign: float
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Return sign·(f(x) − value), whether sign·f'(x) > 0, and x after a Newton step."""
    f, slope = function(x)
    return sign * (f - value), sign * slope > 0, x - (f - value) / slope


def _search(
    function: WithSlope,
    value: Array,
    sign: float,
    bracket: tuple[Array, Array],
    on_stretch: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    seen: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    active: NDArray[np.bool_],
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Search f(x) = value in a bracket; return x, and whether f ≤ value and f ≥ value were met.

    Args:
        function: f and f'.
        value: Right-hand sides, shape (M,).
        sign: Sign of f' on the part of the interval that is searched.
        bracket: Low and high ends of the search, each (M,).
        on_stretch: Whether the low and the high end lie on that part.
        seen: Whether sign·f ≤ sign·value and sign·f ≥ sign·value are known to occur, at the ends.
        active: Mask of the equations to solve.
    """
    (low, high), (below, above) = bracket, seen
    turn_is_high = on_stretch[0] & ~on_stretch[1]
    x, last = 0.5 * (low + high), high - low
    for _ in range(_STEPS):
        gap, ok, newton = _newton_step(function, x, value, sign)
        below, above = below | (ok & (gap <= 0)), above | (ok & (gap >= 0))
        too_far = np.where(ok, gap > 0, turn_is_high)
        low, high = np.where(too_far, low, x), np.where(too_far, x, high)
        safe = ok & (newton >= low) & (newton <= high) & (np.abs(newton - x) < 0.5 * np.abs(last))
        settled = active & safe & (np.abs(newton - x) <= 2e-16 * (1e-6 + np.abs(x)))
        below, above = below | settled, above | settled
        following = np.where(safe, newton, 0.5 * (low + high))
        active = active & ~(ok & (np.abs(gap) <= 1e-16 * np.abs(value)))
        last, x = np.where(active, following - x, 0.0), np.where(active, following, x)
        active = active & (np.abs(last) > 2e-16 * (1e-6 + np.abs(x)))
        if not np.any(active):
            break
    return x, below, above
