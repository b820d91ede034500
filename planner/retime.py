"""The fastest timing of a plan's path.

The systems are driftless: where a motion goes does not depend on its timing. So a plan whose inputs
are too fast for the motors, or too slow for the user, keeps its path and gets another clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError, SingularError, VerificationError, expect
from planner.plan.claims import Certificate
from planner.plan.fastest_timing import Moving, fastest_motion
from planner.plan.measures import peak_inputs
from planner.plan.plan import Plan, refuse_compensated
from planner.problem.problem import Problem
from planner.verification.certify import certify
from planner.verification.verify import verify

BLIND = 1e-3
"""Excess over a limit, relative to it, that samples may have missed; a greater one is for `verify`
to refuse."""


def retime(
    plan: Plan,
    limits: Mapping[str, Any] | None = None,
    rest: bool = False,
    intervals: int = 200,
) -> Plan:
    """Give a plan's path its fastest timing within input limits.

    Under limits on the inputs alone the timing is exact: at every instant one input is at its limit
    (the time is ∫ max|uᵢ|/limitᵢ over the plan). Under limits on their rates too it is the optimum
    of a convex programme; see `planner.plan.fastest_timing`. With rate limits the motion stops
    where the path has a corner, that is where the plan's inputs jump to another ratio.

    Args:
        plan: A plan whose inputs exist at all times.
        limits: Keys of the `[limits]` table that replace the problem's, as in
            {"input_rad_s": 0.3, "input_rate_rad_s2": [2.0, 1.0]}; None for the problem's own.
        rest: Whether inputs are zero at both ends; needs rate limits.
        intervals: Intervals of the programme.

    Returns:
        A verified plan with its certificate and the same path. Its problem has these limits and, as
        its duration, the time found.

    Raises:
        InputError: If the plan is compensated, or an input moves that nothing limits, or `rest` is
            asked for without rate limits, or a limit's key or value is wrong.
        SingularError: If the plan is not executable.
        NotConvergedError: If the programme is not solved.
        VerificationError: If the retimed plan breaks a requirement (another limit of the problem).
    """
    refuse_compensated(plan, "retime")
    if not plan.executable:
        raise SingularError(
            f"{plan.problem.source}: a plan that leaves the domain of the chained-form chart has no"
            " inputs to retime",
            plan=plan,
        )
    if limits is not None:
        expect(Mapping, limits, 'give keys of [limits], as in {"input_rad_s": 0.3}')
    changes = {f"limits.{key}": value for key, value in (limits or {}).items()}
    problem = plan.problem.changed({**changes, "goal.duration": "free"})
    moving = peak_inputs(plan.trajectory) > 1e-12
    _refuse_unlimited(problem, moving, rest)
    trajectory, notes = fastest_motion(
        plan.trajectory, problem.limits, problem.requirements, moving, rest, intervals
    )
    timed = problem.changed({"goal.duration": trajectory.duration})
    found = certify(replace(plan, problem=timed, trajectory=trajectory))
    factor = _over(problem, found)
    if factor > 1:
        trajectory = trajectory.slowed(factor)
        timed = problem.changed({"goal.duration": trajectory.duration})
    notes = {"retimed_from_s": plan.duration, **notes, **plan.notes}
    return _verified(
        replace(
            plan,
            problem=timed,
            trajectory=trajectory,
            objective=trajectory.duration,
            objective_name="time: the least for this path, in seconds",
            verified=False,
            certificate=None if factor > 1 else found,
            notes=notes,
        )
    )


def _over(problem: Problem, certificate: Certificate) -> float:
    """How much slower a motion must be for what is above a limit where samples were blind."""
    factor = 1.0
    for required in problem.requirements:
        for part in required.parts if required.speed else ():
            excess = -certificate[part.label].attained / part.scale
            if 0 < excess < BLIND:
                factor = max(factor, (1 + excess) ** (1 / required.speed) * (1 + 1e-9))
    return factor


def _refuse_unlimited(problem: Problem, moving: Moving, rest: bool) -> None:
    limits = problem.limits
    for i in np.flatnonzero(moving & limits.unlimited):
        raise InputError(
            f"{problem.source}: input {problem.system.inputs[i].name} moves and has no limit,"
            " so no timing is the fastest; give limits for it"
        )
    if np.any(np.isfinite(limits.input_rate)):
        return
    if rest:
        raise InputError(
            f"{problem.source}: rest at the ends needs limits on the inputs' rates; without them"
            " the inputs jump to their limits at no cost"
        )


def _verified(plan: Plan) -> Plan:
    check = verify(plan)
    if check.ok:
        return replace(plan, verified=True, certificate=plan.certificate or certify(plan))
    raise VerificationError(
        f"{plan.problem.source}: the retimed {plan.method} plan breaks"
        f" {len(check.violations)} requirement(s)",
        plan=replace(plan, status=VerificationError.status),
        violations=check.violations,
    )
