"""Read plans from files, and verify each again, since anyone may have changed the file."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.errors import InputError, InputWarning, VerificationError
from planner.plan.claims import Certificate
from planner.plan.plan import Plan
from planner.plan.plan_file import read_plan
from planner.verification.certify import certify
from planner.verification.verdict import judge


def load_plan(path: str | Path, *, strict: bool = False) -> Plan:
    """Read a plan that `Plan.save` wrote, and judge it again if the file calls it verified.

    The result has `verified` True only if `verify` confirms the plan and a new certificate shows no
    violation. A compensated plan must also contain a verified original plan of the
    same problem. The objective is computed again, except for desensitised plans and methods of
    other packages: if the file has another value, the computed value is used, with a warning, and
    a proof of optimality for the value in the file is dropped. `Plan.claimed` names the figures
    that are taken unchecked from the file, as are the other `notes`. A plan that fails has
    `verified` False, the status "verification_failed", no certificate, and its violations in `why`.
    A plan that the file does not call verified (such as a refused plan, kept for study) keeps its
    status.

    Args:
        path: The file.
        strict: Whether to refuse a file that wrongly claims to contain a verified plan.

    Raises:
        InputError: If the file is missing, is not a plan, or has another version; or, if `strict`,
            its plan fails the verification.
    """
    said = read_plan(path)
    if not said.verified:
        if said.certificate is None:
            return said
        return replace(said, certificate=_with_first_time(said, certify(said)))
    plan, violations = _judge_again(said, path)
    if violations and strict:
        raise InputError(
            f"{path} is marked as a verified plan, but the plan fails the verification:"
            f" {violations}; the file was changed, so plan again"
        )
    return replace(plan, status=VerificationError.status, why=violations) if violations else plan


OBJECTIVE_TOLERANCE = 1e-9
"""Largest relative difference between the objective in a file and the objective computed from the
plan and the weights in the file."""


def _correct_objective(plan: Plan, path: str | Path) -> Plan:
    """Return a plan with its objective computed again, if possible, and with `claimed` filled in.

    A compensated plan has the objective of its original plan.
    """
    true = plan.aim.value((plan.compensates or plan).trajectory)
    claimed = ["objective"] if true is None and not np.isnan(plan.objective) else []
    if true is not None and not abs(plan.objective - true) <= OBJECTIVE_TOLERANCE * abs(true):
        warnings.warn(
            f"{path}: the file gives the objective {plan.objective:.6g}, but that of its plan is"
            f" {true:.6g} ({plan.objective_name}), which is used; the file was changed",
            InputWarning,
            stacklevel=5,
        )
        notes = {key: value for key, value in plan.notes.items() if key != "optimality"}
        plan = replace(plan, objective=true, notes=notes)
    claimed += ["notes.optimality"] * ("optimality" in plan.notes)
    return replace(plan, claimed=tuple(claimed))


def _judge_again(said: Plan, path: str | Path) -> tuple[Plan, str]:
    """Judge a plan from a file again; return the plan and its worst violation in words, or ""."""
    unknown = replace(said, verified=False, certificate=None)
    if said.trajectory.flaw:
        return unknown, said.trajectory.flaw
    if said.compensates is not None and not said.compensates.verified:
        return unknown, "the original plan in the file is not verified"
    with np.errstate(all="ignore"):  # a changed file may contain any numbers
        try:
            plan, check = judge(unknown)
        except (ArithmeticError, ValueError) as error:
            return unknown, f"the plan's motion cannot be computed: {error}"
    if check.ok:
        return _with_own_figures(plan, said, path), ""
    more = len(check.violations) - 1
    return plan, str(check.violations[0]) + (f" (and {more} more)" if more else "")


def _with_own_figures(plan: Plan, said: Plan, path: str | Path) -> Plan:
    """Return a verified plan, and the original plan inside, with their objectives computed again.

    Certificates keep the computing times that the file gives.
    """
    assert plan.certificate is not None
    plan = replace(plan, certificate=_with_first_time(said, plan.certificate))
    if plan.compensation is not None and said.compensates is not None:
        inside = _with_own_figures(plan.compensation.plan, said.compensates, path)
        plan = replace(plan, compensation=replace(plan.compensation, plan=inside))
    return _correct_objective(plan, path)


def _with_first_time(said: Plan, proven: Certificate) -> Certificate:
    """Return the new certificate with the file's computing time, so that saving changes nothing."""
    return proven if said.certificate is None else replace(proven, seconds=said.certificate.seconds)
