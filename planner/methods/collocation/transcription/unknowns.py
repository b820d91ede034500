"""The vector of unknowns of a solver, and the motions that it describes.

    w = (y₀, c₀, y₁, c₁, …, y_K)        y = (X, [T], [V], [B])        c = (U, P)

The order is by stages, as solvers for optimal control require it: the state y at an edge of the
mesh, then the control c of the interval that begins there. X are the coordinates. A free duration T
is a constant state, so that no unknown belongs to all stages. The input U is a constant; or, if it
must not jump, the slope of a line that starts at V, which is then part of the state. B are the
joints of the nominal machine (see `follower`). P are the collocation values of the lifted
coordinates (see `order`); the manipulator has none.

Two motions are computed from the vector: the interpolant of the scheme, and the true motion under
the input, by a Runge–Kutta method with small fixed steps. The true motion is sampled between the
nodes, to tighten limits and to refine the mesh. This is fast, and uses the same expressions of the
system as the transcription; the independent judge is `verify`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.methods.collocation.transcription.augmented import MovingSystem
from planner.methods.collocation.transcription.form import Form, Mesh, Units
from planner.plan.trajectory import StateTrajectory
from planner.support.arrays import Array
from planner.support.calculus import runge_kutta
from planner.support.calculus.bernstein import Bernstein
from planner.support.compiled_calls import Call
from planner.systems.triangular_system import TriangularSystem

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Iterate:
    """The unknowns, and the values that follow from the unknowns, by name.

    Attributes:
        duration: T in seconds.
        nodes: States at the mesh's edges, shape (K+1, N).
        points: States at the collocation points, shape (K, d, N).
        inputs: Inputs, shape (K, 2) if constant in each interval, (K+1, 2) at the edges if linear.
        joints: States of a `Follower` at the mesh's edges, shape (K+1, P).
    """

    duration: float
    nodes: Array
    points: Array
    inputs: Array
    joints: Array = field(default_factory=lambda: np.zeros((1, 0)))

    def input_ends(self) -> tuple[Array, Array]:
        """Return the inputs at the left and at the right end of each interval, both (K, 2)."""
        if len(self.inputs) == len(self.points):
            return self.inputs, self.inputs
        return self.inputs[:-1], self.inputs[1:]


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions of the unknowns in the solver's vector; the module's text explains the letters.

    Attributes:
        intervals: Number K of intervals.
        state: Number of entries of y.
        control: Number of entries of c.
        nodes: Positions of X, shape (K+1, N).
        durations: Positions of T, shape (K+1,), or (0,) if T is known.
        inputs: Positions of the inputs, in the shape of `Iterate.inputs`.
        slopes: Positions of the slopes of a linear input, shape (K, 2), else (0, 2).
        joints: Positions of B, shape (K+1, P).
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
    joints: Index
    points: Index
    lifted: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.intervals * (self.state + self.control) + self.state

    def units(self, units: Units) -> Array:
        """Return the natural units of the unknowns, shape (size,)."""
        w = np.ones(self.size)
        w[self.durations], w[self.inputs] = units.time_s, units.inputs
        w[self.slopes] = np.array(units.inputs) / units.time_s
        return w

    def pack(self, iterate: Iterate, widths: Array) -> Array:
        """Return an iterate as a vector (size,), in the problem's units, for mesh widths (K,)."""
        w = np.empty(self.size)
        w[self.nodes] = iterate.nodes
        w[self.durations] = iterate.duration
        w[self.inputs] = iterate.inputs
        if len(self.slopes):
            left, right = iterate.input_ends()
            w[self.slopes] = (right - left) / (widths[:, None] * iterate.duration)
        w[self.joints] = iterate.joints
        w[self.points] = iterate.points[:, :, list(self.lifted)]
        return w


def layout(form: Form, size: int, lifted: tuple[int, ...]) -> Layout:
    """Return the positions of the unknowns for a form and a system of `size` coordinates."""
    K, d = form.intervals, form.degree
    linear = form.input == "linear"
    corners = size + form.free_duration
    first = corners + (2 if linear else 0)
    state = first + (form.follower.size if form.follower else 0)
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
        joints=edges[:, None] + np.arange(first, state),
        points=controls[:, 2:].reshape(K, d, len(lifted)),
        lifted=lifted,
    )


