"""What the tracker follows: a plan, and a run-up before it where there is one.

The tracker's clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import InputError
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class RunUp:
    """A motion before the plan's start that ends where and as the plan begins.

    Attributes:
        t: Increasing times (m+1,), s; the last is 0.
        q: Coordinates then, (m+1, N).
        u: Inputs between them, (m, 2).
    """

    t: Array
    q: Array
    u: Array


@dataclass(frozen=True, eq=False)
class Course:
    """Coordinates and inputs to follow, at any time; the plan starts at 0.

    Attributes:
        plan: The plan.
        run_up: What comes before it, if anything.
    """

    plan: Plan
    run_up: RunUp | None = None

    @property
    def lead_s(self) -> float:
        """How long before the plan it starts, s."""
        return 0.0 if self.run_up is None else float(-self.run_up.t[0])

    def q(self, t: Array) -> Array:
        """Coordinates (…, N) at times t (…); at rest before and after."""
        out = self.plan.trajectory.q(t)
        if self.run_up is None:
            return out
        before = np.stack(
            [np.interp(t, self.run_up.t, column) for column in self.run_up.q.T], axis=-1
        )
        return np.where((t < 0)[..., None], before, out)

    def u(self, t: Array) -> Array:
        """Inputs (…, 2) at times t (…); zero before and after."""
        out = self.plan.trajectory.u(t)
        if self.run_up is None:
            return out
        index = np.searchsorted(self.run_up.t, t, side="right") - 1
        on = (index >= 0) & (t < 0)
        before = self.run_up.u[np.clip(index, 0, len(self.run_up.u) - 1)]
        return np.where(on[..., None], before, out)


DEFAULT_TICK_S = 0.01
"""How long a command is held when the machine does not say, s."""


@dataclass(frozen=True, eq=False)
class Timing:
    """When the tracker reads and commands, and when that acts.

    Attributes:
        begin: Time of its first reading, s; 0 is the plan's start.
        tick: How long a command is held, s.
        ticks: Ticks a period, M.
        latency: Ticks from a reading to the first command that follows from it.
        shift: From each motor's command to its effect, (2,), s: the machine's mean delay, the lag
            of the servo and, for the drive, that of the joints' viscous friction.
    """

    begin: float
    tick: float
    ticks: int
    latency: int
    shift: Array

    @property
    def period(self) -> float:
        """Time between two readings, s."""
        return self.tick * self.ticks

    @property
    def wait(self) -> float:
        """From a reading to the first command that follows from it, s."""
        return self.latency * self.tick


def timing(
    options: FeedbackTable, system: TriangularSystem, machine: Machine, lead_s: float
) -> Timing:
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
    return Timing(begin, tick, ticks, latency, shift_of(system, machine))


def shift_of(system: TriangularSystem, machine: Machine) -> Array:
    """Delay, lag 1/b of each servo (2ζ/b of second order), and the joints' lag d/k, (2,), s."""
    out = np.full(2, float(np.mean(mean_of(machine, "delay_s"))))
    lag = 1 / mean_of(machine, "servo_bandwidth_rad_s", np.inf)
    if "servo_damping" in machine.effects:
        lag = lag * 2 * mean_of(machine, "servo_damping")
    out += lag
    if isinstance(system, Manipulator):
        stiffness = mean_of(machine, "shaft_stiffness_nm_per_rad", np.inf)
        out[0] += float(np.mean(mean_of(machine, "viscous_friction_nms_per_rad") / stiffness))
    return out


def mean_of(machine: Machine, name: str, off: float = 0.0) -> Array:
    """Mean of an effect, one number or one per motor or joint; `off` where there is none."""
    effect = machine.effects.get(name)
    return np.array([off] if effect is None else effect.value)
