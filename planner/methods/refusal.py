"""Changes of the problem that a method may suggest when it refuses, and trials of the changes.

A method that finds no plan names changes but tries none, since it must not call other methods. The
caller of the method uses `advise`, which tries the changes in turn and describes one that works.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planner.errors import InputError, NoPlanError, TimeLimitError, Violation
from planner.plan.plan import Plan
from planner.problem.free_space import blocked_links
from planner.problem.problem import Problem
from planner.problem.reach import Reach
from planner.problem.requirements.ends import Duration, Goal, Start
from planner.support import progress
from planner.support.deadline import TimeUpError, remaining, time_advice, time_share, work_limit
from planner.support.files import toml
from planner.verification.verify import verify


@dataclass(frozen=True)
class Change:
    """A change of the problem or method that may lead to a plan.

    Attributes:
        keys: Dotted keys of the problem file and their values, as for `Problem.changed`.
        words: Text to show instead of the keys; for a change of method, text after its name.
        without: The requirement that the change removes, in words; named as the cause if the change
            leads to a plan.
        solid: Whether this requirement keeps bodies apart. Such a change is tried last, and only to
            tell what is in the way.
        method: Another method to use, or "" for the same method.
        defaults: Whether to use the method's default options instead of the given ones.
    """

    keys: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""
    without: str = ""
    solid: bool = False
    method: str = ""
    defaults: bool = False

    def __str__(self) -> str:
        if self.method and not self.keys:
            return f"use the method '{self.method}'{self.words}"
        return self.words or " and ".join(f"{key} = {toml(v)}" for key, v in self.keys.items())


BY_COLLOCATION = Change(method="collocation", words=", which plans in joint coordinates")


def duration_change(seconds: float) -> Change:
    """Return the change of goal.duration to the given seconds, rounded up to about four digits."""
    text = round_up(seconds)
    return Change({"goal.duration": float(text)}, f"goal.duration = {text}")


def travel_changes(problem: Problem, without: str = "") -> list[Change]:
    """Return a list with the change to a free travel, empty if the travel is free or has no key.

    The travel has no key in the file if the goal's coordinates determine it.
    """
    if problem.travel is None or not problem.travel_key:
        return []
    return [Change(problem.travel_change(None), without=without)]


def reach_changes(problem: Problem, reach: Reach) -> list[Change]:
    """Return a list with the change to the nearest reachable tip pose; empty if the goal is one."""
    tip, keys = problem.tip, dict[str, Any]()
    if tip is None or reach.branches or reach.blocked:
        return []
    if tip.place is not None:
        keys["goal.tip_m"] = [float(f"{x:.4g}") for x in reach.tip[:2]]
    if tip.angle is not None:
        keys["goal.tip_angle_deg"] = float(f"{np.rad2deg(reach.tip[2]):.4g}")
    return [Change(keys)]


def duration_changes(problem: Problem) -> list[Change]:
    """Return the changes to a free duration, a free travel, and both, for those that are fixed.

    The duration stays if a waypoint has a time or no limit depends on the speed.
    """
    free = travel_changes(problem)
    timed = any(point.time_s is not None for point in problem.waypoints)
    limited = any(requirement.speed_power for requirement in problem.requirements)
    if problem.duration is None or timed or not limited:
        return free
    duration = Change({"goal.duration": "free"})
    return [duration, *free, *(Change({**duration.keys, **each.keys}) for each in free)]


def path_changes(problem: Problem) -> list[Change]:
    """Return changes that each remove one requirement on the path, except the travel.

    Joint limits come first if obstacles block the arm within them, since an obstacle may be fixed.
    """
    out = dict[str, Change]()
    blocked = blocked_links(problem)
    for demand in problem.demands if blocked else reversed(problem.demands):
        if removal := demand.removal():
            keys, words, what = removal
            out[what] = Change(keys, words, what, demand.solid)
    return list(out.values())


def looser_limits(problem: Problem, of_paths: bool = False) -> list[str]:
    """Return advice to widen limits and to lower margins, by the keys of the problem file.

    Args:
        problem: The problem.
        of_paths: Whether to leave out limits that a slow enough motion keeps.
    """
    keys: dict[str, dict[str, None]] = {"wider": {}, "smaller": {}}
    for each in problem.requirements:
        for part in each.parts if not (of_paths and each.speed_power) else ():
            if key := part.key or (each.key and f"limits.{each.key}"):
                keys["wider" if np.isfinite(part.high) else "smaller"][key] = None
    return [f"{word} {' and '.join(named)}" for word, named in keys.items() if named]


def round_up(value: float) -> str:
    """Format a number, rounded up to about four digits."""
    scale = 10.0 ** (3 - int(np.floor(np.log10(value))))
    return f"{np.ceil(value * scale) / scale:.10g}"


Attempt = Callable[[Change], Plan]
"""Function that plans the problem with a change, or raises a refusal."""

MOST_TIMES_REFUSAL, LEAST_S, MOST_S = 3.0, 8.0, 40.0
"""Limits of the solvers' work for all tries together (`planner.support.deadline.spend`):
`MOST_TIMES_REFUSAL` times the work until the refusal, but at least `LEAST_S` and at most `MOST_S`.
What else a try does takes about as long as its solvers."""

TRY_SHARE = 0.5
"""Fraction of the remaining work for one try. The first changes help most often, but a try that is
as hard as the original problem must leave work for the others."""


@dataclass(frozen=True)
class TriedChanges:
    """Result of trying changes in turn.

    Attributes:
        change: The first change that led to a verified plan, or None.
        plan: The plan that this change led to, or None.
        vain: Changes that did not lead to a plan.
        left: Changes that were not tried, or not to the end, because a limit came first.
    """

    change: Change | None
    plan: Plan | None
    vain: list[Change]
    left: list[Change]


def try_changes(
    changes: Sequence[Change], attempt: Attempt, report: Callable[[str], None]
) -> TriedChanges:
    """Try changes in order, each in a share of what the limits leave, until one leads to a verified
    plan."""
    vain, left = list[Change](), list[Change]()
    for change in changes:
        if remaining() <= 0:
            left.append(change)
            continue
        report(f"trying {change}")
        try:
            with time_share(TRY_SHARE):
                plan = attempt(change)
        except (TimeUpError, TimeLimitError):
            left.append(change)
        except (NoPlanError, InputError):
            vain.append(change)
        else:
            if plan.verified:
                return TriedChanges(change, plan, vain, left)
            vain.append(change)
    return TriedChanges(None, None, vain, left)


def advise(error: NoPlanError, problem: Problem, attempt: Attempt, work: float) -> Plan | None:
    """Try the changes of a refusal, and add the change that helps to the refusal's message.

    Other methods are named but not tried: `planner.check` tries them. How much is tried depends on
    the problem alone, not on the computer, unless a time limit of the caller ends the tries.

    Args:
        error: The refusal, whose message is changed.
        problem: The original problem.
        attempt: Plans the problem with a change.
        work: Work of the method's solvers until its refusal, s.

    Returns:
        A plan of the original problem, if a try happened to find one; else None.
    """
    changes = [change for change in error.changes if not change.method]
    changes.sort(key=lambda change: change.solid)
    if not changes:
        return None
    allowed = min(max(LEAST_S, MOST_TIMES_REFUSAL * work), MOST_S)
    with work_limit(allowed, "the limit of work for trying changes"):
        tries = try_changes(changes, attempt, lambda doing: progress.tell(f"no plan; {doing}"))
    if tries.change is None or tries.plan is None:
        said = [error.otherwise] if error.otherwise else []
        if vain := [str(change) for change in tries.vain if not change.solid]:
            said.append(f"tried without success: {', '.join(vain)}")
        if left := [str(change) for change in tries.left if not change.solid]:
            said.append(f"not tried, or not to the end: {', '.join(left)}")
        error.advise(time_advice() if remaining() <= 0 else None, "; ".join(said))
        return None
    shown = replace(tries.plan, problem=problem, verified=False, certificate=None)
    violations = verify(shown).violations
    if not violations and not any(key.startswith("method.") for key in tries.change.keys):
        return tries.plan  # a plan with other options does not answer the request
    words, change = changed_words(shown, violations), str(tries.change)
    wider = f" with {change}" if words and change.startswith("limits.") else ""
    if any(v.demand is not None and v.demand.solid and v.value <= 0 for v in violations):
        error.advise(error.otherwise, words if words != error.otherwise else None)
    else:
        error.advise(f"{words or change} (tried{wider})")
        error.has_remedy = True
    if tries.change.without:
        error.blame(tries.change.without, replace(shown, status=error.status), violations)
    return None


def changed_words(plan: Plan, violations: Sequence[Violation]) -> str:
    """Say in words which changes of its problem would allow a plan with the given violations."""
    problem, parts = plan.problem, []
    for kind in dict.fromkeys(type(demand) for demand in reversed(problem.demands)):
        group = [v for v in violations if type(v.demand) is kind]
        if kind is Duration and group:
            parts.append(f"goal.duration = {round_up(plan.duration)} or more")
        elif kind is Goal and any(v.part.index == 0 for v in group):
            ((key, value),) = problem.travel_change(plan.travel).items()
            parts.append(f"{key} = {value:.6g}")
        elif group and kind not in (Start, Goal):
            parts.append(kind.easing(sorted(group, key=lambda v: v.label)))
    return " and ".join(words for words in parts if words)
