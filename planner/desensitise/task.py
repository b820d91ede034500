"""One problem's numbers in the shape of a programme, and its solution from a start."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from planner.desensitise.bounds import row_bounds, unknown_bounds
from planner.desensitise.program import Program, program
from planner.ocp.curve import curve
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.problem import Problem
from planner.stopping import Ipopt
from planner.systems.base import Array
from planner.trajectory import StateTrajectory

ACCEPTED_RESIDUAL = 1e-7
"""Largest excess of a row over its bounds that counts as solved."""

BARRIER = 0.01
"""Barrier to begin with: a guess that obeys the kinematics needs no greater one."""

NEAR = 1e-4
"""Barrier and distance to the bounds to begin with when the start is near the answer."""

_SETTLED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Maximum_Iterations_Exceeded")
"""A motion that keeps every row is a plan, also where its last digits of optimality are missing."""


@dataclass(frozen=True)
class Weights:
    """Weights of the squared passive block, terminal response and response along the path (deg²),
    of the effort, and of a free duration."""

    passive: float
    terminal: float
    path: float
    effort: float
    time: float

    @property
    def array(self) -> Array:
        """Shape (5,)."""
        return np.array([self.passive, self.terminal, self.path, self.effort, self.time])


@dataclass(frozen=True)
class DrawnIn:
    """By how much limits are drawn in so that they hold between the nodes.

    Attributes:
        joint: One a coordinate, in its unit.
        z2: Of the z₂ margin.
        obstacle: Added to every link's clearance from every disc, metres.
    """

    joint: tuple[float, ...]
    z2: float = 0.0
    obstacle: float = 0.0


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the solver stopped.

    Attributes:
        vector: The unknowns.
        cost: Value of the objective.
        passive_deg: Size of the passive block.
        total_deg: Size of the whole terminal response.
        effort: ∫ u₁² + u₂² dt.
        ok: Whether the rows, evaluated anew, keep their bounds, and the solver did not fail.
        status: What the solver says of itself.
        iterations: How many it made.
    """

    vector: Array
    cost: float
    passive_deg: float
    total_deg: float
    effort: float
    ok: bool
    status: str
    iterations: int


@dataclass(frozen=True, eq=False)
class Task:
    """What is solved, and how.

    Attributes:
        problem: Start, goal and limits.
        program: The transcription.
        mesh: Its mesh.
        spread: Standard deviation of each error by name.
        weights: Of the objective.
        backoff: Standard deviations by which limits are backed off.
        direction: Sign that u₁ keeps, or 0 where it may change.
        effort_limit: Largest effort; infinite when there is none.
        rest: Whether inputs are zero at both ends.
        tolerance: Of the solver.
        max_iterations: Of the solver.
        drawn: Limits drawn in.
    """

    problem: Problem
    program: Program
    mesh: Mesh
    spread: dict[str, float]
    weights: Weights
    backoff: float
    direction: float
    effort_limit: float
    rest: bool
    tolerance: float
    max_iterations: int
    drawn: DrawnIn = field(default_factory=lambda: DrawnIn(()))

    @property
    def sigma(self) -> Array:
        """Spreads, shape (P,), in the order of the response's columns."""
        return np.array([self.spread[name] for name in self.program.made.names])

    @property
    def parameters(self) -> Array:
        """Numbers of the programme."""
        sign = self.problem.z2_sign if self.program.shape.form.chart else 1.0
        discs = [[*disc.centre, disc.radius] for disc in self.problem.obstacles]
        tail = [self.backoff, sign, *(value for disc in discs for value in disc)]
        return np.concatenate(
            [self.problem.start, self.sigma, self.weights.array, tail, self.mesh.edges]
        )

    def on(self, mesh: Mesh) -> Task:
        """The same on another mesh."""
        shape = self.program.shape
        finer = replace(shape, form=replace(shape.form, intervals=len(mesh.widths)))
        return replace(self, mesh=mesh, program=program(self.program.made, finer))

    def iterate(self, vector: Array) -> Iterate:
        """The motion's unknowns by name."""
        p, N = self.program, self.problem.system.size
        return Iterate(
            float(vector[0]),
            vector[p.states][:, :N],
            vector[p.points][:, :, :N],
            vector[p.inputs],
        )

    def curve(self, vector: Array) -> StateTrajectory:
        """The motion an iterate describes."""
        form = self.program.shape.form
        return curve(self.problem.system, form, self.mesh, self.iterate(vector))

    def solve(self, start: Array, near: bool = False) -> Solution:
        """Solve from a vector of unknowns, which may be near the answer."""
        lower, upper = unknown_bounds(self)
        low, high = row_bounds(self)
        call = _solver(self.program, self.tolerance, self.max_iterations, near)
        found = call(
            x0=np.clip(start, lower, upper),
            p=self.parameters,
            lbx=lower,
            ubx=upper,
            lbg=low,
            ubg=high,
        )
        vector, stats = np.asarray(found["x"], dtype=float).ravel(), call.stats()
        rows = np.asarray(self.program.rows(vector, self.parameters)).ravel()
        excess = np.max(np.maximum(low - rows, rows - high), initial=0.0)
        sound = bool(np.all(np.isfinite(rows))) and excess <= ACCEPTED_RESIDUAL
        measures = np.asarray(self.program.measures(vector, self.parameters), dtype=float)
        passive, total, _, used = measures.ravel()
        return Solution(
            vector=vector,
            cost=float(found["f"]),
            passive_deg=float(np.sqrt(passive)),
            total_deg=float(np.sqrt(total)),
            effort=float(used),
            ok=stats["return_status"] in _SETTLED and sound,
            status=stats["return_status"],
            iterations=int(stats["iter_count"]),
        )


@lru_cache(maxsize=64)
def _solver(made: Program, tolerance: float, max_iterations: int, near: bool) -> Ipopt:
    """IPOPT through CasADi, kept once made; limits hold exactly at every iterate."""
    ipopt: dict[str, Any] = {
        "print_level": 0,
        "sb": "yes",
        "tol": tolerance,
        "constr_viol_tol": min(tolerance, 1e-9),
        "max_iter": max_iterations,
        "bound_relax_factor": 0.0,
        "mu_init": BARRIER,
    }
    if near:
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
        ipopt |= {"mu_init": NEAR, **dict.fromkeys(pushes, NEAR)}
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "jac_g": made.jacobian,
        "ipopt": ipopt,
    }
    return Ipopt("desensitised", made.problem, options)


def prepared(task: Task) -> float:
    """Make the task's solver unless it was made before; the seconds that took."""
    began = time.perf_counter()
    _solver(task.program, task.tolerance, task.max_iterations, False)
    return time.perf_counter() - began
