"""The fastest timing of a plan's path.

The systems are driftless: where a motion goes does not depend on its timing. So a plan whose inputs
are too fast for the motors, or too slow for the user, keeps its path and gets another clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from planner.arclength import arc_length
from planner.certificate import certify
from planner.claims import Certificate
from planner.errors import InputError, SingularError, VerificationError
from planner.measures import peak_inputs, peak_rates
from planner.plan import Plan
from planner.problem import Limits, Problem
from planner.retimed import RetimedTrajectory
from planner.timing import cut, fastest
from planner.trajectory import Trajectory
from planner.verify import verify

Moving = NDArray[np.bool_]


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
    of a convex programme; see `planner.timing`. With rate limits the motion stops where the path
    has a corner, that is where the plan's inputs jump to another ratio.

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
        InputError: If an input moves that nothing limits, or `rest` is asked for without rate
            limits, or a limit's key or value is wrong.
        SingularError: If the plan is not executable.
        NotConvergedError: If the programme is not solved.
        VerificationError: If the retimed plan breaks a requirement (another limit of the problem).
    """
    if not plan.executable:
        raise SingularError(
            f"{plan.problem.source}: a plan that leaves the domain of the chained-form chart has no"
            " inputs to retime",
            plan=plan,
        )
    changes = {f"limits.{key}": value for key, value in (limits or {}).items()}
    problem = plan.problem.changed({**changes, "goal.duration": "free"})
    moving = peak_inputs(plan.trajectory) > 1e-12
    _refuse_unlimited(problem, moving, rest)
    trajectory, notes = fastest_motion(plan.trajectory, problem.limits, moving, rest, intervals)
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


def fastest_motion(
    path: Trajectory, limits: Limits, moving: Moving, rest: bool = False, intervals: int = 200
) -> tuple[RetimedTrajectory, dict[str, Any]]:
    """The fastest timing of a path within limits of inputs and of their rates, not verified yet.

    Args:
        path: A trajectory with inputs at all times.
        limits: Of inputs and of their rates; one of them for each input that moves.
        moving: Which inputs move, shape (2,).
        rest: Whether inputs are zero at both ends; needs rate limits.
        intervals: Intervals of the programme, where rates are limited.

    Returns:
        The motion, and what to note of it.

    Raises:
        NotConvergedError: If the programme is not solved.
    """
    if np.any(np.isfinite(limits.input_rate[moving])):
        trajectory, notes = _with_rates(path, limits, moving, rest, intervals)
    else:
        trajectory, notes = _without_rates(path, limits, moving), {}
    return _within(trajectory, limits), notes


def _without_rates(path: Trajectory, limits: Limits, moving: Moving) -> RetimedTrajectory:
    scale = np.where(moving, limits.input, 1.0)
    length = arc_length(path, scale, "max")
    edges = np.append(length.c[0], length.c[-1, -1])
    clock = BPoly(np.stack([edges[:-1], edges[1:]]), edges)
    return RetimedTrajectory(path, length, clock, length.x)


def _with_rates(
    path: Trajectory, limits: Limits, moving: Moving, rest: bool, intervals: int
) -> tuple[RetimedTrajectory, dict[str, Any]]:
    scale = np.where(np.isfinite(limits.input), limits.input, limits.input_rate)
    scale = np.where(moving & np.isfinite(scale), scale, 1.0)
    length = arc_length(path, scale, "euclid")
    stretch = cut(path, length, scale, intervals, rest)
    clock = fastest(stretch, limits.input, limits.input_rate)
    notes = {"stops": int(np.sum(stretch.stops[1:-1]))}
    return RetimedTrajectory(path, length, clock, stretch.stations), notes


def _within(trajectory: RetimedTrajectory, limits: Limits) -> RetimedTrajectory:
    """Slowed by what little the interpolants exceed the limits between their nodes."""
    factor = float(np.max(peak_inputs(trajectory) / limits.input))
    if np.any(np.isfinite(limits.input_rate)):
        factor = max(factor, float(np.sqrt(np.max(peak_rates(trajectory) / limits.input_rate))))
    return trajectory.slowed(factor) if factor > 1 else trajectory


def _over(problem: Problem, certificate: Certificate) -> float:
    """How much slower a motion must be for what is above a limit where samples were blind."""
    limits, factor = problem.limits, 1.0
    for i, named in enumerate(problem.system.inputs):
        for label, limit, power in (
            (f"input {named.name}", limits.input[i], 1.0),
            (f"rate of input {named.name}", limits.input_rate[i], 0.5),
        ):
            excess = -certificate[label].attained / limit if np.isfinite(limit) else 0.0
            if 0 < excess < BLIND:
                factor = max(factor, (1 + excess) ** power * (1 + 1e-9))
    return factor


def _refuse_unlimited(problem: Problem, moving: Moving, rest: bool) -> None:
    limits = problem.limits
    for i in np.flatnonzero(moving):
        if not np.isfinite(limits.input[i]) and not np.isfinite(limits.input_rate[i]):
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
