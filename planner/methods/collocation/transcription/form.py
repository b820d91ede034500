"""The properties that distinguish transcriptions (scheme, form, mesh), and the objective.

The objective is a weighted sum of duration, effort, smoothness and closeness to the domain's edge.
A collocation scheme consists of points and of weights for integration, quadrature and conversion to
Bernstein form. On one interval, scaled to [0, 1], a coordinate is the polynomial of degree d
through its value at 0 and at the d collocation points. Everything else is linear in these d + 1
values.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import casadi as ca
import numpy as np

from planner.errors import InputError
from planner.methods.collocation.transcription.augmented import Augmented
from planner.methods.collocation.transcription.follower import Follower
from planner.plan.measures import INTEGRALS, Objective
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Requirement
from planner.problem.tables.method_options import CollocationOptions
from planner.support.arrays import Array
from planner.support.calculus.bernstein import basis

Kind = Literal["radau", "legendre"]


@dataclass(frozen=True, eq=False)
class Scheme:
    """Points and weights of a collocation scheme, as built by `scheme`.

    Attributes:
        points: τ₁ … τ_d, shape (d,), in (0, 1].
        integration: Matrix (d, d) from rates at the points to the changes from 0 to τ₁ … τ_d.
        quadrature: Weights (d,): ∫₀¹ f ≈ Σ quadrature · f(points).
        bernstein: Matrix (d+1, d+1) from values at (0, τ₁ … τ_d) to Bernstein coefficients, the
            last of which is the value at 1.
    """

    points: Array
    integration: Array
    quadrature: Array
    bernstein: Array


@lru_cache(maxsize=16)
def scheme(kind: Kind, degree: int) -> Scheme:
    """Return the collocation scheme of a kind and degree d (1 to 5), cached.

    "radau": the right end point is a collocation point, order 2d − 1 at the end of an interval;
    "legendre": order 2d.
    """
    points = np.array(ca.collocation_points(degree, kind))
    derivative = np.array(ca.collocation_coeff(points.tolist())[0])
    powers = np.arange(degree)
    moments = points ** powers[:, None]
    values = basis(degree, np.array([0.0, *points])).T
    return Scheme(
        points=points,
        integration=np.asarray(np.linalg.inv(derivative.T[:, 1:]), dtype=float),
        quadrature=np.asarray(np.linalg.solve(moments, 1 / (powers + 1.0)), dtype=float),
        bernstein=np.asarray(np.linalg.inv(values), dtype=float),
    )


InputKind = Literal["constant", "linear"]

REFERENCE_S, REFERENCE_LIMITED_S = 15.0, 3.0
"""Usual durations, s, for which the natural unit of time is one second: a given duration; or the
longest time that a limit or the objective alone implies for a move by 1 rad or 1 m."""

VANISHING, NEAR_RAD = 1e-3, 1.0
"""The drive vanishes at a place if it is less than this share of the drive at the place where all
angles are larger by this amount."""


@dataclass(frozen=True)
class Units:
    """Natural units, in which the unknowns of any problem are near one.

    The units are powers of ten, so that problems of ordinary size have units of one and are solved
    with unchanged rounding.

    Attributes:
        time_s: Unit of time, s.
        inputs: Natural units of the two inputs, in rad/s or m/s.
        objective: Unit of the objective.
    """

    time_s: float = 1.0
    inputs: tuple[float, float] = (1.0, 1.0)
    objective: float = 1.0

    def weights(self, weights: Array) -> Array:
        """Convert the weights of an objective's integrals, shape (6,), to natural units."""
        T, squares = self.time_s, np.square(self.inputs)
        units = np.array([T, *(squares * T), *(squares / T), 1.0])
        return np.asarray(weights * units / self.objective)


