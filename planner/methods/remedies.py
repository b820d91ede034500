"""What a refusal advises: one change that makes a plan possible, and has been tried.

Trying takes as long as planning, and a change tried may be refused in turn: so a method first
refuses without advice, and looks for it only where the refusal is its last word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner import progress
from planner.deadline import TimeUpError
from planner.errors import InputError, NoPlanError, TimeLimitError
from planner.plan import Plan
from planner.problem import Problem
from planner.verify import verify

TRIED = " (tried)"
"""After advice with which a verified plan was found."""

UNTRIED = "a larger time limit: there was no time left to find a change that helps"


class UnexplainedError(NoPlanError):
    """A refusal to which advice is still to be found; methods let none of them out.

    Attributes:
        explained: From a method's way to plan, with which changes are tried, to the refusal proper.
    """

    def __init__(self, explained: Callable[[Any], NoPlanError], plan: Plan | None = None) -> None:
        super().__init__("no plan was found", plan=plan)
        self.explained = explained


@dataclass(frozen=True, eq=False)
class Change:
    """A change of a problem, of options or of the method.

    Attributes:
        words: What to say of it, given the plan that it leads to.
        plan: Plans with it; may refuse.
    """

    words: Callable[[Plan], str]
    plan: Callable[[], Plan]


def tried(changes: Iterable[Change]) -> str | None:
    """The first change that leads to a verified plan, in words; None if none does.

    Where time is up before all are tried, more time is advised.
    """
    for change in changes:
        progress.tell("no plan; trying a change of the problem")
        try:
            plan = change.plan()
        except (TimeUpError, TimeLimitError):
            return UNTRIED
        except (NoPlanError, InputError):
            continue
        if verify(plan).ok:
            return change.words(plan) + TRIED
    return None


def longer(
    problem: Problem, seconds: float, plan: Callable[[Problem], Plan], more: str = ""
) -> Change:
    """Another duration; `more` follows it in words."""
    value = least(seconds)
    changed = replace(problem, duration=float(value))
    return Change(lambda _: f"goal.duration = {value}{more}", lambda: plan(changed))


def travelling(plan: Plan) -> str:
    """The key that asks for a plan's travel."""
    ((key, value),) = plan.problem.travel_change(plan.travel).items()
    return f"{key} = {value:.6g}"


def least(value: float) -> str:
    """A number rounded up to four digits or so."""
    scale = 10.0 ** (3 - int(np.floor(np.log10(value))))
    return f"{np.ceil(value * scale) / scale:.10g}"
