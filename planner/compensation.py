"""From a verified plan to one that allows for the machine, or a refusal that says why.

What is run fits into the time there is: the plan underneath is made shorter for that, or slower.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError, InputWarning, NoPlanError, TimeLimitError
from planner.methods.judgement import judge_plan, refusal
from planner.methods.ranking import MEASURES
from planner.methods.refusal import LEAST_S, MOST_TIMES_REFUSAL, Change, try_changes
from planner.methods.registry import find_method, merged_options
from planner.plan.measures import objective_of
from planner.plan.plan import Plan, mark_cut_short
from planner.problem.feasibility import refuse_too_short
from planner.problem.problem import Problem
from planner.problem.tables.problem_file import CompensationTable
from planner.support.deadline import TimeUpError, is_over, time_advice, time_limit
from planner.support.progress import tell
from planner.verification.verdict import judge
from planner.verification.verify import Check

if TYPE_CHECKING:
    from planner.machine.machine import Machine


def compensate_in_time(
    plan: Plan, check: Check, machine: Machine | None, options: CompensationTable
) -> tuple[Plan, Check]:
    """As `compensate_plan`; where time is up before, or Ctrl-C ends it, the verified plan as it is.

    Its status and `notes["ended_early"]` then say so.
    """
    with time_limit(None, has_answer=lambda: True) as span:
        try:
            return compensate_plan(plan, machine, options)
        except NoPlanError:
            if not is_over():
                raise
        return mark_cut_short(plan, span, "ended the work on it before it was compensated"), check


def compensate_plan(
    plan: Plan, machine: Machine | str | None, options: CompensationTable
) -> tuple[Plan, Check]:
    """The plan with commands that allow for the machine, verified on the nominal one.

    Args:
        plan: An executable plan of an arm.
        machine: The machine, whose spreads count for nothing; the problem's own when None.
        options: What is done.

    Raises:
        InputError: If the system is no arm with friction disks.
        NoPlanError: If the plan or the predicted motion breaks a requirement.
    """
    from planner.machine.feedforward.advice import (  # with the machine, which only this needs
        NO_COMPENSATION,
        compensation_changes,
        meets_before_start,
    )
    from planner.machine.machine import machine_for

    plan = plan if plan.verified else judge_plan(plan)[0]
    problem = plan.problem
    used = machine_for(problem.machine, machine)
    began = time.perf_counter()
    tell("compensating")
    try:
        made = _compensate_in_duration(plan, used, options)
    except TimeUpError:
        raise TimeLimitError(
            f"{problem.source}: the plan cannot be compensated: it takes too long",
            advice=time_advice(),
        ) from None
    compensated, check = _with_room(made, used, options)
    compensated = replace(compensated, solve_time_s=plan.solve_time_s + time.perf_counter() - began)
    changes = [*compensation_changes(compensated, check.violations, options), NO_COMPENSATION]
    if not check.ok:
        where = " on the nominal machine"
        if meets_before_start(compensated, check.violations):
            where += f" in the preparation, the first {compensated.lead_s:.3g} s, before the plan"
            where += " starts"
        tried = _try_settings(plan, used, options, compensated, check, time.perf_counter() - began)
        raise refusal(compensated, check, where, "; or ".join([*tried, *changes]))
    ways = "; or ".join(changes)
    said = compensated.notes["compensation"]
    if not said["E_deg"] < said["plain_E_deg"]:
        warnings.warn(
            f"{problem.source}: compensated, the nominal machine leaves the path by"
            f" {said['E_deg']:.3g} deg, as it is by {said['plain_E_deg']:.3g} deg; {ways}",
            InputWarning,
            stacklevel=3,
        )
    return compensated, check


def _try_settings(
    plan: Plan,
    machine: Machine,
    options: CompensationTable,
    refused: Plan,
    check: Check,
    seconds: float,
) -> list[str]:
    """What compensates the same plan where the preparation meets something, in words, with what it
    leaves; and what there was no time to try. It takes a few times as long as the refusal did."""
    from planner.machine.feedforward.advice import settings_to_try

    def attempt(change: Change) -> Plan:
        tables: dict[str, dict[str, Any]] = {"machine": {}, "compensation": {}}
        for key, value in change.keys.items():
            table, _, name = key.partition(".")
            tables[table][name] = value
        own = options.model_copy(update=tables["compensation"])
        other = machine.with_(**tables["machine"])
        return _with_room(_compensate_in_duration(plan, other, own), other, own)[0]

    out = []
    with time_limit(max(LEAST_S, MOST_TIMES_REFUSAL * seconds), "the time for trying changes"):
        for change in map(Change, settings_to_try(refused, check.violations)):
            tries = try_changes([change], attempt, lambda doing: tell(f"no plan; {doing}"))
            said = "home first; " if "machine.start_state" in change.keys else ""
            if tries.plan is not None:
                made = tries.plan.notes["compensation"]
                said += f"tried: off the path by {made['E_deg']:.2g} deg, uncompensated by"
                out.append(f"{change} ({said} {made['plain_E_deg']:.2g})")
            elif tries.left:
                out.append(f"{change} ({said}not tried for lack of time)")
    return out


def _compensated_error_deg(plan: Plan) -> float:
    """E of a plan compensated for its machines; see `planner.machine.feedforward.follow`."""
    from planner.machine.feedforward.follow import compensated_error_deg

    return compensated_error_deg(plan)


MEASURES["machine"] = _compensated_error_deg

MOST_SHORTER = 4
"""Times that a plan is made shorter until all that is run fits: what is added depends on it."""

SLOWER = (1.02, 1.05, 1.1)
"""Times as long as the fastest, where that leaves the correction no room: its inputs are at their
limits all the time."""


def _compensate_in_duration(plan: Plan, machine: Machine, options: CompensationTable) -> Plan:
    """The compensated plan; where all that is run takes more than it may, of a shorter plan.

    Raises:
        NoPlanError: If no plan short enough is found; it names a duration that would do.
    """
    from planner.machine.feedforward.advice import LARGER_INPUTS, NO_COMPENSATION
    from planner.machine.feedforward.follow import follow

    problem, most, why = plan.problem, plan.problem.duration_max, ""
    most = np.inf if most is None else most
    made = follow(plan, machine, options)
    least = made
    for _ in range(MOST_SHORTER):
        if made.duration <= most:
            return made
        added = made.duration - plan.duration
        seconds = float(f"{most - added:.6g}") - 1e-5
        try:
            plan = _plan_near(problem.changed({"goal.duration": seconds}), plan)
        except (NoPlanError, InputError) as error:
            if seconds > 0:
                said = str(error).splitlines()[0].removeprefix(f"{problem.source}: ")
                said = said.rpartition(". ")[0] if said.endswith(":") else said  # of a list
                why = f", and there is no plan of {seconds:.4g} s: {said}"
            break
        made = follow(plan, machine, options)
        least = min(least, made, key=lambda each: each.duration)
    if made.duration > most and (fastest := _fastest(plan)) is not None:
        made = follow(fastest, machine, options)
        least = min(least, made, key=lambda each: each.duration)
    if made.duration <= most:
        return made
    seconds = least.clock.seconds
    room = (SLOWER[-1] - 1) * seconds if problem.duration is None else 0.0
    raise NoPlanError(
        f"{problem.source}: goal.duration_max = {most:g} s is too short: the plan takes"
        f" {seconds:.4g} s, compensation adds {least.duration - seconds:.4g} s{why}",
        advice=f"goal.duration_max = {np.ceil(100 * (least.duration + room)) / 100:g};"
        f" or {LARGER_INPUTS}; or {NO_COMPENSATION}",
    )


def _with_room(fastest: Plan, machine: Machine, options: CompensationTable) -> tuple[Plan, Check]:
    """A compensated plan, judged; where its duration is free, and it breaks something or is no
    better than the plan as it is, that of the same path a little slower, if it fits."""
    from planner.machine.feedforward.follow import follow

    tried = judged = judge(fastest)
    most, plan = fastest.problem.duration_max, fastest.compensates
    if fastest.problem.duration is not None:
        return judged
    assert plan is not None
    for factor in SLOWER:
        if _is_good(*tried):
            return tried
        if most is not None and fastest.duration + (factor - 1) * plan.duration > most:
            return judged
        try:
            tried = judge(follow(_slower(plan, factor), machine, options))
        except (TimeUpError, NoPlanError):
            return judged
    return tried if _is_good(*tried) else judged


def _is_good(made: Plan, check: Check) -> bool:
    """Whether a slower plan would not be better: it keeps all, or the preparation does not."""
    from planner.machine.feedforward.advice import meets_before_start

    if "ended_early" in made.notes:
        return True
    said = made.notes["compensation"]
    helps = check.ok and said["E_deg"] < said["plain_E_deg"]
    return helps or meets_before_start(made, check.violations)


def _slower(plan: Plan, factor: float) -> Plan:
    """The same path in `factor` times the time."""
    trajectory = plan.trajectory.slowed(factor)
    objective = objective_of(trajectory, plan.objective_name)
    slowed = replace(
        plan,
        trajectory=trajectory,
        objective=plan.objective if objective is None else objective,
        notes={**plan.notes, "slowed_for_compensation": factor},
    )
    return judge_plan(slowed)[0]


def _fastest(plan: Plan) -> Plan | None:
    """The plan of the same problem in the least time, where one is found."""
    free = {"goal.duration": "free", "goal.duration_max": None}
    try:
        found = _plan_near(plan.problem.changed(free), plan)
        seconds = float(f"{1.0001 * found.duration:.6g}")
        return _plan_near(plan.problem.changed({"goal.duration": seconds}), found)
    except (NoPlanError, InputError):
        return None


def _plan_near(problem: Problem, near: Plan) -> Plan:
    """A verified plan of a problem, by the method of a plan, and next to it where there is one."""
    entry = find_method(near.method)
    options = merged_options(problem, entry, dict(near.options))
    refuse_too_short(problem)
    if entry.replan is not None:
        try:
            return judge_plan(entry.replan(problem, options, near))[0]
        except NoPlanError:
            if is_over():
                raise
    return judge_plan(entry.plan(problem, options))[0]
