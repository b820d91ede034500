"""What verify lets pass, certify does not call violated; and the other way round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import planner
from planner.problem.requirements.places import Obstacle
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.verification.verdict import judge
from planner.verification.verify import LIMIT_TOLERANCE


def statuses(plan: planner.Plan) -> tuple[bool, set[str]]:
    """Whether it is verified, and what certify says of what the problem asks for."""
    found, _ = judge(plan)
    claims = planner.certify(plan).claims
    return found.verified, {claim.status for claim in claims if claim.required}


@pytest.mark.parametrize("made", ["optimal", "law", "retimed"])
@pytest.mark.parametrize("key", ["input_rad_s", "joint_deg"])
def test_a_limit_within_the_tolerance_of_the_motion_is_kept_for_both(
    made: str, key: str, request: pytest.FixtureRequest
) -> None:
    plan: planner.Plan = request.getfixturevalue(made)
    for part, kept in ((8e-7, True), (1.2e-6, False)):
        moved = replace(
            plan, problem=plan.problem.changed({f"limits.{key}": _most(plan, key, part)})
        )
        verified, said = statuses(moved)
        assert verified is kept, (made, key)
        assert ("violated" in said) is not kept
        assert planner.verify(moved).ok is kept


def _most(plan: planner.Plan, key: str, part: float) -> Any:
    """A limit that the motion exceeds by a part of it."""
    wide = [50.0, 50.0] if key == "input_rad_s" else 88.0
    margins = planner.verify(
        replace(plan, problem=plan.problem.changed({f"limits.{key}": wide}))
    ).margins
    if key == "input_rad_s":
        return [(50.0 - margins[f"input u{i}"]) / (1 + part) for i in (1, 2)]
    angle = np.deg2rad(88.0) - min(
        m for name, m in margins.items() if name.startswith("joint theta")
    )
    return float(np.rad2deg(angle)) / (1 + part)


@pytest.mark.parametrize("radius", [0.01, 1.0, 1e5])
def test_a_disc_of_any_size_may_be_entered_by_the_same_part_of_the_arms_reach(
    optimal: planner.Plan, radius: float
) -> None:
    """Its edge stands where the arm's tip comes farthest out."""
    system: Any = optimal.problem.system
    tips = system.arm_points(optimal.q(np.linspace(0, optimal.duration, 4001))[:, 1:])[:, -1]
    farthest = tips[np.argmax(np.hypot(*tips.T))]
    reach, out = float(np.sum(system.link_lengths)), float(np.hypot(*farthest))
    ahead = farthest / out
    for depth, kept in ((-1e-6, True), (0.5e-6, True), (2e-6, False), (0.08 / reach, False)):
        centre = ahead * (out + radius - depth * reach)
        disc = Obstacle(1, 3, float(centre[0]), float(centre[1]), radius, 0.0, reach)
        moved = replace(optimal, problem=replace(optimal.problem, obstacles=(disc,)))
        verified, said = statuses(moved)
        assert verified is kept, depth
        assert ("violated" in said) is not kept
        assert {"undecided"} & said == set()


def test_the_scale_of_a_disc_in_a_file_is_the_arms_reach() -> None:
    problem = planner.load_problem("problems/obstacle.toml")
    reach = float(np.sum(problem.system.link_lengths))  # type: ignore[attr-defined]
    (disc,) = problem.obstacles
    assert {part.scale for part in disc.parts} == {reach}


def test_what_is_exceeded_within_the_tolerance_says_so(optimal: planner.Plan) -> None:
    limits = _most(optimal, "input_rad_s", 0.5 * LIMIT_TOLERANCE)
    moved = replace(optimal, problem=optimal.problem.changed({"limits.input_rad_s": limits}))
    claim = planner.certify(moved)["input u1"]
    assert claim.status == "proven"
    assert str(claim).startswith("input u1: proven within the tolerance, exceeded by ")


# -- rows that are a substitute for values ---------------------------------------------------------


@dataclass(frozen=True)
class InputNorm(Requirement):
    """‖u‖ ≤ most, whose rows have no corner at zero: u²/most."""

    most: float
    reads, row_fields, speed_power = frozenset({"u"}), ("most",), 1

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("norm of the inputs", "rad/s", -np.inf, self.most, self.most),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [(point.u[0] ** 2 + point.u[1] ** 2) / self.most]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        return [np.hypot(point.u[0], point.u[1])]


@pytest.mark.parametrize("made", ["optimal", "law", "retimed"])
def test_a_margin_is_that_of_the_values_that_verify_reads(
    made: str, request: pytest.FixtureRequest
) -> None:
    plan: planner.Plan = request.getfixturevalue(made)
    size = np.hypot(*plan.u(np.linspace(0.0, plan.duration, 20001)).T)
    most = 1.7 * float(np.max(size))
    asks = replace(plan, problem=replace(plan.problem, registered_limits=(InputNorm(most),)))
    margin = planner.verify(asks).margins["norm of the inputs"]
    claim = planner.certify(asks)["norm of the inputs"]
    assert most - margin == pytest.approx(np.max(size), rel=1e-3)
    assert claim.status == "proven"
    assert claim.guaranteed == 0.0
    assert claim.attained == pytest.approx(margin, rel=1e-5)
    broken = replace(
        plan, problem=replace(plan.problem, registered_limits=(InputNorm(most / 1.8),))
    )
    said = planner.certify(broken)["norm of the inputs"]
    assert said.status == "violated"
    assert said.attained == pytest.approx(most / 1.8 - (most - margin), abs=1e-5)
