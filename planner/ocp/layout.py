"""Where each quantity sits in the solver's vector of unknowns.

    w = (T, X₀, [U₀, P₀, (X₁)], [U₁, P₁, (X₂)], …, (U_K))

X are the states at the mesh's edges, P those at the collocation points, U the inputs. Radau's last
point is the next edge, so X appears by itself only for Gauss–Legendre; the last U only for a linear
input. An interval touches a fixed number of neighbours: the problem's matrices are banded, but for
the column of T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.ocp.form import Form
from planner.systems.base import Array

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Iterate:
    """The unknowns by name.

    Attributes:
        duration: T in seconds.
        nodes: States at the mesh's edges, shape (K+1, N).
        points: States at the collocation points, shape (K, d, N).
        inputs: Shape (K, 2) if constant in each interval, (K+1, 2) if linear.
    """

    duration: float
    nodes: Array
    points: Array
    inputs: Array

    def input_ends(self) -> tuple[Array, Array]:
        """Inputs at the left and right end of each interval, shapes (K, 2)."""
        if len(self.inputs) == len(self.points):
            return self.inputs, self.inputs
        return self.inputs[:-1], self.inputs[1:]


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions in the vector of unknowns.

    Attributes:
        size: Number of unknowns.
        nodes: Shape (K+1, N).
        points: Shape (K, d, N).
        inputs: Shape (K or K+1, 2).
        stages: Shape (K, m): what interval k touches, in the order (T, X_k, U_k, (U_{k+1}), P_k,
            (X_{k+1})).
    """

    size: int
    nodes: Index
    points: Index
    inputs: Index
    stages: Index

    def pack(self, iterate: Iterate) -> Array:
        """Names to vector, shape (size,)."""
        w = np.empty(self.size)
        w[0] = iterate.duration
        w[self.inputs] = iterate.inputs
        w[self.points] = iterate.points
        w[self.nodes] = iterate.nodes
        return w

    def unpack(self, w: Array) -> Iterate:
        """Vector to names."""
        return Iterate(float(w[0]), w[self.nodes], w[self.points], w[self.inputs])


def layout(form: Form, size: int) -> Layout:
    """The layout for a system of `size` coordinates."""
    K, d, closed = form.intervals, form.degree, form.scheme.closed
    block = 2 + d * size + (0 if closed else size)
    starts = 1 + size + block * np.arange(K)
    inputs = starts[:, None] + np.arange(2)
    points = (starts[:, None] + 2 + np.arange(d * size)).reshape(K, d, size)
    after = points[:, -1] if closed else points[:, -1] + size
    nodes = np.concatenate([1 + np.arange(size)[None], after])
    count = 1 + size + block * K
    if form.input == "linear":
        inputs = np.concatenate([inputs, count + np.arange(2)[None]])
        count += 2
    parts = [np.zeros((K, 1), dtype=np.int64), nodes[:-1], inputs[:K]]
    parts += [inputs[1:]] if form.input == "linear" else []
    parts += [points.reshape(K, -1)]
    parts += [] if closed else [nodes[1:]]
    return Layout(count, nodes, points, inputs, np.concatenate(parts, axis=1))
