"""First guesses: seeds that say how the two driven coordinates wander on the way to the goal.

The path coordinate q₁ and the driven one q₂ follow a straight line plus the seed's excursion; the
others follow a straight line. The guess does not obey the kinematics: the solver sees to that. An
excursion matters where a straight line has no slope to follow, as at θ = 0, and where the path
coordinate must turn back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.ocp.layout import Iterate
from planner.ocp.mesh import Mesh
from planner.ocp.transcription import Transcription
from planner.problem import Problem
from planner.systems.base import Array

Excursion = Callable[[Array], Array]
SAMPLES = 1001
LARGEST_GUESS_RAD = 1.3


@dataclass(frozen=True)
class Seed:
    """A named excursion.

    Attributes:
        name: For reports.
        path: Excursion of q₁ over s in [0, 1], in its unit for distances near one.
        driven: Excursion of q₂.
    """

    name: str
    path: Excursion
    driven: Excursion


def seeds(kind: str, count: int = 12) -> list[Seed]:
    """Seeds of one kind, or for "auto" all of them in the order in which they are tried.

    - straight: a line, with a slight excursion of q₂.
    - bump: q₁ goes out and back, q₂ makes its excursion on the way back.
    - reverse: q₁ first leaves the line, then returns late; q₂ goes out and back.
    - wander: smooth random loops, from `count` fixed random seeds.
    """
    known = _known()
    wander = [_wander(k) for k in range(max(count, 2))]
    if kind != "auto":
        return wander if kind == "wander" else [*known[kind]]
    straight, bump, reverse = known.values()
    first = [straight[0], bump[0], reverse[0], wander[0], wander[1], bump[1], reverse[1]]
    return [*first, *wander[2:]][:count]


@lru_cache(maxsize=1)
def _known() -> dict[str, list[Seed]]:
    return {
        "straight": [_straight()],
        "bump": [_bump(a, b) for a, b in ((1.0, 0.8), (-1.0, -0.8), (-1.0, 0.8), (1.0, -0.8))],
        "reverse": [_reverse(a, b) for a, b in ((-0.7, 0.8), (0.7, -0.8), (0.7, 0.8))],
    }


def guess(problem: Problem, made: Transcription, mesh: Mesh, seed: Seed) -> Iterate:
    """The unknowns along a seed."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    q = _states(problem, mesh, seed, s)
    rates = np.gradient(q[:, :2], s, axis=0)
    rates[:, 0] /= _away_from_zero(problem.system.drive(q))
    duration = problem.duration or _duration(problem, rates)
    where = made.form.input_places(mesh)
    return Iterate(
        duration=duration,
        nodes=_interpolate(mesh.edges, s, q),
        points=_interpolate(mesh.at(made.form.scheme.points), s, q),
        inputs=_interpolate(where, s, rates) / duration,
    )


def likely_travel(problem: Problem) -> float:
    """Travel given, or the one that best fits the others' moves at the middle's slopes."""
    if problem.travel is not None:
        return problem.travel
    moves = (problem.goal - problem.start)[2:]
    middle = np.append(problem.start[0], (problem.start[1:] + problem.goal[1:]) / 2)
    slopes = problem.system.slopes(middle)
    size = float(slopes @ slopes)
    return float(slopes @ moves) / size if size > 1e-12 else 0.0


def _states(problem: Problem, mesh: Mesh, seed: Seed, s: Array) -> Array:
    travel = likely_travel(problem)
    q = through_waypoints(problem, mesh.knots, travel, s)
    q[:, 0] += max(1.0, abs(travel) / 2) * seed.path(s)
    q[:, 1] += seed.driven(s)
    limit = problem.limits.joint.copy()
    if problem.system.coordinates[1].unit == "rad":
        limit[1] = min(limit[1], LARGEST_GUESS_RAD)
    return np.clip(q, -limit, limit)


def through_waypoints(problem: Problem, knots: Array, travel: float, s: Array) -> Array:
    """Straight lines from start to goal by way of the waypoints, shape (S, N), at s (S,)."""
    goal = problem.goal.copy()
    goal[0] = problem.start[0] + travel
    known = np.array([problem.start, *(w.q for w in problem.waypoints), goal])
    return np.stack([_filled(s, knots, column) for column in known.T], axis=-1)


def _filled(s: Array, knots: Array, values: Array) -> Array:
    known = ~np.isnan(values)
    return np.interp(s, knots[known], values[known])


def _duration(problem: Problem, rates: Array) -> float:
    limit = np.where(np.isfinite(problem.limits.input), problem.limits.input, 1.0)
    return 1.5 * float(np.max(np.mean(np.abs(rates), axis=0) / limit)) + 0.01


def _away_from_zero(values: Array) -> Array:
    return np.where(np.abs(values) < 0.05, 0.05, values)


def _interpolate(where: Array, s: Array, values: Array) -> Array:
    return np.stack([np.interp(where, s, column) for column in values.T], axis=-1)


def _straight() -> Seed:
    return Seed("straight", np.zeros_like, lambda s: 0.1 * np.sin(np.pi * s))


def _bump(path: float, driven: float) -> Seed:
    return Seed(
        f"bump {_sign(path)}{_sign(driven)}",
        lambda s: path * np.sin(np.pi * s),
        lambda s: driven * np.maximum(0.0, np.sin(2 * np.pi * (s - 0.5))),
    )


def _reverse(path: float, driven: float) -> Seed:
    return Seed(
        f"reverse {_sign(path)}{_sign(driven)}",
        lambda s: 2 * path * s * np.sin(np.pi * s) ** 2,
        lambda s: driven * np.sin(np.pi * s),
    )


def _wander(number: int) -> Seed:
    terms = 3 + number % 4
    path, driven = np.random.default_rng(number).normal(size=(2, terms)) * 0.75

    def series(weights: Array) -> Excursion:
        k = np.arange(1, terms + 1)
        return lambda s: np.asarray(np.sin(np.pi * s[:, None] * k) @ weights)

    return Seed(f"wander {number}", series(path), series(driven))


def _sign(value: float) -> str:
    return "+" if value > 0 else "-"
