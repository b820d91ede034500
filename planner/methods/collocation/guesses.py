"""First guesses: seeds, that is excursions of the two driven coordinates on the way to the goal.

The path coordinate q₁ and the driven coordinate q₂ follow a straight line plus the seed's
excursion; the others follow a straight line. The guess ignores the kinematics, which the solver
then enforces. Excursions are needed where a straight line has zero slopes, as at θ = 0, and where
the path coordinate must reverse.

The rates of an arm depend on θ₁ only through cos θ₁. So a motion that crosses θ₁ = 0 and comes back
can be mirrored to stay on one side at the same effort, and the corners that arise can be cut. So
the best motion crosses θ₁ = 0 at most once, and only if its ends lie on different sides. Guesses
are mirrored likewise (`_on_one_side`). The first direction of the drive, and whether θ₁ crosses
early or late, remain to be tried: all four combinations in turn, since each may be the best.

For a goal that leaves joints free, guesses end at several poses in turn; the solver determines the
end of the motion.

A waypoint is an edge of the mesh at which some coordinates are fixed. A waypoint with a time has a
fixed place in the mesh; the others are first placed by distance. The systems are driftless, so the
times of the parts can be adjusted afterwards: a motion of least effort has constant speed, so each
part gets time in proportion to its length (`rebalance`), repeatedly until the times settle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from planner.errors import InputError
from planner.methods.collocation.task import Task, task
from planner.methods.collocation.transcription.form import Mesh, through, uniform
from planner.methods.collocation.transcription.transcription import Transcription
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import Problem
from planner.problem.reach import expected_goals
from planner.problem.requirements.places import Waypoint
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

Excursion = Callable[[Array], Array]
SAMPLES = 1001
"""Number of samples of a guess before it is put on a mesh, many more than a mesh has nodes."""

LARGEST_GUESS_RAD = 1.3
"""Largest |q₂| of a guess, rad; nearer to 90 degrees the drive hardly moves the joints."""


@dataclass(frozen=True)
class Seed:
    """A named excursion of q₁ and q₂ from the straight line, which makes a first guess.

    Attributes:
        name: Name of the first guess in reports.
        path: Excursion of q₁ as a function of s in [0, 1]; `guess` multiplies it by half of the
            travel if this half exceeds one.
        driven: Excursion of q₂ as a function of s.
    """

    name: str
    path: Excursion
    driven: Excursion


def seeds(kind: str, count: int = 12, sides: int = 1) -> list[Seed]:
    """Return the seeds of one kind, or for "auto" of all kinds, in the order of trial.

    - straight: a line with a slight excursion of q₂; if `sides` is 2, one seed for each side.
    - reverse: q₁ first leaves the line, then returns late; q₂ goes out and back.
    - bump: q₁ goes out and back; q₂ makes its excursion while q₁ comes back.
    - wander: smooth random loops, from `count` fixed random seeds.
    """
    fixed = _fixed_seeds()
    fixed = fixed | {"straight": fixed["straight"][:sides]}
    if kind not in ("auto", "wander"):
        return [*fixed[kind]]
    first = [] if kind == "wander" else [seed for kind in fixed.values() for seed in kind]
    return [*first, *(wander(k) for k in range(count))][:count]


SIGNS = ((-1, 1), (1, -1), (1, 1), (-1, -1))
"""Pairs of signs of the excursions of q₁ and q₂: every first direction with every side."""


@lru_cache(maxsize=1)
def _fixed_seeds() -> dict[str, list[Seed]]:
    return {
        "straight": [_straight("straight", 0.1), _straight("straight, mirrored", -0.1)],
        "reverse": [_reverse(0.7 * a, 0.8 * b) for a, b in SIGNS],
        "bump": [_bump(a, 0.8 * b) for a, b in SIGNS],
    }


def guess(
    problem: Problem,
    nlp: Transcription,
    mesh: Mesh,
    seed: Seed,
    about: StateTrajectory | None = None,
) -> Iterate:
    """Return the first guess of a seed on a mesh, added to a straight line or to motion `about`."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    travel = likely_travel(problem)
    if about is not None:
        q = about.q(s * about.duration)
    else:
        q = lines_through_waypoints(problem, mesh.knots, travel, s)
    q[:, 0] += max(1.0, abs(travel) / 2) * seed.path(s)
    q[:, 1] = _on_one_side(problem, q[:, 1], seed.driven(s))
    limit = problem.limits.joint.copy()
    if problem.system.coordinates[1].unit == "rad":
        limit[1] = min(limit[1], LARGEST_GUESS_RAD)
    q = np.clip(q, -limit, limit)
    rates = np.gradient(q[:, :2], s, axis=0)
    drive = problem.system.drive(q)
    units = nlp.form.units
    least = 0.05 / (units.inputs[0] * units.time_s)
    rates[:, 0] /= np.where(np.abs(drive) < least, least, drive)
    duration = problem.duration
    if duration is None:
        slowest = np.max(np.mean(np.abs(rates), axis=0) / problem.limits.input_scale)
        duration = 1.5 * float(slowest) + 0.01 * units.time_s
    where = nlp.form.input_places(mesh)
    return Iterate(
        duration=duration,
        nodes=_interpolate(mesh.edges, s, q),
        points=_interpolate(mesh.at(nlp.form.scheme.points), s, q),
        inputs=_interpolate(where, s, rates) / duration,
    )


