"""Solve a problem by a method: return a verified plan, or refuse and say why.

Compensation corrects the systematic errors of a machine in advance: backlash, shaft torsion, creep
and lag are similar on all machines of a kind, so most of their effect needs no sensors.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.compensation import compensate_in_time, compensate_plan
from planner.errors import InfeasibleError, InputError, NoPlanError, TimeLimitError
from planner.methods.judgement import judge_plan, judge_slowed
from planner.methods.keeping import refuse_unkept
from planner.methods.refusal import Change, advise, path_changes
from planner.methods.registry import METHODS, Method, find_method, merged_options, parse_spec, typed
from planner.plan.measures import Objective
from planner.plan.plan import Plan, expect_plan, refuse_inexecutable
from planner.plan.spec import Spec
from planner.plan.trajectory import StateTrajectory
from planner.problem.feasibility import SHORTEST_S, refuse_too_short
from planner.problem.free_space import why_blocked
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.tables.method_options import LawOptions
from planner.problem.tables.problem_file import CompensationTable
from planner.support.calculus.bernstein import Bernstein
from planner.support.deadline import (
    SEARCH_SHARE,
    TimeUpError,
    check_seconds,
    default_limit,
    holds_answer,
    time_advice,
    time_limit,
    time_share,
)
from planner.support.progress import Listener, current_progress, progress_listener
from planner.support.user_tables import parse
from planner.verification.verify import GOAL_TOLERANCE, Check, verify

if TYPE_CHECKING:
    from planner.machine.machine import Machine


SAME_PLACE = GOAL_TOLERANCE / 20 * (1 + 1e-6)
"""Largest distance between goal and start, in radians or metres, at which both count as equal,
since verification could not distinguish the two."""


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
        method: Name of a method (`planner.METHODS` lists them), with options and the word
            `compensated` if needed, as in `compare`: "polynomial:points=auto".
        warm: A plan of a similar problem of the same system, by any method. 'collocation' and
            'desensitised' start from it instead of searching and return the nearest local optimum.
        time_limit_s: Seconds for the whole call: planning, verification, trying advice after a
            refusal, and compensation. By default only the search is limited, to 60 s of processor
            time. When time is up, the best verified plan so far is returned, uncompensated if
            compensation was not reached; its `notes["ended_early"]` says what it lacks. Without a
            plan the call raises `TimeLimitError`. The call ends at the latest after 1.2 times the
            limit plus two seconds. The limit replaces a method's option of the same name.
        progress: Called with a `planner.support.progress.Progress` at every step. The logger
            `planner` receives the same steps.
        **options: Override single keys of the problem's `[method.<name>]` table.

    Returns:
        A plan with `verified` True and a `certificate`. Its status is "time_limit" if the limit
        ended a step early. If the problem's `[compensation]` is on, the plan is compensated for its
        machine (see `planner.compensate`). There is one exception: a method in chained coordinates
        with `allow_singular` may return a path outside the domain, with status "singular" and
        `verified` False.

    Raises:
        InputError: If the method or an option is unknown or has an impossible value, the problem is
            not a `Problem`, `warm` belongs to another system, or the method cannot use `warm`.
        TimeLimitError: If time is up without a plan; the message says how far the search got.
        NoPlanError: If no plan is found, or the plan breaks a requirement; the subclass tells
            which. The error carries the last iterate and its violations. Before the error, changes
            of the problem are tried (`planner.methods.refusal`), within the time limit and with at
            most a few times the work of the failed search, counted in iterations of the solvers.
    """
    return solve_and_check(
        problem, method, options, warm=warm, time_limit_s=time_limit_s, progress=progress
    )[0]


def solve_and_check(
    problem: AnyProblem,
    method: str | Spec,
    options: Mapping[str, Any] = MappingProxyType({}),
    *,
    warm: Plan | None = None,
    time_limit_s: float | None = None,
    progress: Listener | None = None,
    advice: bool = True,
    compensated_for: Machine | None = None,
) -> tuple[Plan, Check]:
    """Plan a motion as `solve` does, and return the plan with the result of its verification.

    Args:
        problem, method, options, warm, time_limit_s, progress: As for `solve`.
        advice: Whether to try the changes that a refusal names.
        compensated_for: The machine to compensate for. By default the problem's machine.
    """
    problem = problem_of(problem)
    spec = parse_spec(method)
    entry, options = find_method(spec.method), {**spec.options, **options}
    if time_limit_s is not None:
        time_limit_s = check_seconds(time_limit_s)
        if "time_limit_s" in entry.options.model_fields:
            options["time_limit_s"] = time_limit_s
    merged = merged_options(problem, entry, options)
    must_compensate = spec.compensated or problem.compensation.on
    # A law's path does not depend on the duration, unless it passes points at given times.
    scales = isinstance(merged, LawOptions) and getattr(merged, "points", []) in ([], "auto")

    def attempt(change: Change, short: Plan | None) -> Plan:
        changed = problem.changed(change.keys)
        duration = changed.duration if change.keys.keys() == {"goal.duration"} else None
        if duration and short is not None and (scales or entry.finds_time):  # slow the motion
            with suppress(NoPlanError):
                factor = duration / short.duration
                return judge_slowed(short, factor, problem=changed, status="solved")
        given = merged_options(changed, entry, {} if change.defaults else options)
        return judge_plan(_plan_by_method(changed, entry, given, None))[0]

    limit_s = getattr(merged, "time_limit_s", None) or time_limit_s
    with time_limit(limit_s) as whole, progress_listener(progress):
        try:
            with (
                default_limit(limit_s) as span,
                time_share(SEARCH_SHARE if must_compensate else 1.0, condition=holds_answer),
            ):
                plan, check = judge_plan(_plan_by_method(problem, entry, merged, warm))
        except TimeUpError:
            far = current_progress()
            came = f" after {far.solves} solves (the search was {far.doing})" if far else ""
            raise TimeLimitError(
                f"{span.why} ended the method '{spec.text}' before it had a plan{came}",
                source=problem.source,
                advice=time_advice(),
            ) from None
        except NoPlanError as error:
            retry = partial(attempt, short=error.plan)
            advised = advise(error, problem, retry, whole.work) if advice else None
            if advised is None:
                raise
            plan, check = judge_plan(replace(advised, problem=problem))
        if not must_compensate or plan.status == "singular":
            return plan, check
        return compensate_in_time(plan, check, compensated_for, problem.compensation)


