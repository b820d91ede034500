"""Wrappers of the methods of other packages, so that an error names the package at fault."""

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
from planner.problem.tables.kinds import Provider
from planner.support.tables import line, shorten
from planner.support.user_tables import parse
from planner.verification.verify import verify


@dataclass(frozen=True)
class ForeignPlans:
    """Callable that plans with another package's function and checks the returned plan."""

    provider: Provider
    function: Callable[..., Any]

    def __call__(self, problem: Problem, options: Any, *near: Plan) -> Plan:
        """Return the package's plan of the problem, marked as not verified.

        Raises:
            MethodError: If the function fails or does not return a plan of this problem.
        """
        answer = self.provider.call(self.function, problem, options, *near)
        plan: Plan = self.provider.call(self._sound, problem, answer)
        return plan

    def _sound(self, problem: Problem, answer: Any) -> Plan:
        """Return a package's answer if it is a complete plan of the problem.

        A compensated plan is replaced by its original; another answer raises a `MethodError`.
        """
        if not isinstance(answer, Plan):
            raise self.provider.error(f"returned {line(repr(answer), 60)}, which is not a plan")
        plan = answer.compensates or answer
        if plan.problem != problem:
            raise self.provider.error("returned a plan of another problem")
        plan = replace(plan, verified=False, certificate=None)
        try:
            parse(PlanFile, plan.to_dict(), "its plan")
        except InputError as error:
            raise self.provider.error(f"returned a plan that cannot be saved: {error}") from None
        verify(plan)  # a failure in here is attributed to the package
        return plan


@dataclass(frozen=True)
class ForeignKeeps:
    """Callable that asks another package's method which requirements it keeps."""

    provider: Provider
    keeps: Keeps

    def __call__(self, problem: Problem, demand: Demand, part: Part) -> Keeping:
        """Return the answer "kept", "judged" or "never" (see `keeping`) for one part of a demand.

        Raises:
            MethodError: If the function fails or its answer is none of these.
        """
        answer = self.provider.call(self.keeps, problem, demand, part)
        if not isinstance(answer, str) or answer not in get_args(Keeping):
            allowed = ", ".join(get_args(Keeping))
            raise self.provider.error(f"keeps {shorten(repr(answer))}; it must be one of {allowed}")
        return cast("Keeping", answer)
