"""Taking up backlash and shaft torsion before the plan, and letting them go after it.

A passive joint rests until its axis has turned through its lost motion: half of the backlash and
the twist at which the shaft overcomes friction. How fast the axes turn under one drive depends on
θ₁, and at a certain θ₁ all of them use up their lost motion together (for three joints with equal
backlash where K₂ cos²θ₁ = K₃ cos³θ₂, which is 25 degrees at the paper's start). The preparatory
motion is therefore

    θ₁ to that angle, the drive forward through the lost motion, θ₁ back to its start

and no passive joint has moved when the plan begins: each then follows its axis at once. The drive
moves in the direction of the plan's first long drive motion. The positions of the joints in their
backlash at the start stay unknown; moving back and forth would not reveal them, and would add the
spread of the backlash twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.machine.feedback.course import turns_back
from planner.machine.feedback.estimate import lost_motion
from planner.machine.feedback.run_up import first_motion, input_scale
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

MOST_THETA1_DEG = 75.0
"""Largest |θ₁| of the preparation: beyond it the axes turn ten times slower than the drive asks."""

REST_S = 0.2
"""Rest before the plan, s: ten time constants of the servos and of the joints' friction."""

BACK = 0.95
"""Part of the way back at which a joint of the nominal machine would follow: creep and the pose
that the machine has indeed may make it come a little sooner."""


@dataclass(frozen=True)
class TakeUp:
    """How the passive axes are brought to where their joints begin to move.

    Attributes:
        theta1: Angle of joint 1 meanwhile, rad.
        drive: How far motor 1 turns, rad, signed.
        evenness: Share of its lost motion that the slowest axis has used up when the fastest has
            used up all, 0 … 1.
    """

    theta1: float
    drive: float
    evenness: float


def take_up(
    plan: Plan, system: Manipulator, machine: Machine, theta1: float | None = None
) -> TakeUp:
    """The drive at whose end the first joint is about to move.

    Args:
        plan: Gives the start, and the direction in which the drive moves first.
        system: Its arm.
        machine: Mean backlash, friction and stiffness.
        theta1: Angle of joint 1, rad; the one that serves all axes best when left out.
    """
    lost, start = lost_motion(system, machine), plan.q(0.0)
    if not np.any(lost > 0) or not np.any(plan.u(plan.t)[:, 0]):
        return TakeUp(float(start[1]), 0.0, 1.0)
    most = min(np.deg2rad(MOST_THETA1_DEG), plan.problem.limits.joint[1])
    side = 1.0 if start[1] >= 0 else -1.0
    angles = side * np.linspace(0.0, most, 721) if theta1 is None else np.array([theta1])
    q = np.repeat(start[None], len(angles), axis=0)
    q[:, 1] = angles
    used = np.abs(system.rates(q, np.array([1.0, 0.0]))[:, 2:]) / np.maximum(lost, 1e-12)
    evenness = used.min(axis=1) / used.max(axis=1)
    best = int(np.argmax(evenness))
    if system.n == 2:  # one axis: every angle serves it alike
        best = int(np.argmin(np.abs(angles - start[1])))
    drive = 1 / float(used[best].max())
    drive *= _way(plan, drive / 2)
    return TakeUp(float(angles[best]), drive, float(evenness[best]))


def _way(plan: Plan, least: float) -> float:
    """Sign of the first turn of motor 1 by at least so much, rad.

    No joint follows a shorter turn in the other direction once its lost motion is taken up.
    """
    t = np.linspace(0.0, plan.duration, 2001)
    turned = np.cumsum(plan.u((t[:-1] + t[1:]) / 2)[:, 0]) * (t[1] - t[0])
    far = np.abs(turned) >= min(least, float(np.max(np.abs(turned))))
    return float(np.sign(turned[np.argmax(far)]))


def forward(plan: Plan, system: Manipulator, machine: Machine, tick: float) -> Array:
    """Angles of both motors at the ticks of the preparatory motion, from 0, shape (m+1, 2), rad.

    The motors' speeds and accelerations keep the problem's limits.
    """
    chosen = take_up(plan, system, machine)
    if chosen.drive == 0:
        return np.zeros((1, 2))
    swing = chosen.theta1 - plan.q(0.0)[1]
    out = [np.zeros((1, 2))]
    for motor, angle in ((1, swing), (0, chosen.drive), (1, -swing)):
        out.append(out[-1][-1] + _move(plan, machine, motor, angle, tick))
    out.append(np.repeat(out[-1][-1:], round(REST_S / tick), axis=0))
    return np.concatenate(out)


def back(plan: Plan, system: Manipulator, machine: Machine, tick: float) -> Array:
    """Angles of both motors at the ticks after the plan's end, from 0, shape (m+1, 2), rad.

    The drive turns back through just less than twice the lost motion of the axis that turns fastest
    there. On the nominal machine no joint follows. On one that loses less motion than the mean
    joints have gone too far, and are taken back; so half of the spread of lost motion is folded
    onto the other half. Not where the drive turns back on its way: what a joint loses there has
    either sign at the end (crossing and four joints would end 0.1 degrees worse at 95 %).

    Args:
        plan: Whose drive comes to its end, and where.
        system: Its arm.
        machine: Mean backlash, friction and stiffness.
        tick: Length of a tick, s.
    """
    lost, way = lost_motion(system, machine), float(first_motion(plan)[0])
    if not np.any(lost > 0) or way == 0 or turns_back(plan):
        return np.zeros((1, 2))
    end = plan.q(plan.duration)
    used = np.abs(system.rates(end, np.array([1.0, 0.0]))[2:]) / np.maximum(lost, 1e-12)
    angle = -way * BACK * 2 / float(used.max())
    return np.concatenate([np.zeros((1, 2)), _move(plan, machine, 0, angle, tick)])


def _move(plan: Plan, machine: Machine, motor: int, angle: float, tick: float) -> Array:
    """A motor's motion by an angle from rest to rest, at the ends of ticks, (m, 2), rad: a cubic,
    whose speed has its peak at 3/2 and whose acceleration at 6 of what it is in the mean."""
    speed, rate = input_scale(plan, machine)[motor], plan.problem.limits.input_rate[motor]
    seconds = max(1.5 * abs(angle) / speed, np.sqrt(6 * abs(angle) / rate))
    out = np.zeros((max(1, int(np.ceil(seconds / tick))), 2))
    x = np.arange(1, len(out) + 1) / len(out)
    out[:, motor] = angle * x * x * (3 - 2 * x)
    return out
