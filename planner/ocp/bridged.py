"""Motions grown from random paths, where no first guess of the solver leads anywhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from planner.bridge import Bridge, bridges
from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.ocp.solver import ACCEPTED_RESIDUAL, Solution
from planner.ocp.task import Task, task
from planner.ocp.timing import Timed, timed
from planner.systems.base import Array

PATIENCE = 400
"""Iterations granted at least: the paths are long, and the start is already a motion."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """A path and what its timing made of it.

    Attributes:
        name: For reports.
        task: The job on the path's own mesh.
        timed: The outcome.
        iterations: Iterations of all solvers, those that closed the path's gaps included.
    """

    name: str
    task: Task
    timed: Timed
    iterations: int


def crossings(job: Task, attempts: int) -> Iterator[Crossing]:
    """Timed motions along random paths, as they are found.

    A motion that keeps every row is taken even where the solver has not got to its optimum: it is
    then marked by its status.
    """
    settings = job.settings
    patient = max(settings.max_iterations, PATIENCE)
    solver = "ipopt" if settings.solver == "auto" else settings.solver
    job = replace(job, settings=replace(settings, max_iterations=patient, solver=solver))
    for bridge in bridges(job.problem, attempts):
        own, path = _follow(job, bridge)
        outcome = timed(own, path)
        own = replace(own, settings=settings)
        outcome = replace(outcome, solution=_kept(outcome.solution))
        yield Crossing(
            f"bridge {bridge.attempt}", own, outcome, bridge.iterations + outcome.iterations
        )


def _kept(solution: Solution) -> Solution:
    if solution.ok or solution.residual > ACCEPTED_RESIDUAL:
        return solution
    return replace(solution, ok=True, status=f"{solution.status} (a motion, not the best)")


def _follow(job: Task, bridge: Bridge) -> tuple[Task, Iterate]:
    """The job on the path's mesh, and the path at the speed the limits allow."""
    limit = job.problem.limits.input
    box = np.where(np.isfinite(limit), limit, 1.0)
    seconds = np.max(np.abs(bridge.u) / box, axis=1)
    kept = seconds > 1e-9 * np.sum(seconds)
    seconds = seconds[kept]
    nodes = np.vstack([bridge.q[:-1][kept], bridge.q[-1:]])
    edges = np.append(0.0, np.cumsum(seconds))
    own = _stepwise(job).on(Mesh(edges / edges[-1]))
    return own, _iterate(own, nodes, bridge.u[kept] / seconds[:, None], float(edges[-1]))


def _stepwise(job: Task) -> Task:
    """The job with constant inputs in each interval, as the path has them, where they may jump."""
    smooth = job.rest or job.objective.smooth or np.any(np.isfinite(job.problem.limits.input_rate))
    if smooth or job.made.form.input == "constant":
        return job
    form = replace(job.made.form, input="constant")
    return task(job.problem, job.objective, form, job.mesh, job.rest, job.settings)


def _iterate(own: Task, nodes: Array, rates: Array, duration: float) -> Iterate:
    tau = own.made.form.scheme.points
    points = nodes[:-1, None] + tau[:, None] * np.diff(nodes, axis=0)[:, None]
    inputs = rates
    if own.made.form.input == "linear":
        padded = np.vstack([rates[:1], rates, rates[-1:]])
        inputs = (padded[:-1] + padded[1:]) / 2
    return Iterate(duration=duration, nodes=nodes, points=points, inputs=inputs)
