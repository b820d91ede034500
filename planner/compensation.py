"""Compensate a verified plan for the errors of a machine, or refuse and say why.

Compensation adds motion before, in and after the plan. If the result exceeds the allowed duration,
a shorter plan is compensated. If the correction reaches the input limits, a slower plan is tried.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError, InputWarning, NoPlanError, TimeLimitError
from planner.methods import motions
from planner.methods.collocation.machine_end import MACHINES
from planner.methods.collocation.transcription.follower import Contacts, Follower
from planner.methods.judgement import judge_plan, judge_slowed, refusal
from planner.methods.refusal import Change, try_changes
from planner.methods.registry import find_method, merged_options
from planner.plan.plan import Plan, mark_cut_short
from planner.problem.feasibility import refuse_too_short
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.tables.problem_file import CompensationTable
from planner.support.deadline import TimeUpError, is_over, time_advice, time_limit
from planner.support.progress import tell
from planner.systems.manipulator import Manipulator
from planner.verification.verdict import judge
from planner.verification.verify import Check

if TYPE_CHECKING:
    from planner.machine.machine import Machine


def compensate_in_time(
    plan: Plan, check: Check, machine: Machine | None, options: CompensationTable
) -> tuple[Plan, Check]:
    """Compensate a plan; return it uncompensated if time runs out or Ctrl-C ends the compensation.

    The status and `notes["ended_early"]` of an uncompensated plan name what ended the compensation.
    """
    with time_limit(None, has_answer=lambda: True) as span:
        try:
            return compensate_plan(plan, machine, options)
        except NoPlanError:
            if not is_over():
                raise
        return mark_cut_short(plan, span, "ended the call before the plan was compensated"), check


def compensate_plan(
    plan: Plan, machine: Machine | str | None, options: CompensationTable
) -> tuple[Plan, Check]:
    """Compensate a plan for a machine, and verify the motion predicted on the nominal machine.

    Args:
        plan: An executable plan of an arm.
        machine: The machine; its spreads are ignored. By default the problem's machine.
        options: The settings of the compensation.

    Raises:
        InputError: If the system is not an arm with friction disks.
        NoPlanError: If the plan or the predicted motion breaks a requirement.
    """
    from planner.machine.feedforward.advice import (  # imports the machine, which only this needs
        NO_COMPENSATION,
        compensation_changes,
        meets_before_start,
        settings_to_try,
    )
    from planner.machine.machine import machine_for

    if plan.compensation is not None:
        why = "method.collocation.end = 'machine' and compensation: choose one of the two"
        raise InputError(why, source=plan.problem.source)
    plan = plan if plan.verified else judge_plan(plan)[0]
    problem = plan.problem
    machine = machine_for(problem.machine, machine)
    began = time.perf_counter()
    tell("compensating")
    try:
        fastest = _compensate_in_duration(plan, machine, options)
    except TimeUpError:
        raise TimeLimitError(
            "the time was too short to compensate the plan",
            source=problem.source,
            advice=time_advice(),
        ) from None
    compensated, check = _with_room(fastest, machine, options)
    compensated = replace(compensated, solve_time_s=plan.solve_time_s + time.perf_counter() - began)
    changes = [*compensation_changes(compensated, check.violations, options), NO_COMPENSATION]
    if not check.ok:
        where = " on the nominal machine"
        if meets_before_start(compensated, check.violations):
            where += f" in the preparation, the first {compensated.lead_s:.3g} s, before the plan"
            where += " starts"
        tries = [Change(keys) for keys in settings_to_try(compensated, check.violations)]
        tried, helps = _try_settings(plan, machine, options, tries)
        error = refusal(compensated, check, where, [*tried, *changes])
        error.has_remedy = helps
        raise error
    ways = "; or ".join(changes)
    errors = compensated.notes["compensation"]
    if errors["unknown_deg"] > 0:
        warnings.warn(
            f"{problem.source}: the state of backlash and shafts before the start is unknown: the"
            f" end may be off by up to about {errors['unknown_deg']:.2g} deg; home the arm, or name"
            " the last plan (planner plan --after)",
            InputWarning,
            stacklevel=3,
        )
    if errors["E_deg"] != 0 and not errors["E_deg"] < errors["plain_E_deg"]:
        warnings.warn(
            f"{problem.source}: on the nominal machine the compensated plan leaves the path by"
            f" {errors['E_deg']:.3g} deg, the uncompensated one by"
            f" {errors['plain_E_deg']:.3g} deg; {ways}",
            InputWarning,
            stacklevel=3,
        )
    return compensated, check


def _try_settings(
    plan: Plan, machine: Machine, options: CompensationTable, tries: list[Change]
) -> tuple[list[str], bool]:
    """Compensate a plan with other settings, each of which takes as long as the refused attempt.

    Return in words each setting that works, with its remaining error, and each that was not tried
    for lack of time; and whether any works.
    """

    def attempt(change: Change) -> Plan:
        tables: dict[str, dict[str, Any]] = {"machine": {}, "compensation": {}}
        for key, value in change.keys.items():
            table, _, name = key.partition(".")
            tables[table][name] = value
        settings = options.model_copy(update=tables["compensation"])
        other = machine.with_(**tables["machine"])
        return _with_room(_compensate_in_duration(plan, other, settings), other, settings)[0]

    out, helps = list[str](), False
    for change in tries:
        trial = try_changes([change], attempt, lambda doing: tell(f"no plan; {doing}"))
        words = "home the arm first; " if "machine.start_state" in change.keys else ""
        if trial.plan is not None:
            helps = True
            errors = trial.plan.notes["compensation"]
            words += f"tried: path error {errors['E_deg']:.2g} deg, uncompensated"
            out.append(f"{change} ({words} {errors['plain_E_deg']:.2g} deg)")
        elif trial.left:
            out.append(f"{change} ({words}not tried for lack of time)")
    return out, helps


def _nominal_machine(problem: Problem) -> tuple[Follower, Callable[[Plan], Plan]]:
    """Return what `end = "machine"` needs of a problem's machine, see `MACHINES`.

    Raises:
        InputError: If the system is not an arm with friction disks, or on an inclined plane.
    """
    from planner.machine.feedback import means
    from planner.machine.feedforward.follow import with_prediction
    from planner.machine.feedforward.legs import start_shares
    from planner.machine.friction.contact_load import gear_constants, weights
    from planner.machine.friction.contacts import friction_capacity, lateral_friction
    from planner.machine.machine import Machine, draw

    system = problem.system
    if not isinstance(system, Manipulator):
        why = f"end = 'machine' of collocation is for arms with friction disks, not a {system.kind}"
        raise InputError(why, source=problem.source)
    machine = Machine.from_table(problem.machine)
    play = means.gearhead_play(system, machine)[1:] / 2
    widths = np.append(play, means.lost_motion(system, machine))
    lead = start_shares(machine, system)[1:]
    draws = draw(machine.nominal(), system.n, np.zeros(1, dtype=np.int64), 0)
    if weights(draws, system.n) is not None:
        why = "end = 'machine' of collocation is for a level plane: gravity moves where joints rest"
        raise InputError(f"{why} (machine.incline_deg)", source=problem.source)
    gears, torques = gear_constants(system, draws)[:, 0], draws["coulomb_friction_nm"][:, 0]
    contact = lateral_friction(draws), friction_capacity(draws), draws["creep"]
    numbers = [float(each.item()) for each in (*contact, draws["creep_per_nm"])]
    contacts = Contacts(tuple(gears), tuple(np.broadcast_to(torques, gears.shape)), *numbers)
    signs = [np.zeros(system.n - 1), *map(np.array, product((-1, 1), repeat=system.n - 1))]
    away = [np.append(0.0, sign * means.lost_spread(machine, system.n)) for sign in signs]
    rows = tuple(tuple((widths + each).tolist()) for each in away)
    follower = Follower(rows, tuple(lead.tolist()), contacts)
    return follower, partial(with_prediction, machine=machine)


MACHINES["machine"] = _nominal_machine

MOST_SHORTER = 4
"""Most times that a plan is shortened to fit `goal.duration_max`. The duration that compensation
adds differs from plan to plan, so that once may not suffice."""

SLOWER = (1.02, 1.05, 1.1)
"""Durations of the slower plans to try, relative to the fastest plan, whose inputs are always at
their limits and leave no room for a correction."""


def _compensate_in_duration(plan: Plan, machine: Machine, options: CompensationTable) -> Plan:
    """Compensate the plan; if the result exceeds `goal.duration_max`, compensate a shorter plan.

    Raises:
        NoPlanError: If no plan is short enough; the advice gives a duration that suffices.
    """
    from planner.machine.feedforward.advice import NO_COMPENSATION
    from planner.machine.feedforward.follow import follow

    problem, most, why = plan.problem, plan.problem.duration_max, ""
    most = np.inf if most is None else most
    tried = [follow(plan, machine, options)]
    for _ in range(MOST_SHORTER):
        if tried[-1].duration <= most:
            return tried[-1]
        added = tried[-1].duration - plan.duration
        seconds = float(f"{most - added:.6g}") - 1e-5
        try:
            plan = _plan_near(problem.changed({"goal.duration": seconds}), plan)
        except (NoPlanError, InputError) as error:
            if seconds > 0:
                why = f", and there is no plan of {seconds:.4g} s: {error.sentence}"
            break
        tried.append(follow(plan, machine, options))
    if tried[-1].duration > most and (fastest := _fastest(plan)) is not None:
        tried.append(follow(fastest, machine, options))
    if tried[-1].duration <= most:
        return tried[-1]
    least = min(tried, key=lambda each: each.duration)
    seconds = least.clock.seconds
    room = (SLOWER[-1] - 1) * seconds if problem.duration is None else 0.0
    raise NoPlanError(
        f"goal.duration_max = {most:g} s is too short: the plan takes"
        f" {seconds:.4g} s, compensation adds {least.duration - seconds:.4g} s{why}",
        source=problem.source,
        advice=[
            f"goal.duration_max = {np.ceil(100 * (least.duration + room)) / 100:g}",
            f"larger {problem.limits.input_words}, which shorten plan and compensation",
            NO_COMPENSATION,
        ],
    )


def _with_room(fastest: Plan, machine: Machine, options: CompensationTable) -> tuple[Plan, Check]:
    """Judge a compensated plan; if it breaks a requirement or does not help, try slower plans.

    Slower plans have the same path, need a free duration, and last at most `goal.duration_max`.
    """
    from planner.machine.feedforward.follow import follow

    tried = judged = judge(fastest)
    most, plan = fastest.problem.duration_max, fastest.compensates
    if fastest.problem.duration is not None:
        return judged
    assert plan is not None
    for factor in SLOWER:
        if _ends_trials(*tried):
            return tried
        if most is not None and fastest.duration + (factor - 1) * plan.duration > most:
            return judged
        try:
            notes = {**plan.notes, "slowed_for_compensation": factor}
            tried = judge(follow(judge_slowed(plan, factor, notes=notes), machine, options))
        except (TimeUpError, NoPlanError):
            return judged
    return tried if _ends_trials(*tried) else judged


def _ends_trials(plan: Plan, check: Check) -> bool:
    """Return whether no slower plan is to be tried after this compensated plan.

    That is so if the plan succeeds, if time is up, or if it breaks requirements only in the
    preparation, before the original plan starts.
    """
    from planner.machine.feedforward.advice import meets_before_start

    if "ended_early" in plan.notes:
        return True
    errors = plan.notes["compensation"]
    helps = check.ok and errors["E_deg"] < errors["plain_E_deg"]
    return helps or meets_before_start(plan, check.violations)


def _fastest(plan: Plan) -> Plan | None:
    """Return a plan of least duration for the given plan's problem; None if none is found."""
    free = {"goal.duration": "free", "goal.duration_max": None}
    try:
        fastest = _plan_near(plan.problem.changed(free), plan)
        seconds = float(f"{1.0001 * fastest.duration:.6g}")
        return _plan_near(plan.problem.changed({"goal.duration": seconds}), fastest)
    except (NoPlanError, InputError):
        return None


