"""The controller of some samples: read, estimate, predict, optimise, command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.feedback.design import Design
from planner.feedback.estimate import Estimate
from planner.feedback.forecast import Forecast, History
from planner.systems.base import Array

AHEAD = 5
"""Periods in which a reversal must be worth crossing the play."""

UNCERTAIN = 0.2
"""How well the play of a gearhead is known: to this part of its mean."""


class Control:
    """One controller of S samples; see `planner.machine.loop.Controller`.

    Args:
        design: What all samples share.
        count: Number of samples S.
    """

    def __init__(self, design: Design, count: int) -> None:
        ref, clock = design.ref, design.ref.timing
        self._design, self._ref, self._clock = design, ref, clock
        self.period_s, self.tick_s = clock.period, clock.tick
        self.lead_s = -clock.begin
        self.end_s = clock.begin + len(ref.feed) * clock.period + clock.latency * clock.tick
        self.fallbacks: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._k = 0
        self._history = History(clock.tick, ref.first, count)
        self._answer = design.programme.none(count)
        self._side = np.zeros((2, count))
        self._forecast = Forecast(design.system, design.play, clock.tick)
        start = np.repeat(ref.start[:, None], count, axis=1)
        self._estimate = Estimate(design.system, start, design.resolution)

    def __call__(self, t: float, measured: Array) -> Array:
        """Commands of the ticks from t to the next reading, (M, 2, S), rad/s.

        Args:
            t: Time of the reading, s; readings come in order, one a period.
            measured: What the encoders read, (N, S); NaN where a reading is lost.
        """
        clock, k = self._clock, self._k
        now, estimate = k * clock.period - clock.shift, self._estimate
        if k:
            before = now - clock.period
            q, self._side = self._forecast(estimate.q, self._side, before, now, self._history)
            estimate.predicted(q)
        estimate.read(measured)
        if k < len(self._ref.feed):
            self._decide(k, now)
        self._k += 1
        return self._history.ticks(k * clock.ticks, clock.ticks)

    def _decide(self, k: int, now: Array) -> None:
        """Add the commands of one period, from when they can act."""
        clock, ref = self._clock, self._ref
        told = np.full(2, k * clock.period + clock.wait)
        q, side = self._forecast(self._estimate.q, self._side, now, told, self._history)
        w = self._answer.corrections[0]
        state = np.concatenate([q - ref.q[k][:, None], w, self._estimate.rate_error])
        self._answer = self._design.programme(k, state, self._answer)
        self.fallbacks += self._answer.fallback
        v = self._answer.corrections[0]
        added = v[None]
        if self._design.ramp:
            share = (np.arange(clock.ticks)[:, None, None] + 0.5) / clock.ticks
            added = w + share * (v - w)
        commands = self._limited(ref.feed[k][:, :, None] + added)
        self._history.append(self._limited(commands + self._crossing(k, commands, side)))

    def _crossing(self, k: int, commands: Array, side: Array) -> Array:
        """What must be added to reverse a motor through its play, (M, 2, S).

        The crossing is spread over the period. It is not begun for less travel than the play is
        uncertain by: the motor stands until the next periods ask for more.
        """
        clock, half = self._clock, self._design.play / 2
        if not np.any(half):
            return np.zeros_like(commands)
        way = np.sign(commands.sum(axis=0))
        gap = np.where(way == 0, 0.0, half - way * side)
        feed = self._ref.feed[k : k + min(AHEAD, self._design.programme.horizon)].mean(axis=1)
        soon = feed[:, :, None] + self._answer.corrections[: len(feed)]
        worth = way * clock.period * soon.sum(axis=0) > UNCERTAIN * 2 * half
        added = np.where(worth, way * gap / clock.period, 0.0)
        stand = ~worth & (gap > half / 2)
        return np.where(stand, -commands, added)

    def _limited(self, commands: Array) -> Array:
        """Within the limits of speed and of its change from tick to tick."""
        limit, rate = self._ref.limit[:, None], self._ref.rate[:, None]
        commands = np.clip(commands, -limit, limit)
        if not np.any(np.isfinite(rate)):
            return commands
        most = rate * self._clock.tick
        before = self._history.last
        out = []
        for u in commands:
            before = np.clip(u, before - most, before + most)
            out.append(before)
        return np.stack(out)
