"""Choose the free numbers of laws: the travel, the offset of the first of two legs, the amplitude.

A free travel (change of q₁) is scanned, and the best travel whose motion stays in the chart's
domain is refined. If no such travel exists, a law of legs goes out and back: the travel is zero,
and the offset is the travel of the first of the two legs. For sinusoids the amplitude of z₁ and the
travel are chosen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.law import Ends, Motion
from planner.methods.laws.scores import (
    BestCandidate,
    Curves,
    Make,
    score_candidates,
    search_candidates,
)
from planner.methods.refusal import BY_COLLOCATION
from planner.plan.plan import Plan
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

Ranges = list[list[float]]
"""Ranges [low, high] of travels for which a law's motion stays inside the chart's domain."""

_OPEN_WINDOW = 3.0
"""Largest travel of an arm tried in either direction if no window of travels is known, rad."""

_OPEN_RATIO = 10.0
"""Largest travel of a vehicle tried in either direction, as a multiple of the largest move from
start to goal of any other coordinate that is a length."""

Options = TypeVar("Options", bound=LawOptions)

Law = Callable[[Problem, Options], Plan]


def one_way_or_back(plan: Law[Options]) -> Law[Options]:
    """Wrap a law of legs so that it goes out and back if no one-way path exists for a free travel.

    Args:
        plan: The law. With a free travel the law searches a one-way path; with travel zero it
            goes out and back in two legs. It raises `SingularError` outside the chart's domain.
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
            there = problem.user_goal.copy()
            there[[i for i, j in problem.system.shared.items() if j == 0]] = problem.start[0]
            back = plan(replace(problem, user_goal=there), options)
        except SingularError as error:
            failed = refusal or error
            failed.advise()  # do not advise another travel, since all have been tried
            raise failed from None
        return replace(back, problem=problem, solve_time_s=time.perf_counter() - began)

    return planned


_SCANS = (60, 600)
"""Numbers of travels in the first scan, and in a second if no travel of the first stays inside."""


def travel_of(
    problem: Problem, law: Callable[[Array], Motion], options: TravelOptions
) -> tuple[float, Ranges]:
    """Return the problem's travel if given, else a travel that stays inside the chart's domain.

    Args:
        problem: Supplies the travel if given, the window of travels to scan, and the limits. The
            limits scale the peak inputs, and are kept if some travel inside the domain keeps them.
        law: Maps travels (C,) to their motions.
        options: Say whether to take the middle of the widest range of travels, or the best travel
            by a criterion.

    Returns:
        The travel, and the ranges from which it was chosen (none for a given travel).

    Raises:
        SingularError: If the law leaves the domain for every travel tried.
    """
    if problem.travel is not None:
        return problem.travel, []

    make = _curves_of(law)

    def inside(travels: Array) -> Array:
        return score_candidates(problem, make, travels.reshape(-1, 1)).inside.reshape(travels.shape)

    for count in _SCANS:
        travels = candidate_travels(problem, count)
        good = inside(travels)
        if good.any():
            break
    else:
        raise SingularError(
            f"no travel between {travels[0]:.5g} and {travels[-1]:.5g}"
            f" {problem.system.coordinates[0].unit} keeps this method inside the domain of the"
            f" chained-form chart ({len(travels)} tried)",
            source=problem.source,
            advice="other constraint points",
            changes=[BY_COLLOCATION],
        )
    ranges = _ranges(travels, good, inside)
    if options.travel == "middle":
        return float(np.mean(max(ranges, key=lambda r: r[1] - r[0]))), ranges
    grids = [np.linspace(low, high, 25) for low, high in ranges]
    steps = [np.full(25, np.ptp(grid) / 25) for grid in grids]
    grid, step = np.concatenate(grids)[:, None], np.concatenate(steps)[:, None]
    return float(search_candidates(problem, make, grid, step, options.criterion).x[0]), ranges


def _curves_of(law: Callable[[Array], Motion]) -> Make:
    """Turn a law of one free number into a function from x (C, 1) to curves, as searches need."""
    return lambda x: law(x[:, 0]).curves


