"""Closed loop: who reads the encoders now and then, and corrects the command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.machine.draw import Draws
from planner.plan import Plan
from planner.systems.base import Array, TriangularSystem

Correct = Callable[[float, Array], Array]
"""From a time, s, and what the encoders read then, (N, S), to what is added to the plan's input
from then until the next reading, (2, S), in the inputs' unit."""


class Feedback(Protocol):
    """Makes controllers.

    Attributes:
        period_s: Time between two readings, s; the first is at the plan's start, the last before
            its end.
    """

    period_s: float

    def start(self, plan: Plan, numbers: NDArray[np.int64]) -> Correct:
        """A fresh controller of the samples `numbers` (S,), which follow `plan` together."""


def readings(feedback: Feedback | None, duration: float) -> Array:
    """When the encoders are read, (K,), s; never without feedback."""
    if feedback is None:
        return np.empty(0)
    count = max(1, int(np.ceil(duration / feedback.period_s - 1e-9)))
    return feedback.period_s * np.arange(count, dtype=np.float64)


def measured(system: TriangularSystem, draws: Draws, q: Array) -> Array:
    """What the encoders read.

    Args:
        system: Says which coordinates are angles.
        draws: The machines, for the resolution of each joint.
        q: True coordinates, (N, S) or (N, R, S).

    Returns:
        The same with the angles after the first at their encoders' resolution.
    """
    out = q.copy()
    steps = np.deg2rad(draws["encoder_resolution_deg"])
    steps = np.broadcast_to(steps, (len(q) - 1, q.shape[-1]))
    for i, coordinate in enumerate(system.coordinates):
        if i and coordinate.unit == "rad":
            step = steps[i - 1]
            rounded = np.round(out[i] / np.where(step > 0, step, 1.0)) * step
            out[i] = np.where(step > 0, rounded, out[i])
    return out
