"""The two servo motors: a velocity loop with lag, limits, gain error and bias.

    reference r = clip((1 + gain error) · command + bias, ± velocity limit)
    first order:   ω̇ = b (r − ω)                    b = servo_bandwidth_rad_s
    second order:  ω̈ = b² (r − ω) − 2 ζ b ω̇         ζ = servo_damping

Between the points of a step both are solved exactly for a linear reference. Then speed and
acceleration are clipped to their limits; this is of first order in the step in which a limit
becomes active, and exact in all others. The bias acts while a plan runs; afterwards the drive
stands still.

The file also integrates over a step from values at its points. Held commands have two, the ends
(trapezoidal rule, order 2: at 1 to 3 ms its error is far below every effect); continuous commands
have the middle too (Simpson's rule, order 4).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from planner.machine.machine import Draws
from planner.support.arrays import Array

SPEED_TOLERANCE_RAD_S = 1e-12
"""Difference of two speeds that count as equal, rad/s."""

LagFactors = tuple[Array, ...]


class Servos:
    """Both servo motors of S machines, at rest at first.

    Attributes:
        saturated_s: Time for which the command of each motor exceeded its limit, (2, S), s.
    """

    def __init__(self, draws: Draws) -> None:
        self._shape = shape = (2, draws.count)
        self._gain = 1.0 + draws["input_gain_error"]
        self._bias = draws["input_bias_rad_s"]
        self._limit = np.broadcast_to(draws["velocity_limit_rad_s"], shape)
        self._ramp = draws["acceleration_limit_rad_s2"]
        self._bandwidth = draws["servo_bandwidth_rad_s"]
        self._limited = draws.has_effect("velocity_limit_rad_s")
        self._ramped = draws.has_effect("acceleration_limit_rad_s2")
        self._lagging = draws.has_effect("servo_bandwidth_rad_s")
        self._direct = not self._lagging and not self._ramped
        second = self._lagging and draws.has_effect("servo_damping")
        self._damping = draws["servo_damping"] if second else None
        self._speed = np.zeros(shape)
        self._slope = np.zeros(shape)
        self._lags: dict[float, LagFactors] = {}
        self._command, self._running = np.full((3, 2, 1), np.nan), False
        self._target: list[Array] = []
        self._over: Array | None = None
        self.saturated_s = np.zeros(shape)

    def step(self, command: Array, h: float, running: bool) -> tuple[Array, Array]:
        """Advance the motors by one time step.

        Args:
            command: At the step's P points (2: its ends; 3: the middle too), (P, 2, S or 1), rad/s.
            h: Length of the step, s.
            running: Whether a plan is being executed.

        Returns:
            Speed at the points, (P, 2, S), rad/s; travel from the start to each later point, (P−1,
            2, S), rad.
        """
        if not (running is self._running and np.array_equal(command, self._command)):
            self._command, self._running = command, running
            self._target, self._over = self._reference(command, running)
        if self._over is not None:
            self.saturated_s += h * self._over
        if self._direct:
            r = np.stack(self._target)
            return r, np.stack(integrals(r, h))
        count = len(command)
        speed, travel = np.empty((count, *self._shape)), np.empty((count - 1, *self._shape))
        speed[0] = self._speed
        for i, (r0, r1) in enumerate(pairwise(self._target)):
            travel[i] = self._advance(r0, r1, h / (count - 1))
            speed[i + 1] = self._speed
        if count > 2:
            travel[1] += travel[0]
        return speed, travel

    def _reference(self, command: Array, running: bool) -> tuple[list[Array], Array | None]:
        """Return the reference speeds (2, S) at each point of a step, and which of them are clipped
        (None if none is)."""
        is_constant = bool(np.all(command == command[0]))
        r = self._gain * command[:1] if is_constant else self._gain * command
        if running:
            r = r + self._bias
        excess = np.abs(r[len(r) // 2]) > self._limit
        r = np.broadcast_to(np.clip(r, -self._limit, self._limit), (len(r), *self._shape))
        points = [r[0]] * len(command) if is_constant else list(r)
        return points, excess if excess.any() else None

    def _advance(self, r0: Array, r1: Array, h: float) -> Array:
        """Advance the motors by h s for a reference from r0 to r1; return travels, (2, S), rad."""
        before = self._speed
        second = self._damping is not None
        free, travel = (self._second_order if second else self._first_order)(r0, r1, h)
        new = np.clip(free, -self._limit, self._limit) if second and self._limited else free
        if self._ramped:
            most = self._ramp * h
            new = before + np.minimum(np.maximum(new - before, -most), most)
        self._speed = new
        if new is free:
            return travel
        if not self._lagging:  # allow for the time that it takes to reach the reference
            travel = travel - (r0 - before) * np.abs(r0 - before) / (2 * self._ramp)
        is_held = np.abs(new - free) > SPEED_TOLERANCE_RAD_S
        if not is_held.any():
            return travel
        if second:
            self._slope = np.where(is_held, (new - before) / h, self._slope)
        return np.where(is_held, (before + new) * (h / 2), travel)

    def _first_order(self, r0: Array, r1: Array, h: float) -> tuple[Array, Array]:
        """Return speed and travel of first-order servos after h seconds: ω = p + (ω₀ − p₀) e^{−bh}
        with the particular solution p = r − ṙ/b."""
        (decay,) = self._lag(h)
        if r0 is r1:
            gap = self._speed - r0
            left = gap * decay
            return r1 + left, r1 * h + (gap - left) / self._bandwidth
        behind = (r1 - r0) / (h * self._bandwidth)
        gap = self._speed - r0 + behind
        left = gap * decay
        travel = (r0 + r1) * (h / 2) - behind * h + (gap - left) / self._bandwidth
        return r1 - behind + left, travel

    def _second_order(self, r0: Array, r1: Array, h: float) -> tuple[Array, Array]:
        """Return speed and travel of second-order servos; with bandwidth
        b and damping ζ the particular solution is r − 2ζṙ/b."""
        assert self._damping is not None
        e11, e12, e21, e22 = self._lag(h)
        b, twice = self._bandwidth, 2 * self._damping / self._bandwidth
        rate = (r1 - r0) / h
        x, y = self._speed - r0 + twice * rate, self._slope - rate
        left, left_slope = e11 * x + e12 * y, e21 * x + e22 * y
        self._slope = left_slope + rate
        swing = (y - left_slope) / b**2 + twice * (x - left)
        travel = (r0 + r1) * (h / 2) - twice * rate * h + swing
        return r1 - twice * rate + left, travel

    def _lag(self, h: float) -> LagFactors:
        if h not in self._lags:
            if self._damping is None:
                self._lags[h] = (np.exp(-self._bandwidth * h),)
            else:
                self._lags[h] = _oscillator(self._bandwidth, self._damping, h)
        return self._lags[h]


def _oscillator(b: Array, damping: Array, h: float) -> LagFactors:
    """Return the four entries of the matrix exp([[0, 1], [−b², −2ζb]] h), for any damping ζ
    (complex roots included)."""
    root = b * np.sqrt((damping**2 - 1).astype(complex))
    slow, fast = np.exp((root - damping * b) * h), np.exp((-root - damping * b) * h)
    cosh = ((slow + fast) / 2).real
    double = np.abs(root * h) < 1e-6
    safe = np.where(double, 1.0, root)
    sinh = np.where(double, h * cosh, ((slow - fast) / (2 * safe)).real)
    spin = damping * b * sinh
    return cosh + spin, sinh, -(b**2) * sinh, cosh - spin


def integrals(f: Array, h: float) -> list[Array]:
    """Return the integrals of a function from the start of a step to each of its later points.

    Args:
        f: Values at the 2 or 3 equally spaced points, along the first axis.
        h: Length of the step.

    Returns:
        With two points the integral to the end; with three those to the middle (exact for
        parabolas) and to the end (exact for cubics). Shapes are those of f without its first axis.
    """
    if len(f) == 2:
        return [(h / 2) * (f[0] + f[1])]
    return [(5 * h / 24) * f[0] + (8 * h / 24) * f[1] - (h / 24) * f[2], to_end(f, h)]


def to_end(f: Array, h: float) -> Array:
    """Return the integral of a function over a whole step; for f and h see `integrals`."""
    if len(f) == 2:
        return np.asarray((h / 2) * (f[0] + f[1]))
    return np.asarray((h / 6) * (f[0] + f[2]) + (4 * h / 6) * f[1])
