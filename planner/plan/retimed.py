"""A trajectory's path with another timing, and the length along a path.

With inputs u(σ) over the path's own time σ and scales c, the length is s(σ) = ∫ ‖u/c‖ dσ. It
depends only on the path. With any timing s(t) the inputs are u(σ(s)) / ‖u(σ(s))/c‖ · ds/dt.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from planner.plan.curves import expect_curve, nonfinite_part
from planner.plan.trajectory import Trajectory, trajectory_from_dict
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, Pieces, basis
from planner.support.calculus.chebyshev import Grid
from planner.support.calculus.extremes import sample_times, zeros
from planner.systems.triangular_system import TriangularSystem

LENGTH_TOLERANCE = 1e-12
"""Difference of two lengths or times of a path that count as equal, relative to the whole length or
time."""

LEAST_GROWTH = 1e-4
"""Least ratio of ds/dσ to the inputs' norm, each relative to its mean; where the ratio is less, the
length counts as constant. For a length from `arc_length` the ratio differs from one only because
the inputs have different scales."""


@dataclass(frozen=True, eq=False)
class RetimedTrajectory(Trajectory):
    """Trajectory of a path with another timing: q(t) = path.q(σ) with length(σ) = clock(t).

    The system is driftless, so any increasing clock gives the same path; the inputs are the path's
    inputs times dσ/dt.

    Attributes:
        path: The trajectory whose path is followed.
        length: Length s over the path's own time σ, scalar, increasing.
        clock: Length s over time t, scalar, increasing; it ends at the whole length.
        stations: σ at the clock's breaks, shape (K+1,); it contains every break of `length`, which
            in turn contains every break of the path.

    Raises:
        ValueError: If a curve is not scalar, its breaks do not increase from 0, or the number of
            stations is not that of the clock's breaks.
    """

    kind: ClassVar[str] = "retimed"
    path: Trajectory
    length: Bernstein
    clock: Bernstein
    stations: Array

    @property
    def system(self) -> TriangularSystem:  # type: ignore[override]
        """The system of the path."""
        return self.path.system

    @property
    def breaks(self) -> Array:
        """Times of the breaks of the clock, which include those of the path."""
        return np.asarray(self.clock.x)

    def __post_init__(self) -> None:
        for name in ("length", "clock"):
            object.__setattr__(self, name, expect_curve(name, getattr(self, name), ()))
        super().__post_init__()
        if np.shape(self.stations) != np.shape(self.clock.x):
            raise ValueError("there must be one station for each break of the clock")

    @property
    def degree(self) -> int:
        """Highest degree of path, length and clock."""
        return max(self.path.degree, self.length.degree, self.clock.degree)

    @property
    def in_coordinates(self) -> bool:
        """Whether the path is given in coordinates."""
        return self.path.in_coordinates

    @cached_property
    def flaw(self) -> str:
        """Reason why the clock does not cover the path piece by piece without jumps; else empty.

        Values at the ends and where two pieces meet are compared exactly, because a clock copies
        them from the length.
        """
        path, length, clock, stations = self.path, self.length, self.clock, self.stations
        both = ((float(c[0, 0]), float(c[-1, -1])) for c in (length.c, clock.c))
        (begin, end), (first, last) = both
        slack = LENGTH_TOLERANCE * (end - begin)
        after = np.clip(np.searchsorted(stations, length.x), 1, len(stations) - 1)
        away = np.minimum(*(np.abs(stations[k] - length.x) for k in (after, after - 1)))
        far = away > LENGTH_TOLERANCE * path.duration
        off = stations[0] != 0 or stations[-1] != path.duration
        disordered = off or np.any(np.diff(stations) <= 0)
        missing, backward = ~np.isin(path.breaks, length.x), np.diff(clock.c, axis=0) < -slack
        astray = np.abs(length(stations) - np.append(clock.c[0], last))
        jumps = [np.any(curve.c[0, 1:] != curve.c[-1, :-1]) for curve in (length, clock)]
        ends = f"from {first:.6g} to {last:.6g} of a path that goes from {begin:.6g} to {end:.6g}"
        numbers = nonfinite_part(length=length.c, clock=clock.c, stations=stations)
        checks = (
            (path.flaw, path.flaw),
            (numbers, numbers),
            (length.x[-1] != path.duration, "the length does not end where the path does"),
            (disordered, "the stations do not increase from the path's start to its end"),
            (np.any(missing), "a break of the path is missing in length"),
            (first != begin or last != end, f"the clock goes {ends}"),
            (any(jumps), "the clock or the length jumps"),
            (not end > begin or np.any(backward), "the clock does not increase"),
            (np.any(far), "a break of the path is not a station"),
            (np.any(astray > slack), "the clock does not match its stations"),
        )
        return next((words for bad, words in checks if bad), "") or self._stall

    @property
    def _stall(self) -> str:
        """Words on where the length hardly grows although the path moves; empty if nowhere.

        At such a place dσ/dt, and thus the inputs, would be far too large.
        """
        grid = Grid(self.length.x)
        speed = np.linalg.norm(self.path.u(grid.times), axis=-1)
        slope = self._inverse.slope(grid.times)
        speed, slope = (each / np.nanmean(each) for each in (speed, slope))
        still = (speed > 1e-3) & (slope < LEAST_GROWTH * speed)
        if not np.any(still):
            return ""
        when = grid.times[still][0]
        return f"its length nearly stands still at {when:.4g} s of the path, yet the path moves"

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates of the path at σ(t)."""
        return self.path.q(self.sigma(t))

    def z(self, t: ArrayLike) -> Array:
        """Return the chained coordinates of the path at σ(t)."""
        return self.path.z(self.sigma(t))

    def margins(self, t: ArrayLike) -> Array:
        """Return the chart margins of the path at σ(t)."""
        return self.path.margins(self.sigma(t))

    def u(self, t: ArrayLike) -> Array:
        """Return the path's inputs times dσ/dt; zero outside [0, duration]."""
        sigma, pace = self._pace(t)
        return self.path.u(sigma) * pace

    def v(self, t: ArrayLike) -> Array:
        """Return the path's chained inputs times dσ/dt; zero outside [0, duration]."""
        sigma, pace = self._pace(t)
        return self.path.v(sigma) * pace

    def piece_values(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        """Return the coordinates of the path, and its inputs times dσ/dt; see the base class."""
        low, high = self.stations[piece], self.stations[piece + 1]
        path_times = self._inverse(self.clock.piece_values(piece, fraction), low, high)
        rate = self._rate.piece_values(piece, fraction)
        sigma, pace = self._moving_pace(path_times, low, high, rate)
        breaks = self.path.breaks
        middle = (low + high) / 2
        path_piece = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, len(breaks) - 2)
        left, right = breaks[path_piece], breaks[path_piece + 1]
        inside = (sigma >= left) & (sigma <= right) & (path_times >= left) & (path_times <= right)
        if np.all(inside):
            q, u = self.path.piece_values(path_piece, (path_times - left) / (right - left))
            if sigma is not path_times:
                _, u = self.path.piece_values(path_piece, (sigma - left) / (right - left))
            return q, u * pace
        # A break of the path is inside a piece.
        return self.path.q(path_times), self.path.u(sigma) * pace

    def slowed(self, factor: float) -> RetimedTrajectory:
        """Return the same path with a motion that takes `factor` times as long."""
        length, clock = self.length, self.clock.slowed(factor)
        if factor > 0:
            return RetimedTrajectory(self.path, length, clock, self.stations)
        left, end = length.slowed(-1.0), length.c[-1, -1]
        length, clock = Bernstein(end - left.c, left.x), Bernstein(end - clock.c, clock.x)
        stations = self.stations[-1] - self.stations[::-1]
        return RetimedTrajectory(self.path.slowed(-1.0), length, clock, stations)

    def to_dict(self) -> dict[str, Any]:
        """Return the trajectory as JSON-ready data."""
        return {
            "kind": self.kind,
            "path": self.path.to_dict(),
            "length": self.length.to_dict(),
            "clock": self.clock.to_dict(),
            "stations": self.stations.tolist(),
        }

    @classmethod
    def from_dict(cls, system: TriangularSystem, data: Mapping[str, Any]) -> RetimedTrajectory:
        """Return the trajectory that `to_dict` wrote."""
        path = trajectory_from_dict(system, data["path"])
        length, clock = (Bernstein.from_dict(data[name]) for name in ("length", "clock"))
        return cls(path, length, clock, np.asarray(data["stations"], dtype=float))

    @cached_property
    def _inverse(self) -> Inverse:
        return Inverse(self.length)

    @cached_property
    def _rate(self) -> Bernstein:
        return self.clock.derivative()

    def sigma(self, t: ArrayLike) -> Array:
        """Return the path's own time σ at t; at a break, that of the piece that begins."""
        times = self._clip(t)
        low, high = self._stations_around(times)
        inner = self._inverse(self.clock(times), low, high)
        return np.where(times < self.duration, inner, high)

    def time_of(self, sigma: ArrayLike) -> Array:
        """Return the times (…) at which the path's own time is σ (…)."""
        k = np.searchsorted(self.stations[1:-1], sigma, "right")
        s, low, high = self.length(sigma), self.clock.x[k], self.clock.x[k + 1]
        for _ in range(60):  # bisection, to rounding
            middle = (low + high) / 2
            early = self.clock(middle) < s
            low, high = np.where(early, middle, low), np.where(early, high, middle)
        return np.asarray((low + high) / 2)

    def _stations_around(self, times: Array) -> tuple[Array, Array]:
        k = self.clock.piece(times)
        return self.stations[k], self.stations[k + 1]

    def _pace(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return σ and dσ/dt (…, 1) at t."""
        times = self._clip(t)
        ends = self._stations_around(times)
        sigma, pace = self._moving_pace(self.sigma(t), *ends, self._rate(times))
        return sigma, pace * self._is_running(t)

    def _moving_pace(
        self, sigma: Array, low: Array, high: Array, rate: Array
    ) -> tuple[Array, Array]:
        """Return σ and dσ/dt (…, 1) for a clock that runs at `rate`, between stations.

        If the path itself stands still, dσ/dt is infinite, but its product with the path's inputs
        has a limit, which is taken slightly inside the piece.
        """
        slope = self._inverse.slope
        still = slope(sigma) <= 1e-9 * self.length.c[-1, -1] / self.length.x[-1]
        if np.any(still):
            nudge = 1e-7 * (high - low)
            sigma = np.where(still, np.clip(sigma, low + nudge, high - nudge), sigma)
        return sigma, (rate / slope(sigma))[..., None]


Norm = Literal["max", "euclid"]

_TAIL_TOLERANCE = 1e-9
"""Largest Chebyshev tail of ‖u/c‖ on a piece that is fine enough, as a share of the maximum."""

_NOISE_TAIL = 1e-6
"""Largest tail that counts as rounding of u if halving a piece does not reduce the tail."""

_NEGLIGIBLE_TAIL = 1e-10
"""Largest tail that is ignored, as a share of the mean of ‖u/c‖ over the whole path."""


def arc_length(path: Trajectory, scale: Array, norm: Norm) -> Bernstein:
    """Return the length s over the path's own time, increasing from 0, in smooth pieces.

    Args:
        path: Any trajectory with inputs at all times.
        scale: Scales c of the inputs, shape (2,).
        norm: "max" for max|uᵢ/cᵢ|, "euclid" for the root of the sum of squares.
    """

    def speed(sigma: Array) -> Array:
        order = np.inf if norm == "max" else 2
        return np.asarray(np.linalg.norm(path.u(sigma) / scale, order, axis=-1))

    samples = sample_times(path.breaks)
    mean = float(np.mean(speed(samples)))
    edges = _merge_breaks(path.breaks, _corners(path, scale, norm, samples, mean))
    grid = _resolve_pieces(speed, edges, _NEGLIGIBLE_TAIL * mean)
    return grid.curve(np.maximum(speed(_inner_points(grid)), 0.0)).antiderivative()


class Inverse:
    """Map from lengths s to the path's own times σ, by Newton's method in a shrinking bracket.

    Args:
        length: As returned by `arc_length`.

    Attributes:
        slope: ds/dσ, as a curve over σ.
    """

    def __init__(self, length: Bernstein) -> None:
        self._length, self.slope = length, length.derivative()

    def __call__(self, s: Array, low: Array, high: Array) -> Array:
        """Return σ (…) at lengths s (…), each between bounds `low` and `high` (…) in one piece."""
        piece = self._length.piece((low + high) / 2)  # rounding may have put `low` before a break
        high = np.nextafter(high, low)  # `high` itself belongs to the next piece
        c = self._length.c[:, piece]
        c = c.reshape(len(c), *[1] * (s.ndim - low.ndim), *low.shape)
        begin, width = self._length.x[piece], np.diff(self._length.x)[piece]
        rise, degree = np.diff(c, axis=0), len(c) - 1

        def gap_and_slope(sigma: Array) -> tuple[Array, Array]:
            fraction = (sigma - begin) / width
            weights = basis(degree - 1, fraction)
            up = np.sum(weights * rise, axis=0)
            return np.sum(weights * c[:-1], axis=0) + fraction * up - s, degree * up / width

        left, right = low, high
        (below, _), (above, _) = (gap_and_slope(np.broadcast_to(t, s.shape)) for t in (low, high))
        share = np.clip(below / np.minimum(below - above, -1e-300), 0.0, 1.0)
        sigma = low + (high - low) * share
        for _ in range(60):
            gap, slope = gap_and_slope(sigma)
            left, right = np.where(gap <= 0, sigma, left), np.where(gap >= 0, sigma, right)
            new = _step(sigma, gap, slope)
            new = np.where((new >= left) & (new <= right), new, (left + right) / 2)
            change, sigma = np.abs(new - sigma), new
            if np.all(change <= 1e-8 * (high - low)):
                break
        new = np.clip(_step(sigma, *gap_and_slope(sigma)), low, high)
        return np.where(np.isnan(new), sigma, new)


def _step(sigma: Array, gap: Array, slope: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(sigma - gap / slope)


def _merge_breaks(breaks: Array, extra: Array) -> Array:
    """Return the breaks with the extra times, except those very close to a time already there."""
    apart = 1e-9 * breaks[-1]
    knots = list(breaks)
    for time in np.sort(extra):
        if np.min(np.abs(np.array(knots) - time)) > apart:
            knots.append(time)
    return np.sort(knots)


def _corners(path: Trajectory, scale: Array, norm: Norm, samples: Array, mean: float) -> Array:
    """Return the path's own times at which the speed ‖u/c‖ has a kink.

    Kinks are stops (both inputs zero) and, for the norm "max", changes of the larger input.
    """

    def scaled(sigma: Array) -> Array:
        return np.where(np.abs(u := path.u(sigma) / scale) < 1e-12 * mean, 0.0, u)

    corners: list[float] = []
    for i in range(2):
        still = zeros(lambda t, i=i: scaled(t)[..., i], samples)  # type: ignore[misc]
        corners += [t for t in still if np.max(np.abs(scaled(np.array(t)))) < 1e-6 * mean]
    if norm == "max":
        corners += zeros(lambda t: np.abs(scaled(t)[..., 0]) - np.abs(scaled(t)[..., 1]), samples)
    return np.array(corners)


def _resolve_pieces(function: Callable[[Array], Array], edges: Array, atol: float) -> Grid:
    """Return the pieces between the edges, halved until interpolants of the function are accurate.

    A piece is also kept if halving no longer improves the interpolant.
    """
    work = [(float(a), float(b), np.inf) for a, b in pairwise(edges)]
    starts: list[float] = []
    shortest = 1e-12 * (edges[-1] - edges[0])
    while work:
        left, right, before = work.pop()
        grid = Grid(np.array([left, right]))
        values = function(_inner_points(grid))
        size = float(np.max(values))
        tail = max(float(grid.tail(values)[0]) - atol, 0.0)
        noise = 0.2 * before < tail < _NOISE_TAIL * size
        if tail <= _TAIL_TOLERANCE * size or noise or right - left <= shortest:
            starts.append(left)
        else:
            middle = (left + right) / 2
            work += [(left, middle, tail), (middle, right, tail)]
    return Grid(np.append(np.sort(starts), edges[-1]))


def _inner_points(grid: Grid) -> Array:
    """Return the grid's points, each piece's last moved inside, as inputs may jump there."""
    return np.minimum(grid.times, np.nextafter(grid.breaks[1:, None], -np.inf))
