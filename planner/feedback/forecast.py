"""The nominal machine: what the commands that are already on their way will do.

Commands act as if late by the known delay and lag; a motor that reverses first crosses the mean
play of its gearhead. Everything else that the machine does to a motion is left to the feedback.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.feedback.timing import Timing
from planner.machine import Machine
from planner.systems.base import Array, TriangularSystem
from planner.systems.manipulator import Manipulator

Commands = Callable[[int], Array]
"""From a tick's number to its commands (2, S)."""


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
        timing: The tracker's clock.
        play: Whole play of each motor, (2, 1), rad.
    """

    def __init__(self, system: TriangularSystem, timing: Timing, play: Array) -> None:
        self._system, self._timing, self._half = system, timing, play / 2

    def __call__(
        self, q: Array, side: Array, start: float, end: float, told: Commands
    ) -> tuple[Array, Array]:
        """Where S samples will be.

        Args:
            q: Coordinates at `start`, (N, S).
            side: Where in its play each motor stands, (2, S), rad; ±half the play is in contact.
            start: Time since the tracker's first reading, s.
            end: Likewise.
            told: Commands by tick; asked only for those that act in between.

        Returns:
            Coordinates and sides at `end`.
        """
        tick, shift = self._timing.tick, self._timing.shift
        now, last = start - shift, end - shift
        index = int(np.floor(now / tick + 1e-9))
        while now < last - 1e-9 * tick:
            following = min((index + 1) * tick, last)
            if index >= 0:
                q, side = self._move(q, side, told(index), following - now)
            now, index = following, index + 1
        return q, side

    def _move(self, q: Array, side: Array, u: Array, h: float) -> tuple[Array, Array]:
        moved = side + h * u
        side = np.clip(moved, -self._half, self._half)
        past = ((moved - side) / h).T
        middle = q.T + h / 2 * self._system.rates(q.T, past)
        return q + h * self._system.rates(middle, past).T, side
