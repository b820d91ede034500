"""The requirements at sample points of the paths of one frame, and their linearisation in y."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.convex.frame import Frame
from planner.convex.look import Look, Samples, coordinates, look
from planner.convex.requirements import Requirement, requirements
from planner.problem import Limits
from planner.systems.base import Array, TriangularSystem

NEAR_EDGE = 0.02
"""Least scale of the u₂ rows, as a fraction of their greatest: rows near the edge stay seen."""


@dataclass(frozen=True)
class Rows:
    """h ≤ 0 and, for those in sight, its linearisation h + J·(y − ȳ) + k·(t − t̄).

    Attributes:
        h: All values, shape (R,), requirement by requirement; 1 means a whole limit too much.
        near: Which of them are in sight, shape (r,).
        J: Their derivatives by y, shape (r, size).
        k: Their derivatives by the level t on the inputs, shape (r,).
    """

    h: Array
    near: NDArray[np.intp]
    J: Array
    k: Array


@dataclass(frozen=True)
class Sampled:
    """Every nonconvex requirement of a problem at samples of the paths of one frame.

    Attributes:
        system: What is steered.
        branch: The chart's branch, shape (N,).
        limits: Of inputs and joints; those of rates are not kept here.
        margin: Least chart margins, shape (m,), or None where the band keeps the domain.
        frame: The paths.
        samples: Where.
        duration: Seconds.
    """

    system: TriangularSystem
    branch: Array
    limits: Limits
    margin: Array | None
    frame: Frame
    samples: Samples
    duration: float

    def look(self, y: Array) -> Look | None:
        """The path of y at the samples; None if any lies outside the chart's domain."""
        return look(self.system, self.branch, self.frame, self.samples, y, self.duration)

    def lost(self, y: Array) -> NDArray[np.bool_]:
        """Which samples lie outside the chart's domain, shape (M,)."""
        q = coordinates(self.system, self.branch, self.frame, self.samples, y)
        return np.asarray(~np.all(np.isfinite(q), axis=1))

    def peaks(self, y: Array) -> Array:
        """Largest |u₁| and |u₂| at the samples, shape (2,); infinite outside the domain."""
        at = self.look(y)
        if at is None:
            return np.full(2, np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.stack([at.v[:, 0] / at.drive, at.turned / at.slope])
        return np.asarray(np.abs(u).max(axis=1))

    def values(self, y: Array, t: float = 1.0) -> Array | None:
        """h of every requirement and sample, shape (R,); None outside the domain."""
        at = self.look(y)
        if at is None:
            return None
        values = [requirement.value(at, t) for requirement in self._all(at)]
        return np.concatenate(values) if values else np.zeros(0)

    def rows(self, y: Array, t: float, sight: float, scale: Array) -> Rows | None:
        """The requirements about the path of y; None outside the domain.

        Args:
            y: Free coefficients.
            t: Level that scales the input limits.
            sight: Rows with h < −sight are not linearised.
            scale: Of |slope| in the u₂ rows, see `turn_scale`.
        """
        at = self.look(y)
        if at is None:
            return None
        every = self._all(at, scale)
        if not every:
            none = np.zeros((0, self.frame.size))
            return Rows(np.zeros(0), np.zeros(0, int), none, np.zeros(0))
        h = np.concatenate([requirement.value(at, t) for requirement in every])
        slopes = [requirement.slopes(at, t) for requirement in every]
        near = np.flatnonzero(h >= -sight)
        where = near % len(at.q)
        by_q = np.concatenate([s.by_q for s in slopes])[near]
        by_z = np.einsum("ri,rij->rj", by_q, at.by_q[1][where])[:, 1:]
        z_by_y, omega_by_y = self._by_y
        J = np.einsum("ri,riy->ry", by_z, z_by_y[where])
        by_v2 = np.concatenate([s.by_v2 for s in slopes])[near]
        J += by_v2[:, None] * omega_by_y[where] / self.duration
        return Rows(h, near, J, np.concatenate([s.by_t for s in slopes])[near])

    def turn_scale(self, y: Array) -> Array:
        """|slope| along the path of y, kept away from zero: shape (M,)."""
        at = self.look(y)
        size = np.ones(len(self.samples.piece)) if at is None else np.abs(at.slope)
        return np.asarray(np.maximum(size, NEAR_EDGE * size.max()))

    def _all(self, at: Look, scale: Array | None = None) -> list[Requirement]:
        scale = np.abs(at.slope) if scale is None else scale
        return requirements(self.system, self.branch, self.limits, self.margin, scale)

    @cached_property
    def _by_y(self) -> tuple[Array, Array]:
        """Derivatives of z₂ … z_N (M, N−1, size) and of ω (M, size)."""
        tau = (self.samples.piece + self.samples.local) / self.frame.shape.pieces
        z = [self.frame.z_rows(i, tau)[0] for i in range(1, self.system.size)]
        omega, _ = self.frame.omega_rows(self.samples.piece, self.samples.local)
        return np.stack(z, axis=1), omega
