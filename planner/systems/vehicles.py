"""Wheeled vehicles: the unicycle (N = 3, the smallest system of the class), the kinematic car
(N = 4), and the car with n trailers, in the coordinates of the last trailer (N = n + 4).

Source: O. J. Sørdalen, "Conversion of the kinematics of a car with n trailers into a chained form",
IEEE ICRA 1993. The position of the last trailer, not of the car, makes the system triangular; its
path y(x) determines every angle (flatness; P. Rouchon, M. Fliess, J. Lévine, P. Martin, "Flatness
and motion planning: the car with n trailers", ECC 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import Coordinate, TangentSystem, positive


class Unicycle(TangentSystem):
    """A wheel, or a robot with two driven wheels, with state q = (x, heading, y).

    ẋ = cosθ u₁,  θ̇ = u₂,  ẏ = sinθ u₁  with u₁ the forward speed in m/s, u₂ the turn rate in
    rad/s. As a function of x: y' = tanθ. The chart ends where the heading is perpendicular to the
    x axis.
    """

    kind: ClassVar[str] = "unicycle"
    coordinates = Coordinate("x", "m"), Coordinate("heading", "rad"), Coordinate("y", "m")
    inputs = Coordinate("speed", "m/s"), Coordinate("turn_rate", "rad/s")
    limited = (1,)  # the heading

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slope y' = dy/dx = tanθ as a CasADi expression."""
        return [ca.tan(q[1])]

    def drive_expr(self, q: Any) -> Any:
        """Return γ = ẋ/u₁ = cosθ as a CasADi expression."""
        return ca.cos(q[1])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Return the rates of x, heading and y as CasADi expressions, finite at every heading."""
        return [ca.cos(q[1]) * u[0], u[1], ca.sin(q[1]) * u[0]]

    def slopes(self, q: Array) -> Array:
        """Return the slope y' = dy/dx of the wheel's path, shape (…, 1)."""
        return np.tan(q[..., 1:2])

    def drive(self, q: Array) -> Array:
        """Return γ = ẋ/u₁, the cosine of the heading, shape (…,)."""
        return np.cos(q[..., 1])

    def rates(self, q: Array, u: Array) -> Array:
        """Return the rates of x, heading and y, shape (…, 3)."""
        velocity = u[..., 0] * np.exp(1j * q[..., 1])
        return np.stack(np.broadcast_arrays(velocity.real, u[..., 1], velocity.imag), axis=-1)

    def axle_points(self, q: Array) -> Array:
        """Return the contact point of the wheel with the ground, shape (…, 1, 2), m."""
        return np.stack([q[..., 0], q[..., -1]], axis=-1)[..., None, :]

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        ones = np.ones_like(q[..., -1])
        return 0 * ones, ones


class _Train(TangentSystem):
    """A car and the n ≥ 0 trailers that it pulls; see `Trailers`.

    Args:
        wheelbase_m: Distance between the car's axles, m.
        trailer_lengths_m: Distance from each hitch to the axle of the trailer behind it, m.
    """

    inputs = Coordinate("speed", "m/s"), Coordinate("steering_rate", "rad/s")

    def __init__(self, wheelbase_m: float, trailer_lengths_m: Sequence[float] = ()) -> None:
        self.wheelbase_m = float(positive("wheelbase_m", [wheelbase_m])[0])
        self._lengths = np.array([self.wheelbase_m, *trailer_lengths_m])

    @property
    def n(self) -> int:
        """Number of trailers."""
        return len(self._lengths) - 1

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates x, steering, hitch1 … hitchn, heading and y, in m and rad."""
        hitches = (Coordinate(f"hitch{k}", "rad") for k in range(1, self.n + 1))
        front = Coordinate("x", "m"), Coordinate("steering", "rad")
        return *front, *hitches, Coordinate("heading", "rad"), Coordinate("y", "m")

    @property
    def limited(self) -> tuple[int, ...]:
        """Indices of the coordinates that have limits: all angles, but neither x nor y."""
        return tuple(range(1, self.size - 1))

    # -- symbolic form -------------------------------------------------------------------------

    def _P(self, k: int, q: Any) -> Any:
        return prod([ca.cos(q[j]) for j in range(k + 2, self.n + 3)])

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slopes βₖ' for k = 1 … n, θ' and y', with ' = d/dx, as CasADi expressions."""
        turn = [ca.tan(q[k + 1]) / (self._lengths[k] * self._P(k, q)) for k in range(self.n + 1)]
        hitches = [turn[k - 1] - turn[k] for k in range(1, self.n + 1)]
        return [*hitches, turn[-1], ca.tan(q[self.n + 2])]

    def drive_expr(self, q: Any) -> Any:
        """Return γ = ẋ/u₁ = cosθ cosβ₁ … cosβₙ as a CasADi expression."""
        return self._P(0, q)

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Return the rates q̇ as CasADi expressions, finite except at the steering angle 90°."""
        trailers = range(1, self.n + 1)
        c = [ca.cos(q[k + 1]) for k in trailers]
        pulled = [prod(c[: k - 1]) * ca.sin(q[k + 1]) / self._lengths[k] * u[0] for k in trailers]
        turn = [ca.tan(q[1]) / self.wheelbase_m * u[0], *pulled]
        last, heading = prod(c) * u[0], q[self.n + 2]
        hitches = [turn[k - 1] - turn[k] for k in trailers]
        return [ca.cos(heading) * last, u[1], *hitches, turn[-1], ca.sin(heading) * last]

    # -- numeric form --------------------------------------------------------------------------

    def slopes(self, q: Array) -> Array:
        """Return the slopes dqᵢ/dx, shape (…, n+2), computed from the last trailer forward.

        Each axle is faster than the axle behind by the factor 1/cosβₖ.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = 1 / np.cos(q[..., -2])
            behind, out = None, [np.tan(q[..., -2])]
            for k in range(self.n, -1, -1):
                turn = speed * np.tan(q[..., k + 1]) / self._lengths[k]
                out.append(turn if behind is None else turn - behind)
                behind = turn
                speed = speed / np.cos(q[..., k + 1])
        return np.stack(out[::-1], axis=-1)

    def drive(self, q: Array) -> Array:
        """Return γ = ẋ/u₁, the product of the cosines of heading and hitch angles, shape (…,)."""
        return np.asarray(np.prod(np.cos(q[..., 2:-1]), axis=-1))

    def rates(self, q: Array, u: Array) -> Array:
        """Return the rates q̇, shape (…, N), computed from the car back, axle by axle.

        vₖ = vₖ₋₁ cosβₖ,  θ̇ₖ = vₖ₋₁ sinβₖ / ℓₖ.
        """
        speed = u[..., 0]
        turn = speed * np.tan(q[..., 1]) / self.wheelbase_m
        hitches = []
        for k, length in enumerate(self._lengths[1:]):
            angle = q[..., k + 2]
            trailer_turn = speed * np.sin(angle) / length
            speed = speed * np.cos(angle)
            hitches.append(turn - trailer_turn)
            turn = trailer_turn
        x, y = speed * np.cos(q[..., -2]), speed * np.sin(q[..., -2])
        return np.stack(np.broadcast_arrays(x, u[..., 1], *hitches, turn, y), axis=-1)

    def axle_points(self, q: Array) -> Array:
        """Return x and y of front axle, rear axle and trailers' axles, shape (…, n+2, 2), m."""
        heading, point = q[..., -2], np.stack([q[..., 0], q[..., -1]], axis=-1)
        points = [point]
        for k in range(self.n, -1, -1):
            ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
            points.append(points[-1] + self._lengths[k] * ahead)
            heading = heading + q[..., k + 1]
        return np.stack(points[::-1], axis=-2)

    # -- the chart -----------------------------------------------------------------------------

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        k = i - 1
        zero = np.zeros_like(q[..., -1])
        if k == self.n + 1:
            return zero, zero + 1
        turn_gain = 1 / (self._lengths[k] * np.prod(np.cos(q[..., k + 2 : -1]), axis=-1))
        if k == self.n:
            return zero, np.asarray(turn_gain)
        after = np.prod(np.cos(q[..., k + 3 : -1]), axis=-1)
        return -np.tan(q[..., k + 2]) / (self._lengths[k + 1] * after), np.asarray(turn_gain)


