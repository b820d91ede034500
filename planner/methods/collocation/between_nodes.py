"""Check an iterate between its nodes: its distance from the true motion, and broken limits.

The file also estimates how much of the objective finer intervals would save.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from planner.methods.collocation.task import Solution, Task
from planner.methods.collocation.transcription.form import Kind, scheme
from planner.methods.collocation.transcription.unknowns import STEPS, Iterate
from planner.problem.requirements.requirement import MotionPoint, Requirement
from planner.support.arrays import Array
from planner.support.calculus.bernstein import basis

INTERPOLANT = 10.0
"""Largest difference of interpolant and true motion, in multiples of what the end may have."""

DRAWN_IN_SLACK = 1e-7
"""Additional amount, relative to a limit, by which a broken limit is tightened."""

CUBIC_BULGE = 0.0642
"""Largest distance of a cubic from the parabola through three samples, in third differences."""

LARGEST_STEP, MAX_PARTS = 0.5, 100
"""Largest move of a link between two samples, in radii of a disc; and the largest number of parts
into which the step between two samples is cut to achieve this."""

ROUNDING = 1e-9
"""Relative excess over a limit below which the limit counts as kept, as in certificates."""

SAVING = 1e-3
"""Share of the objective that a finer mesh must save at least, so that the saving counts."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """A solution with samples between the nodes.

    Attributes:
        task: The task that is solved.
        solution: The solution.
        curves: Samples of the iterate's interpolant and of the true motion under its input, at the
            same times, shape (2, K, M, N).
        end_error: Largest difference of a coordinate between the two curves at the end.
        largest_error: Largest difference of a coordinate between the two curves at any time.
    """

    task: Task
    solution: Solution
    curves: Array
    end_error: float
    largest_error: float

    @cached_property
    def excess(self) -> Array:
        """Excess of the worse curve over each part of the requirements, (K, R), as by `excess`."""
        return excess(self.task, self.solution.iterate, self.curves)

    @cached_property
    def savings(self) -> Array:
        """Estimated share of the objective that a finer mesh would save in each interval, (K,)."""
        return _savings(self.task, self.solution)

    def fine(self, accuracy: float) -> bool:
        """Return whether the mesh is fine enough for an accuracy of the end, in rad or m."""
        return self.end_error <= accuracy and self.largest_error <= INTERPOLANT * accuracy


def inspect(task: Task, solution: Solution) -> Inspection:
    """Sample a solution's interpolant and the true motion under its input between the nodes."""
    iterate, form = solution.iterate, task.nlp.form
    values = np.concatenate([iterate.nodes[:-1, None], iterate.points], axis=1)
    values = values[..., : task.problem.system.size]
    plan = _basis(form.scheme_kind, form.degree) @ values
    curves = np.stack([plan, task.motion(iterate)])
    gap = np.abs(curves[1] - curves[0])
    return Inspection(task, solution, curves, float(gap[-1, -1].max()), float(gap.max()))


def _savings(task: Task, solution: Solution) -> Array:
    """Estimate the share of the objective that a finer mesh would save in each interval, (K,).

    The optimal input differs from the piecewise one by about its kinks: where a linear input must
    begin at rest or bend at a limit, the cost is a tenth of a squared triangle. Kinks that change
    evenly from edge to edge belong to a smooth input, which lines approximate much better, so only
    the uneven part counts.
    """
    iterate, widths = solution.iterate, task.mesh.widths * solution.iterate.duration
    left, right = iterate.input_ends()
    effort, smooth = task.objective.weights[1:5].reshape(2, 2)
    if len(widths) < 4 or solution.objective <= 0:
        return np.zeros(len(widths))
    narrow = np.minimum(widths[1:], widths[:-1])[:, None]
    if task.nlp.form.input == "constant":
        lost = effort * np.diff(left, axis=0) ** 2 * narrow / 12
    else:
        kinks = np.diff((right - left) / widths[:, None], axis=0)
        pairs = np.pad(kinks, ((1, 1), (0, 0)), mode="reflect")
        uneven = np.minimum(np.abs(kinks), np.abs(kinks - (pairs[:-2] + pairs[2:]) / 2))
        lost = effort * uneven**2 * narrow**3 / 10 + smooth * kinks**2 * narrow / 12
    share = np.sum(lost, axis=1) / solution.objective
    return np.asarray(np.append(share, 0.0) + np.append(0.0, share)) / 2


@lru_cache(maxsize=16)
def _basis(kind: Kind, degree: int) -> Array:
    """Return the matrix (M, d+1) from values at left edge and collocation points to M samples."""
    tau = np.arange(STEPS + 1) / STEPS
    return np.asarray(basis(degree, tau).T @ scheme(kind, degree).bernstein)


