"""Integrals over a step from values at its points: both ends, or both ends and the middle.

Held commands are integrated with two points (the trapezoidal rule, order 2: at 1 ms its error is
far below every effect), continuous ones with three (Simpson's rule, order 4).
"""

from __future__ import annotations

import numpy as np

from planner.systems.base import Array


def integrals(f: Array, h: float) -> list[Array]:
    """From the start of a step of length h to each of its later points.

    Args:
        f: Values at the points; the first axis has 2 or 3.
        h: Length of the step.

    Returns:
        The integral to the end; or to the middle (exact for parabolas) and to the end (exact for
        cubics). Shapes are those of f without its first axis.
    """
    if len(f) == 2:
        return [(h / 2) * (f[0] + f[1])]
    return [(5 * h / 24) * f[0] + (8 * h / 24) * f[1] - (h / 24) * f[2], to_end(f, h)]


def to_end(f: Array, h: float) -> Array:
    """The last of `integrals` alone."""
    if len(f) == 2:
        return np.asarray((h / 2) * (f[0] + f[1]))
    return np.asarray((h / 6) * (f[0] + f[2]) + (4 * h / 6) * f[1])
