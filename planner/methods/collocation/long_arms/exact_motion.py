"""Turn a path into an exact motion along it, as fast as the limits allow.

The file is for paths that are too long for a solver to optimise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.methods.collocation.between_nodes import inspect
from planner.methods.collocation.long_arms.bridges import (
    ChainEnds,
    PieceChain,
    close_gaps,
    cut_finer,
    cuts,
    ends_of,
    make_exact,
)
from planner.methods.collocation.path import needed_duration
from planner.methods.collocation.task import Solution, Task, stretch_to, task
from planner.methods.collocation.transcription.form import Mesh
from planner.methods.collocation.transcription.unknowns import Iterate

DEGREE = 5
"""Number of collocation points per interval of a path; few wide intervals are accurate enough."""

MOST_TURN, HALVINGS = 0.4, 2
"""Largest turn of a limited coordinate in an interval, rad; and how often all intervals are halved
at most if the turn is too coarse. In most intervals little turns, but small errors add up."""

COARSE_TURN = 0.3
"""Largest turn in a piece made from a solution whose mesh was too coarse, rad."""

FREE_LIMIT_SHARE = 1e-4
"""Share of the joint limits that the nodes leave free for the motion between the nodes."""


def has_only_limits(job: Task) -> bool:
    """Return whether a task limits only joints and inputs, and allows inputs to jump everywhere."""
    may_jump = not (job.demands.rest or job.objective.weights[3] or job.problem.reads("du"))
    plain = all(requirement.is_direct for requirement in job.problem.requirements)
    return may_jump and plain and not (job.problem.waypoints or job.nlp.form.augmented)


def exact_motion(job: Task, chain: PieceChain, accuracy: float) -> tuple[Task, Solution] | None:
    """Return a task on the path's own mesh, and an exact motion that solves it; None if that fails.

    Args:
        job: The task, see `has_only_limits`.
        chain: The path; small gaps are closed.
        accuracy: Largest error at the end, as for `refine.polish`.
    """
    system = job.problem.system
    places = ChainEnds.of(job.problem, 1 - FREE_LIMIT_SHARE)
    if free := list(job.problem.free):  # fix the free joints at the path's end
        goal = places.goal.copy()
        goal[free] = chain.q[-1, free]
        places = replace(places, goal=goal)
    for halved in range(HALVINGS + 1):
        pieces = cut_finer(system, chain, list(system.limited), MOST_TURN, least=2 if halved else 1)
        whole, _ = close_gaps(system, pieces, places)
        motion = make_exact(system, whole, places) if whole is not None else None
        if motion is None:
            return None
        chain = motion
        path_job, path = follow(job, chain, DEGREE)
        duration = _duration(path_job, path)
        if duration is None:
            return None
        solution = path_job.judge(stretch_to(path, duration))
        if solution.ok and inspect(path_job, solution).fine(accuracy):
            return path_job, solution
    return None


def _duration(job: Task, path: Iterate) -> float | None:
    """Return the given duration, or the least within limits, s; None if the given is too short."""
    given, needed = job.problem.duration, needed_duration(job.problem, job.mesh, path)
    if given is None:
        return needed or path.duration
    return given if needed <= given * (1 + 1e-9) else None


def chain_of(job: Task, solution: Solution) -> PieceChain:
    """Approximate a solution's path by a chain of pieces with constant inputs.

    Where a piece misses the path's next node, the chain has a gap."""
    iterate, limited = solution.iterate, list(job.problem.system.limited)
    parts, interval, share = cuts(iterate.nodes, limited, COARSE_TURN)
    width = job.mesh.widths[interval]
    edges = np.append(job.mesh.edges[:-1][interval] + share * width, 1.0)
    left, right = (end[interval] for end in iterate.input_ends())
    middle = left + (right - left) * (share + 0.5 / parts[interval])[:, None]
    u = middle * np.diff(edges)[:, None] * iterate.duration
    q = job.curve(iterate).q(edges * iterate.duration)
    return PieceChain(q, u, q[1:] - ends_of(job.problem.system, q[:-1], u))


def follow(job: Task, chain: PieceChain, degree: int = 0) -> tuple[Task, Iterate]:
    """Return a task on the path's mesh, and the path at the speed that the input limits allow.

    Each interval has at least `degree` collocation points.
    """
    seconds = np.max(np.abs(chain.u) / job.problem.limits.input_scale, axis=1)
    moving = seconds > 1e-9 * np.sum(seconds)
    seconds = seconds[moving]
    nodes = np.vstack([chain.q[:-1][moving], chain.q[-1:]])
    edges = np.append(0.0, np.cumsum(seconds))
    path_job = _with_constant_inputs(job, degree).on_mesh(Mesh(edges / edges[-1]))
    tau, inputs = path_job.nlp.form.scheme.points, chain.u[moving] / seconds[:, None]
    points = nodes[:-1, None] + tau[:, None] * np.diff(nodes, axis=0)[:, None]
    if path_job.nlp.form.input == "linear":
        padded = np.vstack([inputs[:1], inputs, inputs[-1:]])
        inputs = (padded[:-1] + padded[1:]) / 2
    return path_job, Iterate(float(edges[-1]), nodes, points, inputs)


def _with_constant_inputs(job: Task, degree: int) -> Task:
    """Return a task with at least the given degree, and with constant inputs if inputs may jump."""
    form = job.nlp.form
    new = replace(form, degree=max(form.degree, degree))
    if has_only_limits(job):
        new = replace(new, input="constant")
    if new == form:
        return job
    return task(job.problem, job.objective, new, job.mesh, job.demands, job.settings)
