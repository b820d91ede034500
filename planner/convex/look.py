"""A path seen at sample points: coordinates, inputs, and their derivatives by z.

The path itself is evaluated from its polynomials. Derivatives follow the chain rule: ∂q/∂z is the
inverse of the chart's Jacobian, which CasADi gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from planner.chained import chained_form
from planner.convex.frame import Frame
from planner.convex.shape import Shape
from planner.systems.base import Array, TriangularSystem


@dataclass(frozen=True)
class Samples:
    """Points of the path: piece numbers and fractions of the piece, shape (M,) each."""

    piece: NDArray[np.intp]
    local: Array

    @classmethod
    def dense(cls, pieces: int, each: int) -> Samples:
        """Chebyshev–Lobatto points of every piece, both ends included."""
        unit = 0.5 - 0.5 * np.cos(np.pi * np.arange(each) / (each - 1))
        return cls(np.repeat(np.arange(pieces), each), np.tile(unit, pieces))

    @classmethod
    def sparse(cls, shape: Shape) -> Samples:
        """Both ends of every piece where ω jumps between them, else nodes and middles."""
        piece = np.repeat(np.arange(shape.pieces), 2)
        if shape.degree == 0:
            return cls(piece, np.tile([0.0, 1.0], shape.pieces))
        return cls(np.append(piece, piece[-1]), np.append(np.tile([0.0, 0.5], shape.pieces), 1.0))

    def plus(self, piece: NDArray[np.intp], local: Array) -> Samples:
        """These and more."""
        return Samples(np.concatenate([self.piece, piece]), np.concatenate([self.local, local]))


@dataclass(frozen=True)
class Look:
    """What is seen at M samples.

    Attributes:
        system: What is steered.
        q: Coordinates, shape (M, N).
        v: Chained inputs, shape (M, 2).
        feedback: (γ, ∂z₂/∂q₂, the part of v₂/v₁ that u₂ does not make), shape (M, 3).
    """

    system: TriangularSystem
    q: Array
    v: Array
    feedback: Array

    @property
    def drive(self) -> Array:
        """γ, shape (M,): v₁ = γ u₁."""
        return np.asarray(self.feedback[:, 0])

    @property
    def slope(self) -> Array:
        """∂z₂/∂q₂, shape (M,): what multiplies u₂ in v₂."""
        return np.asarray(self.feedback[:, 1])

    @property
    def turned(self) -> Array:
        """Slope times u₂, shape (M,)."""
        return np.asarray(self.v[:, 1] - self.feedback[:, 2] * self.v[:, 0])

    @cached_property
    def by_q(self) -> tuple[Array, Array]:
        """Derivatives of `feedback` by q (M, 3, N), and ∂q/∂z (M, N, N)."""
        N = self.system.size
        by_q, chart = (part.full().T for part in _derivatives(self.system)(ca.DM(self.q.T)))
        return by_q.reshape(-1, 3, N), np.asarray(np.linalg.inv(chart.reshape(-1, N, N)))


def look(
    system: TriangularSystem,
    branch: Array,
    frame: Frame,
    samples: Samples,
    y: Array,
    duration: float,
) -> Look | None:
    """The path of y at the samples; None if any of them lies outside the chart's domain."""
    q = coordinates(system, branch, frame, samples, y)
    if not np.all(np.isfinite(q)):
        return None
    omega = frame.shape.bernstein(frame.x(y))
    rate = omega[0, samples.piece]  # the piece's own value at its ends, where ω may jump
    if frame.shape.degree == 1:
        rate = rate + samples.local * (omega[1, samples.piece] - rate)
    v = np.stack([np.full(len(rate), frame.travel), rate], axis=1) / duration
    feedback = _feedback(system)(ca.DM(q.T)).full().T
    return Look(system, q, v, feedback)


def coordinates(
    system: TriangularSystem, branch: Array, frame: Frame, samples: Samples, y: Array
) -> Array:
    """q along the path of y, shape (M, N); NaN outside the chart's domain."""
    breaks = frame.shape.breaks
    tau = breaks[samples.piece] + samples.local / frame.shape.pieces
    rest = frame.bernstein(y)[1:]
    z = np.stack([frame.start[0] + frame.travel * tau, *(BPoly(c, breaks)(tau) for c in rest)], 1)
    return chained_form(system).q(z, branch)


def _feedback_expr(system: TriangularSystem) -> tuple[Any, Any, Any]:
    q = ca.SX.sym("q", system.size)
    chart = ca.jacobian(chained_form(system).z_expr(q), q)
    slopes = ca.vertcat(*system.slopes_expr(q))
    feedback = ca.vertcat(system.drive_expr(q), chart[1, 1], chart[1, 2:] @ slopes)
    return q, feedback, chart


@lru_cache(maxsize=16)
def _feedback(system: TriangularSystem) -> Any:
    """CasADi function q → feedback, by columns."""
    q, feedback, _ = _feedback_expr(system)
    return ca.Function("feedback", [q], [feedback])


@lru_cache(maxsize=16)
def _derivatives(system: TriangularSystem) -> Any:
    """CasADi function q → (derivatives of the feedback, Jacobian of the chart), row by row."""
    q, feedback, chart = _feedback_expr(system)
    by_q = ca.jacobian(feedback, q)
    return ca.Function("derivatives", [q], [ca.vec(by_q.T), ca.vec(chart.T)])
