"""Methods of other packages: what they raise or return is no bug of `planner`, and names them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast, get_args

from planner.errors import InputError
from planner.methods.keeping import Keeping, Keeps
from planner.plan.plan import Plan
from planner.plan.plan_file import PlanFile
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Demand, Part
from planner.problem.tables.kinds import Owner
from planner.support.arrays import jsonable
from planner.support.tables import line, shorten
from planner.support.user_tables import parse
from planner.verification.verify import verify


@dataclass(frozen=True)
class ForeignPlans:
    """Makes plans by a function of another package: plans that can be judged, replayed and kept."""

    owner: Owner
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

    owner: Owner
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
