"""The tracker's clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.machine import Machine
from planner.schema.feedback import FeedbackTable

DEFAULT_TICK_S = 0.01
"""How long a command is held when the machine does not say, s."""


@dataclass(frozen=True)
class Timing:
    """When the tracker reads and commands, and when that acts.

    Attributes:
        begin: Time of its first reading, s; 0 is the plan's start.
        tick: How long a command is held, s.
        ticks: Ticks a period, M.
        latency: Ticks from a reading to the first command that follows from it.
        shift: From a command to its effect, s: the machine's mean delay and its servos' lag.
    """

    begin: float
    tick: float
    ticks: int
    latency: int
    shift: float

    @property
    def period(self) -> float:
        """Time between two readings, s."""
        return self.tick * self.ticks

    @property
    def dead(self) -> float:
        """From a reading to the effect of what follows from it, s."""
        return self.latency * self.tick + self.shift


def timing(options: FeedbackTable, machine: Machine, lead_s: float) -> Timing:
    """The clock for a machine, which starts `lead_s` before the plan.

    Raises:
        InputError: If the period is shorter than the machine's control period, or no longer than
            the latency.
    """
    held = machine.effects.get("control_period_s")
    longest = held.value[0] if held else min(DEFAULT_TICK_S, options.period_s)
    if options.period_s < longest * (1 - 1e-9):
        raise InputError(
            f"feedback.period_s = {options.period_s:g}: commands are held for the machine's"
            f" control_period_s = {longest:g} s; it must be at least that"
        )
    ticks = int(np.ceil(options.period_s / longest - 1e-9))
    tick = options.period_s / ticks
    latency = int(np.ceil(options.latency_s / tick - 1e-9))
    if latency > ticks:
        raise InputError(
            f"feedback.latency_s = {options.latency_s:g}: must be at most the period,"
            f" feedback.period_s = {options.period_s:g}"
        )
    begin = -options.period_s * int(np.ceil(lead_s / options.period_s - 1e-9))
    return Timing(begin, tick, ticks, latency, _shift(machine))


def _shift(machine: Machine) -> float:
    """Mean delay, and the lag of the slower servo: 1/b, or 2ζ/b of a second-order loop, s."""
    effects = machine.effects
    delay = float(np.mean(effects["delay_s"].value)) if "delay_s" in effects else 0.0
    if "servo_bandwidth_rad_s" not in effects:
        return delay
    lag = 1 / np.array(effects["servo_bandwidth_rad_s"].value)
    if "servo_damping" in effects:
        lag = lag * 2 * np.array(effects["servo_damping"].value)
    return delay + float(np.max(lag))
