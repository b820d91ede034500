"""Where each quantity sits in the solver's vector of unknowns.

    w = (y₀, c₀, y₁, c₁, …, y_K)        y = (X, [T], [V])        c = (U, P)

Stage by stage, as solvers want it that know the structure of optimal control: the state y at an
edge of the mesh, then the control c of the interval that begins there. X are the coordinates. The
duration T, if free, is a state that stays what it is, so that no unknown belongs to all stages.
The input U is a constant; or, where it must not jump, the slope of a line that starts at V, which
is then part of the state. P are the collocation values of the lifted coordinates (see `order`):
none for the manipulator.
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
    """The unknowns, and what follows from them, by name.

    Attributes:
        duration: T in seconds.
        nodes: States at the mesh's edges, shape (K+1, N).
        points: States at the collocation points, shape (K, d, N).
        inputs: Shape (K, 2) if constant in each interval, (K+1, 2) at the edges if linear.
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
        intervals: Number K.
        state: Entries of y.
        control: Entries of c.
        nodes: Positions of X, shape (K+1, N).
        durations: Positions of T, shape (K+1,), or (0,) if it is known.
        inputs: Positions of inputs, in the shape of `Iterate.inputs`.
        slopes: Positions of the slopes of a linear input, shape (K, 2), else (0, 2).
        points: Positions of P, shape (K, d, L).
        lifted: The L lifted coordinates.
    """

    intervals: int
    state: int
    control: int
    nodes: Index
    durations: Index
    inputs: Index
    slopes: Index
    points: Index
    lifted: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.intervals * (self.state + self.control) + self.state

    def pack(self, iterate: Iterate, widths: Array) -> Array:
        """Names to vector, shape (size,), on a mesh of these widths (K,)."""
        w = np.empty(self.size)
        w[self.nodes] = iterate.nodes
        w[self.durations] = iterate.duration
        w[self.inputs] = iterate.inputs
        if len(self.slopes):
            left, right = iterate.input_ends()
            w[self.slopes] = (right - left) / (widths[:, None] * iterate.duration)
        w[self.points] = iterate.points[:, :, list(self.lifted)]
        return w


def layout(form: Form, size: int, lifted: tuple[int, ...]) -> Layout:
    """The layout for a system of `size` coordinates, some of them lifted."""
    K, d = form.intervals, form.degree
    linear = form.input == "linear"
    corners = size + form.free_duration
    state = corners + (2 if linear else 0)
    control = 2 + d * len(lifted)
    edges = (state + control) * np.arange(K + 1)
    controls = edges[:-1, None] + state + np.arange(control)
    return Layout(
        intervals=K,
        state=state,
        control=control,
        nodes=edges[:, None] + np.arange(size),
        durations=edges + size if form.free_duration else np.empty(0, dtype=np.int64),
        inputs=edges[:, None] + corners + np.arange(2) if linear else controls[:, :2],
        slopes=controls[:, :2] if linear else np.empty((0, 2), dtype=np.int64),
        points=controls[:, 2:].reshape(K, d, len(lifted)),
        lifted=lifted,
    )
