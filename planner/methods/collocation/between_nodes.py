"""What an iterate does between its nodes: how far plan and true motion differ, what they break."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from planner.methods.collocation.solvers.solver import Solution
from planner.methods.collocation.task import Task
from planner.methods.collocation.transcription.bounds import Tightening
from planner.methods.collocation.transcription.form import Kind, bernstein_values, scheme
from planner.methods.collocation.transcription.unknowns import STEPS
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.systems.chained_form import chained_form

INTERPOLANT = 10.0
"""How much more the interpolant may differ inside the motion than at its end."""

SLACK = 1e-7
"""Distance from a limit, relative to it, that is kept where the limit is drawn in."""

CUBIC = 0.0642
"""Most that a cubic differs from the parabola through three even samples, in third differences."""

ROUNDING = 1e-9
"""Excess over a limit, relative to it, that counts as none, as in certificates."""


@dataclass(frozen=True, eq=False)
class Look:
    """Samples between the nodes, at the same times.

    Attributes:
        plan: Of the iterate's own interpolant, shape (K, M, N).
        motion: Of the motion its input really makes, shape (K, M, N).
        error: How far they differ.
    """

    plan: Array
    motion: Array
    error: MeshError


def look(task: Task, solution: Solution) -> Look:
    """Sample an iterate and the motion its input really makes."""
    iterate, form = solution.iterate, task.made.form
    values = np.concatenate([iterate.nodes[:-1, None], iterate.points], axis=1)
    values = values[..., : task.problem.system.size]
    plan = np.asarray(_basis(form.scheme_kind, form.degree) @ values)
    motion = task.motion(iterate).states
    own = np.abs(task.motion_apart(iterate) - plan).max(axis=2)
    gap = np.abs(motion - plan)
    error = MeshError(float(gap[-1, -1].max()), float(gap.max()), own[:, -1], own.max(axis=1))
    return Look(plan, motion, error)


@lru_cache(maxsize=16)
def _basis(kind: Kind, degree: int) -> Array:
    """Values at the left edge and the collocation points to samples in the interval, (M, d+1)."""
    tau = np.arange(STEPS + 1) / STEPS
    return np.asarray(bernstein_values(degree, tau) @ scheme(kind, degree).bernstein)


@dataclass(frozen=True, eq=False)
class MeshError:
    """Difference of the true motion and the interpolant, the largest over coordinates.

    Attributes:
        end: At the end of the motion.
        largest: At any time.
        nodes: At an interval's end, where the motion begins with the interval, shape (K,).
        inside: The same anywhere in the interval, shape (K,).
    """

    end: float
    largest: float
    nodes: Array
    inside: Array

    def fine(self, accuracy: float) -> bool:
        """Whether no refinement is needed."""
        return self.end <= accuracy and self.largest <= INTERPOLANT * accuracy


def excess(task: Task, seen: Look) -> Tightening:
    """By how much each interval breaks limits on coordinates, z₂ and discs, plus a little.

    The plan's q(t) and the motion its input really makes are both held to the limits.
    """
    problem = task.problem
    both = np.stack([seen.plan, seen.motion])
    limit = problem.limits.joint
    joint = _over(np.abs(both), limit, limit)
    joint[:, 0] = 0.0
    margin, z2 = problem.limits.z2_margin, np.zeros(len(seen.plan))
    if margin is not None:
        values = problem.z2_sign * chained_form(problem.system).z(both)[..., 1]
        z2 = _over(-values, np.array(-margin), np.array(max(margin, 1e-3)))
    return Tightening(joint, z2, into_discs(problem, both, task.made.form.obstacles))


def into_discs(problem: Problem, curves: Array, count: int) -> Array:
    """How far each link reaches into each disc in each interval, shape (K, D · L).

    The curves' samples have the shape (C, K, M, N).
    """
    system: Any = problem.system
    out = [np.zeros((curves.shape[1], 0))]
    for disc in problem.obstacles[:count]:
        clearances = disc.clearances(system.arm_points(curves[..., 1:]))
        out.append(_over(-clearances, np.array(0.0), np.array(disc.radius)))
    return np.concatenate(out, axis=-1)


def _over(curves: Array, limit: Array, scale: Array) -> Array:
    """How far curves pass a limit in each interval (K, …), and a tenth and a little, or zero.

    The curves' samples have the shape (C, K, M, …). No parabola through three of them rises above
    the highest by more than a quarter of the step to a neighbour, which most often says it all.
    """
    flat = curves.reshape(-1, *curves.shape[2:])
    before, after = flat[:, :-1], flat[:, 1:]
    if ((before + after) / 2 + 0.75 * np.abs(after - before) <= limit).all():
        return np.zeros((curves.shape[1], *curves.shape[3:]))
    excess = np.max(peaks(flat).reshape(curves.shape[:2] + curves.shape[3:]), axis=0) - limit
    with np.errstate(invalid="ignore"):
        return np.where(excess > ROUNDING * scale, 1.1 * excess + SLACK * scale, 0.0)


def peaks(values: Array) -> Array:
    """Bounds of the greatest value in each interval (K, …) of samples (K, M, …).

    Parabolas through three samples count wherever among these they are highest: close to an
    interval's end no sample beyond tells that there is a peak. What a cubic could differ from them
    is added.
    """
    inner = values[:, 1:-1]
    before, after = values[:, :-2], values[:, 2:]
    slope, bend = (after - before) / 2, after - 2 * inner + before
    top = np.abs(slope) < -bend
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(top, inner - slope**2 / (2 * bend) + CUBIC * _uneven(bend), -np.inf)
    return np.asarray(np.maximum(np.max(values, axis=1), np.max(vertex, axis=1, initial=-np.inf)))


def _uneven(bend: Array) -> Array:
    """How much second differences (K, M, …) differ from their neighbours."""
    steps = np.abs(np.diff(bend, axis=1))
    none = np.zeros_like(bend[:, :1])
    left, right = (np.concatenate(both, axis=1) for both in ([none, steps], [steps, none]))
    return np.asarray(np.maximum(left, right))


def clears(task: Task, solution: Solution) -> bool:
    """Whether no link passes through a disc between two places at which it must clear it.

    What reaches less than half its radius into a disc can be drawn out of it.
    """
    if not task.problem.obstacles:
        return True
    radii = np.array([disc.radius for disc in task.problem.obstacles])
    deep = into_discs(task.problem, task.motion(solution.iterate).states[None], len(radii))
    return bool(np.all(np.max(deep, axis=0).reshape(len(radii), -1) < radii[:, None] / 2))
