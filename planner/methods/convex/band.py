"""The convex part of the chart's domain, between a floor and a concave cap on ±z₂, and its excess.

    n = 2:  p = z₂            0 < p < K₂                    cos³θ₁ = p/K₂
    n = 3:  p = −sign(θ₂) z₂  0 < p < g(z₃)                 cos²θ₁ = p/g(z₃)
            g(z₃) = 3K₂K₃ c²√(1−c²),  c = cosθ₂ = (z₃/K₃)^{1/3},  concave on (0, K₃)

For n = 2 and 3 the band is the whole domain. The cap is lowered by the factor that keeps
sin²θ₁ ≥ edge, and the floor is raised to the required margin; both keep the set convex. The sign of
θ₁ does not matter, since the cap depends on cos²θ₁. For longer chains and other systems the band is
only the margin of z₂.

That a path stays in the band between the nodes is proven, not sampled. On an interval, z₃ lies
between the least and greatest of its Bernstein coefficients, and there a concave cap lies above its
chord. So

    p − cap(z₃) ≤ p − chord(z₃) ≤ greatest Bernstein coefficient of the polynomial p − chord(z₃)

and halving the interval (de Casteljau) tightens the bound with the square of its length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.support.calculus.bernstein import elevate, split
from planner.systems.manipulator import Manipulator

DEFAULT_FLOOR = 1e-4
"""Least |z₂| if the problem sets no margin; half of the smaller value at an end if that is less."""

Indices = NDArray[np.intp]

MAX_HALVINGS = 40

COARSE = 0.02
"""Accuracy with which an excess is located, relative to the largest excess."""


@dataclass(frozen=True)
class Band:
    """The set of chained coordinates with floor ≤ p ≤ cap(z₃), where p = sign · z₂.

    Attributes:
        sign: ±1.
        floor: Least p; −inf without a floor.
        cap_factor: Factor on g (n = 3) or K₂ (n = 2), < 1 to keep a distance from θ₁ = 0.
        K: Constants (K₂,) or (K₂, K₃) of the chained form; empty without a cap.
    """

    sign: float
    floor: float
    cap_factor: float
    K: Array

    @property
    def complete(self) -> bool:
        """Whether the band is the whole domain of the chart."""
        return len(self.K) > 0

    @property
    def edge(self) -> float:
        """Least sin²θ₁ inside the band, which the cap ensures."""
        return float(1 - self.cap_factor ** (2 / 3 if len(self.K) == 1 else 1))

    @property
    def words(self) -> str:
        """Conditions of the band in words, for the message that no path satisfies them."""
        if not self.complete:
            return f"with |z2| >= {self.floor:.4g}"
        parts = [f"|z2| >= {self.floor:.4g}"] if self.floor > 0 else []
        parts += [f"sin^2(theta1) >= {self.edge:.4g}"] if self.edge > 0 else []
        return "inside the chart's domain" + (f" with {' and '.join(parts)}" if parts else "")

    @property
    def z3_range(self) -> tuple[float, float]:
        """Range of z₃ in which the cap is concave."""
        return (0.0, float(self.K[1])) if len(self.K) == 2 else (-np.inf, np.inf)

    @property
    def top(self) -> float:
        """Greatest value of the cap."""
        if len(self.K) == 1:
            return float(self.cap_factor * self.K[0])
        return float(self.cap_factor * 2 * self.K[0] * self.K[1] / np.sqrt(3))

    def cap(self, z3: Array) -> Array:
        """Return the greatest p in the band at z₃, same shape; z₃ is clipped to [0, K₃]."""
        if len(self.K) == 1:
            return np.full(np.shape(z3), self.cap_factor * self.K[0])
        c2 = np.clip(z3 / self.K[1], 0.0, 1.0) ** (2 / 3)
        return np.asarray(3 * self.cap_factor * self.K[0] * self.K[1] * c2 * np.sqrt(1 - c2))

    def tangent(self, z3: Array) -> tuple[Array, Array]:
        """Return the tangent of the cap, slope · z₃ + offset, at z₃ moved slightly into (0, K₃).

        Returns:
            (slope, offset), each of the shape of z₃; the cap lies on or below the tangent.
        """
        if len(self.K) == 1:
            return np.zeros(np.shape(z3)), self.cap(z3)
        x = np.clip(z3, 1e-9 * self.K[1], (1 - 1e-9) * self.K[1])
        c = np.cbrt(x / self.K[1])
        slope = self.cap_factor * self.K[0] * (2 - 3 * c**2) / (c * np.sqrt(1 - c**2))
        return np.asarray(slope), np.asarray(self.cap(x) - slope * x)


def band_of(problem: Problem, start: Array, goal: Array, edge: float) -> Band:
    """Return the band of a problem whose start and goal lie in one branch of the chart.

    Args:
        problem: The problem, for the constants, the margin of z₂ and, for n = 2, the limit of θ₁.
        start: z(0), shape (N,).
        goal: z(T), shape (N,).
        edge: Least sin²θ₁ wanted; half of the value at start or goal if that is less.
    """
    system, margin = problem.system, problem.limits.z2_margin
    if not isinstance(system, Manipulator) or system.n > 3:
        floor = -np.inf if margin is None else margin
        return Band(problem.z2_sign or 1.0, floor, 1.0, np.zeros(0))
    two = system.n == 2
    sign = 1.0 if two else -float(problem.branch[2])
    ends = sign * np.array([start[1], goal[1]])
    floor = min(DEFAULT_FLOOR, float(ends.min()) / 2) if margin is None else margin
    if two and np.isfinite(problem.limits.joint[1]):
        floor = max(floor, float(system.K[0] * np.cos(problem.limits.joint[1]) ** 3))
    widest = Band(sign, floor, 1.0, system.K)
    nearest = float(np.min(1 - ends / widest.cap(np.array([start[2], goal[2]]))))
    share = min(1 - (1 - edge) ** 1.5 if two else edge, nearest / 2)
    return Band(sign, floor, 1 - share, system.K)


@dataclass(frozen=True)
class Excess:
    """Excess of a piecewise polynomial over the floor or cap of a band.

    Attributes:
        proven: Proven upper bound of the excess on all pieces.
        piece: Numbers of the pieces whose excess is above the tolerance, shape (k,).
        local: Position of the greatest excess in each such piece, from 0 to 1, shape (k,).
        value: The excess at these positions, shape (k,).
    """

    proven: float
    piece: Indices
    local: Array
    value: Array


NO_EXCESS = Excess(-np.inf, np.zeros(0, int), np.zeros(0), np.zeros(0))


def floor_excess(band: Band, z2: Array, tolerance: float, proof: bool) -> Excess:
    """Find where p = ±z₂ falls below the floor of a band, and bound by how much.

    Args:
        band: The band with the floor.
        z2: Bernstein coefficients (d+1, pieces) of z₂.
        tolerance: Precision of the proven bound; a large excess is bounded less precisely.
        proof: Whether to refine pieces that seem to keep the floor until this is proven or
            disproven.
    """
    if not np.isfinite(band.floor):
        return NO_EXCESS
    return _search(band.floor - band.sign * z2, np.zeros_like(z2[:1]), None, tolerance, proof)


def cap_excess(band: Band, z2: Array, z3: Array, tolerance: float, proof: bool) -> Excess:
    """Find where p = ±z₂ rises above the cap at z₃, from Bernstein coefficients (d+1, pieces)."""
    if not band.complete:
        return NO_EXCESS
    return _search(band.sign * z2, z3, band, tolerance, proof)


def _search(p: Array, z: Array, band: Band | None, tolerance: float, proof: bool) -> Excess:
    """Find where p exceeds cap(z), or 0 without a band, on all pieces at once by branch and bound.

    Args:
        p: Bernstein coefficients, shape (d+1, pieces).
        z: Bernstein coefficients of z₃, shape (e+1, pieces).
        band: The band with the cap, or None.
        tolerance: See `floor_excess`.
        proof: See `floor_excess`.
    """
    pieces = p.shape[1]
    p = elevate(p, max(len(p), len(z)) - 1)
    best, where = np.full(pieces, -np.inf), np.zeros(pieces)
    proven = -np.inf
    piece, low, width = np.arange(pieces), np.zeros(pieces), 1.0
    for _ in range(MAX_HALVINGS):
        for end, tau in ((0, low), (-1, low + width)):
            value = p[end] - (0.0 if band is None else band.cap(z[end]))
            _keep_best(best, where, piece, value, tau)
        bound = _upper_bound(p, z, band)
        is_violated = best[piece] > 0 if proof else True
        slack = max(tolerance, COARSE * float(best.max()))
        open_ = bound > np.where(is_violated, np.maximum(best[piece], 0.0) + slack, 0.0)
        proven = max(proven, float(np.max(bound[~open_], initial=-np.inf)))
        if not open_.any():
            break
        p, z = (np.concatenate(split(c[:, open_], 0.5), axis=1) for c in (p, z))
        width /= 2
        piece = np.concatenate([piece[open_]] * 2)
        low = np.concatenate([low[open_], low[open_] + width])
    else:
        proven = max(proven, float(np.max(_upper_bound(p, z, band))))
    bad = np.flatnonzero(best > tolerance)
    return Excess(proven, bad, where[bad], best[bad])


def _keep_best(best: Array, where: Array, piece: Indices, value: Array, tau: Array) -> None:
    order = np.argsort(value, kind="stable")  # the last value for a piece, the greatest, wins
    piece, value, tau = piece[order], value[order], tau[order]
    top = np.full(len(best), -np.inf)
    place = np.zeros(len(best))
    top[piece], place[piece] = value, tau
    better = top > best
    best[better], where[better] = top[better], place[better]


def _upper_bound(p: Array, z: Array, band: Band | None) -> Array:
    if band is None:
        return np.asarray(p.max(axis=0))
    low, high = z.min(axis=0), z.max(axis=0)
    at_low, at_high = band.cap(low), band.cap(high)
    rise = high - low
    slope = np.divide(at_high - at_low, rise, out=np.zeros_like(rise), where=rise > 0)
    chord = at_low + slope * (z - low)
    inside = (low >= band.z3_range[0]) & (high <= band.z3_range[1])
    chord[:, ~inside] = 0.0  # outside its domain the cap counts as zero, which is not concave
    return np.asarray((p - chord).max(axis=0))
