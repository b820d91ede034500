"""The nominal machine: what the commands that are already on their way will do.

Commands act as if late by the known delay and lag; a motor that reverses first crosses the mean
play of its gearhead. Everything else that the machine does to a motion is left to the feedback.
Since the systems are driftless, what counts is how far each motor has been told to turn, not when.
"""

from __future__ import annotations

import numpy as np

from planner.machine import Machine
from planner.systems.base import Array, TriangularSystem
from planner.systems.manipulator import Manipulator


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
