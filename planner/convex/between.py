"""The band checked between the nodes: proven bounds on the polynomial pieces, not samples.

On an interval, z₃ lies between the least and greatest of its Bernstein coefficients, and there a
concave cap lies above its chord. So

    p − cap(z₃) ≤ p − chord(z₃) ≤ greatest Bernstein coefficient of the polynomial p − chord(z₃)

and halving the interval (de Casteljau) tightens the bound with the square of its length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.convex.band import Band
from planner.systems.base import Array

Indices = NDArray[np.intp]

MAX_HALVINGS = 40

COARSE = 0.02
"""Where a limit is broken, how finely the breach is located, relative to the worst one."""


@dataclass(frozen=True)
class Excess:
    """How far the pieces exceed a limit.

    Attributes:
        proven: No point of any piece exceeds it by more than this.
        piece: Piece numbers (k,) whose excess is above the tolerance.
        local: Where in each of them it is greatest, as a fraction of the piece, shape (k,).
        value: The excess there, shape (k,).
    """

    proven: float
    piece: Indices
    local: Array
    value: Array


NO_EXCESS = Excess(-np.inf, np.zeros(0, int), np.zeros(0), np.zeros(0))


def floor_excess(band: Band, z2: Array, tolerance: float, proof: bool) -> Excess:
    """Where p falls below the floor.

    Args:
        band: The floor.
        z2: Bernstein coefficients (d+1, pieces) of z₂.
        tolerance: Precision of the bound; coarser where the floor is broken by more.
        proof: Refine pieces that seem to keep the floor until that is proven, or disproven.
    """
    if not np.isfinite(band.floor):
        return NO_EXCESS
    polynomial = band.floor - band.sign * z2.T
    return _search(polynomial, np.zeros((len(polynomial), 1)), None, tolerance, proof)


def cap_excess(band: Band, z2: Array, z3: Array, tolerance: float, proof: bool) -> Excess:
    """Where p rises above the cap; with z₃ by Bernstein coefficients (e+1, pieces) beside z₂."""
    if not band.complete:
        return NO_EXCESS
    return _search(band.sign * z2.T, z3.T, band, tolerance, proof)


def _search(p: Array, z: Array, band: Band | None, tolerance: float, proof: bool) -> Excess:
    """Branch and bound on all pieces at once; p (pieces, d+1), z (pieces, e+1)."""
    pieces = len(p)
    p = _elevate(p, z.shape[1] - 1)
    best, where = np.full(pieces, -np.inf), np.zeros(pieces)
    proven = -np.inf
    piece, low, width = np.arange(pieces), np.zeros(pieces), 1.0
    for _ in range(MAX_HALVINGS):
        for end, at in ((0, low), (-1, low + width)):
            value = p[:, end] - (0.0 if band is None else band.cap(z[:, end]))
            _keep_best(best, where, piece, value, at)
        bound = _upper_bound(p, z, band)
        broken = best[piece] > 0 if proof else True
        slack = max(tolerance, COARSE * float(best.max()))
        open_ = bound > np.where(broken, np.maximum(best[piece], 0.0) + slack, 0.0)
        proven = max(proven, float(np.max(bound[~open_], initial=-np.inf)))
        if not open_.any():
            break
        p, z = _halves(p[open_]), _halves(z[open_])
        width /= 2
        piece = np.concatenate([piece[open_]] * 2)
        low = np.concatenate([low[open_], low[open_] + width])
    else:
        proven = max(proven, float(np.max(_upper_bound(p, z, band))))
    bad = np.flatnonzero(best > tolerance)
    return Excess(proven, bad, where[bad], best[bad])


def _keep_best(best: Array, where: Array, piece: Indices, value: Array, at: Array) -> None:
    order = np.argsort(value, kind="stable")  # the last of equal pieces wins, so the greatest
    piece, value, at = piece[order], value[order], at[order]
    top = np.full(len(best), -np.inf)
    place = np.zeros(len(best))
    top[piece], place[piece] = value, at
    better = top > best
    best[better], where[better] = top[better], place[better]


def _upper_bound(p: Array, z: Array, band: Band | None) -> Array:
    if band is None:
        return np.asarray(p.max(axis=1))
    low, high = z.min(axis=1), z.max(axis=1)
    at_low, at_high = band.cap(low), band.cap(high)
    rise = high - low
    slope = np.divide(at_high - at_low, rise, out=np.zeros_like(rise), where=rise > 0)
    chord = at_low[:, None] + slope[:, None] * (z - low[:, None])
    inside = (low >= band.z3_range[0]) & (high <= band.z3_range[1])
    chord[~inside] = 0.0  # beyond its domain the cap is taken as zero, which is not concave
    return np.asarray((p - chord).max(axis=1))


def _elevate(c: Array, degree: int) -> Array:
    """Bernstein coefficients (k, d+1) written at a higher degree."""
    while c.shape[1] - 1 < degree:
        share = np.arange(c.shape[1] + 1) / c.shape[1]
        c = share * np.concatenate([c[:, :1], c], 1) + (1 - share) * np.concatenate(
            [c, c[:, -1:]], 1
        )
    return c


def _halves(c: Array) -> Array:
    """Both halves of every interval by de Casteljau: (k, d+1) to (2k, d+1), left halves first."""
    left, right, row = [c[:, 0]], [c[:, -1]], c
    while row.shape[1] > 1:
        row = (row[:, 1:] + row[:, :-1]) / 2
        left.append(row[:, 0])
        right.append(row[:, -1])
    return np.concatenate([np.stack(left, 1), np.stack(right[::-1], 1)])
