"""The manipulator with inertia: two masses an axis, backlash by Nordin and Gutman, real torques.

The gap position is a state of its own (M. Nordin, P.-O. Gutman, Automatica 38, 2002, 1633): with
twist x of the shaft and position b of the axis in its play, |b| <= gap/2,

    x + b = axis − joint,    T = k x + c ẋ,    T in the normal cone of [−gap/2, gap/2] at b

so that T = 0 inside the play and never pulls: the shaft's damping cannot hold the teeth together.
Each servo is a velocity loop around what `servo` makes of the command, with that acceleration fed
forward, integral action and a torque limit; the torque of the load acts back on the motor. Friction
contacts hold up to their capacity; below it they slip by creep_per_nm times torque times rate.
Creep without load counts as a smaller rolling radius: it costs travel and no power.

Stepped by `dynamic.c` where it is compiled, else by `march`, with the same numbers to rounding.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from planner.machine import compiled
from planner.machine.draw import Draws
from planner.machine.march import GAMMA, March, begin
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator


class DynamicChain:
    """S manipulators with inertia.

    Args:
        system: The manipulator as the planner knows it.
        draws: The machines.
        q: Coordinates at the start, (N, S); everything is at rest then.

    Attributes:
        limited_s: Seconds so far at each motor's torque limit, (2, S).
    """

    def __init__(self, system: Manipulator, draws: Draws, q: Array) -> None:
        self._march = march = begin(system, draws, q)
        self._at, self._masses, self._y = march.place, march.data, march.y
        self._shape, self._energy = (2, draws.count), march.energy
        self._compiled, self._last = _compiled(self._march), np.inf
        self.limited_s = np.zeros(self._shape)

    @property
    def q(self) -> Array:
        """Coordinates (φₙ₋₁, θ₁ … θₙ), shape (N, S), rad."""
        return self._y[self._at.q]

    @property
    def motor_rates(self) -> Array:
        """Speeds of the motors, behind their gearheads' ratio, (2, S), rad/s."""
        return self._y[self._at.bodies.motors]

    @property
    def shaft_torque(self) -> Array:
        """Of the shafts into joints 2 … n, springs and damping, (n−1, S), N m."""
        return np.asarray(self._y[self._at.torque][2:])

    @property
    def gap(self) -> Array:
        """Where the axes of joints 2 … n are in their play, (n−1, S), rad; 0 is the middle."""
        return np.asarray(self._y[self._at.gap][2:])

    @property
    def stored_J(self) -> Array:
        """Kinetic energy and that of the shafts, (S,), J."""
        v, twist = self._y[self._at.v], self._y[self._at.twist]
        kinetic = np.sum(self._masses.inertia * v * v, axis=0)
        return np.asarray((kinetic + np.sum(self._masses.stiffness * twist * twist, axis=0)) / 2)

    @property
    def work_J(self) -> Array:
        """Work of the motors so far, (S,), J."""
        return np.asarray(self._energy[0])

    @property
    def lost_J(self) -> Array:
        """What friction, slip and damping took of it, (S,), J; rigid teeth that meet take more."""
        return np.asarray(self._energy[1])

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by a step.

        Args:
            speed: That the motors should have at the step's P points (2 or 3), (P, 2, S), rad/s.
            travel: Likewise, from the start to each later point, (P−1, 2, S), rad.
            h: Length of the step, s.
        """
        mean = np.ascontiguousarray(np.broadcast_to(travel[-1] / h, self._shape))
        swing = np.ascontiguousarray(np.broadcast_to(speed[-1] - speed[0], self._shape))
        lead, self._last = min(1.0, h / self._last) / 2, h
        step = self._compiled or self._march.step
        step(mean, swing, h, lead)
        self.limited_s += h * (self._march.pieces[:2] != 0)


class _Compiled:
    """`March.step` in compiled code."""

    def __init__(self, function: Any, march: March) -> None:
        function.argtypes = [ctypes.c_int64] * 3 + [ctypes.c_double] * 4 + [ctypes.c_void_p] * 7
        kept = (march.table, march.y, march.pieces, march.gained, march.energy)
        self._function, self._k_g, self._arrays = function, march.k_g, kept
        self._size = (len(march.gained), len(march.y))
        self._masses, *self._state = (array.ctypes.data for array in kept)

    def fits(self) -> bool:
        """Whether the compiled code has room for the joints, and the same rows."""
        return not self._function(*self._size, 0, 1.0, 0.5, GAMMA, 1.0, *[None] * 7)

    def __call__(self, mean: Array, swing: Array, h: float, lead: float) -> None:
        """See `March.step`."""
        inputs = (self._masses, mean.ctypes.data, swing.ctypes.data)
        size = (*self._size, mean.shape[1])
        self._function(*size, h, lead, GAMMA, self._k_g, *inputs, *self._state)


def _compiled(march: March) -> _Compiled | None:
    """None where there is no compiled code that fits."""
    function = getattr(compiled.library(), "planner_dynamic_march", None)
    found = _Compiled(function, march) if function is not None else None
    return found if found is not None and found.fits() else None
