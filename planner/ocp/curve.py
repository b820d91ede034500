"""From the unknowns to the motion: the interpolant that the scheme itself uses."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly

from planner.ocp.form import Form
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.systems.base import TriangularSystem
from planner.trajectory import StateTrajectory


def curve(system: TriangularSystem, form: Form, mesh: Mesh, iterate: Iterate) -> StateTrajectory:
    """The motion of a system, which may not be all that moves."""
    q, u = pieces(form, mesh, iterate)
    return StateTrajectory(system, BPoly(q.c[..., : system.size], q.x), u)


def pieces(form: Form, mesh: Mesh, iterate: Iterate) -> tuple[BPoly, BPoly]:
    """Piecewise polynomials in time: all states of degree d, u of degree 0 or 1."""
    breaks = mesh.edges * iterate.duration
    values = np.concatenate([iterate.nodes[:-1, None], iterate.points], axis=1)
    q = (form.scheme.bernstein @ values).swapaxes(0, 1)
    q[0], q[-1] = iterate.nodes[:-1], iterate.nodes[1:]
    left, right = iterate.input_ends()
    u = np.stack([left, right]) if form.input == "linear" else left[None]
    return BPoly(q, breaks), BPoly(u, breaks)
