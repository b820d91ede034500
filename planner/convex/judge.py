"""The requirements between the samples: a fine grid, refined twice about every near breach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.convex.look import Samples
from planner.convex.sampled import Sampled
from planner.systems.base import Array

DENSE = 33
"""Points a piece of the first grid."""

FINE = 17
"""Points between two neighbours of a peak, at each refinement."""

CLOSE = 0.01
"""Peaks with h above minus this are refined."""


@dataclass(frozen=True)
class Verdict:
    """What the judge finds.

    Attributes:
        worst: Greatest h; infinite outside the chart's domain, −1 if nothing is required.
        breaches: The worst point of every piece where h > 0.
    """

    worst: float
    breaches: Samples


def judge(at: Callable[[Samples], Sampled], pieces: int, y: Array, t: float = 1.0) -> Verdict:
    """Judge the path of y.

    Args:
        at: The requirements at given samples.
        pieces: Number of pieces of the path.
        y: Free coefficients.
        t: Level that scales the input limits.
    """
    grid = Samples.dense(pieces, DENSE)
    h = at(grid).values(y, t)
    none = Samples(np.zeros(0, int), np.zeros(0))
    if h is None:
        return Verdict(np.inf, _lost(grid, at(grid).lost(y), pieces))
    if not len(h):
        return Verdict(-1.0, none)
    local = np.tile(grid.local[:DENSE], (pieces, 1))
    peak = h.reshape(-1, pieces, DENSE)
    which, piece = np.nonzero(peak.max(axis=2) > -CLOSE)
    values, place = peak[which, piece], local[piece]
    for _ in range(2):
        if not len(piece):
            break
        place = _between(place, np.argmax(values, axis=1))
        fine = at(Samples(np.repeat(piece, FINE), place.ravel())).values(y, t)
        if fine is None:
            return Verdict(np.inf, none)
        values = fine.reshape(-1, len(piece), FINE)[which, np.arange(len(piece))]
    worst = max(float(h.max()), float(values.max(initial=-1.0)))
    return Verdict(worst, _breaches(piece, place, values))


def _lost(grid: Samples, lost: NDArray[np.bool_], pieces: int) -> Samples:
    """The middle one of the lost points of every piece that has any."""
    table = lost.reshape(pieces, DENSE)
    piece = np.flatnonzero(table.any(axis=1))
    middle = [np.flatnonzero(table[k])[table[k].sum() // 2] for k in piece]
    return Samples(piece, grid.local[:DENSE][np.array(middle, dtype=int)])


def _between(place: Array, k: Array) -> Array:
    """Fine points between the neighbours of point k of every row: (C, m) to (C, FINE)."""
    rows = np.arange(len(place))
    low = place[rows, np.maximum(k - 1, 0)]
    high = place[rows, np.minimum(k + 1, place.shape[1] - 1)]
    return np.asarray(low[:, None] + (high - low)[:, None] * np.linspace(0, 1, FINE))


def _breaches(piece: NDArray[np.intp], place: Array, values: Array) -> Samples:
    best = np.argmax(values, axis=1) if len(piece) else np.zeros(0, int)
    rows = np.arange(len(piece))
    top, where = values[rows, best], place[rows, best]
    order = np.argsort(-top, kind="stable")
    order = order[top[order] > 0]
    _, first = np.unique(piece[order], return_index=True)
    kept = order[first]
    return Samples(piece[kept], where[kept])
