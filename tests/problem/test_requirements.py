"""One class a kind: the judge and the proofs take one that they have never heard of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import planner
from planner.problem.requirements.requirement import At, Part, Requirement

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class InputProduct(Requirement):
    """low ≤ u₁ u₂ ≤ high."""

    low: float
    high: float
    reads = frozenset({"u"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("product of the inputs", "", self.low, self.high, 0.01),)

    def rows(self, at: At) -> Sequence[Any]:
        return [at.u[0] * at.u[1]]


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


@dataclass(frozen=True)
class Faster(Requirement):
    """u₁ ≥ low."""

    low: float
    reads = frozenset({"u"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("least u1", "rad/s", self.low, np.inf, 0.1, 0),)


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
    assert certificate["product of the inputs"].status == "proven"
    u = plan.u(np.linspace(0.0, plan.duration, 20001))
    margin = 1.0 - float(np.max(np.abs(u[:, 0] * u[:, 1])))
    assert certificate["product of the inputs"].guaranteed == pytest.approx(margin, abs=1e-6)
    problem.__dict__["requirements"] = (Cornered(-1.0),)
    certificate = planner.certify(planner.Plan(problem, plan.method, {}, plan.trajectory))
    assert certificate["least angle"].status == "undecided"
    assert "no proof is written" in certificate["least angle"].why
    assert not certificate.ok


@dataclass(frozen=True)
class Cornered(Requirement):
    """|θ₁| ≥ low, which has a corner at zero."""

    low: float
    reads = frozenset({"q"})
    smooth = False

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("least angle", "rad", self.low, np.inf, 0.1),)

    def rows(self, at: At) -> Sequence[Any]:
        return [at.q[1] ** 2]

    def values(self, at: At) -> Sequence[Any]:
        return [np.abs(at.q[1])]


def kinds() -> list[tuple[planner.Problem, Requirement]]:
    """Every kind there is, as problem files ask for them."""
    paper = planner.load_problem(ROOT / "problems/paper.toml")
    limits = {"limits.input_rate_rad_s2": 0.3, "limits.z2_margin": 0.01}
    found = [(paper, required) for required in paper.changed(limits).requirements]
    mirrored = {"start.theta_deg": [-1, -1, -1], "goal.theta_deg": [-30, -30, -30]}
    found += [(paper, required) for required in paper.changed(mirrored).requirements]
    obstacle = planner.load_problem(ROOT / "problems/obstacle.toml")
    found += [(obstacle, required) for required in obstacle.obstacles]
    arm = {"joints": 4, "K": [0.87, 0.71, 0.58], "link_lengths": [0.3, 0.2, 0.2, 0.3]}
    four = paper.changed(
        {
            **{f"system.{key}": value for key, value in arm.items()},
            "start.theta_deg": [1, 1, 1, 1],
            "goal.theta_deg": [30, 30, 30, 30],
            "limits": {"self_clearance_m": 0.1},
        }
    )
    return found + [(four, required) for required in four.further]


@pytest.mark.parametrize(("problem", "required"), kinds(), ids=lambda x: type(x).__name__)
def test_rows_and_values_are_on_the_same_side(
    problem: planner.Problem, required: Requirement
) -> None:
    """The planners' formula and the judge's, at random states."""
    rng, N = np.random.default_rng(0), problem.system.size
    q = np.pi * rng.uniform(-0.49, 0.49, (N, 4000))
    u, du = rng.normal(size=(2, 2, 4000))
    values = np.array(required.values(At(problem.system, q, u, du)))
    symbols = [ca.SX.sym(name, size) for name, size in (("q", N), ("u", 2), ("du", 2))]
    rows = ca.Function("rows", symbols, [ca.vertcat(*required.rows(At(problem.system, *symbols)))])
    found = np.asarray(rows(q, u, du))
    assert found.shape == values.shape == (len(required.parts), 4000)
    low, high, scale = (side[:, None] for side in required.sides)
    np.testing.assert_array_equal(found >= low - 1e-12 * scale, values >= low - 1e-12 * scale)
    np.testing.assert_array_equal(found <= high + 1e-12 * scale, values <= high + 1e-12 * scale)
    assert np.any(values < low)  # both sides were seen
    assert np.any(values >= low)
