"""Meshes: how scaled time [0, 1] is cut into intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A partition of [0, 1].

    Attributes:
        edges: Increasing, shape (K+1,), from 0 to 1.
    """

    edges: Array

    @property
    def widths(self) -> Array:
        """Interval widths, shape (K,)."""
        return np.diff(self.edges)

    def at(self, tau: Array) -> Array:
        """Fractions of the whole, shape (K, m), of places tau (m,) in each interval."""
        return np.asarray(self.edges[:-1, None] + self.widths[:, None] * tau)


def uniform(intervals: int) -> Mesh:
    """K intervals of the same width."""
    return Mesh(np.linspace(0.0, 1.0, intervals + 1))
