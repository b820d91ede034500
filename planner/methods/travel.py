"""The choice of travel for laws that leave it free: scan, keep what stays in the domain, refine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from planner.errors import InfeasibleError, SingularError
from planner.extrema import sample_times
from planner.methods.chart import WAY_OUT, inside
from planner.problem import Problem
from planner.reachability import travel_window
from planner.systems.base import Array
from planner.trajectory import Trajectory

Make = Callable[[float], Trajectory]


@dataclass(frozen=True)
class Choice:
    """A travel chosen, and the ranges of travels it was chosen from.

    Attributes:
        travel: The travel.
        ranges: Ranges (low, high) of travels for which the law stays inside the domain.
    """

    travel: float
    ranges: tuple[tuple[float, float], ...]


def choose_travel(problem: Problem, make: Make, rule: str, scan: int = 241) -> Choice:
    """Choose a travel for which `make(travel)` stays inside the chart's domain.

    Args:
        problem: Supplies the window of travels and the input limits that scale the peaks.
        make: The law, from travel to trajectory.
        rule: "auto" for the least peak input (scaled by the limits where there are any), "middle"
            for the middle of the widest range.
        scan: Number of travels tried before refinement.

    Raises:
        InfeasibleError: If no one-way motion exists at all.
        SingularError: If the law leaves the domain for every travel tried.
    """
    travels = _candidates(problem, scan)
    good = np.array([_is_inside(make(d)) for d in travels])
    if not good.any():
        raise SingularError(
            f"{problem.source}: no travel between {travels[0]:.5g} and {travels[-1]:.5g} rad keeps"
            f" this law inside the domain of the chained-form chart ({scan} tried)",
            advice=f"other constraint points; or {WAY_OUT}",
        )
    ranges = _ranges(travels, good, make)
    if rule == "middle":
        low, high = max(ranges, key=lambda r: r[1] - r[0])
        return Choice((low + high) / 2, ranges)
    return Choice(_least_peak(problem, make, ranges), ranges)


def _candidates(problem: Problem, count: int) -> Array:
    window = travel_window(problem)
    if window is None:
        return np.linspace(-3.0, 3.0, count)
    if window.empty:
        raise InfeasibleError(
            f"{problem.source}: no one-way motion exists: {window.reason}",
            advice=f"goal.travel = 0 (two legs, out and back); or {WAY_OUT}",
        )
    low, high = sorted((window.low, window.high), key=abs)
    if not np.isfinite(high):
        high = 5 * low
    inner = np.arange(1, count + 1) / (count + 1)
    return np.sort(low + (high - low) * inner)


def _is_inside(trajectory: Trajectory) -> bool:
    return inside(trajectory, sample_times(trajectory.breaks, 400))


def _ranges(travels: Array, good: Array, make: Make) -> tuple[tuple[float, float], ...]:
    padded = np.concatenate([[False], good, [False]])
    starts = np.flatnonzero(padded[1:] & ~padded[:-1])
    ends = np.flatnonzero(padded[:-1] & ~padded[1:]) - 1
    out = []
    for a, b in zip(starts, ends, strict=True):
        low = travels[a] if a == 0 else _edge(travels[a], travels[a - 1], make)
        high = travels[b] if b == len(travels) - 1 else _edge(travels[b], travels[b + 1], make)
        out.append((float(low), float(high)))
    return tuple(out)


def _edge(inner: float, outer: float, make: Make) -> float:
    """The last travel inside the domain between one inside and one outside, by bisection."""
    for _ in range(40):
        middle = (inner + outer) / 2
        inner, outer = (middle, outer) if _is_inside(make(middle)) else (inner, middle)
    return float(inner)


def _least_peak(problem: Problem, make: Make, ranges: tuple[tuple[float, float], ...]) -> float:
    scale = np.where(np.isfinite(problem.limits.input), problem.limits.input, 1.0)

    def peak(travel: float) -> float:
        trajectory = make(float(travel))
        times = sample_times(trajectory.breaks, 400)
        if not inside(trajectory, times):
            return np.inf
        return float(np.max(np.abs(trajectory.u(times)) / scale))

    best = (np.inf, ranges[0][0])
    for low, high in ranges:
        grid = np.linspace(low, high, 25)
        k = int(np.argmin([peak(d) for d in grid]))
        bounds = (grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)])
        found = minimize_scalar(peak, bounds=bounds, method="bounded", options={"xatol": 1e-9})
        for travel in (float(found.x), float(grid[k])):
            best = min(best, (peak(travel), travel))
    return best[1]
