"""Choose a law's free numbers: a scan, then Nelder–Mead from the best candidates.

Scores rate trajectories in the chart, many candidates at once: their samples need few calls of the
chart, which makes scans cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from planner.errors import SingularError
from planner.plan.measures import worst_margin
from planner.plan.trajectory import ChainedTrajectory
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import MotionPoint
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, basis
from planner.support.calculus.chebyshev import points
from planner.systems.chained_form import chained_form

_CLOSE = 0.1
"""A motion is too close to the domain's edge if its margin is less than this fraction of the ends'.
There θ₁ bounces off zero and the inputs are quotients of small numbers."""

SLACK = 1e-6
"""Relative slack to a limit that a choice leaves if the ends do. With less, the certificate's
enclosures cannot distinguish a coordinate at its limit from one beyond it."""

ROUNDING = 1e-9
"""Missing slack that counts as rounding."""

Criterion = Literal["peak", "margin"]


@dataclass(frozen=True)
class Scores:
    """Scores of C candidates from samples; arrays of shape (C,).

    Attributes:
        margin: Least chart margin (dimensionless, negative outside the domain).
        slack: Least slack to the problem's limits on coordinates, relative to each; infinite where
            the problem has none, negative where one is broken, NaN outside the domain.
        peak: Largest input, relative to its limit if it has one; NaN outside the domain.
    """

    margin: Array
    slack: Array
    peak: Array

    @property
    def inside(self) -> Array:
        """Whether all samples lie inside the domain."""
        return np.asarray(self.margin > 0)

    def cost(self, criterion: Criterion, ends: float, slack: float = 0.0) -> Array:
        """One number to minimise, shape (C,), in three ranges.

        Below 1: keeps limits and a distance from the domain's edge; 1 to 2: breaks a limit or comes
        ten times closer to the edge than the ends; 2 to 3: leaves the domain.

        Args:
            criterion: "peak" compares peak inputs; "margin" compares margins, and peak inputs among
                those that reach the ends' margin, which no path can exceed.
            ends: The least margin of start and goal; see `end_margin`.
            slack: The slack that keeps a limit; see `end_slack`.
        """
        with np.errstate(invalid="ignore"):
            outside = 2 + _bound(-self.margin)
            close = 1 - self.margin / (_CLOSE * ends)
            broken = 1 + _bound(np.maximum(close, slack - self.slack))
            kept = _bound(self.peak)
            if criterion == "margin":
                short = self.margin < ends * (1 - 1e-6)
                kept = np.where(short, 1 - 0.5 * self.margin / ends, 0.5 * kept)
            cost = np.where((self.slack < slack - ROUNDING) | (close > 0), broken, kept)
            cost = np.where(self.margin > 0, cost, outside)
        return np.where(np.isnan(cost), 3.0, cost)


MOST_SAMPLES = 20_000
"""Samples in one call of the chart: half a second with eight joints, between checks of the time."""


def score(
    problem: Problem, candidates: Iterable[ChainedTrajectory | None], samples: int = 400
) -> Scores:
    """Score candidates of one law by about `samples` samples each.

    Args:
        problem: The problem, for its limits; the peak of an input without a limit is in its unit.
        candidates: Trajectories with equal numbers of pieces; None for one without a solution.
            They are computed one by one, so that the time can be checked in between.

    Raises:
        TimeUpError: If time is up.
    """
    parts: list[Scores] = []
    together: list[ChainedTrajectory | None] = []
    count = 0
    deadline.check()
    for candidate in candidates:
        deadline.check()
        together.append(candidate)
        if candidate is not None:
            count += len(candidate.z_curve.x[1:]) * _count(samples, candidate.z_curve)
        if count >= MOST_SAMPLES:
            parts.append(_score_one(problem, together, samples))
            together, count = [], 0
    parts.append(_score_one(problem, together, samples))
    joined = (np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Scores))
    return Scores(*joined)


def _score_one(
    problem: Problem, candidates: Sequence[ChainedTrajectory | None], samples: int
) -> Scores:
    """Scores of candidates whose samples are mapped in one call of the chart."""
    out = np.full((3, len(candidates)), np.nan)
    made = [k for k, c in enumerate(candidates) if c is not None]
    if not made:
        return Scores(*out)
    chosen = [c for c in candidates if c is not None]
    form, branch = chained_form(problem.system), chosen[0].branch
    z = _sample([c.z_curve for c in chosen], samples)
    pieces = z.shape[1] // _count(samples, chosen[0].z_curve)
    worst = worst_margin(form.margins(z, branch)).reshape(len(chosen), pieces, -1)
    margin = np.minimum(np.min(worst, axis=(1, 2)), _dips(worst))
    out[0, made] = margin
    good = np.flatnonzero(margin > 0)
    if good.size:
        v = _sample([chosen[k].v_curve for k in good], samples)
        q, u = form.both(z[good], v, branch)
        at = np.asarray(made)[good]
        out[1, at] = _slack(problem, z[good], q, pieces)
        peaks = np.max(np.abs(u), axis=1)
        out[2, at] = np.max(peaks / problem.limits.input_scale, axis=-1)
    return Scores(*out)


def _sample(curves: Sequence[Bernstein], samples: int) -> Array:
    """Values (C, S, D) of curves with the same pieces, denser towards each piece's ends.

    The ends belong to both neighbours, each with its own one-sided value.
    """
    c = np.stack([curve.c for curve in curves])
    weights = _weights(c.shape[1] - 1, _count(samples, curves[0]))
    values = weights @ np.moveaxis(c, 1, 2)  # (C, P, D+1, N) → (C, P, S, N)
    return np.asarray(values.reshape(len(c), -1, c.shape[-1]))


def _count(samples: int, curve: Bernstein) -> int:
    """Samples of each piece."""
    return max(9, samples // len(curve.x[1:]))


def _dips(values: Array) -> Array:
    """Least value (C,) of values (C, P, S), also between their samples.

    A dip can be narrower than the distance of samples, so a parabola through the three samples
    around each local minimum is used, except beside a margin of −∞.
    """
    step = _steps(values.shape[-1])
    before, after, width = step[:-1], step[1:], step[:-1] + step[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.diff(values, axis=-1) / step
        bend = (slope[..., 1:] - slope[..., :-1]) / width
        tangent = (slope[..., :-1] * after + slope[..., 1:] * before) / width
        lowest = values[..., 1:-1] - tangent**2 / (4 * bend)
    is_dip = (slope[..., :-1] <= 0) & (slope[..., 1:] >= 0) & (bend > 0)
    return np.asarray(np.min(np.where(is_dip, lowest, np.inf), axis=(1, 2)))


@lru_cache(maxsize=64)
def _steps(count: int) -> Array:
    """Distances between successive samples of a piece, (count−1,), relative to the piece."""
    return np.diff(points(count))


@lru_cache(maxsize=64)
def _weights(degree: int, count: int) -> Array:
    """Bernstein polynomials (count, degree+1) at Chebyshev–Lobatto points of the unit interval."""
    return np.ascontiguousarray(basis(degree, points(count)).T)


def end_margin(problem: Problem) -> float:
    """Least chart margin of start and goal: no path between them has a larger one."""
    ends = np.stack([problem.start, np.nan_to_num(problem.goal)])
    return float(np.min(problem.system.chart_margins(ends, problem.branch)))


def end_slack(problem: Problem) -> float:
    """The slack to limits that a choice leaves: that of start and goal, at most `SLACK`."""
    ends = np.stack([problem.start, np.nan_to_num(problem.goal)])
    z = chained_form(problem.system).z(ends)
    return float(np.clip(np.min(list(_rooms(problem, z, ends)), initial=SLACK), 0.0, SLACK))


def _slack(problem: Problem, z: Array, q: Array, pieces: int) -> Array:
    """Least relative slack (C,) to limits along motions z, q of shape (C, S, N)."""
    slack = np.full(len(q), np.inf)
    for room in _rooms(problem, z, q):
        slack = np.minimum(slack, np.min(room, axis=1))
        slack = np.minimum(slack, _dips(room.reshape(len(q), pieces, -1)))
    return slack


def _rooms(problem: Problem, z: Array, q: Array) -> Iterator[Array]:
    """Slack (…) to each limit on coordinates, relative to it, at z and q (…, N)."""
    at = replace(MotionPoint.of(problem.system, q), z=np.moveaxis(z, -1, 0))
    for required in problem.requirements:
        if required.reads == {"q"} and required.smooth:
            for part, value in zip(required.parts, required.values(at), strict=True):
                if part.low == -part.high:
                    yield 1 - np.abs(value) / part.high
                else:
                    yield np.minimum(part.high - value, value - part.low) / part.scale


def _bound(x: Array) -> Array:
    """Increasing map of [0, ∞] onto [0, 1]."""
    return np.where(np.isinf(x), 1.0, x / (1 + np.abs(x)))


Make = Callable[[Array], ChainedTrajectory | None]

_RESTARTS = 6
_COARSE, _FINE = 200, 6000
"""Samples of a candidate during the search, and of the final one."""


@dataclass(frozen=True)
class BestCandidate:
    """The best candidate of a search.

    Attributes:
        x: Its free numbers, shape (d,).
        cost: See `Scores.cost`; below 1 when domain and limits are kept.
        tried: Number of candidates tried.
    """

    x: Array
    cost: float
    tried: int

    @property
    def inside(self) -> bool:
        """Whether it stays inside the chart's domain."""
        return self.cost < 2


