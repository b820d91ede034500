"""After the solve: limits kept between the nodes, and a mesh fine enough for the true motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.chained import chained_form
from planner.ocp.bounds import Tightening
from planner.ocp.mesh import Mesh
from planner.ocp.solver import Solution
from planner.ocp.task import Task, transferred
from planner.problem import Problem
from planner.systems.base import Array

INTERPOLANT = 10.0
"""How much more the interpolant may differ inside the motion than at its end."""

EVENNESS = 0.35
"""Least density of a refined mesh, relative to its greatest."""

LARGEST_MESH = 2000
TIGHTENING_ROUNDS = 6
SLACK = 2e-7
"""Excess over a limit, relative to it, that is left: a fifth of what `verify` lets pass."""


@dataclass(frozen=True, eq=False)
class Polished:
    """A solution, the task it belongs to now, and what was done to it.

    Attributes:
        task: With its final mesh and limits drawn in.
        solution: The answer.
        error: Largest difference at the end between true motion and interpolant, over coordinates.
        notes: JSON-ready.
        seconds: Time in the solver.
        iterations: Iterations of the solver.
    """

    task: Task
    solution: Solution
    error: float
    notes: dict[str, Any]
    seconds: float
    iterations: int


def polish(task: Task, solution: Solution, accuracy: float, refinements: int) -> Polished:
    """Refine the mesh until the re-simulated end is accurate, then draw limits in where needed."""
    build, seconds, iterations = task.build_time_s, 0.0, 0
    meshes = [len(task.mesh.widths)]
    error = mesh_error(task, solution)
    for _ in range(refinements):
        if error.fine(accuracy):
            break
        finer = task.on(_finer(task, error, accuracy))
        better = finer.solve(transferred(task, solution.iterate, finer), near=True)
        seconds, iterations = seconds + better.seconds, iterations + better.iterations
        build += finer.build_time_s
        if not better.ok:
            break
        task, solution = finer, better
        meshes.append(len(task.mesh.widths))
        error = mesh_error(task, solution)
    drawn = _draw_in(replace(task, build_time_s=build), solution)
    notes = {"intervals": meshes, **drawn.notes}
    return replace(
        drawn,
        notes=notes,
        seconds=drawn.seconds + seconds,
        iterations=drawn.iterations + iterations,
    )


@dataclass(frozen=True, eq=False)
class MeshError:
    """Difference of the true motion and the interpolant, the largest over coordinates.

    Attributes:
        end: At the end of the motion.
        largest: At any time.
        nodes: Its growth from edge to edge, shape (K,).
        inside: Its growth from an edge to anywhere in the interval, shape (K,).
    """

    end: float
    largest: float
    nodes: Array
    inside: Array

    def fine(self, accuracy: float) -> bool:
        """Whether no refinement is needed."""
        return self.end <= accuracy and self.largest <= INTERPOLANT * accuracy


def mesh_error(task: Task, solution: Solution) -> MeshError:
    """Compare an iterate with the motion its input really makes."""
    motion = task.motion(solution.iterate)
    times = motion.fractions * solution.iterate.duration
    gap = motion.states - task.curve(solution.iterate).q(times)
    growth = np.max(np.abs(gap - gap[:, :1]), axis=2)
    return MeshError(
        end=float(np.max(np.abs(gap[-1, -1]))),
        largest=float(np.max(np.abs(gap))),
        nodes=growth[:, -1],
        inside=np.max(growth, axis=1),
    )


def _finer(task: Task, error: MeshError, accuracy: float) -> Mesh:
    """Intervals as dense as the errors ask for, at most three times as many, and evenly graded.

    Errors shrink with the interval's width to the power 2d at the nodes and d + 1 inside it. The
    next solution may move where this one rests, so that no interval is much wider than another.
    """
    d, widths = task.made.form.degree, task.mesh.widths
    at_nodes = (error.nodes * np.sqrt(len(widths)) / accuracy) ** (1 / (2 * d))
    inside = (error.inside / (INTERPOLANT * accuracy)) ** (1 / (d + 1))
    density = np.maximum(at_nodes, inside) / widths
    density = np.maximum(density, EVENNESS * np.max(density))
    wanted = int(np.ceil(1.1 * np.sum(density * widths)))
    count = min(max(wanted, len(widths) * 5 // 4), 3 * len(widths), LARGEST_MESH)
    covered = np.concatenate([[0.0], np.cumsum(density * widths)])
    edges = np.interp(np.linspace(0, covered[-1], count + 1), covered, task.mesh.edges)
    edges[0], edges[-1] = 0.0, 1.0
    return task.mesh.snapped(edges)


def _draw_in(task: Task, solution: Solution) -> Polished:
    """Keep limits between the edges: solve again with them at the collocation points too, then
    with limits drawn in by what is still broken, first where, then everywhere.
    """
    seconds, iterations, rounds = 0.0, 0, 0
    tightening = task.tightening
    for _ in range(TIGHTENING_ROUNDS):
        over = _excess(task, solution)
        if not over:
            break
        if not task.made.form.inner:
            built = task.build_time_s
            task = task.inside()
            task = replace(task, build_time_s=built + task.build_time_s)
        else:
            tightening = tightening + over
            if rounds > 0:
                tightening = tightening.everywhere()
            task, rounds = replace(task, tightening=tightening), rounds + 1
        better = task.solve(solution.iterate, near=True)
        if not better.ok:
            better = task.solve(solution.iterate)
        seconds, iterations = seconds + better.seconds, iterations + better.iterations
        if not better.ok:
            break
        solution = better
    notes = {
        "limits_drawn_in": {
            "rounds": rounds,
            "joint": float(np.max(tightening.joint)),
            "z2": float(np.max(tightening.z2)),
            "obstacles": float(np.max(tightening.discs, initial=0.0)),
        }
    }
    error = mesh_error(task, solution)
    return Polished(task, solution, error.end, notes, seconds, iterations)


def clears(task: Task, solution: Solution) -> bool:
    """Whether no link passes through a disc between two places at which it must clear it.

    What reaches less than half its radius into a disc can be drawn out of it.
    """
    radii = np.array([disc.radius for disc in task.problem.obstacles])
    deep = _into_discs(task.problem, task.motion(solution.iterate).states, len(radii))
    return bool(np.all(np.max(deep, axis=0).reshape(len(radii), -1) < radii[:, None] / 2))


def _excess(task: Task, solution: Solution) -> Tightening:
    """By how much each interval breaks joint and z₂ limits, plus a little.

    The plan's q(t) and the motion its input really makes are both held to the limits.
    """
    motion = task.motion(solution.iterate)
    plan = task.curve(solution.iterate).q(motion.fractions * solution.iterate.duration)
    found = [_breaks(task, states) for states in (plan, motion.states)]
    return Tightening(
        np.maximum(*(each.joint for each in found)),
        np.maximum(*(each.z2 for each in found)),
        np.maximum(*(each.discs for each in found)),
    )


def _breaks(task: Task, states: Array) -> Tightening:
    problem = task.problem
    limit, count = problem.limits.joint, len(states)
    peak = np.stack([peaks(np.abs(states[:, :, i])) for i in range(len(limit))], axis=-1)
    joint = _over(peak - limit, limit)
    joint[:, 0] = 0.0
    margin, z2 = problem.limits.z2_margin, np.zeros(count)
    if margin is not None:
        values = problem.z2_sign * chained_form(problem.system).z(states)[:, :, 1]
        z2 = _over(margin + peaks(-values), np.array(max(margin, 1e-3)))
    return Tightening(joint, z2, _into_discs(problem, states, task.made.form.obstacles))


def _into_discs(problem: Problem, states: Array, count: int) -> Array:
    """How far each link reaches into each disc in each interval, shape (K, D · L)."""
    system: Any = problem.system
    out = [np.zeros((len(states), 0))]
    for disc in problem.obstacles[:count]:
        clearances = disc.clearances(system.arm_points(states[..., 1:]))
        deepest = [peaks(-clearances[..., i]) for i in range(clearances.shape[-1])]
        out.append(_over(np.stack(deepest, axis=-1), np.array(disc.radius)))
    return np.concatenate(out, axis=-1)


def _over(excess: Array, scale: Array) -> Array:
    """The excess and a tenth, where it is more than the slack."""
    with np.errstate(invalid="ignore"):
        return np.where(excess > SLACK * scale, 1.1 * excess + SLACK * scale, 0.0)


def peaks(values: Array) -> Array:
    """Largest value in each interval (K,) of samples (K, M), by parabolas through three samples."""
    inner = values[:, 1:-1]
    before, after = values[:, :-2], values[:, 2:]
    slope, bend = (after - before) / 2, after - 2 * inner + before
    top = (inner >= before) & (inner >= after) & (bend < 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(top, inner - slope**2 / (2 * bend), -np.inf)
    return np.asarray(np.maximum(np.max(values, axis=1), np.max(vertex, axis=1, initial=-np.inf)))
