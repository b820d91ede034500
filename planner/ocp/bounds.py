"""A problem's numbers in the shape of a transcription: bounds on unknowns and rows, parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.ocp.mesh import Mesh
from planner.ocp.objective import Objective
from planner.ocp.transcription import Transcription
from planner.problem import Problem
from planner.systems.base import Array

SHORTEST_S = 1e-3
"""Least duration that a free one may take, in seconds."""

MOST_DRAWN_IN = 0.1
"""Largest share of a joint limit by which it is drawn in; more would mean a mesh far too coarse."""


@dataclass(frozen=True, eq=False)
class Tightening:
    """By how much limits are drawn in, interval by interval, so that they hold between nodes.

    Attributes:
        joint: Shape (K, N), in the coordinates' units.
        z2: Shape (K,).
    """

    joint: Array
    z2: Array

    @classmethod
    def none(cls, intervals: int, size: int) -> Tightening:
        """No change."""
        return cls(np.zeros((intervals, size)), np.zeros(intervals))

    def everywhere(self) -> Tightening:
        """Each limit drawn in by its greatest amount, in all intervals."""
        joint = np.broadcast_to(np.max(self.joint, axis=0), self.joint.shape)
        return Tightening(joint, np.full_like(self.z2, np.max(self.z2)))


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the solver is given beside the functions.

    Attributes:
        lower: Of the unknowns, shape (size,).
        upper: Of the unknowns.
        row_lower: Of the rows, shape (K · height,).
        row_upper: Of the rows.
        parameters: Objective weights and mesh widths, shape (3 + K,).
        widths: The mesh widths, shape (K,).
    """

    lower: Array
    upper: Array
    row_lower: Array
    row_upper: Array
    parameters: Array
    widths: Array

    @property
    def pattern(self) -> bytes:
        """Which bounds are there and which are fixed: equal for problems of one kind."""
        pairs = ((self.lower, self.upper), (self.row_lower, self.row_upper))
        kinds = [
            (low == high) + 2 * np.isfinite(low) + 4 * np.isfinite(high) for low, high in pairs
        ]
        return np.concatenate(kinds).astype(np.uint8).tobytes()


def bounds(
    problem: Problem,
    made: Transcription,
    mesh: Mesh,
    objective: Objective,
    rest: bool,
    tightening: Tightening,
) -> Bounds:
    """Fill in a problem's numbers."""
    lower, upper = _unknowns(problem, made, rest, tightening)
    low, high = _rows(problem, made, tightening)
    return Bounds(
        lower, upper, low, high, np.concatenate([objective.weights, mesh.widths]), mesh.widths
    )


def _unknowns(
    problem: Problem, made: Transcription, rest: bool, tightening: Tightening
) -> tuple[Array, Array]:
    places = made.layout
    upper = np.full(places.size, np.inf)
    upper[places.inputs] = problem.limits.input
    upper[places.slopes] = problem.limits.input_rate
    joint = _joint(problem, made, tightening)
    upper[places.points] = joint[:, None, list(places.lifted)]
    upper[places.nodes] = -_at_nodes(-joint)
    lower = -upper
    lower[places.durations[0]] = SHORTEST_S
    duration = np.nan if problem.duration is None else problem.duration
    fixed = [(places.nodes[0], problem.start), (places.nodes[-1], _goal(problem))]
    fixed += [(places.durations[:1], np.array([duration]))]
    fixed += [(places.inputs[[0, -1]].ravel(), np.zeros(4))] if rest else []
    for where, values in fixed:
        known = ~np.isnan(values)
        lower[where[known]] = upper[where[known]] = values[known]
    return lower, upper


def _goal(problem: Problem) -> Array:
    goal = problem.goal.copy()
    goal[0] = np.nan if problem.travel is None else problem.start[0] + problem.travel
    return goal


def _at_nodes(tightening: Array) -> Array:
    """Values (K, …) of intervals at the K+1 edges: the greater of the two neighbours."""
    ends = np.concatenate([tightening[:1], tightening, tightening[-1:]])
    return np.asarray(np.maximum(ends[:-1], ends[1:]))


def _rows(problem: Problem, made: Transcription, tightening: Tightening) -> tuple[Array, Array]:
    shape = (made.form.intervals, made.height)
    low, high = np.zeros(shape), np.zeros(shape)
    for rows in made.labels:
        if rows.kind == "joint":
            high[:, rows.positions] = _joint(problem, made, tightening)[:, [rows.index]]
            low[:, rows.positions] = -high[:, rows.positions]
        elif rows.kind == "z2":
            bounds = _chart(problem, tightening.z2, rows.tau)
            low[:, rows.positions], high[:, rows.positions] = bounds
    return low.ravel(), high.ravel()


def _chart(problem: Problem, tightening: Array, tau: Array) -> tuple[Array, Array]:
    """Bounds of z₂; none at the motion's start, where the problem itself has been checked."""
    least = np.repeat((problem.limits.z2_margin or 0.0) + tightening[:, None], len(tau), axis=1)
    edge = tau == 0.0
    least[:, edge] += (_at_nodes(tightening)[:-1] - tightening)[:, None]
    least[0, edge] = -np.inf
    none = np.full_like(least, np.inf)
    return (least, none) if problem.z2_sign > 0 else (-none, -least)


def _joint(problem: Problem, made: Transcription, tightening: Tightening) -> Array:
    """Limits on coordinates in each interval, shape (K, N); infinite where there is none."""
    limited = np.isin(np.arange(made.system.size), made.system.limited)
    joint = np.where(limited, problem.limits.joint, np.inf)
    return np.asarray(joint - np.minimum(tightening.joint, MOST_DRAWN_IN * joint))
