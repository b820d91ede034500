"""The unicycle: the simplest member of the class (N = 3)."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np

from planner.systems.base import Array, Coordinate
from planner.systems.tangent import TangentSystem


class Unicycle(TangentSystem):
    """A wheel, or a robot with two driven wheels, with state q = (x, heading, y).

    ẋ = cosθ u₁,  θ̇ = u₂,  ẏ = sinθ u₁  with u₁ the forward speed in m/s, u₂ the turn rate in rad/s.
    Along x: y' = tanθ. The chart ends where the heading is across the x axis.
    """

    kind: ClassVar[str] = "unicycle"

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """(x, heading, y) in m, rad, m."""
        return Coordinate("x", "m"), Coordinate("heading", "rad"), Coordinate("y", "m")

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """Forward speed and turn rate."""
        return Coordinate("speed", "m/s"), Coordinate("turn_rate", "rad/s")

    @property
    def limited(self) -> tuple[int, ...]:
        """The heading."""
        return (1,)

    def slopes_expr(self, q: Any) -> list[Any]:
        """y' = tanθ."""
        return [ca.tan(q[1])]

    def drive_expr(self, q: Any) -> Any:
        """γ = cosθ."""
        return ca.cos(q[1])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Regular at every heading."""
        return [ca.cos(q[1]) * u[0], u[1], ca.sin(q[1]) * u[0]]

    def slopes(self, q: Array) -> Array:
        """y', shape (…, 1)."""
        return np.tan(q[..., 1:2])

    def drive(self, q: Array) -> Array:
        """γ, shape (…,)."""
        return np.cos(q[..., 1])

    def rates(self, q: Array, u: Array) -> Array:
        """q̇, shape (…, 3), from the velocity as a complex number."""
        velocity = u[..., 0] * np.exp(1j * q[..., 1])
        return np.stack(np.broadcast_arrays(velocity.real, u[..., 1], velocity.imag), axis=-1)

    def axle_points(self, q: Array) -> Array:
        """Where the wheel touches the ground, shape (…, 1, 2), m."""
        return np.stack([q[..., 0], q[..., -1]], axis=-1)[..., None, :]

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        ones = np.ones_like(q[..., -1])
        return 0 * ones, ones

    def to_dict(self) -> dict[str, Any]:
        """The `[system]` table."""
        return {"kind": self.kind}
