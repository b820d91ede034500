"""Closed loop: who reads the encoders now and then, and commands the motors."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.machine.draw import Draws
from planner.machine.machine import Machine
from planner.plan import Plan
from planner.systems.base import Array, TriangularSystem


class Controller(Protocol):
    """Commands S samples that follow a plan together.

    Times are the plan's: 0 where it starts. Before the first command and after the last the motors
    are told to rest.

    Attributes:
        period_s: Time between two readings, s.
        tick_s: How long each command is held, s; the period is a multiple of it.
        lead_s: How long before the plan's start it begins, s, ≥ 0.
        end_s: When its last command ends, s.
        fallbacks: How often it had to command something cruder than it should, shape (S,).
    """

    period_s: float
    tick_s: float
    lead_s: float
    end_s: float
    fallbacks: NDArray[np.int64]

    def __call__(self, t: float, measured: Array) -> Array:
        """What the motors are told in the M ticks from t until the next reading.

        Args:
            t: Now, s.
            measured: What the encoders read (see `measured`), (N, S).

        Returns:
            Speeds before delay, resolution and limits of the drive, shape (M, 2, S), rad/s.
        """


class Feedback(Protocol):
    """Makes controllers."""

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Controller:
        """A fresh controller of the samples `numbers` (S,), of which it knows the machine's kind.

        Nothing that it is given tells one sample from another but what the encoders read.
        """


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
