"""A path of one trajectory under another timing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly

from planner.arclength import Inverse
from planner.systems.base import Array, TriangularSystem
from planner.trajectory import (
    Pieces,
    Trajectory,
    curve_from_dict,
    curve_to_dict,
    expect_curve,
    on_pieces,
    trajectory_from_dict,
    undefined,
)

SAME = 1e-12
"""Distance of two lengths, or two own times, over the whole, that is the rounding of an inverse."""


@dataclass(frozen=True)
class RetimedTrajectory(Trajectory):
    """q(t) = path.q(σ) with length(σ) = clock(t).

    The system is driftless, so any increasing clock gives a motion along the same path, whose
    inputs are the path's times dσ/dt.

    Attributes:
        path: The trajectory whose path it follows.
        length: BPoly of the length s over the path's own time σ, scalar, increasing.
        clock: BPoly of s over time t, scalar, increasing; it ends at the whole length.
        stations: σ at the clock's breaks, shape (K+1,); every break of `length` is one of them, and
            every break of the path is one of `length`.

    Raises:
        ValueError: If a curve is not scalar, its breaks do not increase from 0, or there is another
            number of stations than breaks of the clock.
    """

    kind: ClassVar[str] = "retimed"
    path: Trajectory
    length: BPoly
    clock: BPoly
    stations: Array

    @property
    def system(self) -> TriangularSystem:  # type: ignore[override]
        """The path's."""
        return self.path.system

    @property
    def breaks(self) -> Array:
        """Times at which the clock or the path has a corner."""
        return np.asarray(self.clock.x)

    def __post_init__(self) -> None:
        expect_curve("length", self.length, ())
        expect_curve("clock", self.clock, ())
        if np.shape(self.stations) != np.shape(self.clock.x):
            raise ValueError("there must be one station for each break of the clock")

    @property
    def in_coordinates(self) -> bool:
        """As the path."""
        return self.path.in_coordinates

    @cached_property
    def flaw(self) -> str:
        """Whether the clock goes all the way along the path, piece by piece, and never jumps.

        Ends and joints are compared to the last bit: whoever makes a clock takes them from the
        length. That the length grows wherever the path moves is not looked at here.
        """
        path, length, clock, stations = self.path, self.length, self.clock, self.stations
        (begin, end), (first, last) = (
            (float(c[0, 0]), float(c[-1, -1])) for c in (length.c, clock.c)
        )
        slack = SAME * (end - begin)
        after = np.clip(np.searchsorted(stations, length.x), 1, len(stations) - 1)
        away = np.minimum(*(np.abs(stations[k] - length.x) for k in (after, after - 1)))
        astray = np.abs(length(stations) - np.append(clock.c[0], last))
        jumps = [np.any(curve.c[0, 1:] != curve.c[-1, :-1]) for curve in (length, clock)]
        ends = f"from {first:.6g} to {last:.6g} of a path that goes from {begin:.6g} to {end:.6g}"
        numbers = undefined(length=length.c, clock=clock.c, stations=stations)
        checks = (
            (path.flaw, path.flaw),
            (numbers, numbers),
            (length.x[-1] != path.duration, "the length does not end where the path does"),
            (
                stations[0] != 0 or stations[-1] != path.duration or np.any(np.diff(stations) <= 0),
                "the stations do not increase from the path's start to its end",
            ),
            (not np.all(np.isin(path.breaks, length.x)), "a break of the path is none of length"),
            (first != begin or last != end, f"the clock goes {ends}"),
            (any(jumps), "the clock or the length jumps"),
            (
                not end > begin or np.any(np.diff(clock.c, axis=0) < -slack),
                "the clock does not increase",
            ),
            (np.any(away > SAME * path.duration), "a break of the path is none of the stations"),
            (np.any(astray > slack), "the clock is not at its stations when it should be"),
        )
        return next((words for bad, words in checks if bad), "")

    def q(self, t: ArrayLike) -> Array:
        """The path's own, where the clock is."""
        return self.path.q(self.place(t))

    def z(self, t: ArrayLike) -> Array:
        """The path's own, where the clock is."""
        return self.path.z(self.place(t))

    def margins(self, t: ArrayLike) -> Array:
        """The path's own, where the clock is."""
        return self.path.margins(self.place(t))

    def u(self, t: ArrayLike) -> Array:
        """The path's inputs times dσ/dt; zero outside [0, duration]."""
        sigma, pace = self._pace(t)
        return self.path.u(sigma) * pace

    def v(self, t: ArrayLike) -> Array:
        """The path's chained inputs times dσ/dt; zero outside [0, duration]."""
        sigma, pace = self._pace(t)
        return self.path.v(sigma) * pace

    def inside(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        """The path's own where the clock is, with its inputs times dσ/dt."""
        low, high = self.stations[piece], self.stations[piece + 1]
        own = self._inverse(on_pieces(self.clock, piece, fraction), low, high)
        sigma, pace = self._paced(own, low, high, on_pieces(self._rate, piece, fraction))
        breaks = self.path.breaks
        at = np.clip(np.searchsorted(breaks, low, side="right") - 1, 0, len(breaks) - 2)
        left, right = breaks[at], breaks[at + 1]
        if np.all((sigma >= left) & (sigma <= right) & (own >= left) & (own <= right)):
            q, u = self.path.inside(at, (own - left) / (right - left))
            if sigma is not own:
                _, u = self.path.inside(at, (sigma - left) / (right - left))
            return q, u * pace
        return self.path.q(own), self.path.u(sigma) * pace  # a break of the path inside a piece

    def slowed(self, factor: float) -> RetimedTrajectory:
        """The same path in `factor` times the time."""
        clock = BPoly(self.clock.c, self.clock.x * factor)
        return RetimedTrajectory(self.path, self.length, clock, self.stations)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form."""
        return {
            "kind": self.kind,
            "path": self.path.to_dict(),
            "length": curve_to_dict(self.length),
            "clock": curve_to_dict(self.clock),
            "stations": self.stations.tolist(),
        }

    @classmethod
    def from_dict(cls, system: TriangularSystem, data: Mapping[str, Any]) -> RetimedTrajectory:
        """Read back what `to_dict` wrote."""
        path = trajectory_from_dict(system, data["path"])
        length, clock = curve_from_dict(data["length"]), curve_from_dict(data["clock"])
        return cls(path, length, clock, np.asarray(data["stations"], dtype=float))

    @cached_property
    def _inverse(self) -> Inverse:
        return Inverse(self.length)

    @cached_property
    def _rate(self) -> BPoly:
        return self.clock.derivative()

    def place(self, t: ArrayLike) -> Array:
        """The path's own time σ at t, on the side of each break that t belongs to."""
        times = self._clip(t)
        low, high = self._between(times)
        found = self._inverse(self.clock(times), low, high)
        return np.where(times < self.duration, found, high)

    def time_of(self, sigma: float) -> float:
        """The time at which the path's own time is σ."""
        k = int(
            np.clip(np.searchsorted(self.stations, sigma, "right") - 1, 0, len(self.clock.x) - 2)
        )
        s, (low, high) = float(self.length(sigma)), self.clock.x[k : k + 2]
        for _ in range(60):  # bisection, to rounding
            middle = (low + high) / 2
            low, high = (middle, high) if self.clock(middle) < s else (low, middle)
        return float((low + high) / 2)

    def _between(self, times: Array) -> tuple[Array, Array]:
        k = np.searchsorted(self.clock.x, times, side="right") - 1
        k = np.minimum(k, len(self.stations) - 2)
        return self.stations[k], self.stations[k + 1]

    def _pace(self, t: ArrayLike) -> tuple[Array, Array]:
        """σ and dσ/dt (…, 1) at t."""
        times = self._clip(t)
        sigma, pace = self._paced(self.place(t), *self._between(times), self._rate(times))
        return sigma, pace * self._running(t)

    def _paced(self, sigma: Array, low: Array, high: Array, rate: Array) -> tuple[Array, Array]:
        """σ and dσ/dt (…, 1) for a clock that runs at `rate` there, between stations.

        Where the path itself stands still dσ/dt is infinite and its product with the path's inputs
        has a limit, taken a little further inside the piece.
        """
        slope = self._inverse.slope
        still = slope(sigma) <= 1e-9 * self.length.c[-1, -1] / self.length.x[-1]
        if np.any(still):
            nudge = 1e-7 * (high - low)
            sigma = np.where(still, np.clip(sigma, low + nudge, high - nudge), sigma)
        return sigma, (rate / slope(sigma))[..., None]
