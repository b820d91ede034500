"""A problem's numbers in the shape of a transcription: bounds on unknowns and rows, parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.methods.collocation.transcription.form import Mesh
from planner.methods.collocation.transcription.objective import Objective
from planner.methods.collocation.transcription.transcription import Transcription
from planner.problem.problem import Problem
from planner.support.arrays import Array

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
        discs: Of each disc and link, shape (K, D · L), metres.
    """

    joint: Array
    z2: Array
    discs: Array

    @classmethod
    def none(cls, intervals: int, size: int, pairs: int = 0) -> Tightening:
        """No change, for N coordinates and as many pairs of disc and link."""
        shapes = (intervals, size), (intervals,), (intervals, pairs)
        return cls(*(np.zeros(shape) for shape in shapes))

    def __bool__(self) -> bool:
        return bool(self.joint.any() or self.z2.any() or self.discs.any())

    def __add__(self, other: Tightening) -> Tightening:
        return Tightening(self.joint + other.joint, self.z2 + other.z2, self.discs + other.discs)

    def everywhere(self, share: float, times: float) -> Tightening:
        """Each limit drawn in so many times, and in all intervals by at least a share of that."""
        amounts = (times * each for each in (self.joint, self.z2, self.discs))
        return Tightening(*(np.maximum(each, share * np.max(each, axis=0)) for each in amounts))


@dataclass(frozen=True)
class Asked:
    """What is asked of the inputs beside the problem's limits.

    Attributes:
        rest: Whether they are zero at both ends.
        way: Sign that the first one keeps; zero where it may change.
        effort: Most that ∫ u₁² + u₂² dt may be, where the transcription meters it.
    """

    rest: bool = False
    way: float = 0.0
    effort: float = np.inf


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the solver is given beside the functions.

    Attributes:
        lower: Of the unknowns, shape (size,).
        upper: Of the unknowns.
        row_lower: Of the rows, shape (K · height,).
        row_upper: Of the rows.
        parameters: Numbers of the form (`Form.parameters`) and mesh widths.
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
    asked: Asked,
    tightening: Tightening,
) -> Bounds:
    """Fill in a problem's numbers."""
    joint = _joint(problem, made, tightening)
    lower, upper = _unknowns(problem, made, mesh, asked, joint)
    low, high = _rows(problem, made, tightening, joint)
    discs = [[*disc.centre, disc.radius] for disc in problem.obstacles]
    given = discs[: made.form.obstacles]
    known = [] if made.form.free_duration else [problem.duration]
    parameters = np.concatenate([objective.weights, *given, known, mesh.widths])
    return Bounds(lower, upper, low, high, parameters, mesh.widths)


def _unknowns(
    problem: Problem, made: Transcription, mesh: Mesh, asked: Asked, joint: Array
) -> tuple[Array, Array]:
    """Bounds of the unknowns; `joint` are the limits on coordinates in each interval, (K, N)."""
    places = made.layout
    upper = np.full(places.size, np.inf)
    upper[places.inputs] = problem.limits.input
    upper[places.slopes] = problem.limits.input_rate
    upper[places.points] = joint[:, None, list(places.lifted)]
    upper[places.nodes] = -_at_nodes(-joint)
    lower = -upper
    lower[places.durations[:1]] = SHORTEST_S
    duration = np.nan if problem.duration is None else problem.duration
    if asked.way:
        (lower if asked.way > 0 else upper)[places.inputs[:, 0]] = 0.0
    if np.isfinite(asked.effort):
        upper[places.nodes[-1, -1]] = asked.effort
    N = problem.system.size
    fixed = [(places.nodes[0], made.start(problem)), (places.nodes[-1, :N], problem.target)]
    fixed += [(places.durations[:1], np.array([duration])[: len(places.durations)])]
    stops = zip(mesh.marks, problem.waypoints, strict=True)
    fixed += [(places.nodes[k, :N], point.q) for k, point in stops]
    fixed += [(places.inputs[[0, -1]].ravel(), np.zeros(4))] if asked.rest else []
    for where, values in fixed:
        known = ~np.isnan(values)
        lower[where[known]] = upper[where[known]] = values[known]
    return lower, upper


def _at_nodes(tightening: Array) -> Array:
    """Values (K, …) of intervals at the K+1 edges: the greater of the two neighbours."""
    ends = np.concatenate([tightening[:1], tightening, tightening[-1:]])
    return np.asarray(np.maximum(ends[:-1], ends[1:]))


def _rows(
    problem: Problem, made: Transcription, tightening: Tightening, joint: Array
) -> tuple[Array, Array]:
    shape = (made.form.intervals, made.height)
    low, high = np.zeros(shape), np.zeros(shape)
    for rows in made.labels:
        if rows.kind == "joint":
            high[:, rows.positions] = joint[:, [rows.index]]
            low[:, rows.positions] = -high[:, rows.positions]
        elif rows.kind == "z2":
            bounds = _chart(problem, tightening.z2, rows.tau)
            low[:, rows.positions], high[:, rows.positions] = bounds
        elif rows.kind == "obstacle":
            least = tightening.discs[:, [rows.index]] + np.zeros(len(rows.tau))
            edge = rows.tau == 0.0
            least[:, edge] = _at_nodes(tightening.discs[:, rows.index])[:-1, None]
            least[0, edge] = -np.inf  # where the problem itself has been checked
            low[:, rows.positions], high[:, rows.positions] = least, np.inf
    return low.ravel(), high.ravel()


def _chart(problem: Problem, tightening: Array, tau: Array) -> tuple[Array, Array]:
    """Bounds of z₂; none at the motion's start, where the problem itself has been checked."""
    least = np.empty((len(tightening), len(tau)))
    least[:] = tightening[:, None]
    edge = tau == 0.0
    least[:, edge] = _at_nodes(tightening)[:-1, None]
    least += problem.limits.z2_margin or 0.0
    least[0, edge] = -np.inf
    none = np.full_like(least, np.inf)
    return (least, none) if problem.z2_sign > 0 else (-none, -least)


def _joint(problem: Problem, made: Transcription, tightening: Tightening) -> Array:
    """Limits on coordinates in each interval, shape (K, N); infinite where there is none."""
    limited = list(made.system.limited)
    joint = np.full(made.system.size, np.inf)
    joint[limited] = problem.limits.joint[limited]
    drawn = joint - np.minimum(tightening.joint, MOST_DRAWN_IN * joint)
    more = made.moved.size - made.system.size
    return np.pad(drawn, [(0, 0), (0, more)], constant_values=np.inf)
