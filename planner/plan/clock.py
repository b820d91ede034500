"""What a plan's own clock reads while a machine runs its commands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from planner.support.arrays import Array

RATE_TOLERANCE = 1e-6
"""By how much the clock's rate may differ from 0 or 1: sums of ticks are rounded."""


@dataclass(frozen=True)
class Clock:
    """A piecewise linear map from the machine's time to the plan's.

    The plan's clock runs as the machine's does, or is held: while lost motion is taken up before
    the plan starts and where its drive turns back, and after its end.

    Attributes:
        t: The machine's times where its rate changes, and both ends, shape (m,), s, from 0.
        s: What it reads then, shape (m,), s.
    """

    t: tuple[float, ...]
    s: tuple[float, ...]

    @classmethod
    def running(cls, seconds: float) -> Clock:
        """The clock of a plan without holds."""
        return cls((0.0, seconds), (0.0, seconds))

    @classmethod
    def held(cls, seconds: float, holds: Iterable[tuple[float, float]]) -> Clock:
        """The clock of a plan of so many seconds.

        Args:
            seconds: Of the plan.
            holds: What the clock reads while it is held, and for how long, s.
        """
        t, s = [0.0], [0.0]

        def go_on(until: float, more: float) -> None:
            rate_now = until > s[-1]
            if more <= 0:
                return
            if len(t) > 1 and (s[-1] > s[-2]) == rate_now:
                t[-1], s[-1] = t[-1] + more, until
            else:
                t.append(t[-1] + more)
                s.append(until)

        for place, length in sorted(holds, key=lambda hold: hold[0]):
            go_on(place, place - s[-1])
            go_on(place, length)
        go_on(seconds, seconds - s[-1])
        return cls(tuple(t), tuple(s))

    @property
    def flaw(self) -> str:
        """Why this is no such map, in words; empty if it is one."""
        if not (len(self.t) == len(self.s) >= 2 and self.t[0] == self.s[0] == 0):
            return "it must have times of the machine and of the plan, from 0"
        steps = np.diff(self.t)
        if not np.all(steps > 0):
            return "the machine's times must increase"
        rates = np.diff(self.s) / steps
        if not np.all(np.minimum(np.abs(rates), np.abs(rates - 1)) <= RATE_TOLERANCE):
            return "the plan's clock must run as the machine's or be held"
        return ""

    def __call__(self, t: ArrayLike) -> Array:
        """What it reads at the machine's times t (…), s; outside as at the ends."""
        return np.asarray(np.interp(np.asarray(t, dtype=float), self.t, self.s))

    def when(self, s: float) -> float:
        """When it leaves what it reads, s, in the machine's time; at the plan's end, comes there.

        The start of the plan is when the preparation is over.
        """
        last = self.s[-1]
        if s >= last:
            return self.t[self.s.index(last)]
        k = int(np.searchsorted(self.s, s, side="right")) - 1
        return self.t[k] + s - self.s[k]

    @property
    def seconds(self) -> float:
        """What it reads in the end, s: the plan's duration."""
        return self.s[-1]

    @property
    def lead_s(self) -> float:
        """How long it is held before the plan starts, s."""
        return self.when(0.0)

    @property
    def tail_s(self) -> float:
        """How long it is held after the plan's end, s."""
        return self.t[-1] - self.when(self.seconds)

    @property
    def holds(self) -> tuple[tuple[float, float], ...]:
        """From when until when it is held on the way, in the machine's time, s."""
        return tuple(
            (a, b)
            for (a, b), (before, after) in zip(pairwise(self.t), pairwise(self.s), strict=True)
            if after - before < (b - a) / 2 and 0 < after < self.seconds
        )
