"""Motion of the nominal machine under commands: a simulation without spreads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.machine.machine import Machine, draw
from planner.machine.replay import SETTLE_S
from planner.machine.simulate import Progress, simulate
from planner.plan.clock import Clock
from planner.plan.plan import Plan
from planner.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted motion of the nominal machine.

    Attributes:
        t: Times no farther apart than the longest step of a simulation, shape (R,), s.
        q: Coordinates at these times, shape (R, N).
        end: Coordinates once the servos have settled, shape (N,); for the first see `end_of`.
        deviation: Largest |q − wanted q| over time of the coordinates after the first, (N−1,).
        end_state: State of backlash and shafts at rest after the plan, see `Replay.end_state`.
    """

    t: Array
    q: Array
    end: Array
    deviation: Array
    end_state: Array

    @property
    def error_deg(self) -> float:
        """E of the nominal machine (eq. 29), degrees."""
        return float(np.rad2deg(self.deviation.max()))

    def q_at(self, times: Array) -> Array:
        """Return the coordinates (…, N) at times (…), interpolated linearly between the steps."""
        return np.stack([np.interp(times, self.t, q) for q in self.q.T], axis=-1)


def predict(plan: Plan, machine: Machine, progress: Progress | None = None) -> Prediction:
    """Simulate a plan's inputs on the nominal machine.

    Args:
        plan: A plan; only its start, its inputs and the wanted motion are used.
        machine: The machine; its spreads are ignored.
        progress: See `planner.machine.replay.replay`.
    """
    nominal = machine.nominal()
    draws = draw(nominal, plan.problem.system.size - 1, np.zeros(1, dtype=np.int64), 0)
    run = simulate(
        plan, nominal, draws, settle_s=SETTLE_S, record_s=machine.step_s, progress=progress
    )
    end = end_of(run.t, run.q, plan.clock)[0]
    return Prediction(run.t, run.q[0], end, run.deviation[0], run.end_state[0])


def end_of(t: Array, q: Array, clock: Clock) -> Array:
    """Return the coordinates at the end, (S, N), of motions q (S, R, N) at times t (R,).

    The travel of the path coordinate while the clock is held, before and during the plan, is left
    out: it is lost motion and moves no joint.
    """
    end = q[:, -1].copy()
    for begin, until in [(0.0, clock.lead_s), *clock.holds]:
        for k, path in enumerate(q[:, :, 0]):
            end[k, 0] -= np.diff(np.interp([begin, until], t, path))[0]
    return end
