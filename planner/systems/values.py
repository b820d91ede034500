"""Small helpers the systems share: constants that must be positive, products, a planar arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.systems.base import Array


def positive(name: str, values: Sequence[float]) -> Array:
    """The values as an array, each positive and finite.

    Raises:
        InputError: If one is not, or there is none; names it.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 1 or array.size == 0 or not np.all(np.isfinite(array) & (array > 0)):
        raise InputError(f"{name} = {list(np.ravel(values))} must be positive finite numbers")
    return array


def product(factors: Sequence[Any]) -> Any:
    """Product of numbers, arrays or CasADi expressions; 1 when there is none."""
    out: Any = 1.0
    for factor in factors:
        out = out * factor
    return out


def arm_points(theta: Array, lengths: Array) -> Array:
    """Forward kinematics of a planar arm.

    Args:
        theta: Joint angles, shape (…, n), radians; each measured from the link before.
        lengths: Link lengths, shape (n,).

    Returns:
        Base, joints and tip, shape (…, n+1, 2), in the unit of `lengths`.
    """
    heading = np.cumsum(theta, axis=-1)
    steps = lengths[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    base = np.zeros((*steps.shape[:-2], 1, 2))
    return np.concatenate([base, np.cumsum(steps, axis=-2)], axis=-2)
