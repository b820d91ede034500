"""The motion that an input really makes, by a Runge–Kutta method with small fixed steps.

It samples the true motion between the nodes, for drawing limits in and for judging the mesh. It is
fast, and shares the system's expressions with the transcription; the independent judge is `verify`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.systems.base import Array, TriangularSystem
from planner.systems.pointwise import evaluated

STEPS = 12
"""Steps an interval."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of the true motion.

    Attributes:
        fractions: Of the duration, shape (K, STEPS + 1).
        states: Shape (K, STEPS + 1, N); an interval's last sample is the next one's first.
    """

    fractions: Array
    states: Array

    @property
    def end(self) -> Array:
        """The state reached, shape (N,)."""
        return np.asarray(self.states[-1, -1])


def resimulate(system: TriangularSystem, mesh: Mesh, iterate: Iterate, start: Array) -> Motion:
    """Integrate an iterate's input from `start` (N,)."""
    K = len(mesh.widths)
    left, right = iterate.input_ends()
    tau = np.arange(2 * STEPS + 1) / (2 * STEPS)
    u = left[:, None] + tau[:, None] * (right - left)[:, None]
    steps = np.repeat(mesh.widths * iterate.duration / STEPS, STEPS)
    given = start, steps, u[:, :-1:2], u[:, 1::2], u[:, 2::2]
    states = np.empty((K, STEPS + 1, system.size))
    states[:, 1:] = evaluated(_runner(system, K * STEPS), given, np.empty((K, STEPS, system.size)))
    states[0, 0], states[1:, 0] = start, states[:-1, -1]
    return Motion(mesh.at(tau[::2]), states)


@lru_cache(maxsize=32)
def _runner(system: TriangularSystem, count: int) -> Any:
    return _step(system).mapaccum("resimulate", count)


@lru_cache(maxsize=32)
def _step(system: TriangularSystem) -> Any:
    """One step of the classical Runge–Kutta method of order 4."""
    q, h = ca.SX.sym("q", system.size), ca.SX.sym("h")
    u = [ca.SX.sym(name, 2) for name in ("first", "middle", "last")]

    def rates(q: Any, u: Any) -> Any:
        return ca.vertcat(*system.rates_expr(q, u))

    a = rates(q, u[0])
    b = rates(q + h / 2 * a, u[1])
    c = rates(q + h / 2 * b, u[1])
    d = rates(q + h * c, u[2])
    return ca.Function("step", [q, h, *u], [q + h / 6 * (a + 2 * b + 2 * c + d)])
