"""Triangular systems whose every link is a tangent: cars, trailers, the ball-gear manipulator.

    fᵢ₊₁(qᵢ; qᵢ₊₁ … q_N) = offset + gain · tan qᵢ,   offset and gain read later coordinates only

The inverse is qᵢ = arctan((fᵢ₊₁ − offset)/gain), which exists for every slope: the chart covers all
chained coordinates and its only edge is qᵢ = ±90°, where the path coordinate stands still.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import casadi as ca
import numpy as np

from planner.systems.base import Array, TriangularSystem

SINGULAR = 1e-12
"""|cos qᵢ| below which a coordinate counts as lying on the chart's edge."""


class TangentSystem(TriangularSystem):
    """A triangular system that gives its links as offset and gain of a tangent."""

    @abstractmethod
    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        """Offset and gain, each of shape (…,), of fᵢ₊₁ at array index i; reads q after i only."""

    def branch(self, q: Array) -> Array:
        """For each link 2k + 1 when the angle is within 90° of k half turns, and 0 on the edge.

        The usual branch, |qᵢ| < 90°, is 1, and so is the entry of a coordinate without a link.
        """
        out = np.ones(self.size)
        angle = np.asarray(q[1:-1], dtype=float)
        on_edge = np.abs(np.cos(angle)) < SINGULAR
        out[1:-1] = np.where(on_edge, 0.0, 2 * np.round(angle / np.pi) + 1)
        return out

    def _tangent(self, i: int, slope: Array, q: Array) -> Array:
        offset, gain = self._link(i, q)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((slope - offset) / gain)

    def link_from_slope(self, i: int, slope: Array, q: Array, branch: Array) -> Array:
        """The angle on the given branch; it exists for every finite slope."""
        return np.asarray(np.arctan(self._tangent(i, slope, q)) + _centre(branch)[i])

    def link_expr(self, i: int, slope: Any, q: list[Any], branch: Any) -> Any:
        """The same, with offset and gain read off the link at 0 and 45 degrees."""
        at = [*q]
        at[i] = ca.SX(0)
        offset = self.slopes_expr(at)[i - 1]
        at[i] = ca.SX(np.pi / 4)
        gain = self.slopes_expr(at)[i - 1] - offset
        return ca.atan((slope - offset) / gain) + (branch[i] - 1) / 2 * np.pi

    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """(cos²qᵢ,)."""
        with np.errstate(over="ignore"):
            return [np.asarray(1 / (1 + self._tangent(i, slope, q) ** 2))]

    def chart_margins(self, q: Array, branch: Array) -> Array:
        """±cos²qᵢ for each link, shape (…, N−2); negative once a coordinate has left its branch."""
        c = np.cos(q[..., 1:-1] - _centre(branch)[1:-1])
        return np.asarray(np.where(branch[1:-1] == 0, -np.abs(c), c) * np.abs(c))

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """The same."""
        cosines = [ca.cos(q[i] - _centre(branch)[i]) for i in range(1, self.size - 1)]
        signs = np.where(branch[1:-1] == 0, -1.0, 1.0)
        return [
            c * ca.fabs(c) if sign > 0 else -c * c for c, sign in zip(cosines, signs, strict=True)
        ]

    @property
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """Margins in the order of `chart_margins`."""
        names = [c.name for c in self.coordinates]
        return tuple(
            (i, f"cos^2({names[i]}): distance from {names[i]} = 90 deg")
            for i in range(1, self.size - 1)
        )


def _centre(branch: Array) -> Array:
    """Middle of each branch, radians."""
    return np.asarray(np.pi * (branch - 1) / 2)
