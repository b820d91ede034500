"""Simulate S samples step by step in NumPy, for any plant.

`StepwiseMotion` records coordinates and motor speeds at the times asked for, and over all steps the
largest deviations, saturation and gross slip, as the C files do.

A plant is a system driven by the motor speeds directly (`KinematicPlant`), the quasi-static
manipulator (`DiskChain`), or the manipulator with inertia (`DynamicChain`), which has two masses
per axis. There the position in the gap is a state (M. Nordin, P.-O. Gutman, Automatica 38, 2002,
1633): with twist x of the shaft and position b of the axis in its play, |b| <= gap/2,

    x + b = axis − joint,    T = k x + c ẋ,    T in the normal cone of [−gap/2, gap/2] at b

so that T = 0 inside the play and never pulls: the shaft's damping cannot hold the teeth together.
Each servo is a velocity loop with integral action and a torque limit. Its reference is the output
of `servos`, whose acceleration is fed forward; the load's torque acts on the motor. Below their
capacity friction contacts slip by creep_per_nm times torque times rate, and by more where they are
turned (see `contacts`). Creep without load acts as a smaller rolling radius: it costs travel but no
power.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.machine.commands import CommandGrid, Steps, lengths
from planner.machine.disk_chain import DiskChain
from planner.machine.machine import Draws, Machine
from planner.machine.march import begin_march
from planner.machine.servos import Servos
from planner.plan.plan import Plan
from planner.support.arrays import Array
from planner.support.calculus import runge_kutta
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

REPORT_EVERY = 250
"""Number of steps between two reports of progress."""


class Plant(Protocol):
    """The mechanism of S samples, from motor speeds to coordinates."""

    @property
    def q(self) -> Array:
        """Coordinates, (N, S)."""

    @property
    def slipping(self) -> Array:
        """Number of the contact in gross slip, (S,), or −1; see `contacts.contact_name`."""

    @property
    def lead(self) -> Array:
        """See `MachineMotion.lead`."""

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance the mechanism by h s under motor speeds (P, 2, S) and travels (P−1, 2, S)."""


class MachineMotion(Protocol):
    """S machines simulated together, whose state can be read between the steps.

    A run has one or more stretches; `begin` starts each.

    Attributes:
        q: Coordinates at the R recorded points of the stretch, (S, R, N).
        speed: Recorded speeds of the motors, (S, R, 2), rad/s.
        deviation: Largest |true − plan| so far of each coordinate after the first, (S, N−1).
        slip: Time so far with a contact in gross slip, s; step of the stretch in which it began;
            number of that contact (see `contacts.contact_name`); (S, 3), the last two −1 if no
            contact slipped.
    """

    q: Array
    speed: Array
    deviation: Array
    slip: Array

    @property
    def coordinates(self) -> Array:
        """Present coordinates, (N, S)."""

    @property
    def lead(self) -> Array:
        """Present angles of an arm's motor 1 before the first disk, and of each joint's axis before
        the joint, (1+n, S), rad; zeros for other systems, (N, S)."""

    @property
    def saturated_s(self) -> Array:
        """Time so far for which the command of each motor exceeded its limit, (S, 2), s."""

    def begin(self, orders: CommandGrid, desired: Array, rows: NDArray[np.int64]) -> None:
        """Begin a stretch where the one before ended.

        Args:
            orders: Commands of the servos on the grid of M steps.
            desired: The plan's coordinates after the first at the grid's points, (M+1, N−1, 1); NaN
                where deviations are ignored.
            rows: Indices of the grid points to record, increasing.
        """

    def advance(self, last: int, tell: Steps | None = None) -> None:
        """Simulate up to the point `last` of the stretch's grid; `tell` reports the steps done."""


