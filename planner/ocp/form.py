"""What distinguishes one transcription from another: all else is data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from planner.ocp.augmented import Augmented
from planner.ocp.mesh import Mesh
from planner.ocp.scheme import Kind, Scheme, scheme
from planner.systems.base import Array

InputKind = Literal["constant", "linear"]


TERMS = 6
"""Terms of the objective: duration, effort of each input, its smoothness, closeness to edges."""


@dataclass(frozen=True)
class Form:
    """The shape of a transcription; with the system, the key under which it is kept.

    Attributes:
        intervals: Number K of mesh intervals.
        scheme_kind: Family of collocation points.
        degree: Collocation points an interval.
        input: "constant" in each interval, or "linear" and continuous.
        free_duration: Whether the duration is an unknown; else it is a parameter.
        chart: Whether z₂ is constrained.
        obstacles: Number of discs that the links must clear.
        edge: Whether closeness to the edge of the chart's domain is a term of the objective.
        inner: Whether limits on coordinates and z₂ hold at the collocation points too, not only at
            the mesh's edges.
        compiled: Whether the functions of one interval are compiled by a C compiler.
        augmented: What moves, where that is more than the system: its response to errors too.
    """

    intervals: int
    scheme_kind: Kind = "radau"
    degree: int = 3
    input: InputKind = "constant"
    free_duration: bool = True
    chart: bool = False
    inner: bool = False
    obstacles: int = 0
    edge: bool = False
    compiled: bool = False
    augmented: Augmented | None = None

    @property
    def parameters(self) -> int:
        """Numbers an interval is given beside its width.

        The objective's weights, centre and radius of each disc, the duration if it is known.
        """
        return TERMS + 3 * self.obstacles + (not self.free_duration)

    @property
    def scheme(self) -> Scheme:
        """The weights."""
        return scheme(self.scheme_kind, self.degree)

    @property
    def input_nodes(self) -> int:
        """Number of input values over time: K constants, or K + 1 corners."""
        return self.intervals + (self.input == "linear")

    def input_places(self, mesh: Mesh) -> Array:
        """Fractions of the duration at which `Iterate.inputs` are sampled from a curve.

        Shape (K,) in the middles, or (K+1,) at the edges.
        """
        return mesh.edges if self.input == "linear" else mesh.edges[:-1] + mesh.widths / 2
