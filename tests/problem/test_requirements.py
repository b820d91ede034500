"""One class a kind: the judge and the proofs take one that they have never heard of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import planner
from planner.problem.requirements.requirement import At, Part, Requirement


@dataclass(frozen=True, eq=False)
class InputProduct(Requirement):
    """low ≤ u₁ u₂ ≤ high."""

    low: float
    high: float
    reads = frozenset({"u"})
    shaped = True

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("product of the inputs", "", self.low, self.high, 0.01),)

    def values(self, at: At) -> Sequence[Any]:
        return [at.u[..., 0] * at.u[..., 1]]


def judged(plan: planner.Plan, low: float, high: float) -> planner.Check:
    problem = planner.load_problem(plan.problem.source)
    problem.__dict__["requirements"] = (*problem.requirements, InputProduct(low, high))
    return planner.verify(planner.Plan(problem, plan.method, {}, plan.trajectory))


def test_the_judge_keeps_a_kind_that_it_does_not_know(paper: planner.Problem) -> None:
    plan = planner.solve(paper)
    u = plan.u(np.linspace(0.0, plan.duration, 20001))
    product = u[:, 0] * u[:, 1]
    most, least = float(np.max(product)), float(np.min(product))
    loose = judged(plan, least - 0.01, most + 0.01)
    assert loose.ok
    assert loose.margins["product of the inputs"] == pytest.approx(0.01, abs=1e-6)
    (above,) = judged(plan, least - 0.01, most - 1e-3).violations
    assert above.label == "product of the inputs"
    assert above.value == pytest.approx(most, abs=1e-6)
    (below,) = judged(plan, least + 1e-3, most + 0.01).violations
    assert below.value == pytest.approx(least, abs=1e-6)
    assert below.limit == pytest.approx(least + 1e-3)


def test_requirements_are_those_that_are_set(paper: planner.Problem) -> None:
    labels = {part.label for each in paper.requirements for part in each.parts}
    margins = set(planner.verify(planner.solve(paper)).margins)
    assert labels <= margins
    free = paper.changed({"limits": {}})
    assert free.requirements == ()


@dataclass(frozen=True, eq=False)
class Faster(Requirement):
    """u₁ ≥ low."""

    low: float
    reads = frozenset({"u"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("least u1", "rad/s", self.low, np.inf, 0.1, 0),)

    def values(self, at: At) -> Sequence[Any]:
        return [at.u[..., 0]]


def test_the_certificate_proves_it_or_says_that_nothing_does(paper: planner.Problem) -> None:
    plan = planner.solve(paper)
    least = float(np.min(plan.u(np.linspace(0.0, plan.duration, 20001))[:, 0]))
    problem = planner.load_problem(plan.problem.source)
    shaped = InputProduct(-1.0, 1.0)
    problem.__dict__["requirements"] = (*problem.requirements, Faster(least - 1e-3))
    certificate = planner.certify(planner.Plan(problem, plan.method, {}, plan.trajectory))
    assert certificate["least u1"].status == "proven"
    assert certificate["least u1"].guaranteed == pytest.approx(1e-3, abs=1e-6)
    problem.__dict__["requirements"] = (Faster(least + 1e-3),)
    certificate = planner.certify(planner.Plan(problem, plan.method, {}, plan.trajectory))
    assert certificate["least u1"].status == "violated"
    problem.__dict__["requirements"] = (shaped,)
    certificate = planner.certify(planner.Plan(problem, plan.method, {}, plan.trajectory))
    assert certificate["product of the inputs"].status == "undecided"
    assert "no proof is written" in certificate["product of the inputs"].why
    assert not certificate.ok
