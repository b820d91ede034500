"""What is not convex in z: input limits, joint limits, and the chart's domain beyond three joints.

Each is a function h ≤ 0 of what is seen at a sample, with its derivatives. The limit on u₂ is kept
as

    ±(v₂ − drift v₁) ≤ U₂ |∂z₂/∂q₂|

because u₂ itself divides by a factor that vanishes on the chart's edge.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from planner.convex.look import Look
from planner.problem import Limits
from planner.systems.base import Array, TriangularSystem

EDGE_SCALE = 0.1
"""Margin (sin²θ or cos²θ) by which the chart's edge is measured."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives of one requirement at M samples, each by q (M, N), ω·T⁻¹ = v₂ (M,), t (M,)."""

    by_q: Array
    by_v2: Array
    by_t: Array


class Requirement(ABC):
    """h ≤ 0 at every sample; h = 1 is a whole limit too much. t scales the input limits."""

    @abstractmethod
    def value(self, at: Look, t: float) -> Array:
        """h, shape (M,)."""

    @abstractmethod
    def slopes(self, at: Look, t: float) -> Slopes:
        """Its derivatives."""


@dataclass(frozen=True)
class DriveLimit(Requirement):
    """|u₁| ≤ t·limit, as γ t·limit ≥ |v₁|."""

    limit: float

    def _gain(self, at: Look) -> float:
        return self.limit / abs(float(at.v[0, 0]))

    def value(self, at: Look, t: float) -> Array:
        """1 − t·limit·γ/|v₁|."""
        return np.asarray(1 - t * self._gain(at) * at.drive)

    def slopes(self, at: Look, t: float) -> Slopes:
        """By the chain rule."""
        gain = self._gain(at)
        none = np.zeros(len(at.q))
        return Slopes(-t * gain * at.by_q[0][:, 0], none, -gain * at.drive)


@dataclass(frozen=True)
class TurnLimit(Requirement):
    """side · u₂ ≤ t·limit, times |slope| and over a scale (M,) that stays fixed."""

    limit: float
    side: float
    scale: Array

    def value(self, at: Look, t: float) -> Array:
        """(side·slope·u₂ − t·limit·|slope|)/scale."""
        return np.asarray((self.side * at.turned - t * self.limit * np.abs(at.slope)) / self.scale)

    def slopes(self, at: Look, t: float) -> Slopes:
        """By the chain rule."""
        feedback = at.by_q[0]
        by_q = -self.side * at.v[:, :1] * feedback[:, 2]
        by_q = by_q - t * self.limit * np.sign(at.slope)[:, None] * feedback[:, 1]
        return Slopes(
            by_q / self.scale[:, None],
            self.side / self.scale,
            -self.limit * np.abs(at.slope) / self.scale,
        )


@dataclass(frozen=True)
class JointLimit(Requirement):
    """|q[index]| ≤ limit."""

    index: int
    limit: float

    def value(self, at: Look, t: float) -> Array:
        """|q|/limit − 1."""
        return np.asarray(np.abs(at.q[:, self.index]) / self.limit - 1)

    def slopes(self, at: Look, t: float) -> Slopes:
        """The sign over the limit."""
        by_q = np.zeros_like(at.q)
        by_q[:, self.index] = np.sign(at.q[:, self.index]) / self.limit
        none = np.zeros(len(at.q))
        return Slopes(by_q, none, none)


@dataclass(frozen=True)
class EdgeLimit(Requirement):
    """The chart margin of one label stays above `least`; `EDGE_SCALE` counts as a whole limit."""

    index: int
    least: float
    branch: Array

    def value(self, at: Look, t: float) -> Array:
        """(least − margin)/scale."""
        margin = at.system.chart_margins(at.q, self.branch)[:, self.index]
        return np.asarray((self.least - margin) / EDGE_SCALE)

    def slopes(self, at: Look, t: float) -> Slopes:
        """By central differences in q, in which margins are smooth."""
        step = 1e-6
        shifts = step * np.eye(at.system.size)
        ahead = at.system.chart_margins(at.q[:, None] + shifts, self.branch)[..., self.index]
        behind = at.system.chart_margins(at.q[:, None] - shifts, self.branch)[..., self.index]
        none = np.zeros(len(at.q))
        return Slopes(-(ahead - behind) / (2 * step * EDGE_SCALE), none, none)


def requirements(
    system: TriangularSystem,
    branch: Array,
    limits: Limits,
    margin: Array | None,
    turn_scale: Array,
) -> list[Requirement]:
    """Every nonconvex requirement.

    Args:
        system: What is steered.
        branch: The chart's branch, shape (N,).
        limits: Of inputs and joints; those of rates are not kept here.
        margin: Least chart margins, or None where the band keeps the domain.
        turn_scale: Scale of |slope| for the u₂ rows at the samples, shape (M,).
    """
    out: list[Requirement] = []
    u1, u2 = limits.input
    if np.isfinite(u1):
        out.append(DriveLimit(float(u1)))
    if np.isfinite(u2):
        out += [TurnLimit(float(u2), side, u2 * turn_scale) for side in (1.0, -1.0)]
    for i in system.limited:
        if np.isfinite(limits.joint[i]):
            out.append(JointLimit(i, float(limits.joint[i])))
    if margin is not None:
        out += [EdgeLimit(j, float(least), branch) for j, least in enumerate(margin)]
    return out
