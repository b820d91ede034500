"""Taking up play before the start, as a machinist approaches a mark from one side.

A joint behind play and a soft shaft rests until its axis has used them up, some degrees later. The
run-up goes back and returns, so that at t = 0 every joint stands at the plan's start, on the side
from which the plan drives it on. With θ₁ between 0 and 90 degrees the axes of joints 2 and 3
turn as K₂ cos²θ₁ to K₃ cos³θ₂; so one drive can bring both home, in two stages:

    back, at a middle θ₁                joint 3 goes further back than joint 2
    forward, at a small θ₁              joint 2 all but arrives, joint 3 still lags
    forward, at a large θ₁              joint 3 arrives, joint 2 hardly moves
    θ₁ to its start, from the side from which the plan moves it on

How far each stage drives is solved for with the machine's mean play; the rest is the tracker's.

What the tracker may command.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from planner.errors import InputError, UntrackableError
from planner.machine.feedback.course import RunUp, mean_of
from planner.machine.feedback.estimate import gearhead_play
from planner.machine.machine import Machine
from planner.plan.measures import beyond, peak_inputs
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import FeedbackTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

STEP_S = 0.02
"""Step of the run-up's table, s."""

MIDDLE_DEG, SMALL_DEG, LARGE_DEG = 32.0, 8.0, 74.0
"""|θ₁| on the way back, and in both stages forward, degrees."""

BEHIND_DEG = 11.0
"""How far the last joint goes back, degrees: room for more play than the mean, and for learning."""

APPROACH_DEG, APPROACH_S, REST_S = 1.5, 0.8, 0.4
"""From how far away θ₁ approaches its start, degrees, in what time, and the rest after it, s."""

ARRIVAL_DEG, ARRIVAL_S = 2.5, 3.0
"""How far and how long a joint moves slowly at the end of its stage, degrees and s."""

SWING, DRIVE = 0.8, 0.6
"""Speeds of both motors, as parts of their limits."""


def run_up(plan: Plan, machine: Machine, options: FeedbackTable) -> RunUp | None:
    """The run-up of a plan on a machine; None where it is not wanted or would be of no use.

    Raises:
        InputError: If it is asked for and the arm has more than three joints.
    """
    system = plan.problem.system
    if not options.run_up or not isinstance(system, Manipulator):
        return None
    lost = lost_motion(system, machine)
    first = first_motion(plan)
    if not lost.any() or first[0] == 0:
        return None
    if options.run_up == "auto" and hindrance(plan, machine):
        return None
    if system.n > 3:
        raise InputError(
            f"feedback.run_up = true: one drive cannot bring {system.n - 1} passive joints home one"
            " by one; it is made for arms of two or three joints"
        )
    speed = np.array([DRIVE, SWING]) * input_scale(plan, machine)
    return _Approach(plan, system, lost, gearhead_play(system, machine), first, speed).solved()


def hindrance(plan: Plan, machine: Machine) -> str:
    """Why play cannot be taken up before the start, in words; empty where it can or is none."""
    system = plan.problem.system
    if not isinstance(system, Manipulator) or not lost_motion(system, machine).any():
        return ""
    if system.n > 3:
        return f"one drive cannot take up the play of {system.n - 1} joints before the start"
    if turns_back(plan):
        return "the drive turns back on its way, which costs the play of every joint again"
    return ""


def lost_motion(system: Manipulator, machine: Machine) -> Array:
    """Mean angle that each axis turns before its joint follows, either way, (n−1,), rad."""
    play, friction = mean_of(machine, "backlash_deg"), mean_of(machine, "coulomb_friction_nm")
    stiffness = mean_of(machine, "shaft_stiffness_nm_per_rad", np.inf)
    return np.asarray(np.broadcast_to(np.deg2rad(play) / 2 + friction / stiffness, system.n - 1))