def clears(task: Task, solution: Solution) -> bool:
    """Return whether links clear all discs also between the points of the mesh.

    A link that enters a disc by less than half the disc's radius counts as clear, since refinement
    can move the link out.
    """
    requirements = [requirement for requirement in task.requirements if requirement.divides]
    if not requirements:
        return True
    thickness = np.concatenate([[each.thickness] * len(each.parts) for each in requirements])
    iterate = solution.iterate
    deep = excess(task, iterate, task.motion(iterate)[None], requirements)
    return bool(np.all(deep < thickness / 2))


def excess(
    task: Task, iterate: Iterate, curves: Array, requirements: list[Requirement] | None = None
) -> Array:
    """Return by how much curves exceed each part of the requirements in each interval, (K, R).

    The excess is zero where a limit holds, elsewhere slightly enlarged, see `limit_excess`.

    Args:
        task: The task.
        iterate: The iterate, for its inputs.
        curves: Samples (C, K, M, N) of curves that must all keep the limits.
        requirements: The requirements to check; by default all that are kept between nodes.
    """
    system, point = task.problem.system, MotionPoint.of(task.problem.system, curves)
    requirements = task.requirements if requirements is None else requirements
    if any(requirement.reads != {"q"} for requirement in requirements):
        (left, right), tau = iterate.input_ends(), np.arange(STEPS + 1)[:, None] / STEPS
        u = left[:, None] + tau * (right - left)[:, None]
        slope = (right - left) / (task.mesh.widths[:, None] * iterate.duration)
        du = np.broadcast_to(slope[:, None], u.shape)
        alike = (np.broadcast_to(each, (*curves.shape[:-1], 2)) for each in (u, du))
        point = MotionPoint.of(system, curves, *alike)
    out = [np.zeros((curves.shape[1], 0))]
    for requirement in requirements:
        low, high, scale = requirement.bounds
        here = point
        if requirement.divides:
            here = MotionPoint.of(system, _dense(system, curves, requirement.thickness))
        values = np.stack(requirement.values(here), axis=-1)
        if (low == -high).all():
            out.append(limit_excess(np.abs(values), high, scale))
        else:
            above = limit_excess(values, high, scale) if np.isfinite(high).any() else 0.0
            out.append(np.maximum(above, limit_excess(-values, -low, scale)))
    return np.concatenate(out, axis=-1)


def _dense(system: Any, curves: Array, thickness: float) -> Array:
    """Add samples to curves (C, K, M, N) so that no link skips a disc of radius `thickness`, m."""
    points = system.arm_points(curves[..., 1:])
    length = float(np.linalg.norm(np.diff(points, axis=2), axis=-1).max())
    count = int(np.clip(np.ceil(length / (LARGEST_STEP * thickness)), 1, MAX_PARTS))
    share = np.arange(count)[:, None] / count
    before, after = curves[:, :, :-1, None], curves[:, :, 1:, None]
    inner = (before + share * (after - before)).reshape(*curves.shape[:2], -1, curves.shape[-1])
    return np.concatenate([inner, curves[:, :, -1:]], axis=2)


def limit_excess(curves: Array, limit: Array, scale: Array) -> Array:
    """Return the excess over a limit in each interval (K, …), enlarged by a tenth; 0 if kept.

    `curves` are samples (C, K, M, …). A parabola through three samples rises above the highest by
    at most a quarter of the step to a neighbour; in most cases this bound is enough.
    """
    flat = curves.reshape(-1, *curves.shape[2:])
    before, after = flat[:, :-1], flat[:, 1:]
    if ((before + after) / 2 + 0.75 * np.abs(after - before) <= limit).all():
        return np.zeros((curves.shape[1], *curves.shape[3:]))
    excess = np.max(peaks(flat).reshape(curves.shape[:2] + curves.shape[3:]), axis=0) - limit
    with np.errstate(invalid="ignore"):
        return np.where(excess > ROUNDING * scale, 1.1 * excess + DRAWN_IN_SLACK * scale, 0.0)


def peaks(values: Array) -> Array:
    """Estimate the greatest value in each interval, (K, …), from samples (K, M, …).

    Estimates are the peaks of the parabolas through three samples, plus the possible difference of
    a cubic. A peak may lie anywhere between the three, since an interval has no samples beyond its
    ends.
    """
    inner = values[:, 1:-1]
    before, after = values[:, :-2], values[:, 2:]
    slope, bend = (after - before) / 2, after - 2 * inner + before
    top = np.abs(slope) < -bend
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(top, inner - slope**2 / (2 * bend) + CUBIC_BULGE * _jumps(bend), -np.inf)
    return np.asarray(np.maximum(np.max(values, axis=1), np.max(vertex, axis=1, initial=-np.inf)))


def _jumps(bend: Array) -> Array:
    """Return the largest change from each second difference (K, M, …) to a neighbour."""
    steps = np.abs(np.diff(bend, axis=1))
    none = np.zeros_like(bend[:, :1])
    left, right = (np.concatenate(both, axis=1) for both in ([none, steps], [steps, none]))
    return np.asarray(np.maximum(left, right))
