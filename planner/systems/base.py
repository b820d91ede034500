"""The class of systems the paper's Theorem 1 steers: driftless, two inputs, triangular.

    q̇₁ = v₁ = γ(q) u₁,   q̇₂ = u₂,   q̇ᵢ = fᵢ(qᵢ₋₁, qᵢ, …, q_N) v₁   (i = 3 … N)

Coordinate numbers in the documentation are the paper's (from 1); array indices start at 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinate:
    """Name and unit of one coordinate or input ("theta1", "rad")."""

    name: str
    unit: str

    @property
    def rate_unit(self) -> str:
        """Unit of its rate ("rad/s" gives "rad/s^2")."""
        return f"{self.unit}^2" if self.unit.endswith("/s") else f"{self.unit}/s"


class TriangularSystem(ABC):
    """A driftless two-input system in triangular form.

    A subclass gives the functions fᵢ twice: as CasADi expressions, from which the chained form and
    the optimal planners are derived, and as NumPy code, which only the verifier and the emulated
    machine use. Neither calls the other, so each checks the other.

    All array methods take the coordinate on the last axis and broadcast over the others.
    """

    kind: ClassVar[str]

    def __repr__(self) -> str:
        names = ", ".join(c.name for c in self.coordinates)
        inputs = ", ".join(c.name for c in self.inputs)
        return f"{type(self).__name__}({names}; inputs {inputs})"

    @property
    @abstractmethod
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The N coordinates in triangular order."""

    @property
    @abstractmethod
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """The two inputs u₁, u₂ with their units."""

    @cached_property
    def size(self) -> int:
        """Number of coordinates N."""
        return len(self.coordinates)

    @property
    def limited(self) -> tuple[int, ...]:
        """Indices of the coordinates that joint limits apply to (all but the path coordinate)."""
        return tuple(range(1, self.size))

    # -- symbolic form -------------------------------------------------------------------------

    @abstractmethod
    def slopes_expr(self, q: Any) -> list[Any]:
        """CasADi expressions of f₃ … f_N (a list of N−2) in the CasADi vector q (N)."""

    @abstractmethod
    def drive_expr(self, q: Any) -> Any:
        """CasADi expression of γ(q), with v₁ = γ(q) u₁."""

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """CasADi expressions of q̇ (a list of N) for inputs u (2)."""
        v1 = self.drive_expr(q) * u[0]
        return [v1, u[1], *(f * v1 for f in self.slopes_expr(q))]

    # -- numeric form --------------------------------------------------------------------------

    @abstractmethod
    def slopes(self, q: Array) -> Array:
        """f₃ … f_N, shape (…, N−2), at q (…, N): the path form dqᵢ/dq₁."""

    @abstractmethod
    def drive(self, q: Array) -> Array:
        """γ(q), shape (…,), at q (…, N)."""

    def rates(self, q: Array, u: Array) -> Array:
        """q̇, shape (…, N), at q (…, N) under inputs u (…, 2)."""
        v1 = self.drive(q) * u[..., 0]
        tail = self.slopes(q) * v1[..., None]
        return np.concatenate([v1[..., None], u[..., 1:2], tail], axis=-1)

    # -- the chart -----------------------------------------------------------------------------

    @abstractmethod
    def branch(self, q: Array) -> Array:
        """Numbers (N,) that tell which of the chart's branches q lies on; 0 on a singularity."""

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
        """`link_from_slope` as a CasADi expression, NaN where no real solution exists.

        Where every link has one the whole inverse is compiled into one function; None, the default,
        leaves it to `link_from_slope`.
        """
        return None

    @abstractmethod
    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Signed margins of `link_from_slope` at index i, one array (…,) per label; > 0 inside."""

    @abstractmethod
    def chart_margins(self, q: Array, branch: Array) -> Array:
        """The same margins from coordinates: shape (…, M), signed by branch, q on (…, N)."""

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """`chart_margins` as CasADi expressions (a list of M); the default, none, has no proof."""
        return []

    @property
    @abstractmethod
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """For each margin: the array index of its coordinate, and its meaning in words."""

    # -- identity ------------------------------------------------------------------------------

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The `[system]` table of a problem file that gives this system back."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TriangularSystem) and self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)

    @cached_property
    def _text(self) -> str:
        return repr(self.to_dict())
