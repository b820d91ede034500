"""Choose the free numbers of laws: the travel, the offset of the first of two legs, the amplitude.

A free travel is scanned, and the best travel whose motion stays in the domain is refined. If there
is none, a law of legs goes out and back: its travel is zero, in two legs, and the offset is the
travel of the first. For sinusoids the amplitude of z₁ and the travel are chosen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.law import Ends
from planner.methods.laws.scores import (
    Criterion,
    Scores,
    end_margin,
    end_slack,
    score,
    search_candidates,
)
from planner.methods.refusal import BY_COLLOCATION
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.method_options import (
    LawOptions,
    LegOptions,
    SinusoidOptions,
    SinusoidStepsOptions,
    TravelOptions,
)
from planner.support.arrays import Array

Make = Callable[[float], ChainedTrajectory | None]

_OPEN_WINDOW = 3.0
"""Largest travel tried in either direction if no window is known, rad, for arms."""

_OPEN_RATIO = 10.0
"""The same for vehicles, in units of the distance between start and goal without the path
coordinate."""


@dataclass(frozen=True)
class Choice:
    """A chosen travel, and the ranges of travels from which it was chosen.

    Attributes:
        travel: The travel.
        ranges: Ranges (low, high) of travels for which the law stays inside the domain.
    """

    travel: float
    ranges: tuple[tuple[float, float], ...]


Options = TypeVar("Options", bound=LawOptions)

Law = Callable[[Problem, Options], Plan]


def one_way_or_back(plan: Law[Options]) -> Law[Options]:
    """A law of legs that goes out and back if its travel is free and it has no one-way path.

    Args:
        plan: The law. With a free travel it searches a one-way path; with travel zero it has two
            legs, out and back. It raises `SingularError` if the motion leaves the chart's domain.
    """

    @wraps(plan)
    def planned(problem: Problem, options: Options) -> Plan:
        if problem.travel is not None:
            return plan(problem, options)
        began, refusal = time.perf_counter(), None
        window = travel_window(problem)
        if window is None or not window.empty:
            try:
                return plan(problem, options)
            except SingularError as error:
                refusal = error
        try:
            back = plan(replace(problem, travel=0.0), options)
        except SingularError as error:
            failed = refusal or error
            failed.advise()  # do not advise another travel, since all have been tried
            raise failed from None
        return replace(back, problem=problem, solve_time_s=time.perf_counter() - began)

    return planned


_SCANS = (60, 600)
"""Numbers of travels to try; the second only if no travel of the first scan stays inside."""


def travel_of(problem: Problem, make: Make, options: TravelOptions) -> Choice:
    """The problem's travel if it is given, else one that stays inside the chart's domain.

    Args:
        problem: The problem, for the window of travels and for the limits, which scale peaks and
            are kept if any travel inside the domain keeps them.
        make: The law, as a function from travel to trajectory; None if it has no solution.
        options: The options, for the rule and the criterion.

    Raises:
        SingularError: If the law leaves the domain for every travel tried.
    """
    if problem.travel is not None:
        return Choice(problem.travel, ())
    for count in _SCANS:
        travels = candidate_travels(problem, count)
        good = score(problem, map(make, travels.tolist())).inside
        if good.any():
            break
    else:
        raise SingularError(
            f"{problem.source}: no travel between {travels[0]:.5g} and {travels[-1]:.5g}"
            f" {problem.system.coordinates[0].unit} keeps this method inside the domain of the"
            f" chained-form chart ({len(travels)} tried)",
            advice="other constraint points",
            changes=[BY_COLLOCATION],
        )
    ranges = _ranges(problem, travels, good, make)
    if options.travel == "middle":
        low, high = max(ranges, key=lambda r: r[1] - r[0])
        return Choice((low + high) / 2, ranges)
    return Choice(_best(problem, make, ranges, options.criterion), ranges)


def candidate_travels(problem: Problem, count: int) -> Array:
    """About `count` travels, increasing, over the window of one-way motions; none is zero.

    If no window is known, or it is empty, they lie on both sides of zero.
    """
    window = travel_window(problem)
    if window is None or window.empty:
        half = np.linspace(0, _open_window(problem), count // 2 + 1)[1:]
        return np.concatenate([-half[::-1], half])
    low, high = sorted((window.low, window.high), key=abs)
    if not np.isfinite(high):
        high = 5 * low
    inner = np.arange(1, count + 1) / (count + 1)
    return np.sort(low + (high - low) * inner)


def _open_window(problem: Problem) -> float:
    aside = [
        abs(problem.goal[i] - problem.start[i])
        for i, coordinate in enumerate(problem.system.coordinates)
        if i > 0 and coordinate.unit == problem.system.coordinates[0].unit != "rad"
    ]
    return _OPEN_RATIO * max(aside) if aside and max(aside) > 0 else _OPEN_WINDOW


def _ranges(
    problem: Problem, travels: Array, good: Array, make: Make
) -> tuple[tuple[float, float], ...]:
    padded = np.concatenate([[False], good, [False]])
    reverses = np.diff(np.sign(travels)) != 0  # a range must not contain zero
    starts = np.flatnonzero(padded[1:] & ~(padded[:-1] & ~np.array([False, *reverses, False])))
    ends = np.flatnonzero(padded[:-1] & ~(padded[1:] & ~np.array([False, *reverses, False]))) - 1
    out = []
    for a, b in zip(starts, ends, strict=True):
        low, high = travels[a], travels[b]
        if a > 0 and not good[a - 1]:
            low = _edge(problem, travels[a], travels[a - 1], make)
        if b < len(travels) - 1 and not good[b + 1]:
            high = _edge(problem, travels[b], travels[b + 1], make)
        out.append((float(low), float(high)))
    return tuple(out)


def _edge(problem: Problem, inner: float, outer: float, make: Make) -> float:
    """The travel at the edge of the domain, between one inside and one outside, by bisection."""
    for _ in range(28):
        middle = (inner + outer) / 2
        good = score(problem, [make(middle)]).inside[0]
        inner, outer = (middle, outer) if good else (inner, middle)
    return float(inner)


def _best(
    problem: Problem, make: Make, ranges: tuple[tuple[float, float], ...], criterion: Criterion
) -> float:
    from scipy.optimize import minimize_scalar  # slow to import

    ends = end_margin(problem), end_slack(problem)

    def scores(travels: Array) -> Scores:
        return score(problem, map(make, travels.tolist()))

    def cost(travel: float) -> float:
        return float(scores(np.array([travel])).cost(criterion, *ends)[0])

    best = (np.inf, ranges[0][0])
    for low, high in ranges:
        grid = np.linspace(low, high, 25)
        costs = scores(grid).cost(criterion, *ends)
        k = int(np.argmin(costs))
        bounds = (grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)])
        xatol = 1e-7 * (bounds[1] - bounds[0])
        found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": xatol})
        best = min(best, (float(found.fun), float(found.x)), (float(costs[k]), float(grid[k])))
    return best[1]


_OFFSETS = np.geomspace(0.01, 1.0, 20)
"""Offsets to scan, with both signs, relative to the largest travel tried without a window."""


def choose_offset(
    ends: Ends, options: LegOptions, name: str, make: Make
) -> tuple[float, dict[str, Any]]:
    """Travel of the first of the two legs of step 4: given, the paper's mean of z(0), or the best.

    The paper writes offset = Σzᵢ/n; z has n+1 coordinates, so we divide by n+1. The sum adds metres
    to angles and slopes, so this value has no special meaning; "auto" tries it among others.

    Args:
        ends: Start and goal.
        options: The options, for the rule and for the criterion of "auto".
        name: Name of the method.
        make: The law, as a function from offset to trajectory.

    Returns:
        The offset, and notes for the plan; (0, none) if one leg is enough.

    Raises:
        InputError: If it is zero.
    """
    if ends.problem.travel != 0:
        return 0.0, {}
    mean = float(np.mean(ends.start))
    if options.offset != "auto":
        offset = mean if options.offset == "mean" else options.offset
        if offset == 0:
            unit = ends.problem.system.coordinates[0].unit
            raise InputError(
                f"{ends.problem.source}: a motion in two legs needs an offset that is not zero; set"
                f' method.{name}.offset ({unit}) to another number or to "auto"'
            )
        return offset, {"offset": offset}

    def attempt(x: Array) -> ChainedTrajectory | None:
        return make(float(x[0])) if x[0] != 0 else None

    sizes = _OFFSETS * _open_window(ends.problem)
    grid = np.concatenate([-sizes, sizes, [mean]])[:, None]
    found = search_candidates(
        ends.problem, attempt, grid, 0.2 * np.abs(grid), options.criterion, starts=3
    )
    notes = {"auto_motions_tried": found.tried, "auto_found_inside": found.inside}
    return float(found.x[0]), {"offset": float(found.x[0]), **notes}


_SIZES = np.geomspace(0.02, 4.0, 12)
"""Amplitudes to scan, with both signs, relative to the size of the travel (or to 1 if it is 0)."""

_TRAVELS = 24
"""Number of travels to scan if the travel is free, each with all amplitudes."""


def choose_swing(
    problem: Problem,
    make: Callable[[float, float], ChainedTrajectory],
    options: SinusoidOptions | SinusoidStepsOptions,
) -> tuple[float, float, dict[str, Any]]:
    """Travel and amplitude: as given, or the best by the criterion if free.

    The amplitude is a₁/ω or α/ω, in the unit of z₁; if steps have their own amplitudes, it is a
    common factor. If no choice stays inside the domain, the one that leaves it least is returned.

    Returns:
        Travel, amplitude, and notes for the plan.
    """
    given: float | None = None
    if options.amplitude != "auto":
        given = 1.0 if isinstance(options.amplitude, list) else float(options.amplitude)
    if problem.travel is not None and given is not None:
        return problem.travel, given, {}

    def read(x: Array) -> tuple[float, float]:
        rest = iter(x.tolist())
        travel = next(rest) if problem.travel is None else problem.travel
        return travel, next(rest) if given is None else given

    def attempt(x: Array) -> ChainedTrajectory | None:
        travel, amplitude = read(x)
        return make(travel, amplitude) if amplitude != 0 else None

    found, tried = None, 0
    for travels in _swing_travels(problem):
        grid, sizes = _grid(problem, travels, given)
        other = search_candidates(problem, attempt, grid, sizes, options.criterion, starts=3)
        tried += other.tried
        if found is None or other.cost < found.cost:
            found = other
        if found.inside:
            break
    assert found is not None
    notes = {"auto_motions_tried": tried, "auto_found_inside": found.inside}
    return *read(found.x), notes


def _swing_travels(problem: Problem) -> Iterator[Array]:
    """The given travel, or the travels to scan; then more if no motion is found with these.

    A sinusoid reverses within its period, so the window of one-way motions is a good first guess
    but not a limit.
    """
    if problem.travel is not None:
        yield np.array([problem.travel])
        return
    window = travel_window(problem)
    if window is not None and not window.empty:
        yield candidate_travels(problem, _TRAVELS)
    widest = _open_window(problem)
    yield np.linspace(-widest, widest, _TRAVELS + 1)


def _grid(problem: Problem, travels: Array, given: float | None) -> tuple[Array, Array]:
    """Candidates (C, d), and the size of the first step from each."""
    width = np.ptp(travels) / len(travels)
    rows, steps = [], []
    for travel in travels:
        sizes = _SIZES * (abs(travel) or 1.0)
        amplitudes = np.concatenate([-sizes, sizes]) if given is None else np.array([given])
        for amplitude in amplitudes:
            row = [travel] if problem.travel is None else []
            step = [width] if problem.travel is None else []
            rows.append(row + ([amplitude] if given is None else []))
            steps.append(step + ([0.3 * amplitude] if given is None else []))
    return np.array(rows), np.array(steps)
