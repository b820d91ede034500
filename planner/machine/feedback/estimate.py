"""What the encoders tell: the coordinates, and how much faster than planned each joint is driven.

Two ideas. An angle is known to one step of its encoder, so the forecast is moved into the interval
that a reading leaves, and not further (F. C. Schweppe, *Recursive state estimation: unknown but
bounded errors and system inputs*, IEEE Transactions on Automatic Control 13, 1968): an angle in
motion is known better than its encoder's resolution. And a passive joint that is in contact moves
(1 + ε) times as far as forecast, ε being what gears and creep make of its ratio: a Kalman filter
(B. D. O. Anderson, J. B. Moore, *Optimal Filtering*, 1979, section 3.1) with the states angle and ε
finds it. A reading that does not fit says that the joint is in its play: ε is left as it is.

The nominal machine: what the commands that are already on their way will do.

Commands act as if late by the known delay and lag; a motor that reverses first crosses the mean
play of its gearhead. Everything else that the machine does to a motion is left to the feedback.
Since the systems are driftless, what counts is how far each motor has been told to turn, not when.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.machine.machine import Machine
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

RATE_SPREAD = 0.01
"""Standard deviation expected of ε."""

CORRELATED = 2.0
"""By how much the variance of rounding is taken larger: slow joints stay in one step for long."""

UNMODELLED = float(np.deg2rad(0.003))
"""Standard deviation of what moves a joint besides, rad a period."""

EXACT = 1e-9
"""Standard deviation of a reading without resolution, in the coordinate's unit."""

FITTING = 3.0
"""Standard deviations within which a reading fits."""


class Estimate:
    """Coordinates of S samples.

    Args:
        system: The system.
        q: Coordinates expected at the start, (N, S).
        resolution: Smallest step of each reading, (N, 1), in the coordinates' units; 0 is exact,
            infinite is not measured.

    Attributes:
        q: The estimate, (N, S).
        rate_error: ε of the passive coordinates, (N−2, S).
    """

    def __init__(self, system: TriangularSystem, q: Array, resolution: Array) -> None:
        self.q = q
        shape = (system.size - 2, q.shape[1])
        self.rate_error = np.zeros(shape)
        self._half = resolution / 2
        self._noise = CORRELATED * resolution[2:] ** 2 / 12 + EXACT**2
        self._var_q = np.repeat(self._noise, q.shape[1], axis=1)
        self._cov, self._var_e = np.zeros(shape), np.full(shape, RATE_SPREAD**2)
        self._fitted = np.zeros(shape, dtype=bool)

    def predicted(self, q: Array) -> None:
        """Take over a forecast (N, S) that knows nothing of ε."""
        moved = q[2:] - self.q[2:]
        self.q = q.copy()
        self.q[2:] += self.rate_error * moved
        self._var_q = self._var_q + moved * (2 * self._cov + moved * self._var_e) + UNMODELLED**2
        self._cov = self._cov + moved * self._var_e

    def read(self, measured: Array) -> None:
        """Take in a reading (N, S), NaN where it is lost."""
        self._filter(measured[2:] - self.q[2:], np.isnan(measured[2:]))
        inside = np.clip(self.q, measured - self._half, measured + self._half)
        self.q = np.where(np.isnan(measured), self.q, inside)

    def _filter(self, surprise: Array, lost: NDArray[np.bool_]) -> None:
        """Correct angle and ε by the difference (N−2, S) between reading and forecast."""
        total = self._var_q + self._noise
        fits = np.abs(surprise) <= FITTING * np.sqrt(total)
        both = fits & self._fitted
        gain_q, gain_e = self._var_q / total, self._cov / total
        self.q[2:] += np.where(fits & ~lost, gain_q * surprise, 0.0)
        self.rate_error = self.rate_error + np.where(both, gain_e * surprise, 0.0)
        self._var_e = np.where(both, self._var_e - gain_e * self._cov, self._var_e)
        self._cov = np.where(both, self._cov * (1 - gain_q), np.where(lost, self._cov, 0.0))
        var_q = np.where(fits, self._var_q * (1 - gain_q), self._noise)
        self._var_q = np.where(lost, self._var_q, var_q)
        self._fitted = np.where(lost, self._fitted, fits)


