"""The motion that commands make on the nominal machine: every spread off, systematic effects on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.machine.feedforward.shaping import Commands
from planner.machine.machine import Machine
from planner.machine.replay import SETTLE_S
from planner.machine.simulate import simulate
from planner.plan.plan import Compensation, Plan
from planner.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """A motion of the nominal machine.

    Attributes:
        q: Coordinates at the plan's own times `plan.t`, shape (K+1, N).
        end: Coordinates once the servos have settled, shape (N,). The path coordinate counts from
            where it is when the plan starts: what the preparation turns it by is lost motion.
        deviation: Largest |q − what is wanted| over time of those after the first, (N−1,).
    """

    q: Array
    end: Array
    deviation: Array


def predicted(plan: Plan, machine: Machine) -> Prediction:
    """What the nominal machine makes of a plan's inputs.

    Args:
        plan: A compensated plan; only the start of its motion and its inputs are read.
        machine: The machine; its spreads count for nothing.
    """
    first = np.zeros(1, dtype=np.int64)
    tick = float(plan.t[1] - plan.t[0])
    run = simulate(plan, machine.nominal(), first, 0, settle_s=SETTLE_S, record_s=tick)
    q, end = run.q[0, : len(plan.t)], run.q[0, -1].copy()
    end[0] -= q[round(plan.lead_s / tick), 0] - q[0, 0]
    return Prediction(q, end, run.deviation[0])


def commanded(
    near: Plan, compensation: Compensation, commands: Commands
) -> tuple[Plan, Prediction]:
    """The compensated plan with these commands, and its prediction; not verified.

    Args:
        near: The plan that the commands were shaped from.
        compensation: The plan whose motion is wanted, and the machine that is allowed for.
        commands: What the motors are told.
    """
    system, wanted = near.problem.system, compensation.plan
    still = np.repeat(near.q(0.0)[None], len(commands.t), axis=0)
    out = replace(
        wanted,
        trajectory=commands.along(system, still),
        verified=False,
        certificate=None,
        compensation=compensation,
    )
    found = predicted(out, Machine.from_table(compensation.machine))
    return replace(out, trajectory=commands.along(system, found.q)), found
