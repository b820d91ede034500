"""One verdict on a plan, from the findings of `verify` and the proofs of the certificate.

`verify` samples the motion at points, between which a narrow excess may hide; `certify` bounds it
over whole intervals. Every plan that is returned as verified has passed `judge`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from planner.errors import Violation
from planner.plan.claims import Certificate, Claim
from planner.plan.plan import Plan
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.verification.certify import PLAN_DEVIATION, certify
from planner.verification.verify import Check, examine


def judge(plan: Plan, certificate: Certificate | None = None) -> tuple[Plan, Check]:
    """Judge a plan by `verify` and `certify`, and mark it as verified if it passes.

    Requirements that the certificate leaves undecided are checked again on the cells of the proof,
    which are finest where the motion's expressions change fast; the certificate names them as only
    sampled. A plan of which nothing can be proven is refused. The original of a compensated plan is
    judged too.

    Args:
        plan: Any plan; its own fields `verified` and `certificate` are ignored.
        certificate: The result of `certify` for this plan; computed by default.

    Returns:
        The plan, marked as verified and with its certificate if it passes; and the check, whose
        violations include those that `certify` proves.
    """
    plan = replace(plan, verified=False, certificate=None)
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
    if certificate.only_sampled and plan.compensation is None:
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
