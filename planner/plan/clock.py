"""Map the machine's time to the plan's time while a machine runs a plan's commands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from planner.support.arrays import Array, floats

RATE_TOLERANCE = 1e-6
"""Largest difference of a clock's rate from 0 or 1 that rounding of time steps explains."""


@dataclass(frozen=True)
class Clock:
    """A piecewise linear map from the machine's time to the plan's time.

    The plan's clock runs at the machine's rate or stands still. It stands still while backlash and
    torsion are taken up, before the plan starts and where its drive reverses, and after its end.

    Attributes:
        t: The machine's times at which the rate changes, and both ends, shape (m,), s, from 0.
        s: The plan's times at the times `t`, shape (m,), s.
    """

    t: tuple[float, ...]
    s: tuple[float, ...]

    @classmethod
    def running(cls, seconds: float) -> Clock:
        """Return the clock of a plan without holds that lasts `seconds`."""
        return cls((0.0, seconds), (0.0, seconds))

    @classmethod
    def with_holds(cls, seconds: float, holds: Iterable[tuple[float, float]]) -> Clock:
        """Return the clock of a plan that is held at some of its times.

        Args:
            seconds: Duration of the plan, s.
            holds: Pairs of plan time and length of the hold, s.
        """
        t, s = [0.0], [0.0]

        def advance(until: float, more: float) -> None:
            rate_now = until > s[-1]
            if more <= 0:
                return
            if len(t) > 1 and (s[-1] > s[-2]) == rate_now:
                t[-1], s[-1] = t[-1] + more, until
            else:
                t.append(t[-1] + more)
                s.append(until)

        for place, length in sorted(holds, key=lambda hold: hold[0]):
            advance(place, place - s[-1])
            advance(place, length)
        advance(seconds, seconds - s[-1])
        return cls(tuple(t), tuple(s))

    @property
    def flaw(self) -> str:
        """Reason why the map is not a valid clock; empty for a valid clock."""
        if not (len(self.t) == len(self.s) >= 2 and self.t[0] == self.s[0] == 0):
            return "t and s must have equally many entries, both from 0"
        steps = np.diff(self.t)
        if not np.all(steps > 0):
            return "the machine's times must increase"
        rates = np.diff(self.s) / steps
        if not np.all(np.minimum(np.abs(rates), np.abs(rates - 1)) <= RATE_TOLERANCE):
            return "the plan's clock must run at the machine's rate or be held"
        return ""

    def __call__(self, t: ArrayLike) -> Array:
        """Return the plan's times at the machine's times t (…), s; constant outside the ends."""
        return np.asarray(np.interp(floats("t", t), self.t, self.s))

    def when(self, s: float) -> float:
        """Return the machine's time at which the plan's clock shows s.

        If the clock is held at s, this is the end of the hold (for s = 0, of the preparatory
        motion), but the start of the hold for the plan's end.
        """
        last = self.s[-1]
        if s >= last:
            return self.t[self.s.index(last)]
        k = int(np.searchsorted(self.s, s, side="right")) - 1
        return self.t[k] + s - self.s[k]

    @property
    def seconds(self) -> float:
        """The plan's duration, s: the clock's last value."""
        return self.s[-1]

    @property
    def lead_s(self) -> float:
        """Duration of the hold before the plan starts, s."""
        return self.when(0.0)

    @property
    def tail_s(self) -> float:
        """Duration of the hold after the plan's end, s."""
        return self.t[-1] - self.when(self.seconds)

    @property
    def hold_s(self) -> float:
        """Duration of all holds together, s."""
        return self.t[-1] - self.seconds

    @property
    def holds(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each hold during the plan, in the machine's time, s."""
        steps = zip(pairwise(self.t), pairwise(self.s), strict=True)
        held = [((a, b), s) for (a, b), (before, s) in steps if s - before < (b - a) / 2]
        return tuple(times for times, s in held if 0 < s < self.seconds)
