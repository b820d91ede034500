"""What the tracker may command."""

from __future__ import annotations

import numpy as np

from planner.errors import UntrackableError
from planner.machine import Machine
from planner.measures import beyond, peak_inputs
from planner.plan import Plan
from planner.systems.base import Array

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
