"""When there is no plan: which requirement stands in the way, and a change that was tried."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

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
    """A requirement without which there is a path.

    Attributes:
        what: The requirement, in words.
        solution: The path, as slow as the limits on the inputs want it.
        violations: What it breaks.
        advice: A change that makes room for it.
        problem: The problem so changed.
    """

    what: str
    solution: Solution
    violations: list[Violation]
    advice: str
    problem: Problem


def obstacles(job: Task) -> Iterator[Obstacle]:
    """Leave out one requirement after the other, and see whether there is a path."""
    for what, relaxed in _relaxations(job):
        result = search(relaxed, seeds("auto")[:RELAXED_SEEDS], enough=1)
        if result.found:
            solution = result.found[0].solution
            slow = _within_input_limits(job, solution)
            violations = broken_limits(job, slow)
            advice, problem = _change(job.problem, what, violations, solution)
            yield Obstacle(what, slow, violations, advice, problem)


def _relaxations(job: Task) -> Iterator[tuple[str, Task]]:
    problem = job.problem
    if problem.obstacles:
        form, free = replace(job.made.form, obstacles=0), replace(problem, obstacles=())
        yield DISCS, task(free, job.objective, form, job.mesh, job.asked, job.settings)
    if problem.waypoints:
        free, mesh = replace(problem, waypoints=()), Mesh(job.mesh.edges)
        yield POINTS, task(free, job.objective, job.made.form, mesh, job.asked, job.settings)
    if problem.limits.z2_margin is not None:
        form = replace(job.made.form, chart=False)
        limits = replace(problem.limits, z2_margin=None)
        free = replace(problem, limits=limits)
        yield CHART, task(free, job.objective, form, job.mesh, job.asked, job.settings)
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


def _change(
    problem: Problem, what: str, violations: list[Violation], solution: Solution
) -> tuple[str, Problem]:
    """A change that makes room for a path, in words, and the problem so changed."""
    if what == TRAVEL:
        nodes = solution.iterate.nodes
        return _travelling(problem, float(nodes[-1, 0] - nodes[0, 0]))
    if what in (DISCS, POINTS):
        return _less(problem, "obstacles" if what == DISCS else "waypoints", violations)
    if what == CHART:
        return _nearer(problem, [v.value for v in violations if v.label == "z2 margin"])
    return _wider(problem, violations)


def _travelling(problem: Problem, travel: float) -> tuple[str, Problem]:
    ((key, value),) = problem.travel_change(travel).items()
    value = float(f"{value:.4g}")
    return f"{key} = {value:g}", problem.changed({key: value})


def _less(problem: Problem, table: str, violations: list[Violation]) -> tuple[str, Problem]:
    """Without the discs or waypoints that the path meets or misses."""
    missed = sorted({v.label.rsplit(" ", 1)[1] for v in violations if table[:-1] in v.label})
    which = f"[[{table}]] {' and '.join(missed)}" if missed else f"[[{table}]]"
    numbers = [int(number) for number in missed]
    words = f"leave out {which}"
    if table == "obstacles":
        return words, replace(problem, obstacles=_left(problem.obstacles, numbers))
    return words, replace(problem, waypoints=_left(problem.waypoints, numbers))


def _left(all_: tuple[Any, ...], numbers: list[int]) -> tuple[Any, ...]:
    """What is left without these, counted from one; nothing if none are named."""
    return tuple(each for k, each in enumerate(all_, 1) if numbers and k not in numbers)


def _nearer(problem: Problem, reached: list[float]) -> tuple[str, Problem]:
    """With a smaller margin of z2, or none."""
    if reached and reached[0] > 0:
        margin = float(f"{reached[0] * 0.999:.4g}")
        words = f"limits.z2_margin = {margin:g} or less"
    else:
        margin, words = None, "leave out limits.z2_margin, so that z2 may change sign"
    return words, replace(problem, limits=replace(problem.limits, z2_margin=margin))


def _wider(problem: Problem, violations: list[Violation]) -> tuple[str, Problem]:
    """With wider limits on the joints that pass them."""
    limit, peaks = problem.limits.joint.copy(), []
    for i, coordinate in enumerate(problem.system.coordinates):
        for v in (v for v in violations if v.label == f"joint {coordinate.name}"):
            limit[i] = v.value * 1.001
            peaks.append(f"{coordinate.name} at least {_shown(float(limit[i]), v.unit)}")
    words = f"wider limits: {', '.join(peaks)}"
    return words, replace(problem, limits=replace(problem.limits, joint=limit))


def _shown(value: float, unit: str) -> str:
    return f"{np.rad2deg(value):.4g} deg" if unit == "rad" else f"{value:.4g} {unit}"