def likely_travel(problem: Problem) -> float:
    """Return the given travel, or an estimate from the slopes dqᵢ/dq₁ halfway to the goal.

    The estimate is the travel that best fits the moves of q₃ … q_N (least squares).
    """
    if problem.travel is not None:
        return problem.travel
    goal = problem.likely.goal
    moves = (goal - problem.start)[2:]
    middle = np.append(problem.start[0], (problem.start[1:] + goal[1:]) / 2)
    slopes = problem.system.slopes(middle)
    size = float(slopes @ slopes)
    return float(slopes @ moves) / size if size > 1e-12 else 0.0


def sides(problem: Problem) -> int:
    """Return how many mirrored guesses to try: 2 for an arm whose θ₁ changes sign, else 1."""
    if not _has_mirror(problem):
        return 1
    return 2 if problem.start[1] * problem.likely.goal[1] < 0 else 1


def _has_mirror(problem: Problem) -> bool:
    """Return whether motions of a problem may be mirrored at θ₁ = 0."""
    is_arm = isinstance(problem.system, Manipulator)
    return is_arm and not problem.divided and not problem.waypoints


def _on_one_side(problem: Problem, line: Array, excursion: Array) -> Array:
    """Return θ₁ of an arm along a guess, with as few crossings of zero as the ends allow.

    A positive excursion leads away from zero. For systems and problems without this mirror symmetry
    the result is the sum of line and excursion.
    """
    if not _has_mirror(problem):
        return line + excursion
    first, last = np.sign(line[[0, -1]])
    first = first or last or 1.0
    theta = line + (np.sign(line[0] + line[-1]) or 1.0) * excursion
    crossed = np.maximum.accumulate(theta * first < 0)
    return np.asarray(np.abs(theta) * np.where(crossed, last or first, first))


def lines_through_waypoints(problem: Problem, knots: Array, travel: float, s: Array) -> Array:
    """Return straight lines from start through waypoints to goal, at fractions s (S,), (S, N)."""
    goal = problem.likely.goal.copy()
    goal[0] = problem.start[0] + travel
    points = np.array([problem.start, *(w.q for w in problem.waypoints), goal])
    there = ~np.isnan(points)
    lines = zip(there.T, points.T, strict=True)
    return np.stack([np.interp(s, knots[at], values[at]) for at, values in lines], axis=-1)


def _interpolate(where: Array, s: Array, values: Array) -> Array:
    return np.stack([np.interp(where, s, column) for column in values.T], axis=-1)


def _straight(name: str, driven: float) -> Seed:
    return Seed(name, np.zeros_like, lambda s: driven * np.sin(np.pi * s))


def _bump(path: float, driven: float) -> Seed:
    return Seed(
        f"bump {sign_of(path)}{sign_of(driven)}",
        lambda s: path * np.sin(np.pi * s),
        lambda s: driven * np.maximum(0.0, np.sin(2 * np.pi * (s - 0.5))),
    )


def _reverse(path: float, driven: float) -> Seed:
    return Seed(
        f"reverse {sign_of(path)}{sign_of(driven)}",
        lambda s: 2 * path * s * np.sin(np.pi * s) ** 2,
        lambda s: driven * np.sin(np.pi * s),
    )


@lru_cache(maxsize=256)  # more than any search uses
def wander(number: int) -> Seed:
    """Return the seed of the smooth random loop with the given number."""
    terms = 3 + number % 4
    path, driven = np.random.default_rng(number).normal(size=(2, terms)) * 0.75

    def series(weights: Array) -> Excursion:
        k = np.arange(1, terms + 1)
        return lambda s: np.asarray(np.sin(np.pi * s[:, None] * k) @ weights)

    return Seed(f"random loop {number}", series(path), series(driven))


def sign_of(value: float) -> str:
    """Return the sign of a value as "+" or "-", for the name of a seed."""
    return "+" if value > 0 else "-"


MOST_ORDERS = 6
"""Largest number of orders of waypoints to try, those with the shortest straight lines first."""

MOST_BRANCHES = 4
"""Largest number of branches (ways to bend the elbows) of a goal with free joints to try, the
nearest first; three joints have no more."""

MAX_ORDERS = 5040
"""Largest number of orders to sort by length: seven waypoints without a time, in about a second."""

LEAST_SHARE = 0.02
"""Least share of the duration that the planner gives to the part between two waypoints."""


