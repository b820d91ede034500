"""One verdict on a plan, from the findings of `verify` and the proofs of the certificate.

`verify` samples the motion at points, between which a narrow excess may hide; `certify` bounds it
over whole intervals. Every plan that is returned as verified has passed `judge`, also one that is
read from a file, since anyone may have changed the file.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.errors import InputError, InputWarning, VerificationError, Violation
from planner.plan.claims import Certificate, Claim
from planner.plan.plan import Plan
from planner.plan.plan_file import read_plan
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.verification.certify import PLAN_DEVIATION, certify
from planner.verification.verify import Check, examine


def judge(plan: Plan, certificate: Certificate | None = None) -> tuple[Plan, Check]:
    """Judge a plan by `verify` and `certify`, and mark it as verified if it passes.

    Requirements that the certificate leaves undecided are checked again on the cells of the proof,
    which are finest where the motion's expressions change fast; the certificate names them as only
    sampled. A plan of which nothing can be proven is refused. The original of a compensated plan is
    judged too. A motion along which errors grow is judged from the goal to the start, as a motion
    of the exchanged problem.

    Args:
        plan: Any plan; its own fields `verified` and `certificate` are ignored.
        certificate: The result of `certify` for this plan; computed by default.

    Returns:
        The plan, marked as verified and with its certificate if it passes; and the check, whose
        violations include those that `certify` proves.
    """
    plan, seconds = replace(plan, verified=False, certificate=None), plan.duration
    if (other := plan.backwards) is None:
        return _judge(plan, certificate)
    other, check = _judge(other, certificate and certificate.turned(seconds))
    proven = other.certificate and other.certificate.turned(seconds)
    return replace(plan, verified=check.ok, certificate=proven), check.turned(seconds)


def _judge(plan: Plan, certificate: Certificate | None) -> tuple[Plan, Check]:
    """Judge a plan from its start to its goal, see `judge`."""
    if plan.compensation is not None:
        inside, check = judge(plan.compensation.plan)
        plan = replace(plan, compensation=replace(plan.compensation, plan=inside))
        if not check.ok:
            words = (f"in its original plan, {v}" for v in check.violations)
            return plan, _refusal(check, [Violation(Part(text)) for text in words])
    check, motion = examine(plan)
    if not check.ok:
        return plan, check
    certificate = certificate or certify(plan)
    if violations := sorted(_proven_violations(plan, certificate), key=lambda v: -v.scaled):
        margins = {v.label: certificate[v.label].attained for v in violations}
        return plan, replace(_refusal(check, violations), margins={**check.margins, **margins})
    if certificate.sampled_labels and plan.compensation is None:
        closer, _ = examine(plan, certificate.edges, motion)
        proven = {claim.label for claim in certificate.claims if claim.status == "proven"}
        if violations := [v for v in closer.violations if v.label not in proven]:
            return plan, _refusal(closer, violations)
    if not any(claim.status == "proven" for claim in certificate.claims if claim.required):
        why = certificate.open[0].why
        return plan, _refusal(check, [Violation(Part(f"nothing of the plan can be proven: {why}"))])
    return replace(plan, verified=True, certificate=certificate), check


def _refusal(check: Check, violations: Sequence[Violation]) -> Check:
    return replace(check, ok=False, violations=tuple(violations))


def _proven_violations(plan: Plan, certificate: Certificate) -> Iterator[Violation]:
    """Yield each violation of the plan that the certificate proves."""
    demands = {part.label: (each, part) for each in plan.problem.demands for part in each.parts}
    for claim in certificate.open:
        if claim.status != "violated":
            break  # violated claims come first
        demand, part = demands.get(claim.label, (None, PLAN_DEVIATION))
        excess, above = -claim.attained, _breaks_upper_limit(plan, demand, part, claim)
        limit = part.high if above else part.low
        value = limit + excess if above else limit - excess
        yield Violation(part, value, limit, claim.time_s, demand)


def _breaks_upper_limit(plan: Plan, demand: Demand | None, part: Part, claim: Claim) -> bool:
    """Return whether a violated claim breaks the upper limit of a part, rather than the lower."""
    if not isinstance(demand, Requirement) or np.isinf(part.low) or np.isinf(part.high):
        return bool(np.isfinite(part.high))
    time_s, path = claim.time_s or 0.0, plan.trajectory
    point = MotionPoint.of(plan.problem.system, path.q(time_s), path.u(time_s), np.zeros(2))
    value = float(demand.values(point)[demand.parts.index(part)])
    return value - part.high >= part.low - value


def load_plan(path: str | Path, *, strict: bool = False) -> Plan:
    """Read a plan that `Plan.save` wrote, and judge it again if the file calls it verified.

    The result has `verified` True only if `verify` confirms the plan and a new certificate shows no
    violation. A compensated plan must also contain a verified original plan of the
    same problem. The objective is computed again, except for desensitised plans and methods of
    other packages: if the file has another value, the computed value is used, with a warning, and
    a proof of optimality for the value in the file is dropped. `Plan.file_figures` names the
    figures that are taken unchecked from the file, as are the other `notes`. A plan that fails has
    `verified` False, the status "verification_failed", no certificate, and its violations in
    `violation`.
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
    return (
        replace(plan, status=VerificationError.status, violation=violations) if violations else plan
    )


OBJECTIVE_TOLERANCE = 1e-9
"""Largest relative difference between the objective in a file and the objective computed from the
plan and the weights in the file."""


def _correct_objective(plan: Plan, path: str | Path) -> Plan:
    """Return a plan with its objective computed again, if possible, and its `file_figures`.

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
    return replace(plan, file_figures=tuple(claimed))


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
