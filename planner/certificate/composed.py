"""Inputs of retimed paths as balls in time: polynomials of polynomials.

With s = clock(t) and σ the path's own time, length(σ) = s. A polynomial g(t) near σ(t) is proven by
what d = length(g) − clock leaves over: where Re length' ≥ m > 0 on the disc of radius η > |d|/m
about g, length − clock is one-to-one there and has, by Rouché's theorem, its one root within |d|/m
of g, on the real line and on every ellipse. Then

    u = w σ̇,   du/dt = w' σ̇² + w σ̈,   σ̇ = ṡ/length',   σ̈ = (s̈ − length'' σ̇²)/length'

with w the path's inputs at σ. Where the path stands still (length' = 0) nothing is bounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from planner.certificate import series
from planner.certificate.balls import Ball, polynomial_balls, reciprocal
from planner.certificate.cells import Cells, derivative, on
from planner.certificate.model import INFLATE, UNIT
from planner.retimed import RetimedTrajectory
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Clocked:
    """A retimed path's own time on cells of time.

    Attributes:
        sigma: Ball of σ(t), seconds of the path.
        pace: Ball of dσ/dt.
        bend: Ball of d²σ/dt².
    """

    sigma: Ball
    pace: Ball
    bend: Ball


def clocked(trajectory: RetimedTrajectory, cells: Cells) -> Clocked:
    """σ and its derivatives on cells of the clock's pieces."""
    length, clock = trajectory.length, trajectory.clock
    own = trajectory.place(cells.times(series.nodes())) @ series.interpolation().T
    (guess,) = polynomial_balls(own[None], np.zeros((1, len(own))))

    def along(order: int, sigma: Ball) -> Ball:
        return at(length, order, trajectory, cells, sigma)[0]

    (s,), (speed,), (gain,) = (on(clock, cells, order) for order in range(3))
    gap = along(0, guess) - s
    defect = (np.abs(gap.c) + gap.reach) * INFLATE
    steep = along(1, guess)
    trust = 2 * defect / (steep.c - steep.reach)
    steep = along(1, guess.widened(trust))
    least = steep.c - steep.reach
    error = np.where(least > 0, defect / least * INFLATE, np.inf)
    proven = error < trust
    sigma = guess.widened(np.where(proven, error, np.inf))
    over = reciprocal(steep.widened(np.where(proven, 0.0, np.inf)))
    pace = speed * over
    return Clocked(sigma, pace, (gain - along(2, sigma) * pace * pace) * over)


def at(
    curve: BPoly, order: int, trajectory: RetimedTrajectory, cells: Cells, sigma: Ball
) -> list[Ball]:
    """A derivative of a piecewise polynomial of the path's own time, at balls of it.

    Every cell of the clock lies in one piece of the curve.
    """
    b, slip = derivative(curve, order)
    stations = trajectory.stations
    middle = (stations[cells.piece] + stations[cells.piece + 1]) / 2
    piece = np.clip(np.searchsorted(curve.x, middle, side="right") - 1, 0, len(curve.x) - 2)
    left, width = curve.x[piece, None], np.diff(curve.x)[piece, None]
    x = (sigma + Ball(-left, 0 * left, 0 * left)).scaled(2 / width) - 1.0
    x = x.widened(4 * UNIT * x.size)
    matrix = series.from_bernstein(len(b))
    grown = (len(b) + 4) * np.sum(np.abs(matrix)) * UNIT
    slips = (slip + grown * np.max(np.abs(b), axis=0))[piece]
    return _composite(b.transpose(2, 1, 0)[:, piece] @ matrix.T, slips.T[..., None], x)


def _composite(c: Array, slip: Array, x: Ball) -> list[Ball]:
    """p(x) = Σ cₖ Tₖ(x) for coefficients (k, C, width) that are wrong by slip (k, C, 1) together.

    rest = δ²/2 max|p''|. What lies within δ of c lies in the ellipse about [−1, 1] whose greater
    half axis is a = max(|c|, 1) + δ, where |Tₖ| ≤ Tₖ(a). Clenshaw's sums are wrong by no more than
    8 width² units of Σ |cₖ| Tₖ(a).
    """
    width, last = c.shape[2], np.zeros(c.shape)
    last[..., -1] = 1.0
    slope, bend = c @ series.slopes(width, 1).T, c @ series.slopes(width, 2).T
    far = (np.maximum(np.abs(x.c), 1.0) + x.reach) * INFLATE
    size, steepest, bent, top = _clenshaw(np.abs(np.stack([c, slope, bend, last])), far)
    value, steep = _clenshaw(np.stack([c, slope]), x.c)
    loose = 8 * width**2 * UNIT
    rest = x.reach**2 / 2 * (bent + width**4 * slip * top) * (1 + loose)
    wrong = loose * (size + x.reach * steepest) + slip * top * (1 + width**2 * x.reach)
    r = (np.abs(steep) * x.r + (rest + wrong) * (1 + loose)) * INFLATE
    return [Ball(*parts) for parts in zip(value, steep * x.b, r, strict=True)]


def _clenshaw(c: Array, x: Array) -> Array:
    """Σ cₖ Tₖ(x), for x (C, E) and coefficients (…, C, width)."""
    later = last = np.zeros((*c.shape[:-1], x.shape[-1]))
    twice = 2 * x
    for k in range(c.shape[-1] - 1, 0, -1):
        later, last = c[..., k, None] + twice * later - last, later
    return np.asarray(c[..., 0, None] + x * later - last)