def _plan_by_method(problem: Problem, entry: Method, options: Any, warm: Plan | None) -> Plan:
    """Plan by a method, after handling problems that need no motion or provably have no plan."""
    if still := _plan_stay(problem, entry.name, options):
        return still
    if problem.obstacles and (why := why_blocked(problem)):
        raise InfeasibleError(why, source=problem.source, changes=path_changes(problem))
    if not entry.finds_time:
        refuse_too_short(problem)
    refuse_unkept(problem, entry.name, entry.keeps)
    if warm is None:
        return entry.plan(problem, options)
    if entry.replan is None:
        able = ", ".join(f"'{m.name}'" for m in METHODS.values() if m.replan)
        raise InputError(
            f"method '{entry.name}' cannot start from a plan; omit warm, or use {able}"
        )
    expect_plan(warm)
    return entry.replan(problem, options, warm.compensates or warm)


def _plan_stay(problem: Problem, method: str, options: Any) -> Plan | None:
    """Return a plan that stays at the start if staying solves the problem, else None.

    Args:
        problem: The problem.
        method: Name of the method that the plan reports.
        options: Options that the plan reports.

    Returns:
        A plan with zero inputs over the given duration, or over `SHORTEST_S` (at most
        `duration_max`) if the duration is free. None if the goal is elsewhere, or staying breaks a
        requirement such as a waypoint.
    """
    away = np.abs(problem.goal - problem.start)
    if np.any(away > SAME_PLACE):  # NaN for a coordinate that the goal leaves free
        return None
    shortest = min(SHORTEST_S, problem.duration_max or SHORTEST_S)
    free, seconds = problem.duration is None, problem.duration or shortest
    breaks = np.array([0.0, seconds])
    q_curve = Bernstein(problem.start[None, None], breaks)
    still = StateTrajectory(problem.system, q_curve, Bernstein(np.zeros((1, 1, 2)), breaks))
    plan = Plan(
        problem=problem,
        method=method,
        options=options.model_dump(),
        trajectory=still,
        objective=seconds if free else 0.0,
        aim=Objective("time", {"duration": 1.0}) if free else Objective("effort", {"effort": 1.0}),
        notes={"start": "none: the start is the goal, and the plan stays there"},
    )
    return plan if verify(plan).ok else None


def compensate(
    plan: Plan | AnyProblem,
    machine: Machine | str | None = None,
    *,
    method: str = "collocation",
    **options: Any,
) -> Plan:
    """Change a plan's inputs so that the nominal machine follows its motion and ends at the goal.

    The nominal machine has all systematic effects and no random spread, and is simulated as its
    table says (quasi-static or dynamic). No input exceeds the plan's limits.

    Args:
        plan: A plan of an arm with friction disks (`system.kind = "manipulator"`), or a problem,
            its file or its tables, which is planned first. If the plan is already compensated, its
            original plan is compensated again.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        method: The method that plans a problem.
        **options: Override the problem's `[compensation]` table, key by key:
            `preparation`, `take_up`, `correction`, `back_off`, `lag`, `gearheads`.

    Returns:
        A verified plan whose inputs are the motor commands. The commands begin with a preparatory
        motion of `lead_s` seconds, pause the original plan wherever the drive reverses, and end
        `tail_s` seconds after the original plan; `clock` maps the commands' time to the original
        plan's. q(t) is the motion predicted on the nominal machine at the ends of the ticks,
        interpolated linearly, and is verified: goal (to 0.05 degrees), limits, waypoints and
        obstacles at all times. `compensates` is the original plan, verified too; replays measure
        errors against it. If compensation does not reduce the predicted path error on the nominal
        machine, an `InputWarning` gives both errors.

    Raises:
        InputError: If the plan is not executable, the system is not a manipulator, or an option is
            wrong.
        NoPlanError: If the plan cannot be compensated; the message says why.
    """
    if isinstance(plan, Problem | str | Path | Mapping):
        problem = problem_of(plan)
        plain = problem.changed({"compensation.on": False}) if problem.compensation.on else problem
        plan = solve(plain, method)
    refuse_inexecutable(plan)
    plan = plan.compensates or plan
    settings = plan.problem.compensation.model_dump(exclude_unset=True)
    table = parse(CompensationTable, {**settings, **options, "on": True}, "options of compensate")
    return compensate_plan(plan, machine, table)[0]
