"""The changes that a refusal names, tried one after the other, and those that work in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from planner.errors import InputError, NoPlanError, TimeLimitError, Violation
from planner.methods.refusal import Change, least
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.requirements.ends import Duration, Goal, Start
from planner.support import progress
from planner.support.deadline import MORE_TIME, TimeUpError, limited, remaining, share
from planner.verification.verify import verify

Attempt = Callable[[Change], Plan]
"""Plans with a change; may refuse."""

TIMES, LEAST_S = 3.0, 10.0
"""All tries together take at most so many times as long as the refusal did, or so many seconds."""

PART = 0.5
"""Of the time left, what one try may take: what helps is most often among the first changes, and
one that is as hard as what was asked must not keep the others from being tried."""


@dataclass(frozen=True)
class Tries:
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


def tried(changes: Sequence[Change], attempt: Attempt, told: Callable[[str], None]) -> Tries:
    """Try changes in order, each in its part of the time, until one leads to a verified plan."""
    vain, left = list[Change](), list[Change]()
    for change in changes:
        if remaining() <= 0:
            left.append(change)
            continue
        told(f"trying {change}")
        try:
            with share(PART):
                plan = attempt(change)
        except (TimeUpError, TimeLimitError):
            left.append(change)
        except (NoPlanError, InputError):
            vain.append(change)
        else:
            if plan.verified:
                return Tries(change, plan, vain, left)
            vain.append(change)
    return Tries(None, None, vain, left)


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
    with limited(max(LEAST_S, TIMES * seconds), "the time for trying changes"):
        tries = tried(own, attempt, lambda doing: progress.tell(f"no plan; {doing}"))
    if tries.change is None or tries.plan is None:
        said = [error.otherwise] if error.otherwise else []
        if tries.vain:
            said.append(f"tried without success: {', '.join(map(str, tries.vain))}")
        if tries.left:
            said.append(f"not tried for lack of time: {', '.join(map(str, tries.left))}")
        error.advise(MORE_TIME if remaining() <= 0 else None, "; ".join(said))
        return None
    shown = replace(tries.plan, problem=problem, verified=False, certificate=None)
    broken = verify(shown).violations
    if not broken and not tries.change.defaults:
        return tries.plan
    error.advise(f"{asked_instead(shown, broken) or tries.change} (tried)")
    if tries.change.without:
        error.blame(tries.change.without, replace(shown, status=error.status), broken)
    return None


def asked_instead(plan: Plan, broken: Sequence[Violation]) -> str:
    """What a problem would have to say for this to be a plan of it, given what it breaks now."""
    problem, parts = plan.problem, []
    found = [(*asked, v) for v in broken if (asked := problem.asking(v.label))]
    for kind in dict.fromkeys(type(demand) for demand in reversed(problem.demands)):
        own = [each for each in found if type(each[0]) is kind]
        if kind is Duration and own:
            parts.append(f"goal.duration = {least(plan.duration)} or more")
        elif kind is Goal and any(part.index == 0 for _, part, _ in own):
            ((key, value),) = problem.travel_change(plan.travel).items()
            parts.append(f"{key} = {value:.6g}")
        elif own and kind not in (Start, Goal):
            parts.append(kind.eased(sorted(own, key=lambda each: each[2].label)))
    return " and ".join(words for words in parts if words)
