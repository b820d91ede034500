"""What distinguishes one transcription from another: all else is data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from planner.ocp.scheme import Kind, Scheme, scheme

InputKind = Literal["constant", "linear"]


@dataclass(frozen=True)
class Form:
    """The shape of a transcription; with the system, the key under which it is kept.

    Attributes:
        intervals: Number K of mesh intervals.
        scheme_kind: Family of collocation points.
        degree: Collocation points an interval.
        input: "constant" in each interval, or "linear" and continuous.
        rate_limits: Whether the slopes of a linear input are constrained.
        chart: Whether z₂ is constrained.
    """

    intervals: int
    scheme_kind: Kind = "radau"
    degree: int = 3
    input: InputKind = "constant"
    rate_limits: bool = False
    chart: bool = False

    @property
    def scheme(self) -> Scheme:
        """The weights."""
        return scheme(self.scheme_kind, self.degree)

    @property
    def input_nodes(self) -> int:
        """Number of input values: K constants, or K + 1 corners."""
        return self.intervals + (self.input == "linear")
