"""Nakamura's ball-gear manipulator: n joints, two motors, balls that transmit sine and cosine.

Source: O. J. Sørdalen, Y. Nakamura, W. J. Chung, "Design of a nonholonomic manipulator", IEEE ICRA
1994; Y. Nakamura, W. J. Chung, O. J. Sørdalen, "Design and control of the nonholonomic
manipulator", IEEE Transactions on Robotics and Automation 17(1), 2001.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Any, ClassVar

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import (
    Coordinate,
    TangentSystem,
    arm_points,
    lengths_of_links,
    positive,
)


class BallGear(TangentSystem):
    """A ball-gear manipulator of n ≥ 2 joints with state q = (φₙ, θ₁, …, θₙ).

    θ̇₁ = u₂,  θ̇ᵢ = kᵢ sinθᵢ₋₁ ∏_{j≤i−2} cosθⱼ u₁,  φ̇ₙ = k_g ∏_{j≤n−1} cosθⱼ u₁.

    The ball at joint i turns joint i+1 at the rate sinθᵢ and the next ball at the rate cosθᵢ; φₙ is
    the output angle of the last ball. Over φₙ: θᵢ' = Kᵢ tanθᵢ₋₁ / ∏_{j=i}^{n−1} cosθⱼ: triangular,
    and one chart covers every |θ| < 90°, θ = 0 included.

    Args:
        K: The ratios Kᵢ = kᵢ/k_g for i = 2 … n (n − 1 positive numbers).
        k_g: Turns of the last disk per turn of motor 1; u₁ and its limit are the motor's.
        link_lengths: Lengths of the n links, for drawing and obstacles; by default 1 each.

    Raises:
        InputError: If a constant is not a positive finite number or the lengths do not match.
    """

    kind: ClassVar[str] = "ball-gear"

    def __init__(
        self, K: Sequence[float], k_g: float = 1.0, link_lengths: Sequence[float] | None = None
    ) -> None:
        self.K = positive("K", K)
        self.k_g = float(positive("k_g", [k_g])[0])
        self.n = len(self.K) + 1
        self.link_lengths = lengths_of_links(self.n, link_lengths)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """(φₙ, θ₁ … θₙ), all in radians."""
        angles = (Coordinate(f"theta{i}", "rad") for i in range(1, self.n + 1))
        return (Coordinate(f"phi{self.n}", "rad"), *angles)

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """u₁, which turns the first ball, and u₂ = θ̇₁, in rad/s."""
        return Coordinate("u1", "rad/s"), Coordinate("u2", "rad/s")

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """θᵢ' = dθᵢ/dφₙ for i = 2 … n."""
        return [
            self.K[i - 2] * ca.tan(q[i - 1]) / prod([ca.cos(q[j]) for j in range(i, self.n)])
            for i in range(2, self.n + 1)
        ]

    def drive_expr(self, q: Any) -> Any:
        """γ = k_g ∏_{j≤n−1} cosθⱼ."""
        return self.k_g * prod([ca.cos(q[j]) for j in range(1, self.n)])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """The gears' own equations, regular at every angle."""
        passive = [
            self.k_g
            * self.K[i - 2]
            * ca.sin(q[i - 1])
            * prod([ca.cos(q[j]) for j in range(1, i - 1)])
            * u[0]
            for i in range(2, self.n + 1)
        ]
        return [self.drive_expr(q) * u[0], u[1], *passive]

    # -- numeric form --------------------------------------------------------------------------

    def _transmitted(self, q: Array) -> Array:
        """Speed of each ball over u₁, shape (…, n): 1, cosθ₁, cosθ₁cosθ₂, …, with k_g left out."""
        ones = np.ones_like(q[..., :1])
        return np.asarray(np.cumprod(np.concatenate([ones, np.cos(q[..., 1:-1])], -1), axis=-1))

    def slopes(self, q: Array) -> Array:
        """θᵢ' for i = 2 … n, shape (…, n−1), as the ratio of joint speed to φ̇ₙ."""
        ball = self._transmitted(q)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.K * np.sin(q[..., 1:-1]) * ball[..., :-1] / ball[..., -1:])

    def drive(self, q: Array) -> Array:
        """γ, shape (…,)."""
        return np.asarray(self.k_g * self._transmitted(q)[..., -1])

    def rates(self, q: Array, u: Array) -> Array:
        """q̇, shape (…, n+1), ball by ball; regular at every angle."""
        ball = self.k_g * self._transmitted(q) * u[..., 0:1]
        joints = self.K * np.sin(q[..., 1:-1]) * ball[..., :-1]
        return np.concatenate([ball[..., -1:], u[..., 1:2], joints], axis=-1)

    def arm_points(self, theta: Array) -> Array:
        """Base, joints and tip, shape (…, n+1, 2), for joint angles theta (…, n) in radians."""
        return arm_points(theta, self.link_lengths)

    # -- the chart -----------------------------------------------------------------------------

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        later = np.prod(np.cos(q[..., i + 1 : self.n]), axis=-1)
        return np.zeros_like(later), np.asarray(self.K[i - 1] / later)

    # -- identity ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The `[system]` table."""
        return {
            "kind": self.kind,
            "joints": self.n,
            "K": self.K.tolist(),
            "k_g": self.k_g,
            "link_lengths": self.link_lengths.tolist(),
        }
