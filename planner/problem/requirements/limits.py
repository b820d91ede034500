"""Limits that hold at all times: of inputs, their rates, coordinates, and z₂."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

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
        words: What stands before a name in its label.
        named: All of them, with names and units.
        most: Their limits; infinite where there is none.
    """

    words: ClassVar[str]
    named: tuple[Coordinate, ...]
    most: Array

    @property
    def parts(self) -> tuple[Part, ...]:
        """One for each that is limited."""
        out = []
        for i in self._limited:
            label, most = f"{self.words} {self.named[i].name}", float(self.most[i])
            out.append(Part(label, self._unit(self.named[i]), -most, most, most, i))
        return tuple(out)

    def values(self, at: At) -> Sequence[Any]:
        """What it reads, as it is."""
        (name,) = self.reads
        return [getattr(at, name)[..., i] for i in self._limited]

    @property
    def _limited(self) -> list[int]:
        return [int(i) for i in np.flatnonzero(np.isfinite(self.most))]

    def _unit(self, named: Coordinate) -> str:
        return named.unit


class InputLimit(_Symmetric):
    """|uᵢ| ≤ most."""

    words, reads = "input", frozenset({"u"})


class RateLimit(_Symmetric):
    """|duᵢ/dt| ≤ most; where an input jumps its rate is infinite."""

    words, reads = "rate of input", frozenset({"du"})

    def _unit(self, named: Coordinate) -> str:
        return named.rate_unit


class JointLimit(_Symmetric):
    """|qᵢ| ≤ most."""

    words, reads = "joint", frozenset({"q"})


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
