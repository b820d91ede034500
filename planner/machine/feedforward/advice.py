"""What would help a compensated plan that breaks a requirement, or follows its path no better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.errors import Violation
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.tables.problem_file import CompensationTable

NO_COMPENSATION = "no compensation (compensation.on = false)"

LEAST_UNEVEN_DEG = 1.0
"""What an axis may lack after a take-up before that is named: half of what spreads leave."""


def compensation_changes(
    plan: Plan, violations: Sequence[Violation], options: CompensationTable
) -> list[str]:
    """What would help a compensated plan, in words: what stands in the way, what was left out, and
    time."""
    made, out = plan.notes["compensation"], []
    times = [v.time_s for v in violations if v.time_s is not None and "goal" not in v.label]
    if plan.lead_s and any(time_s < plan.lead_s for time_s in times):
        out.append("compensation.preparation = false, for the preparation meets a limit")
    near = [s for s in times for a, b in plan.clock.holds if a - 1 < s < b + 1]
    uneven = max(made["uneven_deg"], default=0.0)
    if near or uneven > LEAST_UNEVEN_DEG:
        where = f" (one is {uneven:.2g} deg short)" if uneven > LEAST_UNEVEN_DEG else ""
        out.append(
            f"another {plan.problem.travel_key} or goal, so that the drive keeps its direction or"
            f" turns back elsewhere: there it cannot take up what all axes lose{where}"
        )
    if near:
        out.append("compensation.take_up = false")
    if options.preparation != "forward":
        out.append("compensation.preparation = 'forward'")
    helpful = ("take_up", "correction")
    out += [f"compensation.{key} = true" for key in helpful if not getattr(options, key)]
    if (drifted := _drift_deg(plan)) > 2 * LEAST_UNEVEN_DEG:  # as much as spreads leave
        less = f"less time (goal.duration), in which the motors' bias adds up to {drifted:.2g} deg"
        return [*out, f"{less} on one machine in twenty"]
    return [*out, "more time (goal.duration)"]


def _drift_deg(plan: Plan) -> float:
    """By how much the bias of a motor has turned it at the end: twice the standard deviation."""
    assert plan.compensation is not None
    bias = Machine.from_table(plan.compensation.machine).effects.get("input_bias_rad_s")
    return float(np.rad2deg(2 * max(bias.spread) * plan.duration)) if bias else 0.0
