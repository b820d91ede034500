"""Advice for a compensated plan that breaks a requirement or follows its path no better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.errors import Violation
from planner.machine.feedforward.legs import reversals, start_shares
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.requirements.places import Obstacle
from planner.problem.tables.problem_file import CompensationTable
from planner.systems.manipulator import Manipulator

NO_COMPENSATION = "no compensation (compensation.on = false)"

LEAST_UNEVEN_DEG = 1.0
"""Angle that an axis may lack after a take-up before it is reported, degrees: half of the error
that a machine's spreads leave."""

Settings = dict[str, bool | str]
"""Settings of a problem file: values by dotted key."""


def meets_before_start(plan: Plan, violations: Sequence[Violation]) -> bool:
    """Return whether all violations happen during the preparation, before the plan starts."""
    times = [v.time_s for v in violations]
    return bool(times) and all(t is not None and t < plan.lead_s for t in times)


def settings_to_try(plan: Plan, violations: Sequence[Violation]) -> list[Settings]:
    """Return the settings with which to compensate the same plan again, the best first.

    A homed arm needs no preparation if the drive starts forward. Without the preparation nothing
    can be hit before the plan.
    """
    if not any(v.time_s is not None and v.time_s < plan.lead_s for v in violations):
        return []
    assert plan.compensation is not None
    system = plan.problem.system
    assert isinstance(system, Manipulator)
    shares = start_shares(Machine.from_table(plan.compensation.machine), system)
    helps = reversals(plan.compensation.plan)[0] > 0 and bool(np.any(shares < 1))
    homed: list[Settings] = [{"machine.start_state": "forward"}] * helps
    return [*homed, {"compensation.preparation": False}]


def compensation_changes(
    plan: Plan, violations: Sequence[Violation], options: CompensationTable
) -> list[str]:
    """Return in words which changes other than `settings_to_try` would help a compensated plan:
    moving an obstacle, switching on steps of the compensation, another goal or path, more time. If
    all violations come before the plan starts, only obstacles are named."""
    problem = plan.problem
    met = [v.demand.number for v in violations if isinstance(v.demand, Obstacle)]
    out = [f"obstacle {number} elsewhere" for number in dict.fromkeys(met)]
    limits = {type(each): each for each in problem.registered_limits if each.reads != {"q"}}
    wider = [limits[type(v.demand)].easing([v]) for v in violations if type(v.demand) in limits]
    smaller = f"smaller {problem.limits.input_words}, which the added inputs keep"
    out += [*wider, smaller] * bool(wider)
    if meets_before_start(plan, violations) or 0 < len(wider) == len(violations):
        return out  # neither another motion nor more time would help
    if options.preparation != "forward":
        out.append("compensation.preparation = 'forward'")
    helpful = ("take_up", "correction")
    out += [f"compensation.{key} = true" for key in helpful if not getattr(options, key)]
    times = [v.time_s for v in violations if v.time_s is not None and not v.misses_goal]
    near = [(a, b) for s in times for a, b in plan.clock.holds if a - 1 < s < b + 1]
    legs = plan.notes["compensation"]["uneven"]
    uneven = [leg for leg in legs if leg["t_s"] > 0 and leg["deg"] > LEAST_UNEVEN_DEG]
    if near or uneven:
        keys = ["another goal", problem.travel_key * (problem.travel is not None)]
        other = " or ".join(filter(None, keys))
        when, why = f"{near[0][0]:.3g} s" if near else "", ""
        if uneven:
            worst = max(uneven, key=lambda each: each["deg"])
            when = f"{worst['t_s']:.3g} s"
            why = f" (this reversal leaves {worst['joint']} {worst['deg']:.2g} deg off the path)"
        out.append(f"{other}, so that the drive does not reverse at t = {when}{why}")
    assert plan.compensation is not None
    bias = Machine.from_table(plan.compensation.machine).effects.get("input_bias_rad_s")
    drifted = float(np.rad2deg(2 * max(bias.spread) * plan.duration)) if bias else 0.0
    if drifted > 2 * LEAST_UNEVEN_DEG:  # the error that spreads leave
        larger = f"larger {problem.limits.input_words}"
        less = larger if problem.duration is None else "a shorter goal.duration"
        return [
            *out,
            f"{less}: the motors' bias adds up to {drifted:.2g} deg on one machine in twenty",
        ]
    if problem.duration is not None:
        is_missed = bool(violations) and all(v.misses_goal for v in violations)
        out.insert(0 if is_missed else len(out), "more time (goal.duration)")
    elif problem.duration_max is not None:
        out.append("a larger goal.duration_max")
    return out
