"""From problem and method to a verified plan, or a refusal that says why.

And from a plan to one that allows for the machine, where the problem asks for that.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError, InputWarning, NoPlanError, TimeLimitError, VerificationError
from planner.methods.keeping import GOALS, not_promised, refuse_unkept
from planner.methods.ranking import MEASURES
from planner.methods.refusal import (
    BY_COLLOCATION,
    LEAST_S,
    MOST_TIMES_REFUSAL,
    Change,
    advise,
    changed_words,
    duration_change,
    try_changes,
)
from planner.methods.registry import METHODS, Method, find_method, merged_options, typed
from planner.plan.measures import objective_of
from planner.plan.plan import Plan, expect_plan, mark_cut_short
from planner.problem.feasibility import refuse_too_short
from planner.problem.problem import Problem, expect_problem
from planner.problem.requirements.ends import LongestDuration
from planner.problem.requirements.requirement import Requirement
from planner.problem.tables.problem_file import CompensationTable
from planner.support.deadline import (
    SEARCH_SHARE,
    TimeUpError,
    check_seconds,
    holds_answer,
    is_over,
    time_advice,
    time_limit,
    time_share,
)
from planner.support.progress import Listener, current_progress, progress_listener, tell
from planner.verification.verdict import judge
from planner.verification.verify import Check, verify

if TYPE_CHECKING:
    from planner.machine.machine import Machine


@typed
def solve(
    problem: Problem,
    method: str = "collocation",
    *,
    warm: Plan | None = None,
    time_limit_s: float | None = None,
    progress: Listener | None = None,
    **options: Any,
) -> Plan:
    """Plan a motion and verify it.

    Args:
        problem: The problem.
        method: Name of a method; `planner.METHODS` lists them.
        warm: A plan of a similar problem of the same system, by any method. 'collocation' and
            'desensitised' start from it instead of searching and return the local optimum next to
            it.
        time_limit_s: Seconds for all of it: planning, verification, what a refusal advises, and
            compensation; no limit by default. When they are over, the best verified plan there is
            comes back: of 'collocation' the best found so far; of a plan to be compensated, where
            there was no time for that, the plan as it is. Its `notes["ended_early"]` says what it
            lacks. Without any plan the call is refused. It ends at the latest after 1.2 times the
            limit plus two seconds. Replaces the option of the same name of the method, if it has
            one.
        progress: Called with a `planner.support.progress.Progress` at every step. The logger
            `planner` receives the same.
        **options: Override single keys of the problem's `[method.<name>]` table.

    Returns:
        A plan with `verified` True and a `certificate`. Its status is "time_limit" if the limit
        ended something early. If the problem's `[compensation]` is on, the plan is compensated for
        its machine (see `planner.compensate`). The only exception: a method in chained coordinates
        with `allow_singular` may return a path outside the domain, with status "singular" and
        `verified` False.

    Raises:
        InputError: If the method or an option is unknown or has an impossible value, the problem is
            not a `Problem`, `warm` belongs to another system, or the method cannot use `warm`.
        TimeLimitError: If the time limit ended without a plan; it says how far the search got.
        NoPlanError: If no plan is found, or the one found breaks a requirement; the subclass says
            which. The error carries the last iterate and its violations. Before it is raised,
            changes of the problem are tried (`planner.methods.refusal`), within the time limit and
            in at most a few times the duration of the failed search.
    """
    return solve_and_check(
        problem, method, warm=warm, time_limit_s=time_limit_s, progress=progress, **options
    )[0]


def solve_and_check(
    problem: Problem,
    method: str,
    *,
    warm: Plan | None = None,
    time_limit_s: float | None = None,
    progress: Listener | None = None,
    advice: bool = True,
    compensate: bool = False,
    compensated_for: Machine | None = None,
    **options: Any,
) -> tuple[Plan, Check]:
    """As `solve`, with what the verification found.

    Args:
        problem, method, warm, time_limit_s, progress, options: As of `solve`.
        advice: Whether the changes that a refusal names are tried.
        compensate: Whether to compensate the plan even if the problem does not ask for it.
        compensated_for: The machine that a compensation allows for; the problem's own when None.
    """
    expect_problem(problem)
    entry = find_method(method)
    if time_limit_s is not None:
        time_limit_s = check_seconds(time_limit_s)
        if "time_limit_s" in entry.options.model_fields:
            options["time_limit_s"] = time_limit_s
    merged = merged_options(problem, entry, options)
    must_compensate = compensate or problem.compensation.on

    def attempt(change: Change) -> Plan:
        changed = problem.changed(change.keys)
        given = {} if change.defaults else options
        return judge_plan(
            _plan_by_method(changed, entry, merged_options(changed, entry, given), None)
        )[0]

    with (
        time_limit(getattr(merged, "time_limit_s", time_limit_s)) as span,
        progress_listener(progress),
    ):
        began = time.monotonic()
        try:
            with time_share(SEARCH_SHARE if must_compensate else 1.0, condition=holds_answer):
                plan, check = judge_plan(_plan_by_method(problem, entry, merged, warm))
        except TimeUpError:
            far = current_progress()
            doing = "" if far is None else f" after {far.solves} solves (it was {far.doing})"
            raise TimeLimitError(
                f"{problem.source}: {span.why} ended the method '{method}' before it had a"
                f" plan{doing}",
                advice=time_advice(),
            ) from None
        except NoPlanError as error:
            seconds = time.monotonic() - began
            advised = advise(error, problem, attempt, seconds) if advice else None
            if advised is None:
                raise
            plan, check = judge_plan(replace(advised, problem=problem))
        if not must_compensate or plan.status == "singular":
            return plan, check
        return compensate_in_time(plan, check, compensated_for, problem.compensation)


def _plan_by_method(problem: Problem, entry: Method, options: Any, warm: Plan | None) -> Plan:
    """What a method makes of a problem, unless it can be refused beforehand."""
    if not entry.finds_time:
        refuse_too_short(problem)
    refuse_unkept(problem, entry.name, entry.keeps)
    if warm is None:
        return entry.plan(problem, options)
    if entry.replan is None:
        able = ", ".join(f"'{m.name}'" for m in METHODS.values() if m.replan)
        raise InputError(f"method '{entry.name}' cannot start from a plan; warm is for {able}")
    expect_plan(warm)
    return entry.replan(problem, options, warm.compensates or warm)


def judge_plan(plan: Plan) -> tuple[Plan, Check]:
    """A plan that a method has made, verified, with what the verification found.

    Raises:
        TimeLimitError: If it breaks a requirement, and there was no time to refine it.
        VerificationError: If it breaks a requirement otherwise.
    """
    tell("verifying")
    if plan.status == "singular":
        return plan, verify(plan)
    plan, check = judge(plan)
    if check.ok:
        return plan, check
    if why := plan.notes.get("ended_early"):
        raise TimeLimitError(
            f"{plan.problem.source}: {why}, and there was no time to refine it: it breaks",
            plan=replace(plan, status=TimeLimitError.status),
            violations=check.violations,
            advice=time_advice(),
        )
    others = not_promised(plan.problem, find_method(plan.method).keeps)
    said = ""
    if left := sum(v.label in others for v in check.violations):
        part = "" if left == len(check.violations) else f"{left} of "
        said = f", {part}which this method does not promise to keep"
    changes, otherwise = _remedies(plan, check)
    raise _refusal(plan, check, said, otherwise, changes)


def _remedies(plan: Plan, check: Check) -> tuple[list[Change], str | None]:
    """Changes to try, and what else may help."""
    violated = [plan.problem.asking(v.label) for v in check.violations]
    broken = [pair[0] for pair in violated if pair]
    speeds = [each.speed if isinstance(each, Requirement) else 0 for each in broken]
    if len(broken) == len(violated) and all(speeds) and plan.trajectory.kind == "chained":
        sizes = (v.value / v.limit for v in check.violations)
        factor = max(size ** (1 / speed) for size, speed in zip(sizes, speeds, strict=True))
        if factor < float("inf"):
            slower = duration_change(plan.duration * factor * 1.0001)
            return [slower, BY_COLLOCATION], None
    if len(broken) < len(violated) or any(isinstance(each, GOALS) for each in broken):
        return [], "a finer mesh: more method.collocation.intervals or a higher degree"
    other = [BY_COLLOCATION] if plan.method != BY_COLLOCATION.method else []
    instead = changed_words(plan, [v for v in check.violations if np.isfinite(v.value)])
    ways = [instead or "wider limits"]
    if plan.problem.duration is None and any(isinstance(each, LongestDuration) for each in broken):
        if plan.problem.compensation.on:
            ways[0] += " and what compensation adds"
        ways.append("wider input limits")
    if plan.problem.travel is not None:
        ways.append(f"another {plan.problem.travel_key}")
    return other, ", or ".join(ways)


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
        compensated = _compensate_in_duration(plan, used, options)
    except TimeUpError:
        raise TimeLimitError(
            f"{problem.source}: the plan cannot be compensated: it takes too long",
            advice=time_advice(),
        ) from None
    compensated, check = judge(compensated)
    compensated = replace(compensated, solve_time_s=plan.solve_time_s + time.perf_counter() - began)
    changes = [*compensation_changes(compensated, check.violations, options), NO_COMPENSATION]
    if not check.ok:
        where = " on the nominal machine"
        if meets_before_start(compensated, check.violations):
            where += f" in the preparation, the first {compensated.lead_s:.3g} s, before the plan"
            where += " starts"
        tried = _try_settings(plan, used, options, compensated, check, time.perf_counter() - began)
        raise _refusal(compensated, check, where, "; or ".join([*tried, *changes]))
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
        return judge(_compensate_in_duration(plan, machine.with_(**tables["machine"]), own))[0]

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
    """The compensated plan; where all that is run takes more than it may, of a shorter plan; where
    the duration is free and it breaks something, of one a little longer.

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
            return made if problem.duration is not None else _with_room(made, machine, options)
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


