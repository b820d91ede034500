"""Verify the plan of a method, or refuse it with changes that would help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import TimeLimitError, VerificationError
from planner.methods.keeping import not_promised
from planner.methods.refusal import BY_COLLOCATION, Change, changed_words, duration_change
from planner.methods.registry import find_method
from planner.plan.plan import Plan
from planner.problem.requirements.ends import LongestDuration
from planner.problem.requirements.requirement import Requirement
from planner.support.deadline import time_advice
from planner.support.progress import tell
from planner.verification.verdict import judge
from planner.verification.verify import Check, verify


def judge_plan(plan: Plan) -> tuple[Plan, Check]:
    """Verify the plan of a method; return the plan and the result of the verification.

    A plan with the status "singular" is returned even if it breaks requirements.

    Raises:
        TimeLimitError: If the plan breaks a requirement because there was no time to refine it;
            its status is that of the plan, "interrupted" after Ctrl-C.
        VerificationError: If the plan breaks a requirement for any other reason.
    """
    tell("verifying")
    if plan.status == "singular":
        return plan, verify(plan)
    plan, check = judge(plan)
    if check.ok:
        return plan, check
    if plan.status in ("interrupted", TimeLimitError.status):
        why = plan.notes.get("ended_early", "something ended the search")
        error = TimeLimitError(
            f"{why}, and no time was left to refine the plan",
            source=plan.problem.source,
            list_head=", which breaks",
            plan=plan,
            violations=check.violations,
            advice=None if plan.status == "interrupted" else time_advice(),
        )
        error.status = plan.status
        raise error
    others = not_promised(plan.problem, find_method(plan.method).keeps)
    said = ""
    if left := sum(v.label in others for v in check.violations):
        part = "" if left == len(check.violations) else f"{left} of "
        said = f", {part}which the {plan.method} method does not promise to keep"
    changes, otherwise = _remedies(plan, check)
    raise refusal(plan, check, said, otherwise, changes)


def judge_slowed(plan: Plan, factor: float, **changes: Any) -> Plan:
    """Slow a plan down to `factor` times its duration, set the fields in `changes`, and verify.

    Raises:
        NoPlanError: If the slowed plan breaks a requirement, see `judge_plan`.
    """
    trajectory = plan.trajectory.slowed(factor)
    objective = plan.aim.value(trajectory)
    value = plan.objective if objective is None else objective
    return judge_plan(replace(plan, trajectory=trajectory, objective=value, **changes))[0]


def _remedies(plan: Plan, check: Check) -> tuple[list[Change], str | None]:
    """Return changes that may mend the violations of a plan, and further advice in words or None.

    A violation without a limit (NaN) has no remedy, since the plan itself is inaccurate.
    """
    if any(np.isnan(v.limit) for v in check.violations):
        return [], None
    other = [BY_COLLOCATION] if plan.method != BY_COLLOCATION.method else []
    broken = [v.demand for v in check.violations if v.demand is not None]
    speeds = [each.speed_power if isinstance(each, Requirement) else 0 for each in broken]
    if len(broken) == len(check.violations) and all(speeds) and plan.trajectory.kind == "chained":
        sizes = (v.value / v.limit for v in check.violations)
        factor = max(size ** (1 / speed) for size, speed in zip(sizes, speeds, strict=True))
        if factor < float("inf"):
            slower = duration_change(plan.duration * factor * 1.0001)
            return [slower, BY_COLLOCATION], None
    if len(broken) < len(check.violations) or any(v.misses_goal for v in check.violations):
        fine = "a finer mesh: more method.collocation.intervals or a higher degree"
        if plan.compensation is not None:
            fine = "compensation (compensation.on = true) or more time (goal.duration)"
        return other, None if other else fine
    jumps = [f"no limit on the {v.label}" for v in check.violations if np.isinf(v.value)]
    instead = changed_words(plan, [v for v in check.violations if np.isfinite(v.value)])
    ways = [" and ".join(filter(None, [*jumps, instead]))]
    if plan.problem.duration is None and any(isinstance(each, LongestDuration) for each in broken):
        if plan.problem.compensation.on:
            ways[0] += " and what compensation adds"
        ways.append(f"larger {plan.problem.limits.input_words}")
    if plan.problem.travel is not None:
        ways.append(f"another {plan.problem.travel_key or 'goal'}")
    return other, ", or ".join(filter(None, ways)) or None


def refusal(
    plan: Plan,
    check: Check,
    where: str,
    advice: str | Sequence[str] | None,
    changes: Sequence[Change] = (),
) -> VerificationError:
    """Return the error to raise for a plan that breaks requirements.

    Args:
        plan: The plan.
        check: The result of its verification.
        where: Words to add to the message after the number of broken requirements.
        advice: Advice in words, or None.
        changes: Changes of the problem that may help.
    """
    name = f"compensated {plan.method}" if plan.is_compensated else plan.method
    where += " on the nominal machine" * plan.ends_on_machine
    error = VerificationError(
        f"the {name} plan breaks"
        f" {len(check.violations)} requirement{'s' if len(check.violations) > 1 else ''}{where}",
        source=plan.problem.source,
        plan=replace(plan, status=VerificationError.status),
        violations=check.violations,
        advice=advice,
        changes=changes,
    )
    error.check = check
    return error
