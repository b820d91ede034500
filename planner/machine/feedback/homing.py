"""Homing with the encoders: the slow turn of the drive ends once every passive joint has risen.

The plan of `planner.homing` gives the times between which a controller may end that turn, and the
rise which proves that every axis is ahead of its joint. Noise requires a larger rise
(`RISE_SPREADS`). The controller needs no model of the machine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import ABOVE_ZERO, InputError, expect_number
from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.machine import Machine
from planner.plan.plan import Plan, refuse_inexecutable
from planner.support.arrays import Array, floats

RISE_SPREADS = 10.0
"""Least rise, in standard deviations of the encoders' noise: the least and the largest of some
hundred readings of a joint at rest differ by six."""


class HomingRule:
    """Feedback law that runs a plan of `planner.homing`, for `planner.replay`."""

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> HomingController:
        """Return a controller of the samples `numbers` (S,).

        Raises:
            InputError: If the plan was not made by `planner.homing`.
        """
        return HomingController(plan, machine, len(numbers))


class HomingController:
    """Controller that runs a homing plan on S samples (`planner.machine.closed_loop.Controller`).

    Attributes:
        done_s: Time at which each sample ended the slow turn, (S,), s; infinite until then.
    """

    def __init__(self, plan: Plan, machine: Machine, count: int) -> None:
        if "until" not in plan.notes:
            raise InputError(f"this {plan.method} plan was not made by planner.homing(problem)")
        hold = machine.effects.get("control_period_s")
        self.period_s = self.tick_s = hold.value[0] if hold else DEFAULT_TICK_S
        self.lead_s, self.end_s = 0.0, plan.duration
        self.fallbacks = np.zeros(count, dtype=np.int64)
        self.done_s = np.full(count, np.inf)
        self._u, self._until = plan.trajectory.u, plan.notes["until"]
        noise_deg = float(np.max(machine.mean("encoder_noise_deg")))
        self._rise = np.deg2rad(max(self._until["rise_deg"], RISE_SPREADS * noise_deg))
        self._least: Array = np.full((1, count), np.inf)

    def __call__(self, t: float, measured: Array) -> Array:
        """Return the motor speeds to command in the tick from t on, (1, 2, S), rad/s."""
        until, joints = self._until, measured[2:]
        if t >= until["count_from_s"]:
            self._least = np.fmin(self._least, joints)  # NaN: no reading
        if until["from_s"] <= t < until["to_s"]:
            risen = np.all(joints - self._least > self._rise, axis=0)
            self.done_s = np.where(risen, np.minimum(self.done_s, t), self.done_s)
        return np.asarray(self._u(t + self.left_out_s).T[None])

    @property
    def left_out_s(self) -> Array:
        """Time of the slow turn that the encoders have cut off so far, (S,), s."""
        return np.asarray(self._until["to_s"] - np.minimum(self.done_s, self._until["to_s"]))


class Player:
    """Commands of a plan, period by period, for the loop of your own controller.

    A motion of `planner.homing` ends its slow turn by the encoders; other plans ignore them. The
    last command is zero, however late it is asked for, because many controllers hold it. When the
    time goes back to the beginning, a new run begins.

    Args:
        plan: An executable plan.
        period_s: Time for which the motors hold a command, s.
        noise_deg: Noise of the encoders, degrees, which sets the rise that ends the slow turn.

    Raises:
        InputError: If the plan is not executable, or the period is not above 0.
    """

    def __init__(
        self, plan: Plan, period_s: float = DEFAULT_TICK_S, noise_deg: float = 0.0
    ) -> None:
        refuse_inexecutable(plan)
        expect_number("period_s", period_s, "a time > 0, in seconds", ABOVE_ZERO)
        self._plan, self._period_s, self._noise_deg = plan, period_s, noise_deg
        self._begin()

    def _begin(self) -> None:
        self._rule, self._moves, self._time_s = None, True, 0.0
        if "until" in self._plan.notes:
            machine = Machine.ideal(encoder_noise_deg=self._noise_deg)
            self._rule = HomingController(self._plan, machine, 1)

    def __call__(self, t_s: float, theta_deg: ArrayLike) -> Array | None:
        """Return the commands to both motors, (2,), rad/s, from `t_s` on; None after the end.

        Args:
            t_s: Time since the start, s.
            theta_deg: Readings of the encoders, (n,), degrees; NaN where there is none.

        Raises:
            InputError: If the time is not a finite number, or a motion of `planner.homing` gets
                other than n readings.
        """
        expect_number("t_s", t_s, "a time, in seconds", -math.inf)
        if t_s < self._time_s / 2:
            self._begin()
        self._time_s, middle = t_s, t_s + self._period_s / 2
        if self._rule is not None:
            read, joints = floats("theta_deg", theta_deg), self._plan.problem.system.size - 1
            if read.shape != (joints,):
                raise InputError(f"theta_deg = {theta_deg!r:.60}: give {joints} readings")
            self._rule(t_s, np.deg2rad([0.0, *read])[:, None])
            middle += float(self._rule.left_out_s[0])
        moved, self._moves = self._moves, middle <= self._plan.duration
        if self._moves:
            return np.asarray(self._plan.trajectory.u(middle))
        return np.zeros(2) if moved else None