def routes(problem: Problem) -> list[Problem]:
    """Return the variants of a problem to search, the shortest by straight lines first.

    There is a variant for each order of the waypoints and, if the goal leaves joints free, for each
    expected branch of the goal; at most `MOST_ORDERS` are returned. The list is empty if no goal is
    found, and contains only the problem if there is no choice.

    Raises:
        InputError: If the waypoints have too many orders.
    """
    expected = [problem]
    if problem.free:
        expected = [problem.expecting(q) for q in expected_goals(problem)[:MOST_BRANCHES]]
    count = len(problem.waypoints)
    if count < 2 or not expected:
        return expected
    free = sum(w.time_s is None for w in problem.waypoints)
    if (ways := math.perm(count, free)) > MAX_ORDERS:
        raise InputError(
            f"{count} waypoints, {free} of them without a time, can be passed"
            f" in {ways:.3g} orders; at most {MAX_ORDERS} are tried, so give more of them a"
            " time",
            source=problem.source,
        )
    orders = sorted(_orders(problem), key=lambda order: _length(expected[0], order))[:MOST_ORDERS]
    every = [(each, order) for each in expected for order in orders]
    every.sort(key=lambda both: _length(*both))
    return [replace(each, waypoints=order) for each, order in every[:MOST_ORDERS]]


def mesh_through(problem: Problem, intervals: int) -> Mesh:
    """Return a mesh of about `intervals` intervals, even between waypoints, with an edge at each.

    The edge lies at the waypoint's time; without a time it is placed in proportion to distance.
    """
    if not problem.waypoints:
        return uniform(intervals)
    passed, total = problem.waypoints, problem.duration or 1.0
    fixed = [0.0, *(np.nan if w.time_s is None else w.time_s / total for w in passed), 1.0]
    knots = _place_knots(np.array(fixed), _steps(problem, passed) + 1e-3)
    return through(intervals, list(knots[1:-1]))


def rebalance(job: Task, iterate: Iterate) -> tuple[Task, Iterate] | None:
    """Redistribute the time among the parts between waypoints; return the new task and motion.

    The result is None if the times have settled."""
    old = job.mesh.knots
    new = _balanced_knots(job, iterate)
    if np.max(np.abs(new - old)) < 0.002:
        return None
    edges = np.interp(job.mesh.edges, old, new)
    mesh = Mesh(edges, job.mesh.marks)
    pace = np.diff(job.mesh.edges) / np.diff(edges)
    factor = np.append(pace, pace[-1])[: len(iterate.inputs), None]
    motion = replace(iterate, inputs=iterate.inputs * factor)
    fresh = task(job.problem, job.objective, job.nlp.form, mesh, job.demands, job.settings)
    return fresh, motion


def _orders(problem: Problem) -> list[tuple[Waypoint, ...]]:
    """Return every order of the waypoints that agrees with their times."""
    timed = [w for w in problem.waypoints if w.time_s is not None]
    orders = [tuple(sorted(timed, key=lambda w: w.time_s or 0.0))]
    for free in (w for w in problem.waypoints if w.time_s is None):
        orders = [(*o[:k], free, *o[k:]) for o in orders for k in range(len(o) + 1)]
    return orders


def _length(problem: Problem, order: tuple[Waypoint, ...]) -> float:
    return float(np.sum(_steps(problem, order)))


def _steps(problem: Problem, order: tuple[Waypoint, ...]) -> Array:
    """Return the straight-line distances between successive waypoints in joint space without q₁."""
    places = np.linspace(0.0, 1.0, len(order) + 2)
    q = lines_through_waypoints(replace(problem, waypoints=order), places, 0.0, places)
    return np.asarray(np.linalg.norm(np.diff(q[:, 1:], axis=0), axis=1))


def _place_knots(knots: Array, needs: Array) -> Array:
    """Replace knots that are NaN by values between their neighbours, in proportion to `needs`."""
    covered = np.append(0.0, np.cumsum(needs))
    is_fixed = ~np.isnan(knots)
    out = np.interp(covered, covered[is_fixed], knots[is_fixed])
    return np.where(is_fixed, knots, out)


def _balanced_knots(job: Task, iterate: Iterate) -> Array:
    left, right = iterate.input_ends()
    weights = np.sqrt(job.objective.weights[1:3])
    if job.problem.duration is None or not np.any(weights):
        weights = 1 / job.problem.limits.input_scale
    speed = np.linalg.norm((left + right) / 2 * weights, axis=1) * job.mesh.widths
    needs = np.add.reduceat(speed, [0, *job.mesh.marks])
    needs = np.maximum(needs, LEAST_SHARE * np.sum(needs))
    timed = [w.time_s is not None for w in job.problem.waypoints]
    fixed = np.where([True, *timed, True], job.mesh.knots, np.nan)
    return _place_knots(fixed, needs)
