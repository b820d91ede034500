"""What a method says where it has no plan: changes of what was asked, as data.

A method that refuses names changes and tries none: it may not ask another method. Who asked the
method calls `advise`, which tries them one after the other and puts those that work in words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planner.errors import InputError, NoPlanError, TimeLimitError, Violation
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.reach import Reach
from planner.problem.requirements.ends import Duration, Goal, Start
from planner.support import progress
from planner.support.deadline import (
    TimeUpError,
    remaining,
    time_advice,
    time_limit,
    time_share,
)
from planner.support.files import toml
from planner.verification.verify import verify


@dataclass(frozen=True)
class Change:
    """Something else to ask for where a method has no plan.

    Attributes:
        keys: Dotted keys of the problem file to values, as `Problem.changed` takes them.
        words: What to say instead of the keys; after a method, what follows its name.
        without: The requirement left out, in words; it is blamed where the change leads to a plan.
        method: Another method to use, or "" for the same.
        defaults: Whether options given to the method are left out.
    """

    keys: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""
    without: str = ""
    method: str = ""
    defaults: bool = False

    def __str__(self) -> str:
        if self.method and not self.keys:
            return f"use the method '{self.method}'{self.words}"
        return self.words or " and ".join(f"{key} = {toml(v)}" for key, v in self.keys.items())


BY_COLLOCATION = Change(method="collocation", words=", which plans in joint coordinates")


def duration_change(seconds: float) -> Change:
    """The change to another duration, rounded up."""
    return Change({"goal.duration": float(rounded(seconds))}, f"goal.duration = {rounded(seconds)}")


def travel_changes(problem: Problem, without: str = "") -> list[Change]:
    """The travel left free, where it is given and does not follow from the rest of the goal."""
    given = problem.travel is not None and problem.has_travel_key
    return [Change(problem.travel_change(None), without=without)][:given]


def reach_changes(problem: Problem, reach: Reach) -> list[Change]:
    """The tip at the nearest place within reach, where no joints' angles meet the goal."""
    tip, keys = problem.tip, dict[str, Any]()
    if tip is None or reach.branches or reach.blocked:
        return []
    if tip.place is not None:
        keys["goal.tip_m"] = [float(f"{x:.4g}") for x in reach.tip[:2]]
    if tip.angle is not None:
        keys["goal.tip_angle_deg"] = float(f"{np.rad2deg(reach.tip[2]):.4g}")
    return [Change(keys)]


def duration_changes(problem: Problem) -> list[Change]:
    """A free duration, a free travel, and both; of those that are given."""
    free = travel_changes(problem)
    timed = any(point.time_s is not None for point in problem.waypoints)
    if (
        problem.duration is None
        or timed
        or not any(required.speed for required in problem.requirements)
    ):
        return free
    duration = Change({"goal.duration": "free"})
    return [duration, *free, *(Change({**duration.keys, **each.keys}) for each in free)]


def path_changes(problem: Problem) -> list[Change]:
    """One requirement on the path left out after the other, but for the travel."""
    limits, out = problem.to_dict().get("limits", {}), dict[str, Change]()
    for demand in reversed(problem.demands):
        if found := demand.removal(limits):
            keys, words, what = found
            out[what] = Change(keys, words, what)
    return list(out.values())


def rounded(value: float) -> str:
    """A number rounded up to four digits or so."""
    scale = 10.0 ** (3 - int(np.floor(np.log10(value))))
    return f"{np.ceil(value * scale) / scale:.10g}"


Attempt = Callable[[Change], Plan]
"""Plans with a change; may refuse."""

MOST_TIMES_REFUSAL, LEAST_S, MOST_S = 3.0, 10.0, 60.0
"""All tries together take at most so many times as long as the refusal did, but at least the first
and at most the second number of seconds."""

TRY_SHARE = 0.5
"""Of the time left, what one try may take: what helps is most often among the first changes, and
one that is as hard as what was asked must not keep the others from being tried."""


@dataclass(frozen=True)
class TriedChanges:
    """What became of changes.

    Attributes:
        change: The first that led to a verified plan, or None.
        plan: That plan.
        vain: Those that led to none.
        left: Those for which there was no time.
    """

    change: Change | None
    plan: Plan | None
    vain: list[Change]
    left: list[Change]


def try_changes(
    changes: Sequence[Change], attempt: Attempt, told: Callable[[str], None]
) -> TriedChanges:
    """Try changes in order, each in its part of the time, until one leads to a verified plan."""
    vain, left = list[Change](), list[Change]()
    for change in changes:
        if remaining() <= 0:
            left.append(change)
            continue
        told(f"trying {change}")
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


def advise(error: NoPlanError, problem: Problem, attempt: Attempt, seconds: float) -> Plan | None:
    """Try the changes of a refusal, and say in it what helps.

    Other methods are named and not tried: `planner.check` does that.

    Args:
        error: The refusal, which is worded anew.
        problem: What was asked.
        attempt: Plans with a change.
        seconds: How long the refusal took.

    Returns:
        A plan of the problem as it was asked, if trying came upon one.
    """
    own = [change for change in error.changes if not change.method]
    if not own:
        return None
    allowed = min(max(LEAST_S, MOST_TIMES_REFUSAL * seconds), MOST_S)
    with time_limit(allowed, "the time for trying changes"):
        tries = try_changes(own, attempt, lambda doing: progress.tell(f"no plan; {doing}"))
    if tries.change is None or tries.plan is None:
        said = [error.otherwise] if error.otherwise else []
        if tries.vain:
            said.append(f"tried without success: {', '.join(map(str, tries.vain))}")
        if tries.left:
            said.append(f"not tried for lack of time: {', '.join(map(str, tries.left))}")
        error.advise(time_advice() if remaining() <= 0 else None, "; ".join(said))
        return None
    shown = replace(tries.plan, problem=problem, verified=False, certificate=None)
    broken = verify(shown).violations
    if not broken and not any(key.startswith("method.") for key in tries.change.keys):
        return tries.plan  # with other options a plan is none of what was asked
    error.advise(f"{changed_words(shown, broken) or tries.change} (tried)")
    if tries.change.without:
        error.blame(tries.change.without, replace(shown, status=error.status), broken)
    return None


def changed_words(plan: Plan, broken: Sequence[Violation]) -> str:
    """What a problem would have to say for this to be a plan of it, given what it breaks now."""
    problem, parts = plan.problem, []
    found = [(*asked, v) for v in broken if (asked := problem.asking(v.label))]
    for kind in dict.fromkeys(type(demand) for demand in reversed(problem.demands)):
        own = [each for each in found if type(each[0]) is kind]
        if kind is Duration and own:
            parts.append(f"goal.duration = {rounded(plan.duration)} or more")
        elif kind is Goal and any(part.index == 0 for _, part, _ in own):
            ((key, value),) = problem.travel_change(plan.travel).items()
            parts.append(f"{key} = {value:.6g}")
        elif own and kind not in (Start, Goal):
            parts.append(kind.easing(sorted(own, key=lambda each: each[2].label)))
    return " and ".join(words for words in parts if words)
