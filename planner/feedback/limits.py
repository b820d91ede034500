"""What the tracker may command."""

from __future__ import annotations

import numpy as np

from planner.machine import Machine
from planner.measures import peak_inputs
from planner.plan import Plan
from planner.systems.base import Array


def input_limit(plan: Plan, machine: Machine) -> Array:
    """Largest |u| that is commanded, (2,): the problem's limit, or the motors' if that is less."""
    effect = machine.effects.get("velocity_limit_rad_s")
    motors = np.broadcast_to(np.array(effect.value if effect else np.inf), 2)
    return np.asarray(np.minimum(plan.problem.limits.input, motors))


def input_scale(plan: Plan, machine: Machine) -> Array:
    """A speed to measure corrections by, (2,): the limit; without one the plan's peak, or 1."""
    limit, peak = input_limit(plan, machine), peak_inputs(plan.trajectory)
    return np.where(np.isfinite(limit), limit, np.where(peak > 0, peak, 1.0))