class StepwiseMotion:
    """Simulation of any plant in NumPy, all samples at once; a `MachineMotion`.

    Args:
        plan: The plan.
        machine: The parameters that all samples share.
        draws: The machines.
        start: True coordinates at the start, (N, S).
    """

    def __init__(self, plan: Plan, machine: Machine, draws: Draws, start: Array) -> None:
        self._servos = Servos(draws)
        self._plant = plant(plan, machine, draws, start)
        self.deviation = np.zeros((draws.count, len(start) - 1))
        self.slip = np.tile([0.0, -1.0, -1.0], (draws.count, 1))

    def begin(self, orders: CommandGrid, desired: Array, rows: NDArray[np.int64]) -> None:
        """Begin a stretch where the one before ended; see `MachineMotion.begin`."""
        self._orders, self._desired, self._k = orders, desired, 0
        self._rows = {k: row for row, k in enumerate(rows.tolist())}
        self._lengths = lengths(orders.t).tolist()
        start, count = self._plant.q, len(self.slip)
        np.fmax(self.deviation, np.abs(start[1:] - desired[0]).T, out=self.deviation)
        self.q = np.empty((count, len(rows), len(start)))
        self.speed = np.empty((count, len(rows), 2))

    @property
    def coordinates(self) -> Array:
        """Present coordinates, (N, S)."""
        return self._plant.q

    @property
    def lead(self) -> Array:
        """Present angles of motors and axes before what they drive, see `MachineMotion.lead`."""
        return self._plant.lead

    @property
    def saturated_s(self) -> Array:
        """Time so far for which the command of each motor exceeded its limit, (S, 2), s."""
        limited = self._plant.limited_s if isinstance(self._plant, DynamicChain) else 0.0
        return np.asarray((self._servos.saturated_s + limited).T)

    def advance(self, last: int, tell: Steps | None = None) -> None:
        """Simulate up to the point `last` of the stretch's grid."""
        orders, end = self._orders, len(self._lengths)
        for k in range(self._k, last):
            h = self._lengths[k]
            speed, travel = self._servos.step(orders.block(k, k + 1)[0], h, bool(orders.running[k]))
            self._record(k, speed[0])
            self._plant.step(speed, travel, h)
            slipping = np.broadcast_to(self._plant.slipping, len(self.slip))
            if (slips := slipping >= 0).any():
                new = slips & (self.slip[:, 1] < 0)
                self.slip[new, 1], self.slip[new, 2] = k, slipping[new]
                self.slip[slips, 0] += h
            gap = np.abs(self._plant.q[1:] - self._desired[k + 1])
            np.fmax(self.deviation, gap.T, out=self.deviation)
            if tell and (k + 1) % REPORT_EVERY == 0:
                tell(k + 1)
            if k + 1 == end:
                self._record(end, speed[-1])
        self._k = last

    def _record(self, k: int, speed: Array) -> None:
        row = self._rows.get(k)
        if row is not None:
            if isinstance(self._plant, DynamicChain):
                speed = self._plant.motor_rates  # true speeds, not the drives' references
            self.q[:, row] = self._plant.q.T
            self.speed[:, row] = speed.T


def plant(plan: Plan, machine: Machine, draws: Draws, start: Array) -> Plant:
    """Return the plant of a plan: a manipulator's disk chain, with or without inertia, or the
    kinematics of another system."""
    system = plan.problem.system
    if isinstance(system, Manipulator) and machine.fidelity == "dynamic":
        return DynamicChain(system, draws, start)
    if isinstance(system, Manipulator):
        return DiskChain(system, draws, start)
    return KinematicPlant(system, start)


class KinematicPlant:
    """S copies of a system without gears, integrated by the classical Runge–Kutta method.

    Args:
        system: The system.
        q: Coordinates at the start, (N, S).
    """

    def __init__(self, system: TriangularSystem, q: Array) -> None:
        self._system = system
        self._q = q.T.copy()
        self.slipping = np.full(q.shape[1], -1.0)

    @property
    def q(self) -> Array:
        """Coordinates, shape (N, S)."""
        return self._q.T

    @property
    def lead(self) -> Array:
        """See `MachineMotion.lead`."""
        return np.zeros(self._q.T.shape)

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance the copies by h seconds under motor speeds (P, 2, S) at the step's points.

        Without a middle point (P = 2) the speeds are assumed linear. `travel` is ignored.
        """
        points = np.swapaxes(speed, 1, 2)
        start, end = points[0], points[-1]
        speeds = start, points[1] if len(points) > 2 else (start + end) / 2, end
        self._q = runge_kutta.step(lambda q, k: self._system.rates(q, speeds[k]), self._q, h)


class DynamicChain:
    """Motion of S manipulators with inertia.

    Args:
        system: The manipulator as the planner knows it.
        draws: The machines.
        q: Coordinates at the start, (N, S); everything is at rest then.

    Attributes:
        q: Coordinates (φₙ₋₁, θ₁ … θₙ), shape (N, S), rad.
        slipping: Number of the contact in gross slip, (S,), or −1; see `contacts.contact_name`.
        motor_rates: Motor speeds at the output of their gearheads, (2, S), rad/s.
        limited_s: Time so far that each motor spent at its torque limit, (2, S), s.
    """

    def __init__(self, system: Manipulator, draws: Draws, q: Array) -> None:
        self._march = march = begin_march(system, draws, q)
        self._place, self._y, self._last = march.place, march.y, np.inf
        # Views of the state, which the march changes in place.
        self.q, self.slipping = self._y[self._place.q], march.slipping[0]
        self.motor_rates = self._y[self._place.bodies.motors]
        self._shape = (2, draws.count)
        self.limited_s = np.zeros(self._shape)

    @property
    def lead(self) -> Array:
        """See `MachineMotion.lead`."""
        return self._y[self._place.gap] + self._y[self._place.twist]

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance the manipulators by one time step.

        Args:
            speed: Reference of the motor speeds at the step's P points (2 or 3), (P, 2, S), rad/s.
            travel: Reference of the travel from the start to each later point, (P−1, 2, S), rad.
            h: Length of the step, s.
        """
        mean = np.broadcast_to(travel[-1] / h, self._shape)
        swing = np.broadcast_to(speed[-1] - speed[0], self._shape)
        lead, self._last = min(1.0, h / self._last) / 2, h
        self._march.step(mean, swing, h, lead)
        self.limited_s += h * (self._march.pieces[:2] != 0)