class History:
    """What S samples have been told, tick by tick, from the first reading on.

    Args:
        tick: Length of a tick, s.
        first: Commands of the first ticks, (m, 2), the same for all.
        count: Number of samples S.
    """

    def __init__(self, tick: float, first: Array, count: int) -> None:
        self._tick = tick
        self._values: list[Array] = []
        self._travel = [np.zeros((2, count))]
        self.append(np.repeat(first[:, :, None], count, axis=2))

    @property
    def last(self) -> Array:
        """The command of the last tick, (2, S); zero at first."""
        return self._values[-1] if self._values else np.zeros_like(self._travel[0])

    def append(self, values: Array) -> None:
        """Add commands of further ticks, (m, 2, S)."""
        for value in values:
            self._values.append(value)
            self._travel.append(self._travel[-1] + self._tick * value)

    def ticks(self, first: int, count: int) -> Array:
        """Commands of some ticks, (count, 2, S); zero after the last one told."""
        none = np.zeros_like(self._travel[0])
        known = self._values[first : first + count]
        return np.stack(known + [none] * (count - len(known)))

    def travel(self, times: Array) -> Array:
        """How far each motor has been told to turn until its own time (2,), (2, S)."""
        if not self._values:
            return self._travel[0]
        position = np.clip(times / self._tick, 0.0, len(self._values))
        whole = np.minimum(np.floor(position + 1e-9).astype(int), len(self._values) - 1)
        out = [
            self._travel[k][i] + (x - k) * self._tick * self._values[k][i]
            for i, (k, x) in enumerate(zip(whole, position, strict=True))
        ]
        return np.stack(out)


def gearhead_play(system: TriangularSystem, machine: Machine) -> Array:
    """Whole play of each motor's gearhead, shape (2, 1), rad; only the arm has gearheads."""
    effect = machine.effects.get("gearhead_backlash_deg")
    if effect is None or not isinstance(system, Manipulator):
        return np.zeros((2, 1))
    return np.asarray(np.deg2rad(np.broadcast_to(effect.value, 2))[:, None])


class Forecast:
    """Predicts S samples.

    Args:
        system: The system.
        play: Whole play of each motor, (2, 1), rad.
        tick: Longest step of integration, s.
    """

    def __init__(self, system: TriangularSystem, play: Array, tick: float) -> None:
        self._system, self._half, self._tick = system, play / 2, tick

    def __call__(
        self, q: Array, side: Array, done: Array, until: Array, history: History
    ) -> tuple[Array, Array]:
        """Where S samples will be.

        Args:
            q: Coordinates when each motor has carried out what it was told until `done` (2,), s;
                shape (N, S).
            side: Where in its play each motor stands, (2, S), rad; ±half the play is in contact.
            done: Times since the first reading, (2,), s.
            until: Times until which the motors' commands are carried out, (2,), s.
            history: The commands.

        Returns:
            Coordinates and sides then.
        """
        count = max(1, int(np.ceil(np.max(until - done) / self._tick - 1e-9)))
        before = history.travel(done)
        for part in np.arange(1, count + 1) / count:
            after = history.travel(done + part * (until - done))
            q, side = self._turn(q, side, after - before)
            before = after
        return q, side

    def _turn(self, q: Array, side: Array, travel: Array) -> tuple[Array, Array]:
        moved = side + travel
        side = np.clip(moved, -self._half, self._half)
        past = (moved - side).T
        middle = q.T + self._system.rates(q.T, past) / 2
        return q + self._system.rates(middle, past).T, side