def _attempt(make: Make, x: Array) -> ChainedTrajectory | None:
    try:
        return make(x)
    except SingularError:
        return None


def search_candidates(
    problem: Problem,
    make: Make,
    grid: Array,
    steps: Array,
    criterion: Criterion = "peak",
    starts: int = 2,
) -> BestCandidate:
    """Find the free numbers of least cost.

    Args:
        problem: The problem, for limits and the chart's branch.
        make: Function from free numbers (d,) to a trajectory; it returns None or raises a
            `SingularError` if the law has no solution.
        grid: Candidates to scan, shape (C, d).
        steps: Size of the first simplex, shape (d,) or (C, d).
        criterion: The quantity to optimise; domain and limits come first.
        starts: Number of the best candidates to refine; 0 to scan only.
    """
    from scipy.optimize import minimize  # slow to import

    ends = end_margin(problem), end_slack(problem)
    tried = 0

    def costs(points: Array, samples: int) -> Array:
        nonlocal tried
        tried += len(points)
        return score(problem, map(partial(_attempt, make), points), samples).cost(criterion, *ends)

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

    scanned = costs(grid, _COARSE)
    steps = np.broadcast_to(steps, grid.shape)
    order = np.argsort(scanned, kind="stable")
    best, x, step = float(scanned[order[0]]), grid[order[0]], steps[order[0]]
    for k in order[:starts]:
        cost, there = refine(grid[k], steps[k], _COARSE)
        if cost < best:
            best, x, step = cost, there, steps[k]
    for _ in range(_RESTARTS if starts else 0):  # restart, since a simplex may collapse at a kink
        cost, there = refine(x, 0.1 * step, _COARSE)
        gain = best - cost
        if gain > 0:
            best, x = cost, there
        if gain < 1e-4 * best:
            break
    true = float(costs(x[None], _FINE)[0])
    if starts and true > best + 1e-3:  # an excursion was hidden between the samples
        true, x = refine(x, 0.1 * step, _FINE)
    return BestCandidate(x, true, tried)
