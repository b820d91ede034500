"""From a plan to what the motors are told, tick by tick, so that a machine makes the plan's motion.

All of it is done on the motors' angles as functions of time. Where a motor should be is

    what the preparation and the plan ask for (and a jump that takes up lost motion, if wanted),
    read ahead by the lag of hold, delay, servo and viscous friction,
    and half of the gearhead's backlash ahead in the direction in which it turns.

Where that jumps, as at each reversal of a gearhead, a motor cannot follow; it goes there as fast as
the limits of the plan allow. Commands are held for a tick and at the motors' resolution, and what
rounding leaves of the angle in one tick is made good in the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import BPoly

from planner.machine.feedback.course import DEFAULT_TICK_S, mean_of, shift_of, turned
from planner.machine.feedback.estimate import gearhead_play
from planner.machine.feedback.run_up import input_limit
from planner.machine.feedforward.preparation import back, forward, take_up
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.plan.trajectory import StateTrajectory
from planner.problem.tables.compensation import CompensationTable
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class Commands:
    """What the motors are told.

    Attributes:
        t: Ends of the ticks, shape (K+1,), s, from 0.
        u: What they are told in each tick, shape (K, 2), rad/s.
        lead_s: How long before the plan's start they begin, s.
        tail_s: How long after the plan's end they end, s.
        straight: Whether inputs go straight from one tick's beginning to the next, as limits on
            their rates ask for; else they are held.
    """

    t: Array
    u: Array
    lead_s: float
    tail_s: float = 0.0
    straight: bool = False

    def along(self, system: TriangularSystem, q: Array) -> StateTrajectory:
        """The trajectory with these inputs and coordinates (K+1, N) at the ends of the ticks."""
        after = np.concatenate([self.u[1:], self.u[-1:]]) if self.straight else self.u
        q_curve = BPoly(np.stack([q[:-1], q[1:]]), self.t)
        return StateTrajectory(system, q_curve, BPoly(np.stack([self.u, after]), self.t))


def shaped(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    options: CompensationTable,
    wanted: Plan | None = None,
) -> Commands:
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
    held = machine.effects.get("control_period_s")
    tick = held.value[0] if held else DEFAULT_TICK_S
    before = after = np.zeros((1, 2))
    if options.preparation == "forward":
        before = forward(wanted, system, machine, tick)
    if options.back_off and plan.problem.travel is None:
        after = back(wanted, system, machine, tick)
    lead, tail = tick * (len(before) - 1), tick * (len(after) - 1)
    t = tick * np.arange(len(before) + len(after) - 1 + int(np.ceil(plan.duration / tick - 1e-9)))
    limit, rate = input_limit(plan, machine), plan.problem.limits.input_rate
    straight = bool(np.any(np.isfinite(rate)))
    ahead = shift_of(system, machine) if options.lag else np.zeros(2)
    if straight and not held:  # what goes straight comes half a tick before what is held
        ahead = ahead - tick / 2
    times, angles = turned(plan, tick)
    angle = np.empty((len(t), 2))
    for i in range(2):
        angle[:, i] = np.interp(t + ahead[i], tick * np.arange(len(before)), before[:, i])
        own = t + ahead[i] - lead
        angle[:, i] += np.interp(own, times, angles[:, i])
        angle[:, i] += np.interp(own - plan.duration, tick * np.arange(len(after)), after[:, i])
    if options.preparation == "jump":
        angle[:, 0] += take_up(wanted, system, machine, plan.q(0.0)[1]).drive
    if options.gearheads:
        angle += _ahead_of_play(angle, gearhead_play(system, machine) / 2)
    grain = np.broadcast_to(mean_of(machine, "velocity_resolution_rad_s"), 2)
    u = np.stack(
        [_pursued(angle[:, i], limit[i], rate[i], grain[i], tick) for i in range(2)], axis=1
    )
    t[-1] = lead + plan.duration + tail
    return Commands(np.asarray(t), u, lead, tail, straight)


def _ahead_of_play(wanted: Array, half: Array) -> Array:
    """What to add to angles (K+1, 2) of motors behind which lies backlash of ± `half` (2,).

    The backlash is in its middle before the first motion; each motor holds its side while at rest.
    """
    moves = np.diff(wanted, axis=0)
    moves = np.concatenate([wanted[:1], moves])
    still = np.abs(moves) < STILL_RAD
    last = np.where(still, 0, np.arange(1, len(moves) + 1)[:, None])
    last = np.maximum.accumulate(last, axis=0)
    signs = np.take_along_axis(np.sign(moves), np.maximum(last - 1, 0), axis=0)
    return np.where(last > 0, signs, 0.0) * half


STILL_RAD = 1e-9
"""Turn in a tick that is rounding and no motion."""


def _pursued(wanted: Array, limit: float, rate: float, grain: float, tick: float) -> Array:
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
