"""After the solve: a mesh fine enough for the true motion, and limits kept between the nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.chained import chained_form
from planner.desensitise.seeds import packed
from planner.desensitise.task import DrawnIn, Solution, Task
from planner.ocp.look import peaks
from planner.ocp.mesh import Mesh
from planner.ocp.resimulation import resimulate
from planner.systems.base import Array

INTERPOLANT = 10.0
"""How much more the interpolant may differ inside the motion than at its end."""

LARGEST_MESH = 800
ROUNDS = 8
BRIEF = 40
"""Iterations of a solve from a neighbour: enough to keep every row, and nearly always to finish."""

SLACK = 2e-7
"""Excess over a limit, relative to it, that is left: a fifth of what `verify` lets pass."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A solution, the task it belongs to now, and what was done to it."""

    task: Task
    solution: Solution
    iterations: int
    notes: dict[str, Any]


def settle(task: Task, solution: Solution, accuracy: float) -> Settled:
    """Halve intervals until the motion's end is accurate, draw limits in where they are broken."""
    iterations, meshes = 0, [len(task.mesh.widths)]
    for _ in range(ROUNDS):
        coarse = not _fine(task, solution, accuracy)
        drawn = _drawn_in(task, solution)
        if coarse and 2 * meshes[-1] <= LARGEST_MESH:
            task = task.on(_halved(task.mesh))
            meshes.append(len(task.mesh.widths))
            start = packed(task, _doubled(task, solution), float(solution.vector[0]))
        elif drawn is not None:
            task, start = replace(task, drawn=drawn), solution.vector
        else:
            break
        brief = replace(task, max_iterations=min(task.max_iterations, BRIEF))
        better = brief.solve(start, near=True)
        if not better.ok:
            better = task.solve(start)
        iterations += better.iterations
        if not better.ok:
            break
        solution = better
    notes = {"intervals": meshes, "limits_drawn_in": vars(task.drawn)}
    return Settled(task, solution, iterations, notes)


def _fine(task: Task, solution: Solution, accuracy: float) -> bool:
    states, plan = _states(task, solution)
    gap = np.abs(states - plan)
    return bool(np.max(gap[-1, -1]) <= accuracy and np.max(gap) <= INTERPOLANT * accuracy)


def _states(task: Task, solution: Solution) -> tuple[Array, Array]:
    """The motion the input really makes, and the plan's, at samples (K, S, N)."""
    iterate = task.iterate(solution.vector)
    motion = resimulate(task.problem.system, task.mesh, iterate, task.problem.start)
    plan = task.curve(solution.vector).q(motion.fractions * iterate.duration)
    return motion.states, plan


def _drawn_in(task: Task, solution: Solution) -> DrawnIn | None:
    """Limits drawn in further by what is broken between the nodes; None where nothing is."""
    limits, size = task.problem.limits, task.problem.system.size
    joint, z2 = np.array(task.drawn.joint or np.zeros(size)), task.drawn.z2
    before, states = (
        (joint.copy(), z2, task.drawn.obstacle),
        np.concatenate(_states(task, solution)),
    )
    for i in task.problem.system.limited:
        over = float(np.max(peaks(np.abs(states[:, :, i])))) - limits.joint[i]
        if over > SLACK * limits.joint[i]:
            joint[i] += 1.1 * over + SLACK * limits.joint[i]
    if limits.z2_margin is not None:
        z = task.problem.z2_sign * chained_form(task.problem.system).z(states)[:, :, 1]
        over, scale = limits.z2_margin + float(np.max(peaks(-z))), max(limits.z2_margin, 1e-3)
        if over > SLACK * scale:
            z2 += 1.1 * over + SLACK * scale
    obstacle = task.drawn.obstacle
    for disc in task.problem.obstacles:
        clear = disc.clearances(task.problem.system.arm_points(states[..., 1:]))  # type: ignore[attr-defined]
        over = float(np.max([np.max(peaks(-clear[..., i])) for i in range(clear.shape[-1])]))
        if over > SLACK * disc.radius:
            obstacle += 1.1 * over + SLACK * disc.radius
    same = np.array_equal(joint, before[0]) and (z2, obstacle) == before[1:]
    return None if same else DrawnIn(tuple(joint.tolist()), z2, obstacle)


def _halved(mesh: Mesh) -> Mesh:
    middles = (mesh.edges[:-1] + mesh.edges[1:]) / 2
    return Mesh(np.sort(np.concatenate([mesh.edges, middles])))


def _doubled(finer: Task, solution: Solution) -> Array:
    """The same input on intervals cut in half."""
    coarse = len(finer.mesh.widths) // 2
    count = coarse + (finer.program.shape.form.input == "linear")
    inputs = solution.vector[-2 * count :].reshape(count, 2)
    if count == coarse:
        return np.repeat(inputs, 2, axis=0)
    middle = (inputs[:-1] + inputs[1:]) / 2
    out = np.empty((2 * coarse + 1, 2))
    out[::2], out[1::2] = inputs, middle
    return out
