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

from planner.ocp.augmented import Moved
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.systems.base import Array
from planner.systems.pointwise import Call

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


def resimulate(system: Moved, mesh: Mesh, iterate: Iterate, start: Array) -> Motion:
    """Integrate an iterate's input from `start` (N,)."""
    K = len(mesh.widths)
    given = start, mesh.widths * iterate.duration, *iterate.input_ends()
    states = np.empty((K, STEPS + 1, system.size))
    states[:, 1:] = _runner(system, K)(*given).reshape(K, STEPS, system.size)
    states[0, 0], states[1:, 0] = start, states[:-1, -1]
    return Motion(mesh.at(np.arange(STEPS + 1) / STEPS), states)


@lru_cache(maxsize=32)
def _runner(system: Moved, intervals: int) -> Call:
    """From the start, the intervals' seconds and the inputs at their ends to all samples."""
    whole = _interval(system).mapaccum(intervals)
    inputs = [ca.MX.sym(name, whole.sparsity_in(k)) for k, name in enumerate("qsab")]
    return Call(ca.Function("resimulate", inputs, whole(*inputs)[1:]))


@lru_cache(maxsize=32)
def _interval(system: Moved) -> Any:
    """To the end of one interval, and all samples, step by step."""
    q, seconds, a, b = (
        ca.SX.sym(name, size) for name, size in zip("qsab", (system.size, 1, 2, 2), strict=True)
    )
    h, samples = seconds / STEPS, [q]
    for k in range(STEPS):
        u = [a + (2 * k + j) / (2 * STEPS) * (b - a) for j in range(3)]
        samples.append(_step(system)(samples[-1], h, *u))
    return ca.Function("interval", [q, seconds, a, b], [samples[-1], ca.horzcat(*samples[1:])])


@lru_cache(maxsize=32)
def _step(system: Moved) -> Any:
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
