"""Some samples of a machine in motion: the loop over steps, in NumPy, for any plant."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.machine.chain import Chain
from planner.machine.command import Orders
from planner.machine.direct import Direct
from planner.machine.draw import Draws
from planner.machine.dynamic import DynamicChain
from planner.machine.grid import Steps, lengths
from planner.machine.machine import Machine
from planner.machine.servo import Servos
from planner.plan import Plan
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator

REPORT_EVERY = 250
"""Steps between two reports of progress."""


class Plant(Protocol):
    """What the motors move."""

    @property
    def q(self) -> Array:
        """Coordinates, (N, S)."""

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by h seconds under motor speeds (P, 2, S) and travels (P−1, 2, S)."""


class Motion(Protocol):
    """S samples that advance together and can be looked at in between.

    Attributes:
        q: Recorded coordinates, (S, R, N).
        speed: Recorded speeds of the motors, (S, R, 2).
        deviation: Largest |true − plan| so far of each coordinate after the first, (S, N−1).
        saturated_s: Seconds so far for which each motor was asked for more than its limit, (S, 2).
    """

    q: Array
    speed: Array

    @property
    def now(self) -> Array:
        """Coordinates, (N, S)."""

    @property
    def deviation(self) -> Array:
        """See the class."""

    @property
    def saturated_s(self) -> Array:
        """See the class."""

    def advance(self, last: int, tell: Steps | None = None) -> None:
        """Go on from where it stands to the point `last` of the command's grid."""


class Stepwise:
    """A `Motion` that steps any plant, all samples at once.

    Args:
        plan: The plan.
        machine: What the samples have in common.
        draws: The machines.
        orders: What the servos are told, and the grid of M steps.
        desired: The plan's coordinates after the first at the grid's points, (M+1, N−1, 1); NaN
            where no deviation counts.
        rows: Which points of the grid to record, increasing; the first is 0, the last M.
        start: True coordinates at the start, (N, S).
    """

    def __init__(
        self,
        plan: Plan,
        machine: Machine,
        draws: Draws,
        orders: Orders,
        desired: Array,
        rows: NDArray[np.int64],
        start: Array,
    ) -> None:
        self._orders, self._desired = orders, desired
        self._rows = {int(k): row for row, k in enumerate(rows)}
        self._lengths = lengths(orders.t)
        self._servos = Servos(draws)
        self._plant = plant(plan, machine, draws, start)
        self._k = 0
        self._gap = np.nan_to_num(np.abs(start[1:] - desired[0]))
        self.q = np.empty((draws.count, len(rows), len(start)))
        self.speed = np.empty((draws.count, len(rows), 2))

    @property
    def now(self) -> Array:
        """See `Motion`."""
        return self._plant.q

    @property
    def deviation(self) -> Array:
        """See `Motion`."""
        return np.asarray(self._gap.T)

    @property
    def saturated_s(self) -> Array:
        """See `Motion`."""
        limited = self._plant.limited_s if isinstance(self._plant, DynamicChain) else 0.0
        return np.asarray((self._servos.saturated_s + limited).T)

    def advance(self, last: int, tell: Steps | None = None) -> None:
        """See `Motion`."""
        orders, end = self._orders, len(self._lengths)
        for k in range(self._k, last):
            h = self._lengths[k]
            speed, travel = self._servos.step(orders.at(k), h, bool(orders.running[k]))
            self._record(k, speed[0])
            self._plant.step(speed, travel, h)
            gap = np.abs(self._plant.q[1:] - self._desired[k + 1])
            np.fmax(self._gap, gap, out=self._gap)
            if tell and (k + 1) % REPORT_EVERY == 0:
                tell(k + 1)
            if k + 1 == end:
                self._record(end, speed[-1])
        self._k = last

    def _record(self, k: int, speed: Array) -> None:
        row = self._rows.get(k)
        if row is not None:
            if isinstance(self._plant, DynamicChain):
                speed = self._plant.motor_rates  # not what the drives aim at
            self.q[:, row] = self._plant.q.T
            self.speed[:, row] = speed.T


def plant(plan: Plan, machine: Machine, draws: Draws, start: Array) -> Plant:
    """What the motors move: the disk chain of a manipulator, or the bare system of any other."""
    system = plan.problem.system
    if isinstance(system, Manipulator) and machine.fidelity == "dynamic":
        return DynamicChain(system, draws, start)
    if isinstance(system, Manipulator):
        return Chain(system, draws, start)
    return Direct(system, start)
