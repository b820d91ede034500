"""The convex part of the chart's domain: a floor and a concave cap on ±z₂.

    n = 2:  p = z₂            0 < p < K₂                    cos³θ₁ = p/K₂
    n = 3:  p = −sign(θ₂) z₂  0 < p < g(z₃)                 cos²θ₁ = p/g(z₃)
            g(z₃) = 3K₂K₃ c²√(1−c²),  c = cosθ₂ = (z₃/K₃)^{1/3},  concave on (0, K₃)

There the band is the whole domain. The cap is lowered by the factor that keeps sin²θ₁ ≥ edge, and
the floor is raised to the margin asked for; both keep the set convex. The sign of θ₁ plays no part:
the cap knows cos²θ₁ only. For longer chains and other systems the band is the margin of z₂ alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.problem import Problem
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator

DEFAULT_FLOOR = 1e-4
"""Least |z₂| where the problem sets no margin; half the nearer end's if that is less."""


@dataclass(frozen=True)
class Band:
    """floor ≤ p ≤ cap(z₃), p = sign · z₂.

    Attributes:
        sign: ±1.
        floor: Least p; −inf where there is none.
        cap_factor: Factor on g (n = 3) or K₂ (n = 2) that keeps the distance from θ₁ = 0.
        K: (K₂,) or (K₂, K₃); empty where there is no cap.
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
    def z3_range(self) -> tuple[float, float]:
        """Where the cap is concave."""
        return (0.0, float(self.K[1])) if len(self.K) == 2 else (-np.inf, np.inf)

    @property
    def top(self) -> float:
        """Greatest value the cap takes anywhere."""
        if len(self.K) == 1:
            return float(self.cap_factor * self.K[0])
        return float(self.cap_factor * 2 * self.K[0] * self.K[1] / np.sqrt(3))

    def cap(self, z3: Array) -> Array:
        """Greatest p at z₃, any shape; z₃ is clipped to [0, K₃]."""
        if len(self.K) == 1:
            return np.full(np.shape(z3), self.cap_factor * self.K[0])
        c2 = np.clip(z3 / self.K[1], 0.0, 1.0) ** (2 / 3)
        return np.asarray(3 * self.cap_factor * self.K[0] * self.K[1] * c2 * np.sqrt(1 - c2))

    def tangent(self, z3: Array) -> tuple[Array, Array]:
        """The cap's tangent slope · z₃ + offset at z₃ (moved a little inside its domain).

        Returns:
            (slope, offset), each of the shape of z₃; no cap value lies above the tangent.
        """
        if len(self.K) == 1:
            return np.zeros(np.shape(z3)), self.cap(z3)
        at = np.clip(z3, 1e-9 * self.K[1], (1 - 1e-9) * self.K[1])
        c = np.cbrt(at / self.K[1])
        slope = self.cap_factor * self.K[0] * (2 - 3 * c**2) / (c * np.sqrt(1 - c**2))
        return np.asarray(slope), np.asarray(self.cap(at) - slope * at)


def band_of(problem: Problem, start: Array, goal: Array, edge: float) -> Band:
    """The band of a problem whose ends lie in one branch.

    Args:
        problem: Supplies the constants, the margin of z₂ and, for n = 2, the limit of θ₁.
        start: z(0), shape (N,).
        goal: z(T), shape (N,).
        edge: Least sin²θ₁ wanted; half the nearer end's if that is less.
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
    wanted = min(1 - (1 - edge) ** 1.5 if two else edge, nearest / 2)
    return Band(sign, floor, 1 - wanted, system.K)
