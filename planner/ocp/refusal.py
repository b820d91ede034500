"""When there is no plan: which requirement stands in the way, and a change that was tried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from planner.errors import Violation
from planner.ocp.guess import seeds
from planner.ocp.mesh import Mesh
from planner.ocp.search import needed_duration, search
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched, task
from planner.ocp.violations import broken_limits
from planner.problem import Problem

RELAXED_SEEDS = 4
CHART, JOINTS, TRAVEL = "the z2 margin", "the limits on the joints", "the travel"
DISCS, POINTS = "the obstacles", "the waypoints"


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A requirement without which there is a motion.

    Attributes:
        what: The requirement, in words.
        solution: A motion without it.
        violations: What that motion breaks.
        advice: The change, tried.
    """

    what: str
    solution: Solution
    violations: list[Violation]
    advice: str


def obstacle(job: Task) -> Obstacle | None:
    """Leave out one requirement after the other until a path is found."""
    for what, relaxed in _relaxations(job):
        result = search(relaxed, seeds("auto")[:RELAXED_SEEDS], enough=1)
        if result.found:
            solution = result.found[0].solution
            slow = _within_input_limits(job, solution)
            violations = broken_limits(job, slow)
            return Obstacle(what, slow, violations, _advice(job, what, violations, solution))
    return None


def _relaxations(job: Task) -> Iterator[tuple[str, Task]]:
    problem = job.problem
    if problem.obstacles:
        form, free = replace(job.made.form, obstacles=0), replace(problem, obstacles=())
        yield DISCS, task(free, job.objective, form, job.mesh, job.rest, job.settings)
    if problem.waypoints:
        free, mesh = replace(problem, waypoints=()), Mesh(job.mesh.edges)
        yield POINTS, task(free, job.objective, job.made.form, mesh, job.rest, job.settings)
    if problem.limits.z2_margin is not None:
        form = replace(job.made.form, chart=False)
        limits = replace(problem.limits, z2_margin=None)
        free = replace(problem, limits=limits)
        yield CHART, task(free, job.objective, form, job.mesh, job.rest, job.settings)
    wide = _widest(problem)
    if np.any(wide > problem.limits.joint):
        limits = replace(problem.limits, joint=wide)
        yield JOINTS, replace(job, problem=replace(problem, limits=limits))
    if problem.travel is not None:
        yield TRAVEL, replace(job, problem=replace(problem, travel=None))


def _widest(problem: Problem) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Joint limits of 88 degrees for angles, none for the rest."""
    angles = np.array([c.unit == "rad" for c in problem.system.coordinates])
    return np.where(angles & np.isfinite(problem.limits.joint), np.deg2rad(88.0), np.inf)


def _within_input_limits(job: Task, solution: Solution) -> Solution:
    needed = needed_duration(job.problem, job.mesh, solution.iterate)
    wanted = job.problem.duration or max(needed, solution.iterate.duration)
    return replace(solution, iterate=stretched(solution.iterate, max(wanted, needed)))


def _advice(job: Task, what: str, violations: list[Violation], solution: Solution) -> str:
    if what == TRAVEL:
        travel = float(solution.iterate.nodes[-1, 0] - solution.iterate.nodes[0, 0])
        name, unit = _named(job, 0)
        return f"another travel of {name}: a motion was found that travels {travel:.4g} {unit}"
    if what in (DISCS, POINTS):
        table = "obstacles" if what == DISCS else "waypoints"
        missed = sorted({v.label.rsplit(" ", 1)[1] for v in violations if table[:-1] in v.label})
        which = f"[[{table}]] {' and '.join(missed)}" if missed else f"[[{table}]]"
        return f"move or leave out {which}: a motion was found without"
    if what == CHART:
        reached = [v.value for v in violations if v.label == "z2 margin"]
        if reached and reached[0] > 0:
            return f"limits.z2_margin = {reached[0] * 0.999:.4g} or less: a motion was found"
        return "leave out limits.z2_margin: a motion was found that lets z2 change sign"
    peaks = [
        f"{v.label.removeprefix('joint ')} at least {_shown(v.value * 1.001, v.unit)}"
        for v in violations
        if v.label.startswith("joint")
    ]
    return f"wider limits: {', '.join(peaks)} (a motion was found)"


def _named(job: Task, i: int) -> tuple[str, str]:
    coordinate = job.problem.system.coordinates[i]
    return coordinate.name, coordinate.unit


def _shown(value: float, unit: str) -> str:
    return f"{np.rad2deg(value):.4g} deg" if unit == "rad" else f"{value:.4g} {unit}"