class Car(_Train):
    """A car driven at its rear axle, with state q = (x, steering, heading, y) of that axle.

    ẋ = cosθ u₁,  φ̇ = u₂,  θ̇ = (tanφ/L) u₁,  ẏ = sinθ u₁  with u₁ the speed in m/s and u₂ the
    steering rate in rad/s (R. M. Murray, S. S. Sastry, "Nonholonomic motion planning: steering
    using sinusoids", IEEE Transactions on Automatic Control 38(5), 1993). As
    functions of x: θ' = tanφ/(L cosθ), y' = tanθ.

    A heading of 90° is only an edge of the chart; a steering angle of 90° is a singularity of the
    car itself.

    Args:
        wheelbase_m: Distance L between the axles, m.

    Raises:
        InputError: If the wheelbase is not positive and finite.
    """

    kind: ClassVar[str] = "car"

    def __init__(self, wheelbase_m: float = 1.0) -> None:
        super().__init__(wheelbase_m)


class Trailers(_Train):
    """A car that pulls n ≥ 1 trailers, each hitched to the middle of the axle in front of it.

    State q = (x, φ, β₁, …, βₙ, θ, y): steering φ, hitch angles βₖ (heading of the vehicle before
    trailer k minus that of the trailer), heading and position of the last trailer. With ℓ₀ the
    wheelbase, ℓₖ the length of trailer k, β₀ = φ, Pₖ = cosθ ∏_{j>k} cosβⱼ and ' = d/dx:

        γ = P₀,   θₖ' = tanβₖ/(ℓₖ Pₖ),   βₖ' = θₖ₋₁' − θₖ',   θ' = θₙ',   y' = tanθ

    u₁ is the speed of the car's rear axle in m/s, u₂ the steering rate in rad/s. Only φ = 90° is a
    singularity of the vehicle; hitch angles or a heading of 90° are edges of the chart.

    Args:
        trailer_lengths_m: Distance from each hitch to the axle of the trailer behind it, the
            first trailer first, m.
        wheelbase_m: Distance between the car's axles, m.

    Raises:
        InputError: If a length is not positive and finite, or there is no trailer.
    """

    kind: ClassVar[str] = "trailers"

    def __init__(self, trailer_lengths_m: ArrayLike, wheelbase_m: float = 1.0) -> None:
        lengths = positive("trailer_lengths_m", trailer_lengths_m)
        super().__init__(wheelbase_m, lengths.tolist())
        self.trailer_lengths_m = lengths