def natural_units(problem: Problem, objective: Objective, timeless: bool) -> Units:
    """Choose natural units from a problem's drive constant, duration or limits, and objective.

    Args:
        problem: The problem.
        objective: The objective.
        timeless: Whether only the path counts, with a reference duration.
    """
    drive = _usual_drive(problem)
    reach = np.array([drive if 0 < drive < np.inf else 1.0, 1.0])
    seconds = 1.0
    if problem.duration is not None and not timeless:
        seconds = problem.duration / REFERENCE_S
    elif problem.duration is None:
        limits, effort = problem.limits, objective.weights[1:3]
        rates = 2 / np.sqrt(reach * limits.input_rate)
        slowest = np.max([1 / (reach * limits.input), rates, np.sqrt(effort) / reach])
        seconds = float(slowest) / REFERENCE_LIMITED_S
    time_s = _decade(seconds)
    first, second = (_decade(1 / (each * time_s)) for each in reach)
    units = Units(time_s, (first, second))
    return replace(units, objective=_decade(np.max(units.weights(objective.weights))))


def _usual_drive(problem: Problem) -> float:
    """Return the largest |γ| at start and goal, or near them if it vanishes there.

    That of a vehicle vanishes where it heads along the y axis, so the larger of the two is taken:
    the frame of a problem then does not change its units.
    """
    ends = np.array([problem.start, problem.likely.goal])
    ends = np.where(np.isnan(ends), problem.start, ends)
    angles = np.array([each.unit == "rad" for each in problem.system.coordinates])
    angles[0] = False
    here = float(np.abs(problem.system.drive(ends)).max())
    near = float(np.abs(problem.system.drive(ends + NEAR_RAD * angles)).max())
    small = 1.0 if problem.system.coordinates[0].unit == "m" else VANISHING
    return near if here < small * near else here


def _decade(value: float) -> float:
    return float(10.0 ** np.round(np.log10(value)))


@dataclass(frozen=True)
class Form:
    """The properties of a transcription, which together with the system are its cache key.

    Attributes:
        intervals: Number K of mesh intervals.
        scheme_kind: Family of collocation points.
        degree: Collocation points per interval.
        input: "constant" in each interval, or "linear" and continuous.
        free_duration: Whether the duration is an unknown; else it is a parameter.
        kept: Requirements that have rows, as templates without numbers, see `Task`.
        final: Requirements at the end and at waypoints, which have rows at right edges only, as
            templates without numbers.
        edge: Whether closeness to the edge of the chart's domain is a term of the objective.
        inner: Whether requirements on coordinates have rows at the collocation points too, not only
            at the mesh's edges.
        augmented: The system with its response to errors, if that is transcribed; else None.
        follower: The joints of the nominal machine, if their motion is transcribed too; else None.
        units: Units of the unknowns, and of rows that depend on inputs.
        soft_goal: Whether the end's distance from the goal can be a term of the objective, with the
            goal and a penalty of each coordinate as parameters.
    """

    intervals: int
    scheme_kind: Kind = "radau"
    degree: int = 3
    input: InputKind = "constant"
    free_duration: bool = True
    inner: bool = False
    kept: tuple[Requirement, ...] = ()
    final: tuple[Requirement, ...] = ()
    edge: bool = False
    augmented: Augmented | None = None
    follower: Follower | None = None
    units: Units = Units()
    soft_goal: bool = False

    @property
    def parameters(self) -> int:
        """Number of parameters of an interval besides its width: weights of the objective, numbers
        of the requirements, the smoothing of a follower, and the duration if fixed."""
        numbers = sum(len(requirement.row_fields) for requirement in (*self.kept, *self.final))
        return INTEGRALS + numbers + (self.follower is not None) + (not self.free_duration)

    @property
    def scheme(self) -> Scheme:
        """Points and weights of the collocation scheme."""
        return scheme(self.scheme_kind, self.degree)

    def input_places(self, mesh: Mesh) -> Array:
        """Return the fractions of the duration to which `Iterate.inputs` refer: the middles of the
        intervals, (K,), for constant inputs, or the edges, (K+1,), for linear inputs."""
        return mesh.edges if self.input == "linear" else mesh.edges[:-1] + mesh.widths / 2