def first_motion(plan: Plan) -> Array:
    """Signs of both inputs where they first act, (2,); 0 where one never does."""
    u = plan.u(np.linspace(0.0, plan.duration, 501))
    moving = np.abs(u) > 1e-6 * np.max(np.abs(u))
    return np.sign(u[np.argmax(moving, axis=0), [0, 1]])


def turns_back(plan: Plan) -> bool:
    """Whether the drive turns back on its way, and so loses the play again."""
    drive = plan.u(np.linspace(0.0, plan.duration, 501))[:, 0]
    least = -1e-6 * np.max(np.abs(drive))
    return bool(np.min(drive) < least and np.max(drive) > -least)


class _Approach:
    """The run-up's inputs and nominal motion as functions of what both stages drive.

    Args:
        plan: The plan.
        system: Its arm.
        lost: Lost motion of each passive axis, (n−1,), rad.
        gears: Whole play of each motor, (2, 1), rad.
        way: Signs of the plan's first inputs, (2,).
        speed: Of the drive and of swings of θ₁, (2,), rad/s.
    """

    def __init__(
        self, plan: Plan, system: Manipulator, lost: Array, gears: Array, way: Array, speed: Array
    ) -> None:
        self._system, self._lost, self._half = system, lost, gears[:, 0] / 2
        self._start, self._way, self._speed = plan.q(0.0), way, speed
        self._rate = plan.problem.limits.input_rate
        sign = 1.0 if self._start[1] >= 0 else -1.0
        most = plan.problem.limits.joint[1] - np.deg2rad(APPROACH_DEG)
        self._middle, self._small, self._large = (
            sign * min(np.deg2rad(angle), most) for angle in (MIDDLE_DEG, SMALL_DEG, LARGE_DEG)
        )

    def solved(self) -> RunUp:
        """The run-up whose nominal motion ends at the plan's start."""

        def miss(drives: Array) -> Array:
            return np.asarray((self._motion(self._inputs(drives))[-1] - self._start)[2:])

        guess = 3 * self._back() * np.ones(self._system.n - 1)
        found = least_squares(miss, guess, bounds=(0.0, np.inf), diff_step=1e-2)
        u = self._inputs(found.x)
        q = self._motion(u)
        q += (self._start - q[-1]) * np.linspace(0.0, 1.0, len(q))[:, None]
        return RunUp(STEP_S * np.arange(-len(u), 1.0), q, u)

    def _back(self) -> float:
        """How far the drive goes back, rad: the last joint's play and some more."""
        q = self._start.copy()
        q[1] = self._middle if self._system.n > 2 else q[1]
        rate = self._system.rates(q, np.array([1.0, 0.0]))[-1]
        return float((self._lost[-1] + np.deg2rad(BEHIND_DEG)) / rate)

    def _inputs(self, drives: Array) -> Array:
        """Inputs of each step, (m, 2), for the travels of the stages forward, (n−1,)."""
        start = self._start[1]
        before = start - self._way[1] * np.deg2rad(APPROACH_DEG)
        if self._system.n > 2:
            stages = zip((self._small, self._large), drives, strict=True)
            stops = [self._middle, self._small, self._large, before, start]
        else:
            stages, stops = zip((start,), drives, strict=True), [start, start, before, start]
        moves = [self._turn(stops[0] - start), self._drive(-self._back())]
        for (angle, drive), last in zip(stages, stops, strict=False):
            slow = min(drive, self._slow(angle))
            moves += [self._turn(angle - last), self._drive(drive - slow)]
            moves += [self._drive(slow, ARRIVAL_S)]
        moves += [self._turn(before - stops[-3]), self._turn(start - before, APPROACH_S)]
        return np.concatenate([*moves, np.zeros((round(REST_S / STEP_S), 2))])

    def _slow(self, angle: float) -> float:
        """Drive that turns the joint it is for by some degrees, rad: of the last one at a large θ₁,
        of the first at a small one."""
        q = self._start.copy()
        q[1] = angle
        rates = self._system.rates(q, np.array([1.0, 0.0]))
        rate = rates[-1] if angle == self._large else rates[2]
        return float(np.deg2rad(ARRIVAL_DEG) / rate)

    def _turn(self, travel: float, least_s: float = 0.0) -> Array:
        return self._move(1, travel, least_s)

    def _drive(self, travel: float, least_s: float = 0.0) -> Array:
        return self._move(0, self._way[0] * travel, least_s)

    def _move(self, motor: int, travel: float, least_s: float = 0.0) -> Array:
        """Inputs (m, 2) that turn one motor by `travel`, rad, within its speed and rate."""
        speed, rate = self._speed[motor], self._rate[motor]
        ramp = int(np.ceil(speed / (rate * STEP_S))) if np.isfinite(rate) else 0
        steps = max(int(np.ceil(abs(travel) / (speed * STEP_S))) + ramp, round(least_s / STEP_S))
        room = np.minimum(np.arange(steps), np.arange(steps)[::-1]) + 0.5
        shape = np.minimum(room, max(ramp, 0.5))
        out = np.zeros((steps, 2))
        out[:, motor] = travel * shape / (shape.sum() * STEP_S) if steps else 0.0
        return out

    def _motion(self, u: Array) -> Array:
        """Coordinates before, between and after the steps, (m+1, N), of the nominal machine."""
        q, gears, axes = self._start.copy(), np.zeros(2), np.zeros(len(self._lost))
        out = [q.copy()]
        for step in STEP_S * u:
            moved = gears + step
            gears = np.clip(moved, -self._half, self._half)
            step = moved - gears
            middle = q.copy()
            middle[1] += step[1] / 2
            change = self._system.rates(middle, step)
            moved = axes + change[2:]
            axes = np.clip(moved, -self._lost, self._lost)
            change[2:] = moved - axes
            q = q + change
            out.append(q)
        return np.stack(out)


