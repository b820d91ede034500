"""Plans read from files, which anyone may have changed since: believed only after a judgement."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.errors import InputError, InputWarning, VerificationError
from planner.plan.claims import Certificate
from planner.plan.measures import objective_of
from planner.plan.plan import Plan
from planner.plan.plan_file import read_plan
from planner.verification.certify import certify
from planner.verification.verdict import judge


def load_plan(path: str | Path, *, strict: bool = False) -> Plan:
    """Read a plan that `Plan.save` wrote, and judge it again if the file calls it verified.

    A plan that was verified comes back with `verified` True only if `verify` still says so and its
    certificate, proven anew, does not say otherwise; a compensated one only with the plan that it
    compensates, which solves the same problem. Its objective is computed, if it is one of duration
    and efforts or of a convex plan; where the file says another, that of the motion is taken, with
    a warning, and a proof of optimality that is about the other is dropped. All else in `notes`,
    and the objective of a desensitised plan, is what the file says. What is
    not a plan any more has `verified` False, the status "verification_failed", no certificate, and
    says in `why` what it breaks. A file that never claimed to hold a verified plan (a refused one,
    kept for study) keeps its own status.

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
        return replace(said, certificate=_with_first_time(said, certify(said)))
    plan, broken = _judge_again(said, path)
    if broken and strict:
        raise InputError(
            f"{path} is marked as a verified plan, but the plan fails the verification:"
            f" {broken}; the file was changed, so plan again"
        )
    if broken:
        return replace(plan, status=VerificationError.status, why=broken)
    return plan


OBJECTIVE_TOLERANCE = 1e-5
"""Difference of an objective, relative to it, that its name leaves: weights of four digits are off
by up to 5e-4, and what they weigh is a hundredth of it."""


def _correct_objective(plan: Plan, path: str | Path) -> Plan:
    """With the objective of its own motion. That of a compensated plan is its original's."""
    true = objective_of((plan.compensates or plan).trajectory, plan.objective_name)
    if true is None or abs(plan.objective - true) <= OBJECTIVE_TOLERANCE * abs(true):
        return plan
    warnings.warn(
        f"{path}: the objective is said to be {plan.objective:.6g}, but that of the plan in it is"
        f" {true:.6g}, which is taken; the file was changed",
        InputWarning,
        stacklevel=5,
    )
    notes = {key: value for key, value in plan.notes.items() if key != "optimality"}
    return replace(plan, objective=true, notes=notes)


def _judge_again(said: Plan, path: str | Path) -> tuple[Plan, str]:
    """The plan with its verdict, and what it breaks, the worst first and in one line, or ""."""
    unknown = replace(said, verified=False, certificate=None)
    if said.trajectory.flaw:
        return unknown, said.trajectory.flaw
    if said.compensates is not None and not said.compensates.verified:
        return unknown, "of the plan that it compensates, it is not verified"
    with np.errstate(all="ignore"):  # what was changed may be anything
        try:
            plan, check = judge(unknown)
        except (ArithmeticError, ValueError) as error:
            return unknown, f"its motion cannot be computed: {error}"
    if check.ok:
        return _with_own_figures(plan, said, path), ""
    more = len(check.violations) - 1
    return plan, str(check.violations[0]) + (f" (and {more} more)" if more else "")


def _with_own_figures(plan: Plan, said: Plan, path: str | Path) -> Plan:
    """A verified plan, and the one that it compensates, with the right objective."""
    assert plan.certificate is not None
    plan = replace(plan, certificate=_with_first_time(said, plan.certificate))
    if plan.compensation is not None and said.compensates is not None:
        inside = _with_own_figures(plan.compensation.plan, said.compensates, path)
        plan = replace(plan, compensation=replace(plan.compensation, plan=inside))
    return _correct_objective(plan, path)


def _with_first_time(said: Plan, proven: Certificate) -> Certificate:
    """In the time of the first proof: what is saved again is the same."""
    return proven if said.certificate is None else replace(proven, seconds=said.certificate.seconds)