@dataclass(frozen=True, eq=False)
class Mesh:
    """A partition of the duration, scaled to [0, 1], into K intervals.

    Attributes:
        edges: Ends of the intervals, increasing from 0 to 1, shape (K+1,).
        marks: Indices of the edges at which the waypoints are passed, in order.
    """

    edges: Array
    marks: tuple[int, ...] = ()

    @cached_property
    def widths(self) -> Array:
        """Interval widths, shape (K,)."""
        return np.asarray(self.edges[1:] - self.edges[:-1])

    @property
    def knots(self) -> Array:
        """Fractions of the duration at start, waypoints and goal: 0, the marked edges, and 1."""
        return self.edges[[0, *self.marks, len(self.edges) - 1]]

    def at(self, tau: Array) -> Array:
        """Convert fractions tau (m,) of each interval to fractions of the whole mesh, (K, m)."""
        return np.asarray(self.edges[:-1, None] + self.widths[:, None] * tau)

    def snap(self, edges: Array) -> Mesh:
        """Return a mesh with the given edges, the nearest of which are moved onto the marks."""
        edges = edges.copy()
        marks: list[int] = []
        for knot in self.knots[1:-1]:
            first = marks[-1] + 1 if marks else 1
            k = max(int(np.argmin(np.abs(edges - knot))), first)
            edges[k] = knot
            marks.append(k)
        return Mesh(np.sort(edges), tuple(marks))


def uniform(intervals: int) -> Mesh:
    """Return the mesh of K intervals of the same width."""
    return Mesh(np.linspace(0.0, 1.0, intervals + 1))


def through(intervals: int, fractions: Sequence[float]) -> Mesh:
    """Return a mesh of about K nearly even intervals, with marked edges at increasing fractions."""
    knots = np.array([0.0, *fractions, 1.0])
    counts = np.maximum(1, np.round(intervals * np.diff(knots)).astype(int))
    spans = zip(knots[:-1], knots[1:], counts, strict=True)
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in spans]
    marks = np.cumsum(counts)[:-1]
    return Mesh(np.append(np.concatenate(parts), 1.0), tuple(int(k) for k in marks))


TIME_REGULARISATION = 0.01
"""Weight of the scaled effort relative to the duration in the objective "time". The scaled effort
is at most twice the duration, so the duration found is within 2 % of the least."""

EDGE_REGULARISATION = 0.01
"""Weight of the effort relative to the closeness to the domain's edge in the objective "edge";
without the effort the motion would leave the edge at infinite speed."""


def objective(problem: Problem, options: CollocationOptions) -> Objective:
    """Return the objective that the options name, or the default objective of the problem.

    Raises:
        InputError: If the objective has no minimum with a free duration (slower is always better),
            or is "time" although an input has no limit.
    """
    kind: str = options.objective
    limited = bool(np.all(np.isfinite(problem.limits.input)))
    if kind == "auto":
        free = "time" if limited else "mixed"
        kind = "effort" if problem.duration is not None else free
    if kind in _FIXED_TIME:
        terms, why = _FIXED_TIME[kind]
        if problem.duration is None:
            raise InputError(
                f"objective '{kind}' with goal.duration = \"free\" has no least"
                f" value ({why}); use objective 'time' or 'mixed', or give goal.duration",
                source=problem.source,
            )
        return Objective(kind, terms)
    if kind == "time":
        if not limited:
            raise InputError(
                "objective 'time' needs a limit on both inputs, but the [limits]"
                " table has none; without one the least duration is zero",
                source=problem.source,
            )
        return fastest(problem)
    weights = {
        "effort": options.effort_weight,
        "smoothness": options.smoothness_weight,
        "closeness": options.edge_weight,
    }
    return Objective("mixed", {"duration": 1.0} | {k: w for k, w in weights.items() if w > 0})


_SLOWNESS = "a slower motion always lowers the objective"
_FIXED_TIME = {
    "effort": ({"effort": 1.0}, _SLOWNESS),
    "smooth": ({"smoothness": 1.0}, _SLOWNESS),
    "edge": (
        {"closeness": 1.0, "effort": EDGE_REGULARISATION},
        "a longer stay far from the edge always lowers the objective",
    ),
}


def fastest(problem: Problem) -> Objective:
    """Return the objective "time": the duration, plus a little effort that makes motions unique."""
    u1, u2 = (TIME_REGULARISATION / problem.limits.input_scale**2).tolist()
    return Objective("time", {"duration": 1.0, "effort u1": u1, "effort u2": u2})
