"""Inputs of retimed paths as models in time: polynomials of polynomials.

With s = clock(t) and σ the path's own time, length(σ) = s. An interpolant of σ(t) is proven by what
length(σ(t)) − clock(t) leaves over, divided by the least slope of the length. Then

    u = w σ̇,   du/dt = w' σ̇² + w σ̈,   σ̇ = ṡ/length',   σ̈ = (s̈ − length'' σ̇²)/length'

with w the path's inputs at σ. Where the path stands still (length' = 0) nothing is bounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from planner.certificate import series
from planner.certificate.cells import Cells, derivative, slopes
from planner.certificate.functions import reciprocal
from planner.certificate.model import UNIT, Model, interpolated
from planner.retimed import RetimedTrajectory
from planner.systems.base import Array

TRUST = 1e-8
"""Distance of σ's interpolant from σ allowed beforehand, over the path's own duration."""


@dataclass(frozen=True, eq=False)
class Clocked:
    """A retimed path's own time on cells of time.

    Attributes:
        sigma: Model of σ(t), seconds of the path.
        pace: Model of dσ/dt.
        bend: Model of d²σ/dt².
    """

    sigma: Model
    pace: Model
    bend: Model


def clocked(trajectory: RetimedTrajectory, cells: Cells) -> Clocked:
    """σ and its derivatives on cells of the clock's pieces."""
    length, clock = trajectory.length, trajectory.clock
    own = trajectory.place(cells.times(series.nodes()))
    guess = Model(interpolated(own), np.zeros(len(cells.piece)))

    def along(order: int, sigma: Model) -> Model:
        return at(length, order, trajectory, cells, sigma)[0]

    (s,), (speed,), (gain,) = (slopes(clock, cells, order) for order in range(3))
    defect = (along(0, guess) - s).size
    trust = np.full(len(defect), TRUST * length.x[-1])
    steep = along(1, guess.widened(trust)).low
    error = np.where(steep > 0, defect / steep, np.inf)
    sigma = guess.widened(np.where(error <= trust, error, np.inf))
    over = reciprocal(along(1, sigma))
    pace = speed * over
    return Clocked(sigma, pace, (gain - along(2, sigma) * pace * pace) * over)


def at(
    curve: BPoly, order: int, trajectory: RetimedTrajectory, cells: Cells, sigma: Model
) -> list[Model]:
    """A derivative of a piecewise polynomial of the path's own time, at models of it.

    Every cell of the clock lies in one piece of the curve.
    """
    curve, slip = derivative(curve, order)
    stations = trajectory.stations
    middle = (stations[cells.piece] + stations[cells.piece + 1]) / 2
    piece = np.clip(np.searchsorted(curve.x, middle, side="right") - 1, 0, len(curve.x) - 2)
    left, width = curve.x[piece], np.diff(curve.x)[piece]
    x = (sigma - Model(left[:, None], np.zeros(len(left)))).scaled(2 / width) - 1.0
    x = x.widened(4 * UNIT * x.size)
    matrix = series.from_bernstein(len(curve.c))
    grown = (len(curve.c) + 4) * np.sum(np.abs(matrix)) * UNIT
    size = np.max(np.abs(curve.c), axis=0)
    rounding = (slip + grown * size)[piece]
    return [
        _clenshaw(curve.c[:, piece, i].T @ matrix.T, x).widened(rounding[:, i])
        for i in range(curve.c.shape[2])
    ]


def _clenshaw(c: Array, x: Model) -> Model:
    """Σ cₖ Tₖ(x) for coefficients (C, d+1), one row a cell."""
    zero = np.zeros(len(c))
    later, last = Model.constant(0.0, len(c)), Model.constant(0.0, len(c))
    for k in range(c.shape[1] - 1, 0, -1):
        later, last = Model(c[:, k : k + 1], zero) + x * later * 2.0 - last, later
    return Model(c[:, :1], zero) + x * later - last
