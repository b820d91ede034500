"""Find the global optimum of a class of paths by cutting planes, or a certificate that it is empty.

Paths must stay in the band, the convex part of the chart's domain between a floor and a cap on ±z₂
(`band`). The relaxation has rows for the floor and for tangents of the cap at a growing list of
points, so its optimum is a lower bound for every path of the class. When no piece leaves the band
by more than a tolerance, all rows are tightened by twice the tolerance and the programme is solved
again. A path that is proven to be inside the band gives an upper bound.

A free travel is chosen by a scan of the window, then a bounded search about the best travel.

At each travel the class is convex, but its optimum as a function of the travel need not be: the
scan may miss a dip narrower than its step. The result is the best of the travels tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.methods.convex.band import Band, cap_excess, floor_excess
from planner.methods.convex.paths import Frame
from planner.methods.convex.programme import Farkas, Goal, Optimum, StalledError, solve
from planner.support import deadline
from planner.support.arrays import Array

TOLERANCE = 1e-10
"""Excess over the band, in z₂, below which cutting stops: the accuracy of the solvers."""

MOST_SLOPE = 1e6
"""Largest |y|, about the root mean square of dz₂/dτ, of the paths of a class without a cap."""


@dataclass(frozen=True)
class Touch:
    """m linear conditions on a path (cuts): p(τ) ≥ floor, or p(τ) ≤ a tangent of the cap; p = ±z₂.

    Attributes:
        tau: Path fractions, shape (m,).
        at: z₃ of the tangent point, shape (m,); NaN for the floor.
    """

    tau: Array
    at: Array

    def only(self, keep: NDArray[np.bool_]) -> Touch:
        """Return those of the cuts that the mask selects."""
        return Touch(self.tau[keep], self.at[keep])

    def plus(self, other: Touch) -> Touch:
        """Return the cuts followed by the cuts of `other`."""
        return Touch(np.append(self.tau, other.tau), np.append(self.at, other.at))


NO_TOUCH = Touch(np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class ClassOptimum:
    """The best path of a class at one travel, with a lower bound of the objective.

    Attributes:
        frame: The class.
        final: The path and its objective, from the last programme, whose rows are tightened.
        bound: Lower bound of the objective over the class, as the programme measures it.
        touch: The active cuts, without the cuts at the nodes.
        rounds: Number of programmes solved.
        proven: Proven upper bound of the excess over the band between the nodes; ≤ 0.
    """

    frame: Frame
    final: Optimum = field(repr=False)
    bound: float
    touch: Touch
    rounds: int
    proven: float

    @property
    def y(self) -> Array:
        """Free coefficients y of the path, shape (size,)."""
        return self.final.y

    @property
    def value(self) -> float:
        """Objective of the path, as the programme measures it."""
        return self.final.value

    @property
    def gap(self) -> float:
        """Largest share of the objective that a better path could save: (value − bound)/|value|."""
        return (self.value - self.bound) / max(abs(self.value), 1e-300)


@dataclass(frozen=True)
class BoundAboveCeiling:
    """Result of a search that ended early: the optimum is at least `bound`, above the ceiling."""

    bound: float


@dataclass(frozen=True)
class EmptyClass:
    """A certificate that a class contains no path inside the band.

    Attributes:
        frame: The class.
        touch: The cuts, one for each row of A and b.
        A: Rows of unit length in the free coefficients, shape (m, size).
        b: Right-hand sides, shape (m,).
        proof: The multipliers that prove infeasibility, and the proven values.
    """

    frame: Frame
    touch: Touch = field(repr=False)
    A: Array = field(repr=False)
    b: Array = field(repr=False)
    proof: Farkas = field(repr=False)


def optimum_by_cuts(
    frame: Frame,
    band: Band,
    goal: Goal,
    extra: Touch = NO_TOUCH,
    max_rounds: int = 100,
    ceiling: float = np.inf,
) -> ClassOptimum | EmptyClass | BoundAboveCeiling:
    """Find the best path of one class at one travel by cutting planes.

    Args:
        frame: The class, its ends and the travel.
        band: The convex domain.
        goal: What to minimise.
        extra: Cuts to begin with, besides the cuts at the nodes; the active cuts of a
            neighbouring travel save rounds.
        max_rounds: Largest number of programmes.
        ceiling: Value of the lower bound above which the search stops.

    Returns:
        The optimum, a certificate that the class is empty, or the bound above the ceiling.

    Raises:
        StalledError: If the rounds are used up, or the feasible set is too thin for a proof.
    """
    touch = _at_nodes(frame, band)
    nodes, touch = len(touch.tau), touch.plus(extra)
    A, b = band_rows(frame, band, touch)
    radius, relaxed, tighten = MOST_SLOPE, None, 0.0
    if band.complete:  # then 0 ≤ p ≤ top bounds |y| for all paths, by Markov's inequality
        radius = float((frame.shape.degree + 1) ** 2 * frame.shape.pieces * band.top)
    for round_ in range(1, max_rounds + 1):
        deadline.check()
        answer = solve(goal, frame, A, b - tighten, radius)
        if isinstance(answer, Farkas):
            if relaxed is not None:
                raise StalledError("feasible only within the tolerance of the cuts")
            length = np.linalg.norm(A, axis=1)
            return EmptyClass(frame, touch, A / length[:, None], b / length, answer)
        if relaxed is None and answer.bound > ceiling:
            return BoundAboveCeiling(answer.bound)
        cuts, proven = _violations(frame, band, answer.y, relaxed is not None)
        if len(cuts.tau) == 0:
            relaxed = relaxed or answer
            tighten = 2 * max(tighten, TOLERANCE)
        if relaxed is not None and proven <= 0:
            leant = (answer.multipliers > 0) & (np.arange(len(b)) >= nodes)
            return ClassOptimum(frame, answer, relaxed.bound, touch.only(leant), round_, proven)
        touch = touch.plus(cuts)
        more = band_rows(frame, band, cuts)
        A, b = np.concatenate([A, more[0]]), np.append(b, more[1])
    raise StalledError(f"cuts did not settle in {max_rounds} rounds")


def band_rows(frame: Frame, band: Band, touch: Touch) -> tuple[Array, Array]:
    """Return the given cuts as rows A y ≤ b in the free coefficients y, in order."""
    A, c = frame.z_rows(1, touch.tau)
    cap = ~np.isnan(touch.at)
    side = np.where(cap, band.sign, -band.sign)
    A, b = side[:, None] * A, -side * c
    b[~cap] -= band.floor
    if cap.any():
        slope, offset = band.tangent(touch.at[cap])
        z3, constant = frame.z_rows(2, touch.tau[cap])
        A[cap] -= slope[:, None] * z3
        b[cap] += offset + slope * constant
    return A, b


def _at_nodes(frame: Frame, band: Band) -> Touch:
    """Return cuts at all inner nodes: the floor, and the cap's tangent at z₃ on a straight line."""
    nodes = frame.shape.breaks[1:-1]
    floor = nodes if np.isfinite(band.floor) else nodes[:0]
    touch = Touch(floor, np.full(len(floor), np.nan))
    if not band.complete:
        return touch
    return touch.plus(Touch(nodes, frame.start[2] + (frame.goal[2] - frame.start[2]) * nodes))


