"""Motions of the nominal machine under corrections of the motors' angles at knots.

Corrections are linear between knots. Variants of them run in one simulation, which gives for each
the errors of joints over time, the misses of goal and waypoints, and the margins of requirements.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from planner.machine.feedback.run_up import REST_S
from planner.machine.feedforward.legs import stopping_s
from planner.machine.feedforward.prediction import end_of
from planner.machine.feedforward.shaping import CommandShape
from planner.machine.machine import Machine
from planner.machine.replay import SETTLE_S
from planner.machine.simulate import simulate_variants
from planner.plan.plan import Plan
from planner.problem.requirements.requirement import MotionPoint
from planner.support.arrays import Array

KNOTS, HOLD_KNOT_S = 20, 0.4
"""Number of linear parts of a correction over the plan, and their largest length in a hold, s."""

ROWS = 150
"""Number of instants at which errors count, over the plan and its holds."""

SAFE = 0.01
"""Least margin of a requirement, in the requirement's scale: room for lower values between the
sampling times, which are only a few per second."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Errors and margins of the motions of S variants of a correction.

    Attributes:
        errors: Errors of the joints, shape (S, E), degrees.
        pins: Misses of goal and waypoints, (S, P), degrees.
        margins: Margins of requirements on coordinates minus `SAFE`, (S, B), in their scales.
    """

    errors: Array
    pins: Array
    margins: Array

    def __getitem__(self, k: int) -> Runs:
        return Runs(self.errors[k], self.pins[k], self.margins[k])


class Variants:
    """Motions of the nominal machine under variants of a correction of a plan's commands.

    Args:
        plan: The plan whose motion is wanted.
        machine: The machine to compensate for.
        shape: The plan's commands without a correction.

    Attributes:
        shape: The given shape.
        knots: Times of the knots, (m,), s; the correction is zero at the first.
    """

    def __init__(self, plan: Plan, machine: Machine, shape: CommandShape) -> None:
        self._plan, self._machine, self.shape = plan, machine.nominal(), shape
        coarse = self._machine.with_(velocity_resolution_rad_s=False)
        self._coarse = replace(coarse, step_s=max(machine.step_s, shape.tick / 2))
        clock = shape.clock
        self._begin, self._end = clock.lead_s, clock.t[-1] - stopping_s(plan, machine)
        if any(np.any(leg.angles) for leg in shape.legs if leg.place_s == plan.duration):
            self._end = clock.when(plan.duration)  # ignore the drive's intended way back after it
        self.knots = self._place_knots()
        marks = [0.0, self._begin, self._end, *np.ravel(clock.holds), clock.t[-1] + SETTLE_S]
        marks += [clock.when(time_s) for _, time_s in self._pins]
        rows = np.linspace(self._begin, clock.t[-1], ROWS)
        self._times = np.unique(np.round(np.concatenate([marks, rows]), 9))
        self._is_in_plan = self._times >= self._begin - 1e-9
        target = plan.trajectory.q(clock(self._times))
        self._reference = target[self._is_in_plan, 1:]

    def _place_knots(self) -> Array:
        """Return the times of the knots, s: evenly over the plan, and more densely in the holds."""
        clock, spacing = self.shape.clock, self._plan.duration / KNOTS
        holds = set(clock.holds)
        holds |= {(clock.when(clock.seconds), self._end)}
        cuts = sorted({self._begin, self._end, *np.ravel(list(holds)).tolist()})
        knots = [] if self._begin == 0 else [max(0.0, self._begin - REST_S)]
        for a, b in pairwise(cuts):
            longest = min(spacing, HOLD_KNOT_S) if (a, b) in holds else spacing
            parts = int(np.ceil((b - a) / longest - 1e-9))
            knots += (a + (b - a) * np.arange(parts) / parts).tolist()
        return np.array([*knots, self._end])

    @cached_property
    def _pins(self) -> list[tuple[Array, float]]:
        """Coordinates (N,) of each waypoint, NaN where free, with its time in the plan, s."""
        problem, out = self._plan.problem, []
        for point in problem.waypoints:
            when = point.time_s
            if when is None:
                t = np.linspace(0.0, self._plan.duration, 2001)
                when = float(t[np.argmin(point.distance(self._plan.trajectory.q(t)))])
            out.append((point.q, when))
        return out

    def run(self, corrections: Array, is_sent: bool = False) -> Runs:
        """Simulate the nominal machine under variants of the correction.

        Args:
            corrections: Corrections at the knots, (m, 2, S), rad.
            is_sent: Whether to simulate the rounded commands on the machine itself; else smoother
                commands on a model with larger time steps.
        """
        shape, machine = self.shape, self._machine if is_sent else self._coarse
        values = shape.commands(corrections, self.knots, is_rounded=is_sent)
        is_linear = shape.is_linear and not machine.effects.get("control_period_s")  # or held
        q = simulate_variants(self._plan, machine, shape.t, values, is_linear, self._times)
        return self._judge(q)

    def _judge(self, q: Array) -> Runs:
        problem, count = self._plan.problem, len(q)
        errors = q[:, self._is_in_plan, 1:] - self._reference
        end = end_of(self._times, q, self.shape.clock) - self._goal
        pins = [end[:, int(np.isnan(problem.goal[0])) :]]
        for place, time_s in self._pins:
            there = np.searchsorted(self._times, self.shape.clock.when(time_s) - 1e-9)
            pins.append((q[:, there] - place)[:, ~np.isnan(place)])
        margins = [np.empty((count, 0))]
        for requirement in problem.requirements:
            if requirement.reads == {"q"}:
                values = requirement.values(MotionPoint.of(problem.system, q))
                for part, value in zip(requirement.parts, values, strict=True):
                    if np.isfinite(part.low):
                        margins.append((value - part.low) / part.scale - SAFE)
                    if np.isfinite(part.high):
                        margins.append((part.high - value) / part.scale - SAFE)
        missed, margin = (np.concatenate(each, axis=1) for each in (pins, margins))
        return Runs(np.rad2deg(errors.reshape(count, -1)), np.rad2deg(missed), margin)

    @cached_property
    def _goal(self) -> Array:
        """Coordinates of the goal, (N,), with the plan's end values for free coordinates."""
        goal = self._plan.problem.goal
        return np.where(np.isnan(goal), self._plan.trajectory.q(self._plan.duration), goal)

    def slopes(self, values: Array, probe: float) -> Runs:
        """Return the derivatives of errors, pins and margins by the corrections at the knots after
        the first, (2(m−1), …), per degree.

        They are central differences: where a joint rests inside its play, a change of one sign
        moves nothing, and one of the other does.

        Args:
            values: The corrections, (m, 2), rad.
            probe: Change of one knot for the finite difference, rad.
        """
        count = 2 * (len(self.knots) - 1)
        probes = np.repeat(values[:, :, None], 2 * count, axis=2)
        k = np.arange(count)
        probes[1 + k // 2, k % 2, k] += probe
        probes[1 + k // 2, k % 2, count + k] -= probe
        runs, step = self.run(probes), 2 * np.rad2deg(probe)
        each = runs.errors, runs.pins, runs.margins
        return Runs(*((part[:count] - part[count:]) / step for part in each))
