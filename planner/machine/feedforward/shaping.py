"""Compute the commands, tick by tick, with which a machine makes the plan's motion.

The computation uses the motors' angles as functions of time. The wanted angle of a motor is

    the plan's angle at the plan's time, or a leg's angle while that time is paused,
    plus the correction,
    advanced in time by the lag of hold, delay, servo and viscous friction,
    plus half of the gearhead's backlash in the direction of its motion.

This angle jumps at each reversal of a gearhead. A motor cannot follow a jump; it moves to the new
angle as fast as the limits of the plan allow. Commands are held for a tick and rounded to the
motors' resolution; the next tick makes up for the rounding error of the angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.machine.feedback.course import DEFAULT_TICK_S, turn_angles
from planner.machine.feedback.means import gearhead_play, input_limit, shift_of
from planner.machine.feedforward.legs import MOST_AWAYS_DEG, legs_of, start_shares
from planner.machine.machine import Machine
from planner.plan.clock import Clock
from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.tables.problem_file import CompensationTable
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class MotorCommands:
    """Commands of both motors, tick by tick.

    Attributes:
        t: Ends of the ticks, shape (K+1,), s, from 0.
        u: Commands in each tick, shape (K, 2), rad/s.
        clock: The plan's clock.
        is_linear: Whether inputs are linear from the beginning of one tick to the next, as limits
            on their rates require; else they are held.
    """

    t: Array
    u: Array
    clock: Clock
    is_linear: bool = False

    def trajectory(self, system: TriangularSystem, q: Array) -> StateTrajectory:
        """Return the trajectory with these commands as inputs and with coordinates q (K+1, N) at
        the ends of the ticks."""
        after = np.concatenate([self.u[1:], self.u[-1:]]) if self.is_linear else self.u
        q_curve = Bernstein(np.stack([q[:-1], q[1:]]), self.t)
        return StateTrajectory(system, q_curve, Bernstein(np.stack([self.u, after]), self.t))


class CommandShape:
    """The commands of one plan for one machine, as functions of a correction of the motors' angles.

    Args:
        plan: An executable plan.
        system: The plan's arm.
        machine: The machine to compensate for, by its means and its `start_state`.
        options: Which steps of the compensation are on.
        most_away: See `legs_of`.

    Attributes:
        tick: Length of a tick, s.
        legs: Motions of the motors while the plan's clock is held.
        clock: The plan's clock.
        t: Ends of the ticks, shape (K+1,), s.
        is_linear: See `MotorCommands`.
        limit: Largest |u|, (2,), rad/s.
    """

    def __init__(
        self,
        plan: Plan,
        system: Manipulator,
        machine: Machine,
        options: CompensationTable,
        most_away: float = MOST_AWAYS_DEG[0],
    ) -> None:
        hold = machine.effects.get("control_period_s")
        self.tick = tick = hold.value[0] if hold else DEFAULT_TICK_S
        self._sides = start_shares(machine, system)[:2]
        self.legs = legs = legs_of(plan, system, machine, options, tick, most_away)
        holds = [(leg.place_s, leg.seconds(tick)) for leg in legs]
        self.clock = Clock.with_holds(plan.duration, holds)
        ticks = int(np.ceil(self.clock.t[-1] / tick - 1e-9))
        self.t: Array = tick * np.arange(1 + ticks, dtype=np.float64)
        self.t[-1] = self.clock.t[-1]
        self.limit = input_limit(plan, machine)
        self._rate = plan.problem.limits.input_rate
        self.is_linear = bool(np.any(np.isfinite(self._rate)))
        ahead = shift_of(system, machine) if options.lag else np.zeros(2)
        if self.is_linear and not hold:  # linear inputs act half a tick earlier than held ones
            ahead = ahead - tick / 2
        self._times = tick * np.arange(len(self.t))[:, None] + ahead
        self._angle = self._angles(plan)
        self._half = gearhead_play(system, machine) / 2 * options.gearheads
        self._grain = np.broadcast_to(machine.mean("velocity_resolution_rad_s"), 2)

    def _angles(self, plan: Plan) -> Array:
        """Return the wanted angles of the motors, (K+1, 2), rad, advanced by the lag."""
        times, turned = turn_angles(plan, self.tick)
        out = np.empty((len(self.t), 2))
        for i in range(2):
            out[:, i] = np.interp(self.clock(self._times[:, i]), times, turned[:, i])
        earlier = 0.0
        for leg in self.legs:
            begin = leg.place_s + earlier
            ticks = begin + self.tick * np.arange(len(leg.angles))
            for i in range(2):
                out[:, i] += np.interp(self._times[:, i], ticks, leg.angles[:, i])
            earlier += leg.seconds(self.tick)
        return out

    def commands(self, corrections: Array, knots: Array, is_rounded: bool = True) -> Array:
        """Return the commands of the motors in each tick, (K, 2, S), rad/s.

        Args:
            corrections: Corrections of the motors' angles at the knots, shape (m, 2, S), rad.
            knots: Times of the knots, (m,), s.
            is_rounded: Whether commands are rounded to the motors' resolution, as when sent.
        """
        angle = self._angle[:, :, None] + self._interpolate(corrections, knots)
        return self._pursue(angle, self._grain if is_rounded else np.zeros(2))

    def _interpolate(self, corrections: Array, knots: Array) -> Array:
        """Return the angles (K+1, 2, S) that corrections (m, 2, S) at the knots add, linear between
        knots."""
        out = np.empty((len(self.t), 2, corrections.shape[2]))
        for i in range(2):
            k = np.clip(np.searchsorted(knots, self._times[:, i], "right"), 1, len(knots) - 1)
            x = (self._times[:, i] - knots[k - 1]) / (knots[k] - knots[k - 1])
            x = np.clip(x, 0.0, 1.0)[:, None]
            out[:, i] = (1 - x) * corrections[k - 1, i] + x * corrections[k, i]
        return out

    def _pursue(self, angle: Array, grain: Array) -> Array:
        """Return the speeds (K, 2, S) of motors that follow wanted angles from 0 within their
        limits.

        Args:
            angle: Wanted angles at the gearheads' output at ends of ticks, (K+1, 2, S), rad.
            grain: Resolution of the speeds, (2,), rad/s; 0 for none.
        """
        if np.any(self._half):
            angle = angle + _ahead_of_play(angle, self._half, self._sides)
        tick, limit, rate = self.tick, self.limit[:, None], self._rate[:, None]
        if not np.any(np.isfinite(rate)):
            return self._pursue_by_speed(angle, grain[:, None])
        place = np.zeros(angle.shape[1:])
        is_free = ~np.isfinite(self._rate)  # a motor without a limit may stop at once
        step, room = (np.where(is_free[:, None], 0.0, by * rate) for by in (tick, 8.0))
        most, square = np.where(is_free[:, None], math.inf, step), step * step
        grain, rounded = grain[:, None], bool(np.any(grain))
        out = np.zeros((len(angle) - 1, *place.shape))
        speed = np.zeros_like(place)
        for k, now in enumerate(angle[1:-1], 1):  # the first command is zero: motors start at rest
            behind = now - place
            far = np.abs(behind)
            stopping = (np.sqrt(square + room * far) - step) / 2  # in whole ticks
            stopping[is_free] = math.inf
            catch = np.copysign(np.minimum(far / tick, stopping), behind)
            low, high = np.maximum(-limit, speed - most), np.minimum(limit, speed + most)
            speed = np.minimum(np.maximum((angle[k + 1] - now) / tick + catch, low), high)
            if rounded:
                speed = round_to_grid(speed, low, high, grain)
            place = place + speed * tick
            out[k] = speed
        return out

    def _pursue_by_speed(self, angle: Array, grain: Array) -> Array:
        """Return the speeds as `_pursue`, without limits on changes of speed; `grain` is (2, 1)."""
        tick, limit = self.tick, self.limit[:, None]
        place = np.zeros(angle.shape[1:])
        if np.any(grain):
            safe, most = np.where(grain > 0, grain, 1.0), round_to_grid(limit, -limit, limit, grain)
            out = np.empty((len(angle) - 1, *place.shape))
            for k, then in enumerate(angle[1:]):
                speed = (then - place) / tick
                speed = np.where(grain > 0, safe * np.round(speed / safe), speed)
                out[k] = np.minimum(np.maximum(speed, -most), most)
                place = place + out[k] * tick
            return out
        places, most = np.empty_like(angle), np.broadcast_to(limit * tick, place.shape).copy()
        places[0], low, high = place, np.empty_like(place), np.empty_like(place)
        for before, then, place in zip(places, angle[1:], places[1:], strict=False):
            np.subtract(before, most, out=low)
            np.add(before, most, out=high)
            np.minimum(np.maximum(then, low, out=low), high, out=place)
        return np.diff(places, axis=0) / tick


def _ahead_of_play(angle: Array, half: Array, side: Array) -> Array:
    """Return the angles to add to motor angles (K+1, 2, S) to allow for backlash of ± `half` (2,).

    Each motor begins at the position `side` (2,) of its play, −1 … 1, and keeps it while at rest.
    """
    moves = np.concatenate([angle[:1], np.diff(angle, axis=0)])
    still = np.abs(moves) < STILL_RAD
    steps = np.arange(1, len(moves) + 1)[:, None, None]
    last = np.maximum.accumulate(np.where(still, 0, steps), axis=0)
    signs = np.take_along_axis(np.sign(moves), np.maximum(last - 1, 0), axis=0)
    return (np.where(last > 0, signs, side[:, None]) - side[:, None]) * half[:, None]


STILL_RAD = 1e-9
"""Largest turn in a tick that counts as rounding, not motion, rad."""


def round_to_grid(value: Array, low: Array, high: Array, grain: Array) -> Array:
    """Round values to multiples of `grain` in `low` … `high`; keep a value if there is none."""
    safe = np.where(grain > 0, grain, 1.0)
    nearest, slack = safe * np.round(value / safe), 1e-9 * safe
    nearest = np.where(nearest > high + slack, nearest - safe, nearest)
    nearest = np.where(nearest < low - slack, nearest + safe, nearest)
    inside = (nearest >= low - slack) & (nearest <= high + slack) & (grain > 0)
    return np.where(inside, nearest, value)