def _violations(frame: Frame, band: Band, y: Array, proof: bool) -> tuple[Touch, float]:
    """Return cuts where the path y leaves the band, and a proven upper bound of the path's excess.

    With `proof`, pieces that seem to be inside are refined until this is proven or disproven.
    """
    _, z2, z3, *_ = frame.bernstein(y)
    low, high = floor_excess(band, z2, TOLERANCE, proof), cap_excess(band, z2, z3, TOLERANCE, proof)
    floor, cap = ((e.piece + e.local) / frame.shape.pieces for e in (low, high))
    rows, constant = frame.z_rows(2, cap)
    touch = Touch(floor, np.full(len(floor), np.nan)).plus(Touch(cap, rows @ y + constant))
    return touch, max(low.proven, high.proven)


Solve = Callable[[float, Touch, float], ClassOptimum | EmptyClass | BoundAboveCeiling | None]
"""Function from (travel, cuts of a neighbouring travel, ceiling) to the result at the travel, as
`optimum_by_cuts` returns it; None if the optimum leaves the chart's domain."""


@dataclass
class BestTravel:
    """The result of a search over travels.

    Attributes:
        best: The best optimum found, or None if no travel tried has a path.
        refusals: Certificates of the travels that have no path.
        tried: Number of travels tried.
        stalls: Number of these at which neither an optimum was found nor a proof that none exists.
        kept: Travels that have a path, or whose search ended early above the ceiling.
    """

    best: ClassOptimum | None = None
    refusals: list[EmptyClass] = field(default_factory=list)
    tried: int = 0
    stalls: int = 0
    kept: list[float] = field(default_factory=list)

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest travel in `kept`; NaN if `kept` is empty."""
        return (min(self.kept), max(self.kept)) if self.kept else (np.nan, np.nan)


def search_travels(solve: Solve, travels: Array, prune: bool = True) -> BestTravel:
    """Scan travels from the middle of the list outwards, then refine about the best travel.

    Args:
        solve: Finds the optimum at one travel.
        travels: Travels to scan, increasing; a single travel is the only one tried.
        prune: Whether to leave a travel as soon as its lower bound exceeds the best value so far.
    """
    search, touch = BestTravel(), NO_TOUCH

    def at(travel: float, prune: bool = False) -> float:
        nonlocal touch
        search.tried += 1
        ceiling = search.best.value if prune and search.best else np.inf
        try:
            answer = solve(float(travel), touch, ceiling)
        except StalledError:
            search.stalls += 1
            return float(np.inf)
        if answer is None or isinstance(answer, EmptyClass):
            search.refusals += [answer] if answer else []
            return float(np.inf)
        search.kept.append(float(travel))
        if isinstance(answer, BoundAboveCeiling):
            return answer.bound
        touch = answer.touch
        if search.best is None or answer.value < search.best.value:
            search.best = answer
        return answer.value

    for k in np.argsort(np.abs(np.arange(len(travels)) - len(travels) // 2), kind="stable"):
        at(travels[k], prune)
    if len(travels) > 1 and search.best is None and search.refusals:
        _approach(at, search)
    if len(travels) > 1 and search.best is not None:
        _refine(at, search.best, travels)
    return search


def _refine(f: Callable[[float], float], best: ClassOptimum, travels: Array) -> None:
    from scipy.optimize import minimize_scalar  # slow to import

    centre = best.frame.travel
    worse = 1e3 * abs(best.value) + 1.0
    step = min(float(travels[1] - travels[0]), 0.999 * abs(centre))  # do not reach zero
    bounds = (max(centre - step, float(travels[0])), min(centre + step, float(travels[-1])))
    tolerance = {"xatol": 1e-5 * (bounds[1] - bounds[0])}
    minimize_scalar(lambda d: min(f(d), worse), bounds=bounds, method="bounded", options=tolerance)


def _approach(f: Callable[[float], float], search: BestTravel) -> None:
    """Search for a travel with a path next to the tried travel whose certificate is weakest."""
    from scipy.optimize import minimize_scalar  # slow to import

    search.refusals.sort(key=lambda r: r.frame.travel)
    k = int(np.argmin([r.proof.margin for r in search.refusals]))
    ends = (search.refusals[max(k - 1, 0)], search.refusals[min(k + 1, len(search.refusals) - 1)])

    def margin(travel: float) -> float:
        return -1.0 if np.isfinite(f(travel)) else search.refusals[-1].proof.margin

    bounds = (ends[0].frame.travel, ends[1].frame.travel)
    minimize_scalar(margin, bounds=bounds, method="bounded", options={"maxiter": 24})
