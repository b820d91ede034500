"""Motions of the chained form under sinusoids, to rounding error.

The pieces of time are so short that what the highest harmonic leaves out of the interpolants is
below rounding.
"""

from __future__ import annotations

from math import pi

import numpy as np
from scipy.interpolate import BPoly

from planner.pieces import Grid
from planner.systems.base import Array

_PHASE = 2.4
"""Radians of the highest harmonic on one piece: the interpolant of degree 14 errs by
2 (h/2)¹⁵/15! = 7e-16 of it, with h half of that."""


def period(start: float, end: float, harmonics: int) -> Grid:
    """Equal pieces over one period, fine enough for functions of that many harmonics."""
    pieces = max(4, int(np.ceil(2 * pi * harmonics / _PHASE)))
    return Grid(np.linspace(start, end, pieces + 1))


def propagate(grid: Grid, start: Array, v1: Array, v2: Array) -> Array:
    """Values of z at the grid's points.

    Args:
        grid: Pieces and points.
        start: z at the first break, shape (N, …).
        v1: Values of v₁, shape (P, DEGREE+1).
        v2: Values of v₂, shape (P, DEGREE+1, …).

    Returns:
        Shape (P, DEGREE+1, N, …).
    """
    first = v1.reshape(*v1.shape, *[1] * (v2.ndim - 2))
    path = grid.integral(first)
    columns = [start[0] + np.broadcast_to(path, v2.shape), start[1] + grid.integral(v2)]
    for i in range(2, len(start)):
        columns.append(start[i] + grid.integral(columns[-1] * first))
    return np.stack(columns, axis=2)


def joined(curves: list[BPoly]) -> BPoly:
    """Curves of one degree that follow each other in time, as one."""
    breaks = np.concatenate([curves[0].x[:1], *(c.x[1:] for c in curves)])
    return BPoly(np.concatenate([c.c for c in curves], axis=1), breaks)
