"""What distinguishes one transcription from another: all else is data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planner.ocp.mesh import Mesh
from planner.ocp.scheme import Kind, Scheme, scheme
from planner.systems.base import Array

InputKind = Literal["constant", "linear", "jumping"]
_JUST_INSIDE = np.array([1e-9, 1 - 1e-9])


@dataclass(frozen=True)
class Form:
    """The shape of a transcription; with the system, the key under which it is kept.

    Attributes:
        intervals: Number K of mesh intervals.
        scheme_kind: Family of collocation points.
        degree: Collocation points an interval.
        input: "constant" in each interval, "linear" and continuous, or "jumping": linear in each
            interval, with jumps between them.
        rate_limits: Whether the input's slopes are constrained by rows; where they are unknowns
            themselves, as in `layout`, this makes no difference.
        chart: Whether z₂ is constrained.
        inner: Whether limits on coordinates and z₂ hold at the collocation points too, not only at
            the mesh's edges.
        compiled: Whether the functions of one interval are compiled by a C compiler.
    """

    intervals: int
    scheme_kind: Kind = "radau"
    degree: int = 3
    input: InputKind = "constant"
    rate_limits: bool = False
    chart: bool = False
    inner: bool = False
    compiled: bool = False

    @property
    def scheme(self) -> Scheme:
        """The weights."""
        return scheme(self.scheme_kind, self.degree)

    @property
    def input_nodes(self) -> int:
        """Number of input values over time: K constants, K + 1 corners, or 2 K ends."""
        return {"constant": self.intervals, "linear": self.intervals + 1}.get(
            self.input, 2 * self.intervals
        )

    def input_places(self, mesh: Mesh) -> Array:
        """Fractions of the duration at which `Iterate.inputs` are sampled from a curve.

        Shape (K,) in the middles, (K+1,) at the edges, or (K, 2) just inside either end.
        """
        if self.input == "constant":
            return mesh.edges[:-1] + mesh.widths / 2
        return mesh.edges if self.input == "linear" else mesh.at(_JUST_INSIDE)
