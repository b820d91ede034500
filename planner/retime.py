"""The fastest timing of a plan's path.

The systems are driftless: the path does not depend on the timing. So a plan that is too fast for
the motors, or too slow for the user, can keep its path and get another timing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError, SingularError, VerificationError, expect
from planner.plan.claims import Certificate
from planner.plan.fastest_timing import InputMask, fastest_motion
from planner.plan.measures import Objective, peak_inputs
from planner.plan.plan import Plan, expect_plan
from planner.problem.problem import Problem
from planner.verification.certify import certify
from planner.verification.verdict import judge

SAMPLING_EXCESS = 1e-3
"""Largest relative excess over a limit that sampling may miss; `verify` refuses a larger excess."""


def retime(
    plan: Plan,
    limits: Mapping[str, Any] | None = None,
    rest: bool | None = None,
    intervals: int = 400,
) -> Plan:
    """Give a plan's path its fastest timing within input limits.

    With limits on the inputs only, the result is exact: at every instant one input is at its limit
    (the duration is ∫ max|uᵢ|/limitᵢ over the plan). With limits on input rates too, the result is
    the optimum of a convex program (`planner.plan.fastest_timing`), 0.1 to 0.3 % above the least
    time with 400 intervals, and the motion stops at every corner of the path, where the ratio of
    the inputs jumps. Pauses of the plan are left out.

    Args:
        plan: A plan whose inputs exist at all times.
        limits: Keys of the `[limits]` table to replace, as in {"input_rad_s": 0.3,
            "input_rate_rad_s2": [2.0, 1.0]}. By default the problem's limits.
        rest: Whether inputs are zero at both ends, which needs rate limits. By default True if
            there are rate limits.
        intervals: Number of intervals of the convex program.

    Returns:
        A verified plan with a certificate and the same path. Its problem has the new limits and the
        new duration.

    Raises:
        InputError: If the plan is compensated or does not move, a moving input has no limit, `rest`
            is set without rate limits, or a limit's key or value is wrong.
        SingularError: If the plan is not executable.
        NotConvergedError: If the convex program is not solved.
        VerificationError: If the retimed plan breaks another requirement of the problem.
    """
    expect_plan(plan)
    if plan.is_compensated:
        raise InputError(
            "retime needs a plan whose inputs follow the kinematics, but this one is compensated"
            " for a machine; use the original plan, plan.compensates"
        )
    plan = plan.compensates or plan
    if not plan.executable:
        raise SingularError(
            "a plan that leaves the domain of the chained-form chart has no inputs to retime",
            source=plan.problem.source,
            plan=plan,
        )
    if limits is not None:
        expect(Mapping, limits, 'give keys of [limits], as in {"input_rad_s": 0.3}')
    changes = {f"limits.{key}": value for key, value in (limits or {}).items()}
    problem = plan.problem.changed({**changes, "goal.duration": "free"})
    moving = peak_inputs(plan.trajectory) > 1e-12
    if rest is None:
        rest = bool(np.isfinite(problem.limits.input_rate[moving]).any())
    _refuse_unlimited(problem, moving, rest)
    trajectory, notes = fastest_motion(
        plan.trajectory, problem.limits, problem.requirements, moving, rest, intervals
    )
    timed = problem.changed({"goal.duration": trajectory.duration})
    certificate = certify(replace(plan, problem=timed, trajectory=trajectory))
    factor = _excess_factor(problem, certificate)
    if factor > 1:
        trajectory = trajectory.slowed(factor)
        timed = problem.changed({"goal.duration": trajectory.duration})
    notes = {"retimed_from_s": plan.duration, **notes, **plan.notes}
    slowed = "slowed_for_other_limits" in notes
    retimed = replace(
        plan,
        problem=timed,
        trajectory=trajectory,
        objective=trajectory.duration,
        aim=Objective("time", {"slowed duration" if slowed else "least duration": 1.0}),
        notes=notes,
    )
    retimed, check = judge(retimed, None if factor > 1 else certificate)
    if check.ok:
        return retimed
    raise VerificationError(
        f"the retimed {plan.method} plan breaks {len(check.violations)} requirement(s)",
        source=plan.problem.source,
        plan=replace(retimed, status=VerificationError.status),
        violations=check.violations,
    )


def _excess_factor(problem: Problem, certificate: Certificate) -> float:
    """Return the factor (≥ 1) to slow a motion by, so that it keeps limits between samples too."""
    factor = 1.0
    for requirement in problem.requirements:
        for part in requirement.parts if requirement.speed_power else ():
            excess = -certificate[part.label].attained / part.scale
            if 0 < excess < SAMPLING_EXCESS:
                factor = max(factor, (1 + excess) ** (1 / requirement.speed_power) * (1 + 1e-9))
    return factor


def _refuse_unlimited(problem: Problem, moving: InputMask, rest: bool) -> None:
    limits = problem.limits
    for i in np.flatnonzero(moving & limits.unlimited):
        raise InputError(
            f"input {problem.system.inputs[i].name.replace('_', ' ')} moves and has no"
            " limit, so there is no fastest timing; give a limit for it",
            source=problem.source,
        )
    if rest and not np.any(np.isfinite(limits.input_rate)):
        raise InputError(
            "rest at the ends needs limits on the inputs' rates; without them"
            " the inputs may jump to their limits",
            source=problem.source,
        )
