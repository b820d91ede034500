"""A coin that rolls upright: a system whose user coordinates differ from the triangular ones.

The user coordinates are the point of contact (x, y), the heading θ and the roll φ. With the radius
r the coin rolls without slipping:

    ẋ = r φ̇ cosθ,   ẏ = r φ̇ sinθ

In the frame that turns with the heading the contact lies at ξ = x cosθ + y sinθ ahead and
η = x sinθ − y cosθ to the right. There η̇ = ξ θ̇ and ξ̇ = r φ̇ − η θ̇, so that with σ = ξ − rφ

    dη/dθ = σ + rφ,   dσ/dθ = −η

and (θ, φ, η, σ) is triangular.

Source: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation,
1994, chapter 7, for the coin (the rolling disk). The triangular coordinates follow by
differentiation.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import Coordinate, TriangularSystem, positive

_ANGLES = (Coordinate("heading", "rad"), Coordinate("roll", "rad"))


class Coin(TriangularSystem):
    """A coin, or an upright wheel, with state q = (heading, roll, eta, sigma).

    Inputs are the turn rate and the roll rate, both in rad/s. The user coordinates are (x, y,
    heading, roll). The chart has no edge.

    Args:
        radius_m: Radius r, m.

    Raises:
        InputError: If the radius is not positive and finite.
    """

    kind: ClassVar[str] = "coin"
    coordinates = (*_ANGLES, Coordinate("eta", "m"), Coordinate("sigma", "m"))
    user_coordinates = (Coordinate("x", "m"), Coordinate("y", "m"), *_ANGLES)
    inputs = Coordinate("turn_rate", "rad/s"), Coordinate("roll_rate", "rad/s")
    limited = (1,)  # the roll
    margin_labels = ((1, "1: the chart has no edge"),)

    def __init__(self, radius_m: float = 1.0) -> None:
        self.radius_m = float(positive("radius_m", [radius_m])[0])

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slopes dη/dθ and dσ/dθ as CasADi expressions."""
        return [q[3] + self.radius_m * q[1], -q[2]]

    def user_expr(self, q: Any) -> list[Any]:
        """Return the contact point (x, y), the heading and the roll as CasADi expressions in q."""
        ahead, c, s = q[3] + self.radius_m * q[1], ca.cos(q[0]), ca.sin(q[0])
        return [ahead * c + q[2] * s, ahead * s - q[2] * c, q[0], q[1]]

    def from_user_expr(self, w: Any) -> list[Any]:
        """Return q = (heading, roll, η, σ) as CasADi expressions in w = (x, y, heading, roll)."""
        c, s = ca.cos(w[2]), ca.sin(w[2])
        sigma = w[0] * c + w[1] * s - self.radius_m * w[3]
        return [w[2], w[3], w[0] * s - w[1] * c, sigma]

    # -- numeric form --------------------------------------------------------------------------

    def slopes(self, q: Array) -> Array:
        """Return the slopes dη/dθ and dσ/dθ, shape (…, 2)."""
        return np.stack([self.radius_m * q[..., 1] + q[..., 3], -q[..., 2]], axis=-1)

    def drive(self, q: Array) -> Array:
        """Return γ = 1, shape (…,): the path coordinate is the heading, which the input turns."""
        return np.ones(q.shape[:-1])

    def user(self, q: Array) -> Array:
        """Convert q (…, 4) to (x, y, heading, roll), shape (…, 4), by x + iy = (ξ − iη) exp(iθ)."""
        contact = (self.radius_m * q[..., 1] + q[..., 3] - 1j * q[..., 2]) * np.exp(1j * q[..., 0])
        return np.stack([contact.real, contact.imag, q[..., 0], q[..., 1]], axis=-1)

    def from_user(self, w: Array) -> Array:
        """Convert (x, y, heading, roll), (…, 4), to q (…, 4), by ξ − iη = (x + iy) exp(−iθ)."""
        frame = (w[..., 0] + 1j * w[..., 1]) * np.exp(-1j * w[..., 2])
        sigma = frame.real - self.radius_m * w[..., 3]
        return np.stack([w[..., 2], w[..., 3], -frame.imag, sigma], axis=-1)

    def axle_points(self, q: Array) -> Array:
        """Return the front end, rear end and contact of the coin from above, (…, 3, 2), m."""
        contact = self.user(q)[..., :2]
        ahead = np.stack([np.cos(q[..., 0]), np.sin(q[..., 0])], axis=-1)
        ends = [contact + side * self.radius_m * ahead for side in (1, -1)]
        return np.stack([*ends, contact], axis=-2)

    # -- the chart -----------------------------------------------------------------------------

    def branch(self, q: Array) -> Array:
        """Return ones, since the chart has only one branch."""
        return np.ones(self.size)

    def link_from_slope(self, i: int, slope: Array, q: Array, branch: Array) -> Array:
        """Return the roll φ from dη/dθ (i = 1), or η from dσ/dθ (i = 2), shape (…,)."""
        return np.asarray((slope - q[..., 3]) / self.radius_m if i == 1 else -slope)

    def link_expr(self, i: int, slope: Any, q: list[Any], branch: Any) -> Any:
        """Return the roll φ from dη/dθ (i = 1), or η from dσ/dθ (i = 2), as an expression."""
        return (slope - q[3]) / self.radius_m if i == 1 else -slope

    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Return one margin, equal to 1, for i = 1, and none for i = 2: the chart has no edge."""
        return [np.where(np.isnan(slope), np.nan, 1.0)] if i == 1 else []

    def chart_margins(self, q: Array, branch: Array) -> Array:
        """Return ones, shape (…, 1): no point lies outside the chart."""
        return np.ones((*q.shape[:-1], 1))

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """Return the constant margin 1 of `chart_margins` as a CasADi expression."""
        return [ca.SX(1)]