def _plan_near(problem: Problem, near: Plan) -> Plan:
    """Return a verified plan by the method of `near`, starting from `near` if the method can."""
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


SEAT_SPREADS = 3.5
"""Standard deviations of a joint's lost motion beyond its mean that are taken up. Of 1000
prototypes in any state 996 are then seated, and 998 with 4, which takes 0.1 s more."""


def seating(problem: AnyProblem, machine: Machine | str | None = None) -> Plan:
    """Return a motion that leaves an arm as homing does, without readings while it runs.

    The drive turns back, then forward by twice the largest lost motion of any joint, as far as the
    slowest axis needs. Joint 1 then turns forward by 2 degrees, and the arm rests. It takes 5 s
    where homing takes 8 s, but needs an arm whose lost motion is known to three and a half standard
    deviations. The pose after it is not known: read it before planning on. Links with inertia coast
    through their backlash: home such an arm.

    Args:
        problem: Defines the arm, its present pose and the limits, of which that of z₂ is ignored.
        machine: The machine with its spreads. By default the problem's machine.

    Raises:
        InputError, VerificationError: As for `planner.homing`.
    """
    from planner.machine.feedback import means  # imports the machine, which only this needs
    from planner.machine.machine import machine_for

    problem = problem_of(problem)
    used, system = machine_for(problem.machine, machine), problem.system
    lost = means.lost_motion(system, used)
    lost = lost + SEAT_SPREADS * means.lost_spread(used, system.size - 1)
    passed = means.mean_passing(system, used, problem.start[None])[0, 1:]
    play = float(means.gearhead_play(system, used)[0])
    return motions.seating(problem, 2 * lost / passed, play)
