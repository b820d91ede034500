"""From a plan to what the motors are told, tick by tick, so that a machine makes the plan's motion.

All of it is done on the motors' angles as functions of time. Where a motor should be is

    what the preparation and the plan ask for (and a jump that takes up lost motion, if wanted),
    read ahead by the lag of hold, delay, servo and viscous friction,
    and half of the gearhead's backlash ahead in the direction in which it turns.

Where that jumps, as at each reversal of a gearhead, a motor cannot follow; it goes there as fast as
the limits of the plan allow. Commands are held for a tick and at the motors' resolution, and what
rounding leaves of the angle in one tick is made good in the next.

Before the plan, backlash and shaft torsion are taken up, and after it they are let go. A passive
joint rests until its axis has turned through its lost motion: half of the backlash and the twist at
which the shaft overcomes friction. How fast the axes turn under one drive depends on θ₁, and at a
certain θ₁ all of them use up their lost motion together (for three joints with equal backlash where
K₂ cos²θ₁ = K₃ cos³θ₂, which is 25 degrees at the paper's start). The preparatory motion is
therefore

    θ₁ to that angle, the drive forward through the lost motion, θ₁ back to its start

and no passive joint has moved when the plan begins: each then follows its axis at once. The drive
moves in the direction of the plan's first long drive motion. The positions of the joints in their
backlash at the start stay unknown; moving back and forth would not reveal them, and would add the
spread of the backlash twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from planner.machine.feedback.course import DEFAULT_TICK_S, first_motion, turn_angles, turns_back
from planner.machine.feedback.means import (
    gearhead_play,
    input_limit,
    input_scale,
    lost_motion,
    shift_of,
)
from planner.machine.feedback.run_up import REST_S
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.tables.problem_file import CompensationTable
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

MOST_THETA1_DEG = 75.0
"""Largest |θ₁| of the preparation: beyond it the axes turn ten times slower than the drive asks."""

WAY_BACK_SHARE = 0.95
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
    way = _way(plan, 0.5 * float(lost.max()))
    lost = lost * (1 - way * start_sides(machine, system)[1:])  # none where it is taken up already
    if not np.any(lost > 0):
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


def preparation_angles(plan: Plan, system: Manipulator, machine: Machine, tick: float) -> Array:
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


def return_angles(plan: Plan, system: Manipulator, machine: Machine, tick: float) -> Array:
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
    angle = -way * WAY_BACK_SHARE * 2 / float(used.max())
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


@dataclass(frozen=True, eq=False)
class MotorCommands:
    """What the motors are told.

    Attributes:
        t: Ends of the ticks, shape (K+1,), s, from 0.
        u: What they are told in each tick, shape (K, 2), rad/s.
        lead_s: How long before the plan's start they begin, s.
        tail_s: How long after the plan's end they end, s.
        is_linear: Whether inputs go straight from one tick's beginning to the next, as limits on
            their rates ask for; else they are held.
    """

    t: Array
    u: Array
    lead_s: float
    tail_s: float = 0.0
    is_linear: bool = False

    def trajectory(self, system: TriangularSystem, q: Array) -> StateTrajectory:
        """The trajectory with these inputs and coordinates (K+1, N) at the ends of the ticks."""
        after = np.concatenate([self.u[1:], self.u[-1:]]) if self.is_linear else self.u
        q_curve = Bernstein(np.stack([q[:-1], q[1:]]), self.t)
        return StateTrajectory(system, q_curve, Bernstein(np.stack([self.u, after]), self.t))


def shape_commands(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    options: CompensationTable,
    wanted: Plan | None = None,
) -> MotorCommands:
    """What the motors of a machine are told to make a plan's motion.

    Args:
        plan: An executable plan.
        system: Its arm.
        machine: Its means are what is allowed for.
        options: What is done.
        wanted: The plan whose motion is wanted, which decides how it is prepared and left, so that
            both stay as they are for plans next to it; `plan` itself when left out.
    """
    wanted = plan if wanted is None else wanted
    hold = machine.effects.get("control_period_s")
    tick = hold.value[0] if hold else DEFAULT_TICK_S
    before = after = np.zeros((1, 2))
    if options.preparation == "forward":
        before = preparation_angles(wanted, system, machine, tick)
    if options.back_off and plan.problem.travel is None:
        after = return_angles(wanted, system, machine, tick)
    lead, tail = tick * (len(before) - 1), tick * (len(after) - 1)
    t = tick * np.arange(len(before) + len(after) - 1 + int(np.ceil(plan.duration / tick - 1e-9)))
    limit, rate = input_limit(plan, machine), plan.problem.limits.input_rate
    straight = bool(np.any(np.isfinite(rate)))
    ahead = shift_of(system, machine) if options.lag else np.zeros(2)
    if straight and not hold:  # what goes straight comes half a tick before what is held
        ahead = ahead - tick / 2
    times, angles = turn_angles(plan, tick)
    angle = np.empty((len(t), 2))
    for i in range(2):
        angle[:, i] = np.interp(t + ahead[i], tick * np.arange(len(before)), before[:, i])
        plan_times = t + ahead[i] - lead
        angle[:, i] += np.interp(plan_times, times, angles[:, i])
        angle[:, i] += np.interp(
            plan_times - plan.duration, tick * np.arange(len(after)), after[:, i]
        )
    if options.preparation == "jump":
        angle[:, 0] += take_up(wanted, system, machine, plan.q(0.0)[1]).drive
    if options.gearheads:
        sides = start_sides(machine, system)
        angle += _ahead_of_play(angle, gearhead_play(system, machine) / 2, sides[[1, 0]])
    grain = np.broadcast_to(machine.mean("velocity_resolution_rad_s"), 2)
    u = np.stack(
        [_pursue(angle[:, i], limit[i], rate[i], grain[i], tick) for i in range(2)], axis=1
    )
    t[-1] = lead + plan.duration + tail
    return MotorCommands(np.asarray(t), u, lead, tail, straight)


def start_sides(machine: Machine, system: Manipulator) -> Array:
    """The side on which joints 1 … n of the machine stand before the start, (n,): 1 where a motion
    forward left them, −1 backward, 0 in the middle or unknown."""
    words = machine.start_state * (system.n if len(machine.start_state) == 1 else 1)
    return np.array([{"forward": 1.0, "backward": -1.0}.get(word, 0.0) for word in words])


def _ahead_of_play(wanted: Array, half: Array, side: Array) -> Array:
    """What to add to angles (K+1, 2) of motors behind which lies backlash of ± `half` (2,).

    Before the first motion it lies on a side (2,), −1 … 1; each motor holds its side while at rest.
    """
    moves = np.diff(wanted, axis=0)
    moves = np.concatenate([wanted[:1], moves])
    still = np.abs(moves) < STILL_RAD
    last = np.where(still, 0, np.arange(1, len(moves) + 1)[:, None])
    last = np.maximum.accumulate(last, axis=0)
    signs = np.take_along_axis(np.sign(moves), np.maximum(last - 1, 0), axis=0)
    return (np.where(last > 0, signs, side) - side) * half


STILL_RAD = 1e-9
"""Turn in a tick that is rounding and no motion."""


def _pursue(wanted: Array, limit: float, rate: float, grain: float, tick: float) -> Array:
    """Speeds (K,) of a motor from angle 0 that goes after angles (K+1,) within its limits.

    Args:
        wanted: Where it should be at the ends of the ticks, rad.
        limit: Largest speed, rad/s.
        rate: Largest acceleration, rad/s²; infinite for none.
        grain: Speeds are multiples of this, rad/s; 0 for any.
        tick: Length of a tick, s.
    """
    out, angle, speed = [], 0.0, 0.0
    step, places = rate * tick, wanted.tolist()
    for now, then in pairwise(places):
        behind = now - angle
        catch = abs(behind) / tick
        if rate < math.inf:  # no faster than it can stop
            catch = min(catch, (math.sqrt(step * step + 8 * rate * abs(behind)) - step) / 2)
        low, high = max(-limit, speed - step), min(limit, speed + step)
        aim = (then - now) / tick + math.copysign(catch, behind)
        speed = min(max(aim, low), high)
        if grain > 0:
            speed = _on_grid(speed, low, high, grain)
        angle += speed * tick
        out.append(speed)
    return np.array(out)


def _on_grid(value: float, low: float, high: float, grain: float) -> float:
    """The multiple of `grain` next to a value that lies between low and high; else the value."""
    nearest, slack = grain * round(value / grain), 1e-9 * grain
    if nearest > high + slack:
        nearest -= grain
    elif nearest < low - slack:
        nearest += grain
    return nearest if low - slack <= nearest <= high + slack else value
