"""The numbers of a problem for its transcription: bounds on unknowns and rows, and parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.methods.collocation.transcription.form import Mesh
from planner.methods.collocation.transcription.transcription import Transcription
from planner.methods.collocation.transcription.unknowns import Index
from planner.plan.measures import Objective
from planner.problem.feasibility import SHORTEST_S
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Requirement
from planner.support.arrays import Array

MOST_DRAWN_IN = 0.1
"""Largest amount by which a limit is tightened, as a share of half the range from low to high."""

Sides = tuple[Array | float, Array | float]
"""Lower and upper bounds."""


@dataclass(frozen=True)
class InputDemands:
    """Demands beside the problem's limits, most of them on the inputs.

    Attributes:
        rest: Whether the inputs are zero at both ends.
        first_sign: Sign of u₁ until the first of `turns`; zero if the sign is free.
        turns: Fractions of the duration at which the sign of u₁ changes.
        effort: Largest ∫ u₁² + u₂² dt, if the transcription has it as a state.
        timeless: Whether to leave out limits that depend on inputs, since a path has no timing.
        joint_ends: Least and greatest angles of a follower's joints at the marks of the mesh and at
            the end, two (M+1, n), rad.
        smoothing: The angle ε of a follower, rad.
    """

    rest: bool = False
    first_sign: float = 0.0
    turns: tuple[float, ...] = ()
    effort: float = np.inf
    timeless: bool = False
    joint_ends: Sides = (-np.inf, np.inf)
    smoothing: float = 0.0


@dataclass(frozen=True, eq=False)
class Bounds:
    """The numbers that a solver gets in addition to the functions, in natural units.

    Attributes:
        lower: Lower bounds of the unknowns, shape (size,).
        upper: Upper bounds of the unknowns, shape (size,).
        row_lower: Lower bounds of the rows, shape (K · height,).
        row_upper: Upper bounds of the rows, shape (K · height,).
        parameters: Numbers of the form (`Form.parameters`), mesh widths and those of a soft goal.
        widths: The mesh widths, shape (K,).
        units: Units of the unknowns, shape (size,).
    """

    lower: Array
    upper: Array
    row_lower: Array
    row_upper: Array
    parameters: Array
    widths: Array
    units: Array

    @property
    def pattern(self) -> bytes:
        """Bytes that encode which bounds are finite or equal, the same for problems of one kind."""
        low, high = np.append(self.lower, self.row_lower), np.append(self.upper, self.row_upper)
        kinds = (low == high) + 2 * np.isfinite(low) + 4 * np.isfinite(high)
        return np.asarray(kinds, dtype=np.uint8).tobytes()


def bounds(
    problem: Problem,
    requirements: list[Requirement],
    nlp: Transcription,
    mesh: Mesh,
    objective: Objective,
    demands: InputDemands,
    inset: Array,
) -> Bounds:
    """Compute the bounds and parameters of a transcription from a problem's numbers.

    Args:
        problem: The problem.
        requirements: Requirements of the problem that have rows, see `Task`.
        nlp: The transcription.
        mesh: The mesh.
        objective: The objective.
        demands: Demands on the inputs beside the problem's limits.
        inset: Amounts by which the parts of the requirements are tightened, shape (K, R), so that
            the requirements hold between the nodes.
    """
    low, high = (np.concatenate([[], *(each.bounds[k] for each in requirements)]) for k in (0, 1))
    most = MOST_DRAWN_IN * (high - low) / 2
    beside = np.concatenate([inset[:1], inset, inset[-1:]])  # an edge has the greater of two
    inside = np.minimum(inset, most)
    edges = np.minimum(np.maximum(beside[:-1], beside[1:]), most)
    lower, upper = _limits(problem, nlp, mesh, demands, inside, edges)
    reads = [requirement.reads for requirement in requirements for _ in requirement.parts]
    speeds = [requirement.speed_power for requirement in requirements for _ in requirement.parts]
    units, of_unknowns = nlp.form.units, nlp.layout.units(nlp.form.units)
    row_lower, row_upper = np.zeros((2, nlp.form.intervals, nlp.height))
    ends = [part for requirement in problem.final for part in requirement.parts]
    for rows in nlp.labels:
        if rows.kind == "final":
            row_lower[:, rows.positions], row_upper[:, rows.positions] = -np.inf, np.inf
            if rows.index < len(ends):
                row_lower[-1, rows.positions] = ends[rows.index].low
                row_upper[-1, rows.positions] = ends[rows.index].high
                continue
            i = problem.on_the_way.indices[rows.index - len(ends)]
            for k, point in zip(mesh.marks, problem.waypoints, strict=True):
                if i in point.beside_q:
                    row_lower[k - 1, rows.positions] = point.user[i]
                    row_upper[k - 1, rows.positions] = point.user[i]
        if rows.kind != "kept":
            continue
        r, where = rows.index, rows.positions
        amounts = inside[:, [r]] + np.zeros(len(rows.tau))
        if reads[r] == {"q"}:
            edge = rows.tau == 0.0
            amounts[:, edge] = edges[:-1, [r]]
            amounts[0, edge] = -np.inf  # the start has been checked with the problem
        elif demands.timeless:
            amounts[:] = -np.inf
        unit = units.time_s ** speeds[r]
        row_lower[:, where] = (low[r] + amounts) * unit
        row_upper[:, where] = (high[r] - amounts) * unit
    every = (*requirements, *problem.final)
    numbers = [number for requirement in every for number in requirement.row_field_values]
    duration = [] if problem.duration is None else [problem.duration / units.time_s]
    weights = units.weights(objective.weights)
    smoothing = [demands.smoothing] * (nlp.form.follower is not None)
    goal = np.zeros(2 * problem.system.size * nlp.form.soft_goal)
    parameters = np.concatenate([weights, numbers, smoothing, duration, mesh.widths, goal])
    sides = lower / of_unknowns, upper / of_unknowns, row_lower.ravel(), row_upper.ravel()
    return Bounds(*sides, parameters, mesh.widths, of_unknowns)


def _limits(
    problem: Problem,
    nlp: Transcription,
    mesh: Mesh,
    demands: InputDemands,
    inside: Array,
    edges: Array,
) -> tuple[Array, Array]:
    """Return bounds (size,) of the unknowns, tightened by `inside` (K, R) and `edges` (K+1, R);
    both are equal where start, goal, duration, waypoints or rest at the ends fix the value."""
    places = nlp.layout
    upper = np.full(places.size, np.inf)
    lower = -upper

    def restrict(unknowns: Index, sides: Sides, inset: Array | float = 0.0) -> None:
        lower[unknowns] = np.maximum(lower[unknowns], sides[0] + inset)
        upper[unknowns] = np.minimum(upper[unknowns], sides[1] - inset)

    r = 0
    for requirement in problem.requirements:
        index, (low, high, _) = [part.index for part in requirement.parts], requirement.bounds
        if requirement.is_direct and requirement.reads != {"q"}:
            unknowns = places.inputs if "u" in requirement.reads else places.slopes
            if not demands.timeless:
                restrict(unknowns[:, index], (low, high))
            continue
        if requirement.is_direct:
            restrict(places.nodes[:, index], (low, high), edges[:, r : r + len(index)])
            for k in set(index) & set(places.lifted):
                place = index.index(k)
                points = places.points[..., places.lifted.index(k)]
                restrict(points, (low[place], high[place]), inside[:, [r + place]])
        r += len(index)
    restrict(places.nodes[-1, list(problem.free)], (-problem.free_within, problem.free_within))
    restrict(places.joints[[*mesh.marks, -1], : problem.system.size - 1], demands.joint_ends)
    lower[places.durations[:1]] = SHORTEST_S * nlp.form.units.time_s
    if demands.first_sign:
        turned = np.searchsorted(demands.turns, nlp.form.input_places(mesh))
        forward = demands.first_sign * (-1.0) ** turned > 0
        lower[places.inputs[forward, 0]] = upper[places.inputs[~forward, 0]] = 0.0
    if np.isfinite(demands.effort):
        upper[places.nodes[-1, -1]] = demands.effort
    N, duration = problem.system.size, np.nan if problem.duration is None else problem.duration
    fixed = [(places.nodes[0], nlp.start(problem)), (places.nodes[-1, :N], problem.goal)]
    fixed += [(places.durations[:1], np.array([duration])[: len(places.durations)])]
    stops = zip(mesh.marks, problem.waypoints, strict=True)
    fixed += [(places.nodes[k, :N], point.q) for k, point in stops]
    fixed += [(places.joints[0], arm.start(problem.start))] if (arm := nlp.form.follower) else []
    fixed += [(places.inputs[[0, -1]].ravel(), np.zeros(4))] if demands.rest else []
    for where, values in fixed:
        is_fixed = ~np.isnan(values)
        lower[where[is_fixed]] = upper[where[is_fixed]] = values[is_fixed]
    return lower, upper
