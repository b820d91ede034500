"""Meshes: how scaled time [0, 1] is cut into intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.systems.base import Array


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