def candidate_travels(problem: Problem, count: int) -> Array:
    """Return about `count` travels, increasing and not zero, over the window of one-way motions.

    If the window is unknown or empty, the travels lie on both sides of zero.
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


def _ranges(travels: Array, good: Array, inside: Callable[[Array], Array]) -> Ranges:
    reverses = np.concatenate([[False], np.diff(np.sign(travels)) != 0, [False]])
    padded = np.concatenate([[False], good, [False]])  # a range does not reach across travel zero
    starts = np.flatnonzero(padded[1:] & ~(padded[:-1] & ~reverses))
    ends = np.flatnonzero(padded[:-1] & ~(padded[1:] & ~reverses)) - 1
    outer = np.concatenate([np.maximum(starts - 1, 0), np.minimum(ends + 1, len(travels) - 1)])
    inner = np.concatenate([starts, ends])
    edge, beyond = travels[inner], np.where(good[outer], travels[inner], travels[outer])
    for _ in range(8):  # the last travel inside, in a quarter of the way at a time
        nodes = edge[:, None] + (beyond - edge)[:, None] * np.arange(5) / 4
        first = np.argmin(np.pad(inside(nodes[:, 1:4]), ((0, 0), (0, 1))), axis=1)
        rows = np.arange(len(nodes))
        edge, beyond = nodes[rows, first], nodes[rows, first + 1]
    return edge.reshape(2, -1).T.tolist()  # type: ignore[no-any-return]


_OFFSETS = np.geomspace(0.01, 4.0, 26)
"""Offsets to scan with both signs, as multiples of `_open_window`."""


def given_reach(ends: Ends, options: LegOptions, name: str) -> float | None:
    """Return the given travel, or for travel zero the given offset; None if still to be chosen.

    The offset is the travel of the first of two legs (step 4 of the paper). The paper writes
    offset = Σzᵢ/n; z has n+1 coordinates, so this program divides by n+1. The sum adds metres to
    angles and slopes, so the value has no special meaning; "auto" tries it among others.

    Args:
        ends: Start and goal.
        options: Supply the offset, or the rule for the offset.
        name: Name of the method, for the error.

    Raises:
        InputError: If the offset is zero.
    """
    if ends.problem.travel != 0:
        return ends.problem.travel
    if options.offset == "auto":
        return None
    offset = float(np.mean(ends.start)) if options.offset == "mean" else options.offset
    if offset == 0:
        unit = ends.problem.system.coordinates[0].unit
        raise InputError(
            f"a motion in two legs needs an offset that is not zero; set"
            f' method.{name}.offset ({unit}) to another number or to "auto"',
            source=ends.problem.source,
        )
    return offset


def candidate_reaches(ends: Ends, count: int) -> tuple[Array, Array]:
    """Return travels (offsets if the travel is zero) to scan, and first steps from each, (C,)."""
    if ends.problem.travel is None:
        travels = candidate_travels(ends.problem, count)
        return travels, np.full(len(travels), np.ptp(travels) / len(travels))
    sizes = _OFFSETS * _open_window(ends.problem)
    offsets = np.concatenate([-sizes, sizes, [np.mean(ends.start)]])
    return offsets, 0.2 * np.abs(offsets)


def choose_reach(
    ends: Ends, options: LegOptions, name: str, law: Callable[[Array], Motion]
) -> tuple[float, dict[str, Any]]:
    """Return the travel (the offset if the travel is zero), given or best, and notes for the plan.

    Args:
        ends, options, name: See `given_reach`.
        law: Maps travels or offsets (C,) to their motions.

    Raises:
        InputError: If the given offset is zero.
        SingularError: If the travel is free and the law leaves the domain for every travel tried.
    """
    ranges: Ranges = []
    reach, notes = given_reach(ends, options, name), {}
    if ends.problem.travel is None:
        reach, ranges = travel_of(ends.problem, law, options)
    elif reach is None:
        offsets, steps = (a[:, None] for a in candidate_reaches(ends, 0))
        best = search_candidates(ends.problem, _curves_of(law), offsets, steps, options.criterion)
        reach, notes = float(best.x[0]), best.notes
    turn = {"offset": reach} if ends.problem.travel == 0 else {}
    return reach, {**turn, **notes, "travel_ranges_in_domain": ranges}


_SIZES = np.geomspace(0.02, 4.0, 12)
"""Amplitudes to scan with both signs, as multiples of |travel|, or of 1 for travel zero."""

_TRAVELS = 24
"""Number of travels to scan, each with all amplitudes, if the travel is free."""


def choose_swing(
    problem: Problem,
    law: Callable[[Array, Array], Motion],
    options: SinusoidOptions | SinusoidStepsOptions,
) -> tuple[float, float, dict[str, Any]]:
    """Return travel and amplitude of a sinusoid: as given, or the best by the criterion if free.

    The amplitude is a₁/ω or α/ω, in the unit of z₁; if the options give one amplitude for each
    period, the result is a common factor on all. If every choice leaves the domain, the choice that
    leaves it least is returned.

    Args:
        problem: Supplies travel and limits.
        law: Maps travels (C,) and amplitudes (C,) to their motions.
        options: Supply the amplitude and the criterion.

    Returns:
        Travel, amplitude, and notes for the plan.
    """
    given: float | None = None
    if options.amplitude != "auto":
        given = 1.0 if isinstance(options.amplitude, list) else float(options.amplitude)
    if problem.travel is not None and given is not None:
        return problem.travel, given, {}
    free = [problem.travel is None, given is None]

    def numbers(x: Array) -> Array:
        """Return travels and amplitudes, (2, C), from the free numbers x (C, d)."""
        out = np.tile([[problem.travel or 0.0], [given or 0.0]], len(x))
        out[free] = x.T
        return out

    def make(x: Array) -> Curves:
        return law(*numbers(x)).curves

    best: BestCandidate | None = None
    count = 0
    for travels in _swing_travels(problem):
        grid, steps = (a[:, free] for a in _swings(travels, given))
        other = search_candidates(problem, make, grid, steps, options.criterion)
        count += other.tried
        if best is None or other.cost < best.cost:
            best = other
        if best.inside:
            break
    assert best is not None
    travel, amplitude = numbers(best.x[None])[:, 0].tolist()
    return travel, amplitude, {**best.notes, "auto_motions_tried": count}


def _swing_travels(problem: Problem) -> Iterator[Array]:
    """Yield the given travel, or travels to scan and then a wider set for the case that these fail.

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


def _swings(travels: Array, given: float | None) -> tuple[Array, Array]:
    """Return candidates (C, 2) for travel and amplitude, and the first step (C, 2) of a search from
    each."""
    sizes = _SIZES * np.where(travels == 0, 1.0, np.abs(travels))[:, None]
    amplitudes = np.concatenate([-sizes, sizes], axis=1)
    if given is not None:
        amplitudes = np.full((len(travels), 1), given)
    every = np.broadcast_to(travels[:, None], amplitudes.shape)
    width = np.full(amplitudes.shape, np.ptp(travels) / len(travels))
    candidates, steps = ((every, amplitudes), (width, 0.3 * np.abs(amplitudes)))
    return np.stack(candidates, -1).reshape(-1, 2), np.stack(steps, -1).reshape(-1, 2)
