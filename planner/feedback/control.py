"""The controller of some samples: read, estimate, predict, optimise, command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.feedback.design import Design
from planner.feedback.estimate import Estimate
from planner.feedback.forecast import Forecast
from planner.systems.base import Array


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
        self._told = [np.repeat(u[:, None], count, axis=1) for u in ref.first]
        self._answer = design.programme.none(count)
        self._side = np.zeros((2, count))
        forecast = Forecast(design.system, clock, design.play)
        start = np.repeat(ref.start[:, None], count, axis=1)
        self._forecast = forecast
        self._estimate = Estimate(design.system, start, design.resolution)

    def __call__(self, t: float, measured: Array) -> Array:
        """Commands of the ticks from t to the next reading, (M, 2, S), rad/s.

        Args:
            t: Time of the reading, s; readings come in order, one a period.
            measured: What the encoders read, (N, S); NaN where a reading is lost.
        """
        clock, k = self._clock, self._k
        now = k * clock.period
        estimate = self._estimate
        if k:
            before = now - clock.period
            q, self._side = self._forecast(estimate.q, self._side, before, now, self._tick)
            estimate.predicted(q)
        estimate.read(measured)
        if k < len(self._ref.feed):
            self._decide(k, now)
        self._k += 1
        first = k * clock.ticks
        return np.stack([self._tick(first + m) for m in range(clock.ticks)])

    def _tick(self, index: int) -> Array:
        return self._told[index] if index < len(self._told) else np.zeros_like(self._side)

    def _decide(self, k: int, now: float) -> None:
        """Append the commands of one period, from when they can act."""
        clock, ref = self._clock, self._ref
        q, side = self._forecast(self._estimate.q, self._side, now, now + clock.dead, self._tick)
        w = self._answer.corrections[0]
        state = np.concatenate([q - ref.q[k][:, None], w, self._estimate.rate_error])
        self._answer = self._design.programme(k, state, self._answer)
        self.fallbacks += self._answer.fallback
        v = self._answer.corrections[0]
        share = (np.arange(clock.ticks) + 0.5) / clock.ticks if self._design.ramp else None
        added = v if share is None else w + share[:, None, None] * (v - w)
        commands = self._limited(ref.feed[k][:, :, None] + added)
        self._told += list(self._limited(commands + self._crossing(commands, side)))

    def _crossing(self, commands: Array, side: Array) -> Array:
        """What must be added to reverse a motor through its play, (M, 2, S).

        The crossing is spread over the period. A reversal that would turn less than the play is
        uncertain is not begun: the motor stands until more is asked for.
        """
        clock, half = self._clock, self._design.play / 2
        if not np.any(half):
            return np.zeros_like(commands)
        wanted = clock.tick * commands.sum(axis=0)
        way = np.sign(wanted)
        gap = np.where(way == 0, 0.0, half - way * side)
        worth = np.abs(wanted) > self._design.worth
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
        before = self._told[-1] if self._told else np.zeros_like(commands[0])
        out = []
        for u in commands:
            before = np.clip(u, before - most, before + most)
            out.append(before)
        return np.stack(out)