def _with_room(fastest: Plan, machine: Machine, options: CompensationTable) -> Plan:
    """A compensated plan of free duration; where it breaks something or is no better than the plan
    as it is, that of the same path a little slower, if it fits."""
    from planner.machine.feedforward.follow import follow

    most, plan, made = fastest.problem.duration_max, fastest.compensates, fastest
    assert plan is not None
    for factor in SLOWER:
        if _is_good(made):
            return made
        if most is not None and fastest.duration + (factor - 1) * plan.duration > most:
            return fastest
        try:
            made = follow(_slower(plan, factor), machine, options)
        except (TimeUpError, NoPlanError):
            return fastest
    return made if _is_good(made) else fastest


def _is_good(made: Plan) -> bool:
    """Whether a slower plan would not be better: it keeps all, or the preparation does not."""
    from planner.machine.feedforward.advice import meets_before_start

    if "ended_early" in made.notes:
        return True
    check, said = verify(made), made.notes["compensation"]
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


def _refusal(
    plan: Plan, check: Check, where: str, advice: str | None, changes: Sequence[Change] = ()
) -> VerificationError:
    """The refusal of a plan that breaks requirements."""
    name = plan.method if plan.compensation is None else f"compensated {plan.method}"
    error = VerificationError(
        f"{plan.problem.source}: the {name} plan breaks"
        f" {len(check.violations)} requirement{'s' if len(check.violations) > 1 else ''}{where}",
        plan=replace(plan, status=VerificationError.status),
        violations=check.violations,
        advice=advice,
        changes=changes,
    )
    error.check = check
    return error
