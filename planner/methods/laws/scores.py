"""Choose a law's free numbers: a scan, then an evolution strategy from the best candidates.

Scores from samples in the chart rate the candidates. Many candidates are sampled at once, so that a
scan needs few calls of the chart and is cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from planner.plan.measures import worst_margin
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import MotionPoint
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, basis
from planner.support.calculus.chebyshev import apply, points
from planner.systems.chained_form import chained_form

_CLOSE = 0.1
"""Margin, as a fraction of the margin at start and goal, below which a motion is too close to the
edge of the chart's domain. Near the edge θ₁ bounces off zero and the inputs are quotients of small
numbers."""

SLACK = 1e-6
"""Least distance of a chosen motion from each limit, as a fraction of the limit, unless start or
goal are closer. With less, the certificate's enclosures cannot distinguish a coordinate at its
limit from a coordinate beyond the limit."""

ROUNDING = 1e-9
"""Largest missing slack that counts as rounding, as a fraction of the limit."""

Criterion = Literal["peak", "margin"]


@dataclass(frozen=True)
class Scores:
    """Scores of C candidates from samples; arrays of shape (C,).

    Attributes:
        margin: Least chart margin (dimensionless, negative outside the domain).
        slack: Least slack to the problem's limits on coordinates, relative to each limit; infinite
            without such limits, negative if a limit is broken, NaN outside the domain.
        peak: Largest input, relative to its limit if it has one; NaN outside the domain.
    """

    margin: Array
    slack: Array
    peak: Array

    @property
    def inside(self) -> Array:
        """Whether all samples of each candidate lie inside the chart's domain, shape (C,)."""
        return np.asarray(self.margin > 0)

    def cost(self, criterion: Criterion, ends: float, slack: float = 0.0) -> Array:
        """Combine the scores into one number to minimise, shape (C,), in three ranges.

        Below 1: all limits are kept, and the chart's margin is at least `_CLOSE` times that of the
        ends; 1 to 2: a limit is broken or the margin is smaller; 2 to 3: it leaves the domain.

        Args:
            criterion: Ranks the candidates below 1: "peak" by peak input, "margin" by margin. If
                candidates reach the margin of the ends, the largest possible, peak inputs decide.
            ends: The least margin of start and goal; see `end_margin`.
            slack: Least slack with which a limit counts as kept; see `end_slack`.
        """
        with np.errstate(invalid="ignore"):
            outside = 2 + _bound(-self.margin)
            close = 1 - self.margin / (_CLOSE * ends)
            penalty = 1 + _bound(np.maximum(close, slack - self.slack))
            kept = _bound(self.peak)
            if criterion == "margin":
                short = self.margin < ends * (1 - 1e-6)
                kept = np.where(short, 1 - 0.5 * self.margin / ends, 0.5 * kept)
            cost = np.where((self.slack < slack - ROUNDING) | (close > 0), penalty, kept)
            cost = np.where(self.margin > 0, cost, outside)
        return np.where(np.isnan(cost), 3.0, cost)


Curves = tuple[Bernstein, Bernstein]
"""Curves z (C, N) and v (C, 2) of C candidates on the same breaks; NaN for failed candidates."""


def score(problem: Problem, curves: Curves, samples: int | Array = 400) -> Scores:
    """Score the motions of C candidates by samples.

    Args:
        problem: Supplies limits; where an input has none, its peak counts in its own unit.
        curves: The candidates.
        samples: Approximate number of samples of each candidate, denser at the ends of its pieces;
            or the places of the samples on every piece, from 0 to 1.
    """
    form, branch = chained_form(problem.system), problem.branch
    places = _places(curves, samples) if isinstance(samples, int) else samples
    z, v = (_sample(curve, places) for curve in curves)
    q, u = form.both(z, v, branch)
    margins = problem.system.chart_margins(q, branch)
    outside = np.isnan(u).any(axis=(1, 2, 3))  # there q has no margins, but z has
    margins[outside] = form.margins(z[outside], branch)
    margin = worst_margin(margins)
    margin[np.isnan(z).any(axis=(1, 2, 3))] = np.nan
    out = np.full((3, len(z)), np.nan)
    out[0] = np.minimum(np.min(margin, axis=(1, 2)), _dips(margin, places))
    good = out[0] > 0
    if good.any():
        room = _room(problem, z[good], q[good])
        out[1, good] = np.minimum(np.min(room, axis=(1, 2)), _dips(room, places))
        out[2, good] = np.max(np.abs(u[good]) / problem.limits.input_scale, axis=(1, 2, 3))
    return Scores(*out)


