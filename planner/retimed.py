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
from planner.trajectory import Trajectory, curve_from_dict, curve_to_dict, trajectory_from_dict


@dataclass(frozen=True)
class RetimedTrajectory(Trajectory):
    """q(t) = path.q(σ) with length(σ) = clock(t).

    The system is driftless, so any increasing clock gives a motion along the same path, whose
    inputs are the path's times dσ/dt.

    Attributes:
        path: The trajectory whose path it follows.
        length: BPoly of the length s over the path's own time σ, scalar, increasing.
        clock: BPoly of s over time t, scalar, increasing; it ends at the whole length.
        stations: σ at the clock's breaks, shape (K+1,); every break of `length` is one of them.
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

    @property
    def in_coordinates(self) -> bool:
        """As the path."""
        return self.path.in_coordinates

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

    def _between(self, times: Array) -> tuple[Array, Array]:
        k = np.searchsorted(self.clock.x, times, side="right") - 1
        k = np.minimum(k, len(self.stations) - 2)
        return self.stations[k], self.stations[k + 1]

    def _pace(self, t: ArrayLike) -> tuple[Array, Array]:
        """σ and dσ/dt (…, 1) at t.

        Where the path itself stands still dσ/dt is infinite and its product with the path's inputs
        has a limit, taken a little further inside the piece.
        """
        times, sigma = self._clip(t), self.place(t)
        slope = self._inverse.slope
        still = slope(sigma) <= 1e-9 * self.length.c[-1, -1] / self.length.x[-1]
        if np.any(still):
            low, high = self._between(times)
            nudge = 1e-7 * (high - low)
            sigma = np.where(still, np.clip(sigma, low + nudge, high - nudge), sigma)
        return sigma, (self._rate(times) / slope(sigma))[..., None] * self._running(t)
