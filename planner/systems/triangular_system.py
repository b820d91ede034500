"""Triangular systems, the class that the paper's Theorem 1 steers: driftless, with two inputs.

    q̇₁ = v₁ = γ(q) u₁,   q̇₂ = u₂,   q̇ᵢ = fᵢ(qᵢ₋₁, qᵢ, …, q_N) v₁   (i = 3 … N)

Coordinate numbers in the documentation are the paper's (from 1); array indices start at 0.

Terms: q₁ is the path coordinate, and fᵢ = dqᵢ/dq₁ is the slope of qᵢ. The chart is the map from q
to chained coordinates. Its inverse goes down the chain and solves one equation fᵢ₊₁ = slope for qᵢ
after another; each is a link. A link may have several solutions, for example ±θ; a branch of the
chart selects one of them in each link. A margin is a number that is positive inside the branch and
zero on its edge.

`TangentSystem` covers systems in which fᵢ₊₁ is linear in tan qᵢ: cars, trailers, the ball-gear arm.

    fᵢ₊₁(qᵢ; qᵢ₊₁ … q_N) = offset + gain · tan qᵢ,   offset and gain read only later coordinates

The inverse is qᵢ = arctan((fᵢ₊₁ − offset)/gain), which exists for every slope. The chart covers all
chained coordinates; its only edge is qᵢ = ±90°, where the path coordinate stands still.

`PlanarArm` holds what all planar arms share, and `positive` checks constants.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError, expect
from planner.support.arrays import Array, Frozen, floats, frozen
from planner.support.casadi import ca
from planner.support.compiled_calls import Pointwise


@dataclass(frozen=True)
class Coordinate:
    """Name and unit of one coordinate or input ("theta1", "rad")."""

    name: str
    unit: str

    @property
    def rate_unit(self) -> str:
        """Unit of the rate of change of the coordinate ("rad/s" gives "rad/s^2")."""
        return f"{self.unit}^2" if self.unit.endswith("/s") else f"{self.unit or 1}/s"


class TriangularSystem(Frozen, ABC):
    """A driftless two-input system in triangular form.

    A subclass gives its `kind`, its coordinates and its functions fᵢ and γ as CasADi expressions,
    from which the chained form and the optimal planners are derived. A subclass should also give
    `slopes` and `drive` as NumPy code, which verification and the emulated machine use; then the
    two forms check each other. By default both are computed from the expressions.

    In all methods on arrays the last axis holds the coordinates or inputs; leading axes broadcast.
    """

    kind: ClassVar[str]

    def __setattr__(self, name: str, value: Any) -> None:
        if "_text" in vars(self):
            raise AttributeError(
                f"{self} is in use and cannot change; make another {type(self).__name__}"
            )
        super().__setattr__(name, frozen(value))

    def __repr__(self) -> str:
        names = ", ".join(c.name for c in self.coordinates)
        inputs = ", ".join(c.name for c in self.inputs)
        return f"{type(self).__name__}({names}; inputs {inputs})"

    @property
    @abstractmethod
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The N coordinates in triangular order."""

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """The two inputs with their units; by default u1 and u2, rates of q₁ and q₂."""
        first, second = (each.unit for each in self.coordinates[:2])
        return Coordinate("u1", f"{first}/s"), Coordinate("u2", f"{second}/s")

    @cached_property
    def size(self) -> int:
        """Number of coordinates N."""
        return len(self.coordinates)

    @property
    def limited(self) -> tuple[int, ...]:
        """Indices of the coordinates to which joint limits apply (by default all but the first)."""
        return tuple(range(1, self.size))

    # -- user coordinates ----------------------------------------------------------------------

    @property
    def user_coordinates(self) -> tuple[Coordinate, ...]:
        """The N coordinates that problem files, figures and exports use; by default `coordinates`.

        A user coordinate with the name of a triangular coordinate is that coordinate. A system
        whose user coordinates differ overrides `user_expr` and `from_user_expr`, and ideally `user`
        and `from_user` with independent NumPy code.
        """
        return self.coordinates

    def user_expr(self, q: Any) -> list[Any]:
        """Return the N user coordinates as CasADi expressions in q (N)."""
        return [q[i] for i in range(self.size)]

    def from_user_expr(self, w: Any) -> list[Any]:
        """Return the N coordinates q as CasADi expressions in the user coordinates w (N)."""
        return [w[i] for i in range(self.size)]

    def user(self, q: Array) -> Array:
        """Convert coordinates q (…, N) to user coordinates, shape (…, N)."""
        return self._user_functions[0](q) if self.has_user_coordinates else q

    def from_user(self, w: Array) -> Array:
        """Convert user coordinates w (…, N) to coordinates q, shape (…, N)."""
        return self._user_functions[1](w) if self.has_user_coordinates else w

    @cached_property
    def _user_functions(self) -> tuple[Pointwise, Pointwise]:
        x = ca.SX.sym("x", self.size)
        there, back = (ca.vertcat(*f(x)) for f in (self.user_expr, self.from_user_expr))
        return Pointwise("user", [x], there), Pointwise("from_user", [x], back)

    @property
    def has_user_coordinates(self) -> bool:
        """Whether user and triangular coordinates differ; another order is a difference too."""
        return self.user_coordinates != self.coordinates

    @cached_property
    def shared(self) -> dict[int, int]:
        """Coordinates that are both user and triangular: triangular index by user index."""
        names = [c.name for c in self.coordinates]
        pairs = enumerate(c.name for c in self.user_coordinates)
        return frozen({i: names.index(name) for i, name in pairs if name in names})

    def fixed_by(self, w: Array) -> Array:
        """Return the entries of q (N,) that the user coordinates w (N,) determine; the others NaN.

        NaN in w is a free coordinate. Without NaN all of q is determined; otherwise only the
        coordinates that are both user and triangular coordinates.
        """
        if not np.any(np.isnan(w)):
            return self.from_user(w)
        q = np.full(self.size, np.nan)
        q[list(self.shared.values())] = w[list(self.shared)]
        return q

    # -- symbolic form -------------------------------------------------------------------------

    @abstractmethod
    def slopes_expr(self, q: Any) -> list[Any]:
        """Return f₃ … f_N as a list of N−2 CasADi expressions in the CasADi vector q (N)."""

    def drive_expr(self, q: Any) -> Any:
        """Return the factor γ in q̇₁ = γ(q) u₁ as a CasADi expression in q (N); by default 1."""
        return ca.SX(1)

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Return q̇ as a list of N CasADi expressions in q (N) and the inputs u (2)."""
        v1 = self.drive_expr(q) * u[0]
        return [v1, u[1], *(f * v1 for f in self.slopes_expr(q))]

    # -- numeric form --------------------------------------------------------------------------

    def slopes(self, q: Array) -> Array:
        """Return the slopes fᵢ = dqᵢ/dq₁ for i = 3 … N, shape (…, N−2), at q (…, N)."""
        return self._pointwise_functions[0](q)

    def drive(self, q: Array) -> Array:
        """Return γ(q) = q̇₁/u₁, shape (…,), at q (…, N)."""
        return self._pointwise_functions[1](q)[..., 0]

    @cached_property
    def _pointwise_functions(self) -> tuple[Pointwise, Pointwise]:
        """Functions from arrays q (…, N) to the slopes fᵢ (…, N−2) and to γ (…, 1)."""
        q = ca.SX.sym("q", self.size)
        slopes = ca.vertcat(*(ca.SX(f) for f in self.slopes_expr(q)))
        drive = ca.SX(self.drive_expr(q))
        return Pointwise("slopes", [q], slopes), Pointwise("drive", [q], drive)

    def rates(self, q: Array, u: Array) -> Array:
        """Return q̇, shape (…, N), at coordinates q (…, N) under inputs u (…, 2)."""
        v1 = self.drive(q) * u[..., 0]
        tail = self.slopes(q) * v1[..., None]
        return np.concatenate([v1[..., None], u[..., 1:2], tail], axis=-1)

    # -- the chart -----------------------------------------------------------------------------

    @abstractmethod
    def branch(self, q: Array) -> Array:
        """Return the branch number of each coordinate of q, shape (N,); 0 on a singularity."""

    @abstractmethod
    def link_from_slope(self, i: int, slope: Array, q: Array, branch: Array) -> Array:
        """Solve fᵢ₊₁(qᵢ; qᵢ₊₁ … q_N) = slope for qᵢ, with array index i (1 ≤ i ≤ N−2).

        Args:
            i: Array index of the coordinate wanted.
            slope: Required values, shape (…,).
            q: Coordinates, shape (…, N); only those after i are read.
            branch: From `branch`, shape (N,).

        Returns:
            The coordinate, shape (…,); NaN where no real solution exists.
        """

    def link_expr(self, i: int, slope: Any, q: list[Any], branch: Any) -> Any | None:
        """Return the result of `link_from_slope` as a CasADi expression, or None without one.

        If every link has an expression, the whole inverse is compiled into one function. With the
        default, None, `link_from_slope` is used.
        """
        return None

    @abstractmethod
    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Return the margins of qᵢ as solved by `link_from_slope`; each (…,), positive inside."""

    @abstractmethod
    def chart_margins(self, q: Array, branch: Array) -> Array:
        """Return the M margins of the chart at q (…, N), shape (…, M); negative off the branch."""

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """Return the margins of the chart as CasADi expressions, for proofs; none by default."""
        return []

    @property
    @abstractmethod
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """Array index of the coordinate, and meaning in words, of each margin of the chart."""

    @property
    def zero_margins(self) -> Collection[int]:
        """Numbers of the margins that are zero where their coordinate is zero."""
        return ()

    # -- identity ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Return the `[system]` table of a problem file that describes this system.

        By default the table has the kind and the public attributes of the object, so a
        constructor must store each constant under the name of its key.
        """
        constants = {
            name: np.asarray(value).tolist() if isinstance(value, np.ndarray | tuple) else value
            for name, value in vars(self).items()
            if not name.startswith("_") and not hasattr(type(self), name)
        }
        return {"kind": self.kind, **constants}

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)

    def difference(self, other: TriangularSystem) -> str:
        """Describe in words how another system differs from this system; "" if both are equal."""
        if self == other:
            return ""
        mine, theirs = self.to_dict(), other.to_dict()
        keys = [key for key in {**mine, **theirs} if repr(mine.get(key)) != repr(theirs.get(key))]
        pairs = (f"{key} = {theirs.get(key)} instead of {mine.get(key)}" for key in keys)
        return (
            "; ".join(pairs) or f"{type(other).__qualname__} instead of {type(self).__qualname__}"
        )

    @cached_property
    def _text(self) -> str:
        return repr(self.to_dict())


def expect_system(value: object) -> None:
    """Raise an error unless the value is a system; a problem or a plan is refused too.

    Raises:
        InputError: If the value is not a system; the message says how to make one.
    """
    expect(TriangularSystem, value, "problem.system is one; planner.Manipulator(K, k_g) makes one")


SINGULAR = 1e-12
"""Value of |cos qᵢ| below which coordinate qᵢ counts as lying on the edge of the chart."""


class TangentSystem(TriangularSystem):
    """A triangular system in which every fᵢ₊₁ is offset + gain · tan qᵢ, such as a vehicle."""

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        """Return offset and gain in fᵢ₊₁ = offset + gain · tan qᵢ, both (…,), from q after index i.

        By default both are computed from the slopes at qᵢ = 0 and 45 degrees.
        """
        state = np.array(q, dtype=float)
        state[..., :i] = 0.0
        state[..., i] = 0.0
        offset = self.slopes(state)[..., i - 1]
        state[..., i] = np.pi / 4
        return offset, self.slopes(state)[..., i - 1] - offset

    def branch(self, q: Array) -> Array:
        """Return the branch number of each coordinate, shape (N,).

        The number is 2k + 1 for an angle within 90° of kπ, 0 on the edge, and 1 for q₁ and q_N.
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
        """Return the angle qᵢ, (…,), rad, for which fᵢ₊₁ = slope; every finite slope has one."""
        return np.asarray(np.arctan(self._tangent(i, slope, q)) + _centre(branch)[i])

    def link_expr(self, i: int, slope: Any, q: list[Any], branch: Any) -> Any:
        """Return the angle qᵢ for which fᵢ₊₁ = slope, as a CasADi expression."""
        state = [*q]
        state[i] = ca.SX(0)
        offset = self.slopes_expr(state)[i - 1]
        state[i] = ca.SX(np.pi / 4)
        gain = self.slopes_expr(state)[i - 1] - offset
        return ca.atan((slope - offset) / gain) + (branch[i] - 1) / 2 * np.pi

    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Return the one margin of the angle qᵢ for which fᵢ₊₁ = slope: [cos²qᵢ]."""
        with np.errstate(over="ignore"):
            return [np.asarray(1 / (1 + self._tangent(i, slope, q) ** 2))]

    def chart_margins(self, q: Array, branch: Array) -> Array:
        """Return ±cos²qᵢ for q₂ … q_{N−1}, shape (…, N−2); negative if qᵢ has left its branch."""
        c = np.cos(q[..., 1:-1] - _centre(branch)[1:-1])
        return np.asarray(np.where(branch[1:-1] == 0, -np.abs(c), c) * np.abs(c))

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """Return the margins ±cos²qᵢ of `chart_margins` as CasADi expressions."""
        cosines = [ca.cos(q[i] - _centre(branch)[i]) for i in range(1, self.size - 1)]
        pairs = zip(cosines, branch[1:-1] == 0, strict=True)
        return [-c * c if is_edge else c * ca.fabs(c) for c, is_edge in pairs]

    @property
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """Array index of the coordinate and meaning of each margin, ordered as `chart_margins`."""
        names = [c.name for c in self.coordinates]
        pairs = enumerate(names[1:-1], start=1)
        return tuple((i, f"cos^2({name}): distance from {name} = 90 deg") for i, name in pairs)


def _centre(branch: Array) -> Array:
    """Return the angle in the middle of each branch, rad, from the branch numbers."""
    return np.asarray(np.pi * (branch - 1) / 2)


def positive(name: str, values: ArrayLike) -> Array:
    """Return the values as an array after checking that all are positive and finite.

    Raises:
        InputError: If there is no value, or a value is not positive and finite.
    """
    try:
        array = floats(name, values)
    except InputError:
        array = np.empty(0)
    if array.ndim != 1 or array.size == 0 or not np.all(np.isfinite(array) & (array > 0)):
        raise InputError(f"{name} = {values!r:.60} must be positive finite numbers")
    return array


class PlanarArm(TriangularSystem):
    """An arm of n ≥ 2 joints in the plane, with state q = (φ, θ₁, …, θₙ), θ̇₁ = u₂ and θ̇ᵢ ∝ kᵢ u₁.

    Args:
        K: The ratios Kᵢ = kᵢ/k_g for i = 2 … n (n − 1 positive numbers).
        k_g: Turns of the last disk per turn of motor 1 with every joint at 0; u₁ and its limit
            refer to the motor.
        link_lengths: Lengths of the n links, for drawing and obstacles; by default 1 each.

    Raises:
        InputError: If a constant is not a positive finite number or the lengths do not match.
    """

    disk: ClassVar[int]
    """Number of the disk whose angle is φ, relative to n: 0 for disk n, −1 for disk n − 1."""

    def __init__(
        self, K: ArrayLike, k_g: float = 1.0, link_lengths: ArrayLike | None = None
    ) -> None:
        self.K = positive("K", K)
        self.k_g = float(positive("k_g", [k_g])[0])
        self.n = len(self.K) + 1
        lengths = [1.0] * self.n if link_lengths is None else link_lengths
        self.link_lengths = positive("link_lengths", lengths)
        if len(self.link_lengths) != self.n:
            raise InputError(
                f"link_lengths has {len(self.link_lengths)} values for {self.n} joints; give"
                f" {self.n}"
            )

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates φ, θ₁ … θₙ, all in radians."""
        angles = (Coordinate(f"theta{i}", "rad") for i in range(1, self.n + 1))
        return (Coordinate(f"phi{self.n + self.disk}", "rad"), *angles)

    def arm_points(self, theta: Array) -> Array:
        """Compute the positions of base, joints and tip in the plane from the joint angles.

        Args:
            theta: Angles of all n joints or of the first k, shape (…, k), radians; each measured
                from the link before.

        Returns:
            Base, joints and tip, or the ends of the first k links, shape (…, k+1, 2), in the unit
            of `link_lengths`.
        """
        heading = np.cumsum(theta, axis=-1)
        directions = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        steps = self.link_lengths[: heading.shape[-1], None] * directions
        base = np.zeros((*steps.shape[:-2], 1, 2))
        return np.concatenate([base, np.cumsum(steps, axis=-2)], axis=-2)

    def to_dict(self) -> dict[str, Any]:
        """Return the `[system]` table of a problem file."""
        return {
            "kind": self.kind,
            "joints": self.n,
            "K": self.K.tolist(),
            "k_g": self.k_g,
            "link_lengths": self.link_lengths.tolist(),
        }


def arm_points_expr(theta: Sequence[Any], lengths: Array) -> list[tuple[Any, Any]]:
    """Return x and y of an arm's base, joints and tip as CasADi expressions in the angles θ."""
    out: list[tuple[Any, Any]] = [(0.0, 0.0)]
    heading: Any = 0.0
    for angle, length in zip(theta, lengths.tolist(), strict=True):
        heading = heading + angle
        x, y = out[-1]
        out.append((x + length * ca.cos(heading), y + length * ca.sin(heading)))
    return out