def _places(curves: Curves, samples: int) -> Array:
    return points(max(9, samples // (len(curves[0].x) - 1)))


def _sample(curve: Bernstein, places: Array) -> Array:
    """Return the values (C, P, S, D) of C curves at S places on each of P pieces.

    A break between two pieces is sampled on both, since a curve may jump there.
    """
    weights = np.ascontiguousarray(basis(curve.degree, places).T)
    return np.moveaxis(apply(weights, curve.c), 2, 0).swapaxes(1, 2)


def _dips(values: Array, places: Array) -> Array:
    """Estimate the least value (C,) between samples (C, P, S), at places (S,) of each piece.

    A dip can be narrower than the distance of samples, so a parabola through the three samples
    around each local minimum is used, except beside a margin of −∞.
    """
    step = np.diff(places)
    before, after, width = step[:-1], step[1:], step[:-1] + step[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.diff(values, axis=-1) / step
        bend = (slope[..., 1:] - slope[..., :-1]) / width
        tangent = (slope[..., :-1] * after + slope[..., 1:] * before) / width
        lowest = values[..., 1:-1] - tangent**2 / (4 * bend)
    is_dip = (slope[..., :-1] <= 0) & (slope[..., 1:] >= 0) & (bend > 0)
    return np.asarray(np.min(np.where(is_dip, lowest, np.inf), axis=(1, 2)))


def end_margin(problem: Problem) -> float:
    """Return the least chart margin of start and goal, which no path between the two exceeds."""
    ends = np.stack([problem.start, np.nan_to_num(problem.goal)])
    return float(np.min(problem.system.chart_margins(ends, problem.branch)))


def end_slack(problem: Problem) -> float:
    """Return the slack to limits that a chosen motion must leave: `SLACK`, or an end's if less."""
    ends = np.stack([problem.start, np.nan_to_num(problem.goal)])
    z = chained_form(problem.system).z(ends)
    return float(np.clip(np.min(list(_rooms(problem, z, ends)), initial=SLACK), 0.0, SLACK))


def _room(problem: Problem, z: Array, q: Array) -> Array:
    """Return the least slack (…) to a limit on coordinates at z, q (…, N); infinite if none."""
    room = np.full(q.shape[:-1], np.inf)
    for each in _rooms(problem, z, q):
        room = np.minimum(room, each)
    return room


def _rooms(problem: Problem, z: Array, q: Array) -> Iterator[Array]:
    """Yield the slack (…) to each limit on coordinates, relative to that limit, at z, q (…, N)."""
    point = replace(MotionPoint.of(problem.system, q), z=np.moveaxis(z, -1, 0))
    for requirement in problem.requirements:
        if requirement.reads == {"q"} and requirement.smooth:
            for part, value in zip(requirement.parts, requirement.values(point), strict=True):
                if part.low == -part.high:
                    yield 1 - np.abs(value) / part.high
                else:
                    yield np.minimum(part.high - value, value - part.low) / part.scale


def _bound(x: Array) -> Array:
    """Map [0, ∞] to [0, 1], increasing, by x/(1 + x)."""
    return np.where(np.isinf(x), 1.0, x / (1 + np.abs(x)))


Make = Callable[[Array], Curves]
"""Function that applies a law: from free numbers (C, d) of C candidates to their curves."""

CALL_S = 0.1
"""Longest computing time of one call of the chart, s; the time limit is checked between calls."""

_SCAN, _SEARCH, _FINE = 60, 100, 6000
"""Numbers of samples of each candidate in the scan, in the search, and of the final candidate."""

_POPULATION = 24
"""Number of candidates of a round; with fewer, most of the time would go to calls of the chart."""

_STAGES = ((6, 1.0, 1e-4), (60, 0.3, 1e-5), (40, 0.02, 1e-7))
"""Stages of the search: from several starts, from the best start, and again with samples crowded at
the peaks. Each stage is (largest number of rounds, factor on the given first steps, spread of costs
at which the stage ends)."""


@dataclass(frozen=True)
class BestCandidate:
    """The best candidate of a search.

    Attributes:
        x: Free numbers of the candidate, shape (d,).
        cost: See `Scores.cost`; below 1 when domain and limits are kept.
        tried: Number of candidates tried.
    """

    x: Array
    cost: float
    tried: int

    @property
    def inside(self) -> bool:
        """Whether the candidate stays inside the chart's domain."""
        return self.cost < 2

    @property
    def notes(self) -> dict[str, Any]:
        """Number of candidates and whether the best is inside, for the notes of a plan."""
        return {"auto_motions_tried": self.tried, "auto_found_inside": self.inside}


def score_candidates(problem: Problem, make: Make, x: Array, samples: int | Array = 200) -> Scores:
    """Score candidates with free numbers x (C, d) in batches; `samples` is as for `score`.

    Raises:
        TimeUpError: If time is up.
    """
    curves, parts = make(x), list[Scores]()
    places = _places(curves, samples) if isinstance(samples, int) else samples
    needed = (len(curves[0].x) - 1) * len(places) * chained_form(problem.system).point_s
    most = max(1, int(CALL_S / needed))
    for k in range(0, len(x), most):
        deadline.check()
        some = slice(k, k + most)
        z, v = (Bernstein(curve.c[:, :, some], curve.x) for curve in curves)
        parts.append(score(problem, (z, v), places))
    return Scores(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Scores)))


REFINED = 3
"""Number of the best candidates of a scan from which a search starts."""


def search_candidates(
    problem: Problem, make: Make, grid: Array, steps: Array, criterion: Criterion = "peak"
) -> BestCandidate:
    """Find the free numbers of least cost: scan a grid, then search from the best candidates.

    `zoom` searches one number, `evolve` several numbers.

    Args:
        problem: Supplies limits and the chart's branch.
        make: The law.
        grid: Candidates to scan, shape (C, d).
        steps: Sizes of the first steps from each candidate, shape (d,) or (C, d).
        criterion: The quantity to optimise; domain and limits come first.

    Raises:
        TimeUpError: If time is up.
    """
    ends = end_margin(problem), end_slack(problem)
    count = 0

    def costs(x: Array, samples: int | Array) -> Array:
        nonlocal count
        count += len(x)
        return score_candidates(problem, make, x, samples).cost(criterion, *ends)

    first = np.argsort(costs(grid, _SCAN), kind="stable")[:REFINED]
    x, step = grid[first], np.abs(np.broadcast_to(steps, grid.shape)[first])
    samples: int | Array = _SEARCH
    for stage, (rounds, part, spread) in enumerate(_STAGES if grid.shape[1] else ()):
        if stage == 2:
            samples = _sample_places(problem, make(x))
        search = zoom if grid.shape[1] == 1 else evolve
        x, cost = search(partial(costs, samples=samples), x, part * step, rounds, spread)
        best = np.argmin(cost, keepdims=True)
        x, step = x[best], step[best]
    return BestCandidate(x[0], float(costs(x[:1], _FINE)[0]), count)


def _sample_places(problem: Problem, curves: Curves) -> Array:
    """Return places (S,) at which to sample a candidate, denser at input peaks and near limits."""
    fine, usual = _places(curves, _FINE), _places(curves, _SEARCH)
    z, v = (_sample(curve, fine)[0] for curve in curves)
    q, u = chained_form(problem.system).both(z, v, problem.branch)
    speed = np.nan_to_num(np.abs(u) / problem.limits.input_scale)
    high = (speed[:, 1:-1] > speed[:, :-2]) & (speed[:, 1:-1] > speed[:, 2:])
    peaks = np.flatnonzero((high & (speed[:, 1:-1] > 0.8 * np.max(speed))).any(axis=(0, 2))) + 1
    lows = (
        np.argmin(_room(problem, z, q)),
        np.argmin(worst_margin(problem.system.chart_margins(q, problem.branch))),
    )
    centres = fine[np.append(peaks, lows) % len(fine)]
    gaps = np.interp(centres, usual[1:], np.diff(usual))[:, None] * np.linspace(-1, 1, 9)
    return np.unique(np.clip([*usual, *(centres[:, None] + gaps).ravel()], 0, 1))


def zoom(
    cost: Callable[[Array], Array], x: Array, steps: Array, rounds: int, spread: float
) -> tuple[Array, Array]:
    """Minimise a cost over one number by a grid about each start, refined about its best point.

    Arguments and results are as for `evolve`, with d = 1.
    """
    places = np.linspace(-1, 1, _POPULATION + 1)
    for _ in range(rounds):
        points = x + steps * places
        costs = cost(points.reshape(-1, 1)).reshape(points.shape)
        best = np.argmin(costs, axis=1)[:, None]
        x, least = (np.take_along_axis(a, best, axis=1) for a in (points, costs))
        if np.max(np.ptp(costs, axis=1)) < spread:
            break
        inner = (best > 0) & (best < _POPULATION)
        steps = steps * np.where(inner, 2 / _POPULATION, 2.0)
    return x, least[:, 0]


def evolve(
    cost: Callable[[Array], Array], x: Array, steps: Array, rounds: int, spread: float
) -> tuple[Array, Array]:
    """Minimise a cost by CMA-ES (Hansen, "The CMA Evolution Strategy: A Tutorial", 2016).

    Args:
        cost: Maps points (M, d) to costs (M,).
        x: Starts of S independent searches, shape (S, d).
        steps: Standard deviations of the first steps, shape (S, d).
        rounds: Largest number of rounds.
        spread: Range of the better half of a round's costs below which the searches end, if it is
            so small in each search.

    Returns:
        The best point of each search, (S, d), and the cost of this point, (S,).
    """
    count, d = x.shape
    weights = np.log((_POPULATION + 1) / 2) - np.log(np.arange(1, _POPULATION // 2 + 1))
    weights /= weights.sum()
    mass = 1 / np.sum(weights**2)
    path_rate, shape_rate = (mass + 2) / (d + mass + 5), (4 + mass / d) / (d + 4 + 2 * mass / d)
    damping = 1 + path_rate + 2 * max(0.0, np.sqrt((mass - 1) / (d + 1)) - 1)
    rank_one = 2 / ((d + 1.3) ** 2 + mass)
    rank_many = min(1 - rank_one, 2 * (mass - 2 + 1 / mass) / ((d + 2) ** 2 + mass))
    usual = np.sqrt(d) * (1 - 1 / (4 * d) + 1 / (21 * d**2))
    random = np.random.default_rng(0)
    mean, best, least = x, x, np.full(count, np.inf)
    size, shape = np.ones((count, 1)), np.tile(np.eye(d), (count, 1, 1))
    path, shape_path = np.zeros((2, count, d))
    for _ in range(rounds):
        squares, axes = np.linalg.eigh(shape)
        widths = np.sqrt(np.maximum(squares, 1e-30))
        normal = random.standard_normal((count, _POPULATION, d))
        moves = np.einsum("sij,sj,spj->spi", axes, widths, normal)
        points = mean[:, None] + (size * steps)[:, None] * moves
        costs = cost(points.reshape(-1, d)).reshape(count, -1)
        order = np.argsort(costs, axis=1, kind="stable")[:, : len(weights)]
        rows = np.arange(count)[:, None]
        points, moves, costs = points[rows, order], moves[rows, order], costs[rows, order]
        better = costs[:, 0] < least
        best, least = np.where(better[:, None], points[:, 0], best), np.minimum(costs[:, 0], least)
        if np.max(np.ptp(costs, axis=1)) < spread:
            break
        move = np.einsum("p,spi->si", weights, moves)
        mean = mean + size * steps * move
        white = np.einsum("sij,sj,skj,sk->si", axes, 1 / widths, axes, move)
        path = (1 - path_rate) * path + np.sqrt(path_rate * (2 - path_rate) * mass) * white
        shape_path = (1 - shape_rate) * shape_path
        shape_path += np.sqrt(shape_rate * (2 - shape_rate) * mass) * move
        shape = (1 - rank_one - rank_many) * shape
        shape += rank_one * np.einsum("si,sj->sij", shape_path, shape_path)
        shape += rank_many * np.einsum("p,spi,spj->sij", weights, moves, moves)
        length = np.linalg.norm(path, axis=1, keepdims=True)
        size = size * np.exp(path_rate / damping * (length / usual - 1))
    return best, least
