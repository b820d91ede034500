"""A plan, or the refusal of one, as the flat table of facts that commands print."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from planner.errors import NoPlanError, Violation
from planner.plan.measures import peak_inputs
from planner.plan.plan import Plan
from planner.support.calculus.extremes import sample_times
from planner.verification.verify import Check, verify

SUMMARY_KEYS = (
    "method",
    "status",
    "verified",
    "objective",
    "objective_name",
    "solve_time_s",
    "build_time_s",
    "iterations",
    "duration_s",
    "travel_rad",
    "direction",
    "terminal_error_deg",
    "terminal_error",
    "peak_u_rad_s",
    "executable",
    "domain_ok",
    "domain_margin",
    "z2_max",
    "singular_times_s",
    "reason",
    "violations",
    "advice",
    "certificate",
    "notes",
)
"""Every key of a summary, in order. For systems whose path coordinate is a length, `travel_rad`
and the first of `peak_u_rad_s` are in metres and metres per second."""


def plan_summary(plan: Plan, check: Check | None = None) -> dict[str, Any]:
    """The facts of a plan.

    Args:
        plan: Any plan, verified or not.
        check: What `verify` found, if it was asked already.

    Returns:
        A value for each of `SUMMARY_KEYS`: number, text, list or dictionary; NaN where undefined.
    """
    check = verify(plan) if check is None else check
    names = [c.name for c in plan.problem.system.coordinates]
    out = dict.fromkeys(SUMMARY_KEYS)
    out |= {
        "method": plan.method,
        "status": plan.status,
        "verified": plan.verified,
        "objective": plan.objective,
        "objective_name": plan.objective_name,
        "solve_time_s": plan.solve_time_s,
        "build_time_s": plan.build_time_s,
        "iterations": plan.iterations,
        "duration_s": plan.duration,
        "travel_rad": plan.travel,
        "direction": direction(plan),
        "terminal_error_deg": check.terminal_error_deg.tolist(),
        "terminal_error": dict(zip(names, check.terminal_error.tolist(), strict=True)),
        "peak_u_rad_s": peak_inputs(plan.trajectory).tolist(),
        "executable": plan.executable,
        **_domain(plan),
        "violations": [_violation(v) for v in check.violations],
        "certificate": None if plan.certificate is None else plan.certificate.to_dict(),
        "notes": dict(plan.notes),
    }
    return out


def refusal_summary(error: NoPlanError, method: str) -> dict[str, Any]:
    """The facts of a refusal, and those of its last iterate when it has one.

    Returns:
        A value for each of `SUMMARY_KEYS`; None where nothing is known. `verified` is False.
    """
    out = dict.fromkeys(SUMMARY_KEYS)
    if error.plan is not None:
        try:
            out |= plan_summary(error.plan, getattr(error, "check", None))
        except (ArithmeticError, ValueError):  # an iterate may be anything; its facts are extras
            out = dict.fromkeys(SUMMARY_KEYS)
    violations = [_violation(v) for v in error.violations]
    return out | {
        "method": method,
        "status": error.status,
        "verified": False,
        "reason": error.reason,
        "violations": violations or out["violations"] or [],
        "advice": error.advice,
    }


def direction(plan: Plan) -> str:
    """How the path coordinate moves: "one way", "two legs" (turns once), "turns 3 times"."""
    v1 = plan.v(sample_times(plan.t))[:, 0]
    moving = v1[np.abs(v1) > 1e-6 * np.nanmax(np.abs(v1), initial=0.0)]
    turns = int(np.sum(np.sign(moving[1:]) != np.sign(moving[:-1])))
    return ("one way", "turns once")[turns] if turns < 2 else f"turns {turns} times"


def _domain(plan: Plan) -> dict[str, Any]:
    report = plan.domain
    return {
        "domain_ok": report.ok,
        "domain_margin": report.margin,
        "z2_max": report.z2_max,
        "singular_times_s": list(report.singular_times_s),
    }


def _violation(violation: Violation) -> dict[str, Any]:
    return {**asdict(violation), "text": str(violation)}
