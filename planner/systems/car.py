"""The kinematic car (N = 4)."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np

from planner.systems.base import Array, Coordinate
from planner.systems.tangent import TangentSystem
from planner.systems.values import positive


class Car(TangentSystem):
    """A car driven at its rear axle, with state q = (x, steering, heading, y) of that axle.

    ẋ = cosθ u₁,  φ̇ = u₂,  θ̇ = (tanφ/L) u₁,  ẏ = sinθ u₁  with u₁ the speed in m/s and u₂ the
    steering rate in rad/s (R. M. Murray, S. S. Sastry, "Nonholonomic motion planning: steering
    using sinusoids", IEEE Transactions on Automatic Control 38(5), 1993). Along x:
    θ' = tanφ/(L cosθ), y' = tanθ.

    Heading 90° is an edge of the chart only; steering 90° is a singularity of the car.

    Args:
        wheelbase_m: Distance L of the axles, m.

    Raises:
        InputError: If the wheelbase is not positive and finite.
    """

    kind: ClassVar[str] = "car"

    def __init__(self, wheelbase_m: float = 1.0) -> None:
        self.wheelbase_m = float(positive("wheelbase_m", [wheelbase_m])[0])

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """(x, steering, heading, y) in m, rad, rad, m."""
        return (
            Coordinate("x", "m"),
            Coordinate("steering", "rad"),
            Coordinate("heading", "rad"),
            Coordinate("y", "m"),
        )

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """Speed of the rear axle and steering rate."""
        return Coordinate("speed", "m/s"), Coordinate("steering_rate", "rad/s")

    @property
    def limited(self) -> tuple[int, ...]:
        """Steering and heading."""
        return 1, 2

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """θ' and y'."""
        return [ca.tan(q[1]) / (self.wheelbase_m * ca.cos(q[2])), ca.tan(q[2])]

    def drive_expr(self, q: Any) -> Any:
        """γ = cosθ."""
        return ca.cos(q[2])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Regular at every heading."""
        turn = ca.tan(q[1]) / self.wheelbase_m
        return [ca.cos(q[2]) * u[0], u[1], turn * u[0], ca.sin(q[2]) * u[0]]

    # -- numeric form --------------------------------------------------------------------------

    def slopes(self, q: Array) -> Array:
        """θ' and y', shape (…, 2)."""
        secant = np.hypot(1.0, np.tan(q[..., 2])) * np.sign(np.cos(q[..., 2]))
        curvature = np.tan(q[..., 1]) / self.wheelbase_m
        return np.stack([curvature * secant, np.tan(q[..., 2])], axis=-1)

    def drive(self, q: Array) -> Array:
        """γ, shape (…,)."""
        return np.cos(q[..., 2])

    def rates(self, q: Array, u: Array) -> Array:
        """q̇, shape (…, 4), from the velocity as a complex number and the turning radius."""
        velocity = u[..., 0] * np.exp(1j * q[..., 2])
        turn = u[..., 0] * np.tan(q[..., 1]) / self.wheelbase_m
        parts = np.broadcast_arrays(velocity.real, u[..., 1], turn, velocity.imag)
        return np.stack(parts, axis=-1)

    def axle_points(self, q: Array) -> Array:
        """Front and rear axle, shape (…, 2, 2), m."""
        rear = np.stack([q[..., 0], q[..., 3]], axis=-1)
        ahead = np.stack([np.cos(q[..., 2]), np.sin(q[..., 2])], axis=-1)
        return np.stack([rear + self.wheelbase_m * ahead, rear], axis=-2)

    # -- the chart -----------------------------------------------------------------------------

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        ones = np.ones_like(q[..., -1])
        return 0 * ones, ones if i == 2 else 1 / (self.wheelbase_m * np.cos(q[..., 2]))

    # -- identity ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The `[system]` table."""
        return {"kind": self.kind, "wheelbase_m": self.wheelbase_m}
