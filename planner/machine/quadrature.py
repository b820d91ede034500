"""Integrals over a step from values at its start, middle and end: the first axis of an array."""

from __future__ import annotations

import numpy as np

from planner.systems.base import Array


def to_middle(f: Array, h: float) -> Array:
    """From the start to the middle of a step of length h; exact for parabolas."""
    return np.asarray((5 * h / 24) * f[0] + (8 * h / 24) * f[1] - (h / 24) * f[2])


def to_end(f: Array, h: float) -> Array:
    """From the start to the end, Simpson's rule; exact for cubics."""
    return np.asarray((h / 6) * (f[0] + f[2]) + (4 * h / 6) * f[1])
