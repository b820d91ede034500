"""What distinguishes one transcription from another: all else is data.

Collocation schemes: points, differentiation, quadrature, end point and Bernstein form.

On one interval, scaled to [0, 1], a coordinate is the polynomial of degree d through its value at 0
and at the d collocation points. Everything else is linear in those d + 1 values.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.5.

Meshes: how scaled time [0, 1] is cut into intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import casadi as ca
import numpy as np
from scipy.special import comb

from planner.methods.collocation.transcription.augmented import Augmented
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Requirement
from planner.support.arrays import Array

Kind = Literal["radau", "legendre"]


@dataclass(frozen=True, eq=False)
class Scheme:
    """Weights of one scheme; build it with `scheme`.

    Attributes:
        kind: "radau" (right end point is a collocation point, order 2d − 1 at the end of an
            interval) or "legendre" (order 2d).
        degree: Number d of collocation points.
        points: τ₁ … τ_d, shape (d,), in (0, 1].
        differentiation: Shape (d, d+1): values at (0, τ₁ … τ_d) to derivatives at τ₁ … τ_d.
        integration: Shape (d, d): rates at the points to the moves from 0 to τ₁ … τ_d.
        quadrature: Shape (d,): ∫₀¹ f ≈ Σ quadrature · f(points).
        end: Shape (d+1,): values to the value at 1.
        bernstein: Shape (d+1, d+1): values to Bernstein coefficients.
    """

    kind: Kind
    degree: int
    points: Array
    differentiation: Array
    integration: Array
    quadrature: Array
    end: Array
    bernstein: Array

    @property
    def closed(self) -> bool:
        """Whether the last collocation point is the interval's end."""
        return self.kind == "radau"


@lru_cache(maxsize=16)
def scheme(kind: Kind, degree: int) -> Scheme:
    """The scheme of that kind and degree (1 to 5)."""
    points = np.array(ca.collocation_points(degree, kind))
    derivative, end = (np.array(m) for m in ca.collocation_coeff(points.tolist())[:2])
    powers = np.arange(degree)
    moments = points ** powers[:, None]
    values = bernstein_values(degree, np.array([0.0, *points]))
    return Scheme(
        kind=kind,
        degree=degree,
        points=points,
        differentiation=derivative.T,
        integration=np.asarray(np.linalg.inv(derivative.T[:, 1:]), dtype=float),
        quadrature=np.asarray(np.linalg.solve(moments, 1 / (powers + 1.0)), dtype=float),
        end=end.ravel(),
        bernstein=np.asarray(np.linalg.inv(values), dtype=float),
    )


def bernstein_values(degree: int, tau: Array) -> Array:
    """Bernstein polynomials of that degree at tau (m,): shape (m, degree+1)."""
    j = np.arange(degree + 1)
    x = tau[:, None]
    return np.asarray(comb(degree, j) * x**j * (1 - x) ** (degree - j))


InputKind = Literal["constant", "linear"]


TERMS = 6
"""Terms of the objective: duration, effort of each input, its smoothness, closeness to edges."""


def held_by(problem: Problem) -> list[Requirement]:
    """What may be broken between the nodes: all but inputs and their rates as they are."""
    drives = {"u", "du"}
    return [each for each in problem.requirements if not (each.plain and each.reads & drives)]


@dataclass(frozen=True)
class Form:
    """The shape of a transcription; with the system, the key under which it is kept.

    Attributes:
        intervals: Number K of mesh intervals.
        scheme_kind: Family of collocation points.
        degree: Collocation points per interval.
        input: "constant" in each interval, or "linear" and continuous.
        free_duration: Whether the duration is an unknown; else it is a parameter.
        kept: What rows are for, without numbers, see `held_by`.
        final: What rows at the end are for, likewise.
        edge: Whether closeness to the edge of the chart's domain is a term of the objective.
        inner: Whether what is kept holds at the collocation points too, not only at the mesh's
            edges.
        compiled: Whether the functions of one interval are compiled by a C compiler.
        augmented: What moves, where that is more than the system: its response to errors too.
    """

    intervals: int
    scheme_kind: Kind = "radau"
    degree: int = 3
    input: InputKind = "constant"
    free_duration: bool = True
    inner: bool = False
    kept: tuple[Requirement, ...] = ()
    final: tuple[Requirement, ...] = ()
    edge: bool = False
    compiled: bool = False
    augmented: Augmented | None = None

    @property
    def parameters(self) -> int:
        """Numbers an interval is given beside its width.

        The objective's weights, those of what is kept, the duration if it is known.
        """
        own = sum(len(required.numbers) for required in (*self.kept, *self.final))
        return TERMS + own + (not self.free_duration)

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


@dataclass(frozen=True, eq=False)
class Mesh:
    """A partition of [0, 1].

    Attributes:
        edges: Increasing, shape (K+1,), from 0 to 1.
        marks: Edges at which waypoints are passed, in their order on the way.
    """

    edges: Array
    marks: tuple[int, ...] = ()

    @cached_property
    def widths(self) -> Array:
        """Interval widths, shape (K,)."""
        return np.asarray(self.edges[1:] - self.edges[:-1])

    @property
    def knots(self) -> Array:
        """0, the fractions at which waypoints are passed, and 1."""
        return self.edges[[0, *self.marks, len(self.edges) - 1]]

    def at(self, tau: Array) -> Array:
        """Fractions of the whole, shape (K, m), of places tau (m,) in each interval."""
        return np.asarray(self.edges[:-1, None] + self.widths[:, None] * tau)

    def snapped(self, edges: Array) -> Mesh:
        """Another partition, whose nearest edges are moved onto this one's marks."""
        edges = edges.copy()
        marks: list[int] = []
        for knot in self.knots[1:-1]:
            first = marks[-1] + 1 if marks else 1
            k = max(int(np.argmin(np.abs(edges - knot))), first)
            edges[k] = knot
            marks.append(k)
        return Mesh(np.sort(edges), tuple(marks))


def uniform(intervals: int) -> Mesh:
    """K intervals of the same width."""
    return Mesh(np.linspace(0.0, 1.0, intervals + 1))


def through(intervals: int, fractions: Sequence[float]) -> Mesh:
    """About K intervals, as even as may be, with edges at the fractions (increasing, inside)."""
    knots = np.array([0.0, *fractions, 1.0])
    counts = np.maximum(1, np.round(intervals * np.diff(knots)).astype(int))
    parts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(knots[:-1], knots[1:], counts, strict=True)
    ]
    marks = np.cumsum(counts)[:-1]
    return Mesh(np.append(np.concatenate(parts), 1.0), tuple(int(k) for k in marks))
