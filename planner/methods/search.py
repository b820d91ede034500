"""The choice of a law's free numbers: a scan, then Nelder–Mead from the best of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from planner.methods.score import Criterion, end_margin, score
from planner.problem import Problem
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory

Make = Callable[[Array], ChainedTrajectory | None]

_CHUNK = 128
_RESTARTS = 6
_COARSE, _FINE = 200, 6000
"""Samples of a candidate while searching, and of the one found."""


@dataclass(frozen=True)
class Found:
    """The best candidate of a search.

    Attributes:
        x: Its free numbers, shape (d,).
        cost: See `Scores.cost`; below 1 when domain and limits are kept.
        tried: Number of candidates made.
    """

    x: Array
    cost: float
    tried: int

    @property
    def inside(self) -> bool:
        """Whether it stays inside the chart's domain."""
        return self.cost < 2


def search(
    problem: Problem,
    make: Make,
    grid: Array,
    steps: Array,
    criterion: Criterion = "peak",
    starts: int = 2,
) -> Found:
    """Find the free numbers of least cost.

    Args:
        problem: Supplies limits and the chart's branch.
        make: From free numbers (d,) to a trajectory; None where the law has no solution.
        grid: Candidates to scan, shape (C, d).
        steps: Size of the first simplex, shape (d,) or (C, d).
        criterion: What to make best; domain and limits come first.
        starts: How many of the best candidates to refine; 0 to scan only.
    """
    best_margin = end_margin(problem)
    tried = 0

    def costs(points: Array, samples: int) -> Array:
        nonlocal tried
        tried += len(points)
        return score(problem, [make(x) for x in points], samples).cost(criterion, best_margin)

    def refine(x: Array, step: Array, samples: int) -> tuple[float, Array]:
        result = minimize(
            lambda p: float(costs(p[None], samples)[0]),
            x,
            method="Nelder-Mead",
            options={
                "initial_simplex": np.concatenate([x[None], x + np.diag(step)]),
                "xatol": 1e-6 * float(np.max(np.abs(step))),
                "fatol": 1e-8,
                "maxfev": 80 * len(x),
            },
        )
        return float(result.fun), np.asarray(result.x)

    chunks = [grid[k : k + _CHUNK] for k in range(0, len(grid), _CHUNK)]
    scanned = np.concatenate([costs(chunk, _COARSE) for chunk in chunks])
    steps = np.broadcast_to(steps, grid.shape)
    order = np.argsort(scanned, kind="stable")
    best, x, step = float(scanned[order[0]]), grid[order[0]], steps[order[0]]
    for k in order[:starts]:
        cost, there = refine(grid[k], steps[k], _COARSE)
        if cost < best:
            best, x, step = cost, there, steps[k]
    for _ in range(_RESTARTS if starts else 0):  # a fresh simplex frees one collapsed on a kink
        cost, there = refine(x, 0.1 * step, _COARSE)
        gain = best - cost
        if gain > 0:
            best, x = cost, there
        if gain < 1e-4 * best:
            break
    true = float(costs(x[None], _FINE)[0])
    if starts and true > best + 1e-3:  # it hid an excursion between samples
        true, x = refine(x, 0.1 * step, _FINE)
    return Found(x, true, tried)
