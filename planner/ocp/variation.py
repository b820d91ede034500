"""Variations of a motion, as first guesses for a better one: a stretch bulges, or is cut short.

A good path lies near other good ones. The guesses do not obey the kinematics: the solver sees to
that (cf. iterated local search: Lourenco, Martin, Stuetzle, Handbook of Metaheuristics, 2003).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.ocp.guess import LARGEST_GUESS_RAD, Seed
from planner.problem import Problem
from planner.systems.base import Array

Path = Callable[[Array], Array]
"""From fractions of the time s (S,) to coordinates (S, N)."""

CUT = 0.4
"""Share of variations that cut a stretch short."""

BULGE = (0.1, 0.8)
"""Least and greatest bulge, of half the range that its coordinate has on the path."""

SHORTEST, LONGEST_CUT = 0.05, 0.35
"""Of the whole time, stretches that are cut short."""


def variation(
    name: str, problem: Problem, path: Path, size: float, rng: np.random.Generator
) -> Seed:
    """A seed along a path changed at random, by more the greater the size (about 1)."""
    if rng.random() < CUT:
        return Seed(name, np.zeros_like, np.zeros_like, _cut(path, size, rng))
    return Seed(name, np.zeros_like, np.zeros_like, _bulging(problem, path, size, rng))


def _bulging(problem: Problem, path: Path, size: float, rng: np.random.Generator) -> Path:
    """Both driven coordinates make an excursion of up to three half waves in the same stretch."""
    a, b = np.sort(rng.uniform(-0.2, 1.2, 2))
    width = max(b - a, 0.15)
    heights = (
        np.exp(rng.uniform(np.log(BULGE[0]), np.log(BULGE[1]), 2))
        * rng.choice([-1.0, 1.0], 2)
        * size
    )
    waves = rng.integers(1, 4, 2)
    limit = problem.limits.joint[1]
    if problem.system.coordinates[1].unit == "rad":
        limit = min(limit, LARGEST_GUESS_RAD)

    def states(s: Array) -> Array:
        q = path(s).copy()
        angle = np.pi * np.clip((s - a) / width, 0.0, 1.0)
        held = np.minimum(1.0, 10 * np.minimum(s, 1.0 - s))  # the ends stay where they are
        for j in (0, 1):
            q[:, j] += heights[j] * np.ptp(q[:, j]) / 2 * np.sin(waves[j] * angle) * held
        q[1:-1, 1] = np.clip(q[1:-1, 1], -limit, limit)
        return q

    return states


def _cut(path: Path, size: float, rng: np.random.Generator) -> Path:
    """A straight line in place of a stretch, in half its time."""
    width = rng.uniform(SHORTEST, min(0.8, size * LONGEST_CUT))
    a = rng.uniform(0.0, 1.0 - width)
    b = a + width
    left = 1.0 - width / 2

    def states(s: Array) -> Array:
        before = np.interp(s, [0.0, a / left, (a + width / 2) / left, 1.0], [0.0, a, b, 1.0])
        share = np.clip((before - a) / width, 0.0, 1.0)[:, None]
        first, last = path(np.array([a, b]))
        inside = (before > a) & (before < b)
        return np.where(inside[:, None], first + share * (last - first), path(before))

    return states
