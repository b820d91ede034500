"""Limits that hold at all times: of inputs, their rates, coordinates, and z₂."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.problem.requirements.requirement import At, Part, Requirement
from planner.support.arrays import Array
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import Coordinate

SMALLEST_Z2 = 1e-3
"""Scale of a z₂ margin that is smaller: an excess is compared with z₂ itself, which is near 1."""


@dataclass(frozen=True, eq=False)
class _Symmetric(Requirement):
    """|value| ≤ most for some inputs or coordinates.

    Attributes:
        named: All of them, with names and units.
        most: Their limits; infinite where there is none.
    """

    named: tuple[Coordinate, ...]
    most: Array

    def _part(self, i: int, label: str, unit: str) -> Part:
        most = float(self.most[i])
        return Part(label, unit, -most, most, most, i)

    @property
    def _limited(self) -> list[int]:
        return [int(i) for i in np.flatnonzero(np.isfinite(self.most))]


@dataclass(frozen=True, eq=False)
class InputLimit(_Symmetric):
    """|uᵢ| ≤ most."""

    reads = frozenset({"u"})

    @property
    def parts(self) -> tuple[Part, ...]:
        """One an input that is limited."""
        named = self.named
        return tuple(self._part(i, f"input {named[i].name}", named[i].unit) for i in self._limited)

    def values(self, at: At) -> Sequence[Any]:
        """The inputs."""
        return [at.u[..., i] for i in self._limited]


@dataclass(frozen=True, eq=False)
class RateLimit(_Symmetric):
    """|duᵢ/dt| ≤ most; where an input jumps its rate is infinite."""

    reads = frozenset({"du"})

    @property
    def parts(self) -> tuple[Part, ...]:
        """One an input whose rate is limited."""
        return tuple(
            self._part(i, f"rate of input {self.named[i].name}", self.named[i].rate_unit)
            for i in self._limited
        )

    def values(self, at: At) -> Sequence[Any]:
        """The inputs' rates."""
        return [at.du[..., i] for i in self._limited]


@dataclass(frozen=True, eq=False)
class JointLimit(_Symmetric):
    """|qᵢ| ≤ most."""

    reads = frozenset({"q"})

    @property
    def parts(self) -> tuple[Part, ...]:
        """One a coordinate that is limited."""
        named = self.named
        return tuple(self._part(i, f"joint {named[i].name}", named[i].unit) for i in self._limited)

    def values(self, at: At) -> Sequence[Any]:
        """The coordinates."""
        return [at.q[..., i] for i in self._limited]


@dataclass(frozen=True, eq=False)
class Z2Margin(Requirement):
    """z₂ on the start's side of zero, by a margin.

    Attributes:
        margin: Least |z₂|.
        sign: Sign of z₂ at the start.
    """

    margin: float
    sign: float

    reads = frozenset({"q"})
    shaped = True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One."""
        return (Part("z2 margin", "", self.margin, np.inf, max(self.margin, SMALLEST_Z2)),)

    def values(self, at: At) -> Sequence[Any]:
        """z₂, positive on the start's side."""
        return [self.sign * chained_form(at.system).z(at.q)[..., 1]]
