"""The least value of many functions over many cells: bounds from both sides, by halving.

Bernstein coefficients bound a polynomial from below, and halving a cell (de Casteljau) tightens the
bound with the square of its width. Only cells that may hold the least value are halved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.certificate import series
from planner.certificate.cells import Cells
from planner.certificate.model import UNIT, Index, Model
from planner.systems.base import Array

MOST_HALVINGS = 40
RESOLVED = 1e-9
"""Distance of the two bounds at which halving stops, over the function's scale."""


@dataclass(frozen=True)
class Least:
    """The least value of one function over all cells.

    Attributes:
        guaranteed: The function is nowhere less.
        attained: It is no greater than this at `time_s`.
        time_s: Seconds.
    """

    guaranteed: float
    attained: float
    time_s: float


def least(functions: list[Model], cells: Cells, scales: Array) -> list[Least]:
    """Bounds on the least value of each function.

    Args:
        functions: Each a model on the cells.
        cells: Where.
        scales: What each function's values are compared with, shape (F,).
    """
    count, number = len(functions), len(cells.piece)
    width = max(f.c.shape[1] for f in functions)
    c = np.concatenate([np.pad(f.c, ((0, 0), (0, width - f.c.shape[1]))) for f in functions])
    matrix = series.to_bernstein(width)
    b = c @ matrix.T
    r = np.concatenate([f.r for f in functions])
    r = r + (width + 2) * UNIT * np.max(np.abs(c) @ np.abs(matrix).T, axis=1)
    unbounded = ~np.isfinite(r)
    b, r = np.where(unbounded[:, None], 0.0, b), np.where(unbounded, np.inf, r)
    which, cell = np.repeat(np.arange(count), number), np.tile(np.arange(number), count)
    return _search(b, r, which, cell, cells, scales)


def _search(
    b: Array, r: Array, which: Index, cell: Index, cells: Cells, scales: Array
) -> list[Least]:
    count = len(scales)
    slack = 2 * b.shape[1] * UNIT * np.max(np.abs(b), axis=1)  # of one halving
    low, size = np.zeros(len(b)), 1.0
    closed = np.full(count, np.inf)
    best, when = np.full(count, np.inf), np.full(count, np.nan)
    for step in range(MOST_HALVINGS + 1):
        for end, at in ((0, low), (-1, low + size)):
            _keep_least(best, when, which, b[:, end] + r, cell, at, cells)
        bound = np.min(b, axis=1) - r
        wanted = np.minimum(best, np.inf) - RESOLVED * scales
        open_ = (bound < wanted[which]) & (np.min(b, axis=1) + r < best[which])
        open_ &= np.isfinite(r) & (step < MOST_HALVINGS)
        np.minimum.at(closed, which[~open_], bound[~open_])
        if not np.any(open_):
            break
        b, r, slack = (
            _halves(b[open_]),
            np.tile(r[open_] + slack[open_], 2),
            np.tile(slack[open_], 2),
        )
        size /= 2
        which, cell = np.tile(which[open_], 2), np.tile(cell[open_], 2)
        low = np.append(low[open_], low[open_] + size)
    return [Least(float(closed[k]), float(best[k]), float(when[k])) for k in range(count)]


def _keep_least(
    best: Array, when: Array, which: Index, value: Array, cell: Index, at: Array, cells: Cells
) -> None:
    order = np.lexsort((value, which))
    first = order[np.unique(which[order], return_index=True)[1]]
    better = first[value[first] < best[which[first]]]
    if len(better):
        some = cells.only(cell[better])
        best[which[better]] = value[better]
        when[which[better]] = some.times(2 * at[better, None] - 1)[:, 0]


def _halves(b: Array) -> Array:
    """Both halves by de Casteljau: (k, d+1) to (2k, d+1), left halves first."""
    left, right, row = [b[:, 0]], [b[:, -1]], b
    while row.shape[1] > 1:
        row = (row[:, 1:] + row[:, :-1]) / 2
        left.append(row[:, 0])
        right.append(row[:, -1])
    return np.concatenate([np.stack(left, 1), np.stack(right[::-1], 1)])