BEYOND = 0.05
"""Part of an input's travel that may lie above its limit: what the tracker can still catch up."""


def input_limit(plan: Plan, machine: Machine) -> Array:
    """Largest |u| that is commanded, (2,): the problem's limit, or the motors' if that is less."""
    effect = machine.effects.get("velocity_limit_rad_s")
    motors = np.broadcast_to(np.array(effect.value if effect else np.inf), 2)
    return np.asarray(np.minimum(plan.problem.limits.input, motors))


def input_scale(plan: Plan, machine: Machine) -> Array:
    """A speed to measure corrections by, (2,): the limit; without one the plan's peak, or 1."""
    limit, peak = input_limit(plan, machine), peak_inputs(plan.trajectory)
    return np.where(np.isfinite(limit), limit, np.where(peak > 0, peak, 1.0))


def refuse_beyond(plan: Plan, machine: Machine) -> None:
    """Refuse a plan whose inputs cannot be commanded for a good part of its motion.

    Raises:
        UntrackableError: Naming the input, its peak, the limit and where that comes from.
    """
    limit = input_limit(plan, machine)
    share = beyond(plan.trajectory, limit)
    i = int(np.argmax(share))
    if share[i] <= BEYOND:
        return
    c, peak = plan.problem.system.inputs[i], peak_inputs(plan.trajectory)[i]
    own = limit[i] >= plan.problem.limits.input[i]
    source = "the problem's limits allow" if own else "the machine's velocity_limit_rad_s allows"
    asked = f"{c.name} asks for {peak:.3g} {c.unit}"
    raise UntrackableError(
        f"feedback cannot follow this {plan.method} plan: {asked}, {source} {limit[i]:g}, and"
        f" {share[i]:.0%} of its motion lies beyond; give it more time (goal.duration, or"
        " planner.retime)",
        why=f"feedback cannot follow it, {asked}, allowed {limit[i]:g}",
    )
