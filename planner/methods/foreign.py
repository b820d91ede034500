"""Methods of other packages: what they raise or return is no bug of `planner`, and names them."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast, get_args

from planner.errors import InputError, MethodError, NoPlanError
from planner.methods.keeping import Keeping, Keeps
from planner.plan.plan import Plan
from planner.plan.plan_file import PlanFile
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Demand, Part
from planner.support.arrays import jsonable
from planner.support.deadline import TimeUpError
from planner.support.interrupts import Terminated
from planner.support.tables import error_words, line, shorten
from planner.support.user_tables import parse
from planner.verification.verify import verify

LONGEST_MESSAGE = 300
"""Characters of a foreign error's message."""


@dataclass(frozen=True)
class MethodOwner:
    """Who brings a method.

    Attributes:
        method: Its name.
        package: Name and version of the package, or the module where it was registered by hand.
    """

    method: str
    package: str

    def error(self, what: str, trace: str = "") -> MethodError:
        """The refusal that names both."""
        return MethodError(f"method '{self.method}' of {self.package} {what}", traceback=trace)

    def call(self, function: Callable[..., Any], *given: Any) -> Any:
        """What a function of the package returns.

        Raises:
            MethodError: If it raises anything but a refusal.
        """
        try:
            return function(*given)
        except (NoPlanError, TimeUpError, KeyboardInterrupt, Terminated):
            raise
        except BaseException as error:
            why = line(error_words(error), LONGEST_MESSAGE)
            raise self.error(f"failed: {why}", traceback.format_exc()) from error


@dataclass(frozen=True)
class ForeignPlans:
    """Makes plans by a function of another package: plans that can be judged, replayed and kept."""

    owner: MethodOwner
    function: Callable[..., Any]

    def __call__(self, problem: Problem, options: Any, *near: Plan) -> Plan:
        """A plan of the problem, which nobody has verified yet.

        Raises:
            MethodError: If the function fails, or what it returns is no such plan.
        """
        found = self.owner.call(self.function, problem, options, *near)
        plan: Plan = self.owner.call(self._sound, problem, found)
        return plan

    def _sound(self, problem: Problem, found: Any) -> Plan:
        """What was returned, if it is a plan through and through."""
        if not isinstance(found, Plan):
            raise self.owner.error(f"returned {line(repr(found), 60)}, which is no plan")
        plan = found.compensates or found
        if plan.problem != problem:
            raise self.owner.error("returned a plan of another problem")
        plan = replace(plan, verified=False, certificate=None)
        try:
            parse(PlanFile, jsonable(plan._to_dict()), "its plan")
        except InputError as error:
            raise self.owner.error(f"returned what no plan file can hold: {error}") from None
        verify(plan)  # here, where whatever fails is the package's
        return plan


@dataclass(frozen=True)
class ForeignKeeps:
    """What a method of another package says that it keeps."""

    owner: MethodOwner
    keeps: Keeps

    def __call__(self, problem: Problem, demand: Demand, part: Part) -> Keeping:
        """Its answer.

        Raises:
            MethodError: If it fails, or answers something else.
        """
        answer = self.owner.call(self.keeps, problem, demand, part)
        if not isinstance(answer, str) or answer not in get_args(Keeping):
            allowed = ", ".join(get_args(Keeping))
            raise self.owner.error(f"keeps {shorten(repr(answer))}, which is none of {allowed}")
        return cast("Keeping", answer)
