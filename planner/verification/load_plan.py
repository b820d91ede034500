"""Plans read from files, which anyone may have changed since: believed only after a judgement."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.errors import InputError, VerificationError
from planner.plan.claims import Certificate
from planner.plan.plan import Plan
from planner.plan.plan_file import read_plan
from planner.verification.certify import certify
from planner.verification.verdict import judge


def load_plan(path: str | Path, *, strict: bool = False) -> Plan:
    """Read a plan that `Plan.save` wrote, and judge it again if the file calls it verified.

    A plan that was verified comes back with `verified` True only if `verify` still says so and its
    certificate, proven anew, does not say otherwise; a compensated one only with the plan that it
    compensates. What is not a plan any more has `verified` False, the status
    "verification_failed", no certificate, and says in `why` what it breaks. A file that never
    claimed to hold a verified plan (a refused one, kept for study) keeps its own status.

    Args:
        path: The file.
        strict: Whether to refuse a file that claims to hold a verified plan and does not.

    Raises:
        InputError: If the file is missing, is not a plan, or has a newer version; or, if `strict`,
            its plan fails the judgement.
    """
    said = read_plan(path)
    if not said.verified:
        if said.certificate is None:
            return said
        return replace(said, certificate=_at_first(said, certify(said)))
    plan, broken = _judged(said)
    if broken and strict:
        raise InputError(
            f"{path} is marked as a verified plan, but the plan fails the verification:"
            f" {broken}; the file was changed, so plan again"
        )
    if broken:
        return replace(plan, status=VerificationError.status, why=broken)
    return plan


def _judged(said: Plan) -> tuple[Plan, str]:
    """The plan with its verdict, and what it breaks, the worst first and in one line, or ""."""
    unknown = replace(said, verified=False, certificate=None)
    if said.trajectory.flaw:
        return unknown, said.trajectory.flaw
    if said.compensation is not None:
        inside = said.compensation.plan
        inside, broken = _judged(inside) if inside.verified else (inside, "it is not verified")
        unknown = replace(unknown, compensation=replace(said.compensation, plan=inside))
        if broken:
            return unknown, f"of the plan that it compensates, {broken}"
    with np.errstate(all="ignore"):  # what was changed may be anything
        try:
            plan, check = judge(unknown)
        except (ArithmeticError, ValueError) as error:
            return unknown, f"its motion cannot be computed: {error}"
    if plan.certificate is not None:
        return replace(plan, certificate=_at_first(said, plan.certificate)), ""
    more = len(check.violations) - 1
    return unknown, str(check.violations[0]) + (f" (and {more} more)" if more else "")


def _at_first(said: Plan, proven: Certificate) -> Certificate:
    """In the time of the first proof: what is saved again is the same."""
    return proven if said.certificate is None else replace(proven, seconds=said.certificate.seconds)
