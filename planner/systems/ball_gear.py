"""Nakamura's ball-gear manipulator: n joints, two motors, balls that transmit sine and cosine.

Source: O. J. Sørdalen, Y. Nakamura, W. J. Chung, "Design of a nonholonomic manipulator", IEEE ICRA
1994; Y. Nakamura, W. J. Chung, O. J. Sørdalen, "Design and control of the nonholonomic
manipulator", IEEE Transactions on Robotics and Automation 17(1), 2001.
"""

from __future__ import annotations

from math import prod
from typing import Any, ClassVar

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import PlanarArm, TangentSystem


class BallGear(PlanarArm, TangentSystem):
    """A ball-gear manipulator of n ≥ 2 joints with state q = (φₙ, θ₁, …, θₙ).

    θ̇₁ = u₂,  θ̇ᵢ = kᵢ sinθᵢ₋₁ ∏_{j≤i−2} cosθⱼ u₁,  φ̇ₙ = k_g ∏_{j≤n−1} cosθⱼ u₁.

    The ball at joint i turns joint i+1 at the rate sinθᵢ and the next ball at the rate cosθᵢ; φₙ is
    the output angle of the last ball. With φₙ in place of time, the equations are triangular:
    θᵢ' = dθᵢ/dφₙ = Kᵢ tanθᵢ₋₁ / ∏_{j=i}^{n−1} cosθⱼ. One chart covers every |θ| < 90°, θ = 0
    included.

    Args:
        K: The ratios Kᵢ = kᵢ/k_g for i = 2 … n (n − 1 positive numbers).
        k_g: Turns of the last ball per turn of motor 1 with every joint at 0; u₁ and its limit
            refer to the motor.
        link_lengths: Lengths of the n links, for drawing and obstacles; by default 1 each.

    Raises:
        InputError: If a constant is not a positive finite number or the lengths do not match.
    """

    kind: ClassVar[str] = "ball-gear"

    disk: ClassVar[int] = 0

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slopes θᵢ' = dθᵢ/dφₙ for i = 2 … n as CasADi expressions."""
        return [
            self.K[i - 2] * ca.tan(q[i - 1]) / prod([ca.cos(q[j]) for j in range(i, self.n)])
            for i in range(2, self.n + 1)
        ]

    def drive_expr(self, q: Any) -> Any:
        """Return γ = φ̇ₙ/u₁ = k_g ∏_{j≤n−1} cosθⱼ as a CasADi expression."""
        return self.k_g * prod([ca.cos(q[j]) for j in range(1, self.n)])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Return the rates q̇ as CasADi expressions, which are finite at every angle."""
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

    def _ratios(self, q: Array) -> Array:
        """Return the ratios 1, cosθ₁, cosθ₁cosθ₂ … of the balls' speeds to k_g u₁, shape (…, n)."""
        ones = np.ones_like(q[..., :1])
        return np.asarray(np.cumprod(np.concatenate([ones, np.cos(q[..., 1:-1])], -1), axis=-1))

    def slopes(self, q: Array) -> Array:
        """Return the slopes θᵢ' = dθᵢ/dφₙ for i = 2 … n, shape (…, n−1), from the ball speeds."""
        ball = self._ratios(q)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.K * np.sin(q[..., 1:-1]) * ball[..., :-1] / ball[..., -1:])

    def drive(self, q: Array) -> Array:
        """Return γ = φ̇ₙ/u₁, the turns of the last ball per turn of motor 1, shape (…,)."""
        return np.asarray(self.k_g * self._ratios(q)[..., -1])

    def rates(self, q: Array, u: Array) -> Array:
        """Return the rates q̇, shape (…, n+1), computed ball by ball; finite at every angle."""
        ball = self.k_g * self._ratios(q) * u[..., 0:1]
        joints = self.K * np.sin(q[..., 1:-1]) * ball[..., :-1]
        return np.concatenate([ball[..., -1:], u[..., 1:2], joints], axis=-1)

    # -- the chart -----------------------------------------------------------------------------

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        later = np.prod(np.cos(q[..., i + 1 : self.n]), axis=-1)
        return np.zeros_like(later), np.asarray(self.K[i - 1] / later)