def curve(system: TriangularSystem, form: Form, mesh: Mesh, iterate: Iterate) -> StateTrajectory:
    """Convert an iterate to a trajectory of the system, without states for response and effort."""
    q, u = pieces(form, mesh, iterate)
    return StateTrajectory(system, Bernstein(q.c[..., : system.size], q.x), u)


def pieces(form: Form, mesh: Mesh, iterate: Iterate) -> tuple[Bernstein, Bernstein]:
    """Convert an iterate to curves in time: all states, of degree d, and u, of degree 0 or 1."""
    breaks = mesh.edges * iterate.duration
    values = np.concatenate([iterate.nodes[:-1, None], iterate.points], axis=1)
    q = (form.scheme.bernstein @ values).swapaxes(0, 1)
    q[0], q[-1] = iterate.nodes[:-1], iterate.nodes[1:]
    left, right = iterate.input_ends()
    u = np.stack([left, right]) if form.input == "linear" else left[None]
    return Bernstein(q, breaks), Bernstein(u, breaks)


STEPS = 12
"""Number of Runge–Kutta steps per interval in the simulation of the true motion."""


def resimulate(system: MovingSystem, mesh: Mesh, iterate: Iterate, start: Array) -> Array:
    """Simulate the true motion under an iterate's input from `start` (N,).

    The samples, (K, STEPS + 1, N), of an interval begin with the last of the interval before.
    """
    K = len(mesh.widths)
    inputs = start, mesh.widths * iterate.duration, *iterate.input_ends()
    states = np.empty((K, STEPS + 1, system.size))
    states[:, 1:] = _runner(system, K, through=True)(*inputs).reshape(K, STEPS, system.size)
    states[0, 0], states[1:, 0] = start, states[:-1, -1]
    return states


def resimulated_apart(system: MovingSystem, mesh: Mesh, iterate: Iterate) -> Array:
    """Simulate each interval from the node at its left edge; return samples (K, STEPS + 1, N)."""
    K, nodes = len(mesh.widths), iterate.nodes[:-1]
    inputs = nodes, mesh.widths * iterate.duration, *iterate.input_ends()
    samples = _runner(system, K, through=False)(*inputs).reshape(K, STEPS, system.size)
    return np.concatenate([nodes[:, None], samples], axis=1)


@lru_cache(maxsize=32)
def _runner(system: MovingSystem, intervals: int, through: bool) -> Call:
    """Build the function that simulates all intervals and returns samples of the states.

    The arguments are the start, the durations of the intervals, and the inputs at the left and
    right ends of the intervals. Unless `through`, each interval has its own start.
    """
    one = _interval(system)
    whole = one.mapaccum(intervals) if through else one.map(intervals)
    inputs = [ca.MX.sym(name, whole.sparsity_in(k)) for k, name in enumerate("qsab")]
    return Call(ca.Function("resimulate", inputs, whole(*inputs)[1:]))


@lru_cache(maxsize=32)
def _interval(system: MovingSystem) -> Any:
    """Build the CasADi function that simulates one interval and returns its end and all samples."""
    q, seconds, a, b = map(ca.SX.sym, "qsab", (system.size, 1, 2, 2))
    h, samples = seconds / STEPS, [q]
    for k in range(STEPS):
        u = [a + (2 * k + j) / (2 * STEPS) * (b - a) for j in range(3)]
        samples.append(_step(system)(samples[-1], h, *u))
    return ca.Function("interval", [q, seconds, a, b], [samples[-1], ca.horzcat(*samples[1:])])


@lru_cache(maxsize=32)
def _step(system: MovingSystem) -> Any:
    q, h = ca.SX.sym("q", system.size), ca.SX.sym("h")
    u = [ca.SX.sym(name, 2) for name in ("first", "middle", "last")]

    def rates(q: Any, k: int) -> Any:
        return ca.vertcat(*system.rates_expr(q, u[k]))

    return ca.Function("step", [q, h, *u], [runge_kutta.step(rates, q, h)])
