"""Closed loop: a controller reads the encoders periodically and commands the motors.

Each command is held for a tick, then delayed and rounded to the servos' resolution.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.commands import ROUNDING, merge_times, quantise, subdivide
from planner.machine.machine import Draws, Machine
from planner.plan.plan import Plan
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem


class Controller(Protocol):
    """Controller of the motors of S machines that follow one plan.

    Time 0 is the plan's start. Before the first command and after the last the command is zero.

    Attributes:
        period_s: Time between two readings, s.
        tick_s: Time for which each command is held, s; the period is a multiple of it.
        lead_s: Time before the plan's start at which the controller begins, s, ≥ 0.
        end_s: Time at which the last command ends, s.
        fallbacks: Number of fallback commands to each machine, shape (S,).
    """

    period_s: float
    tick_s: float
    lead_s: float
    end_s: float
    fallbacks: NDArray[np.int64]

    def __call__(self, t: float, measured: Array) -> Array:
        """Return the commands of the motors in the M ticks from t until the next reading.

        Args:
            t: Present time, s.
            measured: Encoder readings (see `encoder_readings`), (N, S).

        Returns:
            Speeds before delay, resolution and limits of the drive, shape (M, 2, S), rad/s.
        """


class Feedback(Protocol):
    """Feedback law that makes a controller for each replay."""

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Controller:
        """Make a controller for the samples `numbers` (S,) of the machine.

        The controller knows the distribution of the machines; it can distinguish the samples only
        by their encoder readings.
        """


def encoder_readings(system: TriangularSystem, draws: Draws, q: Array, t: float | Array) -> Array:
    """Return the coordinates as the encoders read them: with noise, rounded to the resolution.

    Args:
        system: The system, whose angles after the first coordinate have encoders.
        draws: The machines, for noise and resolution of each joint.
        q: True coordinates, (N, S) or (N, R, S).
        t: Time of the reading, s, or times (R,); the noise depends on it.

    Returns:
        Readings, with the shape of q; coordinates without an encoder are exact.
    """
    out = q.copy()
    if draws.has_effect("encoder_noise_deg"):
        noise = np.stack([draws.noise(x, len(q) - 1) for x in np.ravel(t)], axis=1)
        noise = np.deg2rad(draws["encoder_noise_deg"])[:, None] * noise
        is_angle = np.array([coordinate.unit == "rad" for coordinate in system.coordinates[1:]])
        out[1:][is_angle] += noise.reshape(q[1:].shape)[is_angle]
    steps = np.deg2rad(draws["encoder_resolution_deg"])
    steps = np.broadcast_to(steps, (len(q) - 1, q.shape[-1]))
    for i, coordinate in enumerate(system.coordinates):
        if i and coordinate.unit == "rad":
            step = steps[i - 1]
            rounded = np.round(out[i] / np.where(step > 0, step, 1.0)) * step
            out[i] = np.where(step > 0, rounded, out[i])
    return out


class FeedbackCommand:
    """Commands of one controller on the time grid of the present stretch (part of a run); a
    `CommandGrid`.

    `begin` starts each stretch. Delayed commands of earlier stretches are kept while needed.

    Args:
        controller: The controller, for the times of its readings and commands.
        draws: The machines, for delay and resolution.
        step: Largest step, s.
        until: End of the whole run, s.
        one_delay: Whether all samples, of these and other runs, have the same delay; the grid then
            contains every change of the command. Otherwise a change inside a step takes effect at
            the step's end.

    Attributes:
        t: The grid, shape (M+1,), s; that of the first stretch starts with the controller.
        running: Whether the controller is running in each step, shape (M,).
        readings: Times of the encoder readings in this stretch, shape (K,), s.
    """

    def __init__(
        self, controller: Controller, draws: Draws, step: float, until: float, one_delay: bool
    ) -> None:
        self._tick, self._start = controller.tick_s, -controller.lead_s
        self._end, self._until = controller.end_s, until
        self._step, self._one_delay = step, one_delay
        self._delay = draws["delay_s"][0]
        self._resolution = draws["velocity_resolution_rad_s"][:, :1]
        self._per_reading = round(controller.period_s / self._tick)
        self._count = int(np.ceil((self._end - self._start) / self._tick - 1e-9))
        self._first, self._next, self._values = 0, 0, np.zeros((0, 2, draws.count))
        self._effort = np.zeros(draws.count)

    def begin(self, stops: Array) -> None:
        """Begin the stretch from the first to the last of the times `stops`, all on its grid."""
        is_first, low = not len(self._values), self._next
        periods = (stops[-1] - self._start) / (self._per_reading * self._tick)
        high = min(self._count, int(np.ceil(periods - 1e-6)) * self._per_reading)
        self._next = high = self._count if stops[-1] == self._until else high
        delayed = int(np.ceil(np.max(self._delay) / self._tick))
        self._keep(max(0, low - self._per_reading - delayed - 1), high)
        ticks: Array = self._start + self._tick * np.arange(self._first, high + 1, dtype=np.float64)
        self._reading = low - self._first
        self.readings = ticks[:-1][self._reading :: self._per_reading]
        changes = ticks + self._delay[0] if self._one_delay else ticks[:0]
        changes = changes[(changes < stops[-1]) & (is_first | (changes > stops[0]))]
        self.t = subdivide(merge_times(stops, self.readings, changes), self._step)
        self.running: NDArray[np.bool_] = self.t[:-1] + np.diff(self.t) / 2 < self._end

    def _keep(self, first: int, last: int) -> None:
        """Drop the commands of ticks before `first`; make room for those of ticks up to `last`."""
        dropped, self._first = first - self._first, first
        self._effort += self._effort_of(self._values[:dropped])
        room = np.zeros((last - first, *self._values.shape[1:]))
        room[: len(self._values) - dropped] = self._values[dropped:]
        self._values = room

    def _effort_of(self, values: Array) -> Array:
        return np.asarray(self._tick * np.sum(values**2, axis=(0, 1)))

    @property
    def reading_steps(self) -> list[int]:
        """Return the numbers of the steps at whose start the encoders are read."""
        close = 4 * ROUNDING * max(1.0, float(np.max(np.abs(self.t))))
        return [int(k) for k in np.searchsorted(self.t, self.readings - close)]

    @property
    def effort(self) -> Array:
        """∫ u₁² + u₂² dt of the commands so far, shape (S,)."""
        return self._effort + self._effort_of(self._values)

    def set_command(self, i: int, values: Array) -> None:
        """Set the commands (M, 2, S) of the M ticks after reading `i` of the stretch.

        Raises:
            InputError: If a number is not finite, or the shape is wrong.
        """
        first = self._reading + i * self._per_reading
        room = self._values[first : first + self._per_reading]
        expected = (self._per_reading, *room.shape[1:])
        if values.shape != expected:
            raise InputError(f"feedback returns shape {values.shape}; it must be {expected}")
        if not np.all(np.isfinite(values)):
            raise InputError(
                f"feedback returns a command that is not finite at t = {self.readings[i]:.6g} s"
            )
        room[:] = values[: len(room)]

    def block(self, first: int, last: int) -> Array:
        """Return the commands in the steps first ≤ k < last; see `CommandGrid`."""
        times = self.t[first:last, None] - self._delay - self._start
        index = np.floor(times / self._tick + 1e-9).astype(np.int64)
        inside = (index >= 0) & (index < self._count)
        index = np.where(inside, index - self._first, 0)
        if index.shape[1] == 1 or np.all(index == index[:, :1]):
            commands = self._values[index[:, 0]]
        else:
            samples = np.arange(self._values.shape[2])
            commands = np.moveaxis(self._values[index, :, samples], -1, 1)
        commands = quantise(np.where(inside[:, None], commands, 0.0), self._resolution)
        return np.broadcast_to(commands[:, None], (len(commands), 2, *commands.shape[1:]))
