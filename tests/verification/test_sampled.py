"""What no proof bounds is read again where expressions change fast, and named on the plan."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
from registered import Bump, restored

import planner
from planner import verify
from planner.plan.claims import undecided_claim
from planner.plan.trajectory import StateTrajectory
from planner.problem.requirements.requirement import MotionPoint
from planner.verification.summary import plan_summary
from planner.verification.verdict import judge
from planner.verification.verify import examine

SMOOTH = "tan(heading)"


def unicycle(slope: str) -> planner.Problem:
    """A vehicle of one's own that goes a metre aside on two metres."""
    system = {
        "kind": "custom",
        "name": "unicycle",
        "coordinates": ["x", "heading", "y"],
        "units": ["m", "rad", "m"],
        "slopes": [slope],
        "drive": "cos(heading)",
        "inputs": ["speed", "turn_rate"],
        "input_units": ["m/s", "rad/s"],
    }
    return planner.Problem.from_dict(
        {
            "system": system,
            "start": {"q": {"x": 0.0, "heading": 0.0, "y": 0.0}},
            "goal": {"q": {"heading": 0.0, "y": 1.0}, "travel": 2.0, "duration": 10.0},
            "limits": {"input": [0.5, 1.0]},
        }
    )


@pytest.fixture(scope="module")
def aside() -> planner.Plan:
    return planner.solve(unicycle(SMOOTH))


def over_a_bump(
    plan: planner.Plan, height: float, width: float, at: float = 0.5123
) -> planner.Plan:
    """The plan on a ground that pushes it aside within some width of y."""
    problem = unicycle(f"{SMOOTH} + {height}*exp(-((y-{at})/{width})**2)")
    path = plan.trajectory
    assert isinstance(path, StateTrajectory)
    return replace(plan, problem=problem, trajectory=replace(path, system=problem.system))


@pytest.mark.parametrize(
    ("height", "width", "at"), [(2000.0, 1e-4, 0.5123), (2000.0, 1e-4, 0.2718), (2e4, 1e-6, 0.5123)]
)
def test_a_narrow_bump_of_a_slope_is_seen(
    aside: planner.Plan, height: float, width: float, at: float
) -> None:
    """It moves y by some of its widths; the integration alone has no point in it."""
    moved = over_a_bump(aside, height, width, at)
    found, check = judge(moved)
    assert not found.verified
    assert check.violations


def test_a_bump_beside_the_way_changes_nothing(aside: planner.Plan) -> None:
    found, check = judge(over_a_bump(aside, 2000.0, 1e-4, at=1.5))
    assert check.ok
    assert found.certificate is not None
    assert found.certificate.sampled_labels == ()
    assert "sampled" not in repr(found)


class Unbounded(Bump):
    """A bump whose rows use a function that no proof knows."""

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [ca.fmax(*super().rows(point), 0.0)]


def test_what_is_only_sampled_stands_in_print_json_and_file(
    paper: planner.Problem, tmp_path: Path
) -> None:
    with restored():
        planner.register_requirement(Unbounded)
        plan = planner.solve(paper.changed({"limits.bump": [-1.0, 0.1]}))
        certificate = plan.certificate
        assert certificate is not None
        assert certificate.sampled_labels == ("bump",)
        assert repr(plan).endswith("verified, only sampled: bump)")
        assert "only sampled: bump (" in str(certificate)
        path = plan.save(tmp_path / "plan.json")
        assert json.loads(path.read_text())["certificate"]["only_sampled"] == ["bump"]
        assert planner.load_plan(path) == plan
        summary = plan_summary(plan)["certificate"]
        assert summary["only_sampled"] == ["bump"]
        assert "only sampled: bump (" in summary["text"]  # the line of `planner plan`


def test_a_bump_narrower_than_what_is_known_of_the_motion_is_read_again(
    law: planner.Plan,
) -> None:
    """The enclosure of a chained plan is wider than the bump, so that nothing is proven of it."""
    at = float(law.q(0.4321 * law.duration)[1])
    asks = replace(law, problem=replace(law.problem, registered_limits=(Bump(at, 1e-10),)))
    assert verify(asks).ok
    assert planner.certify(asks)["bump"].status == "undecided"
    found, check = judge(asks)
    assert not found.verified
    assert check.violations


@pytest.mark.parametrize(
    "slope",
    [
        "tan(heading) + 1000*(fabs(1-fabs(y-0.5123)/1e-4) + 1-fabs(y-0.5123)/1e-4)",
        "tan(heading) + 0.001*(1+tanh((y-0.999)/1e-9))",
    ],
)
def test_corners_and_steps_of_a_slope_are_seen(aside: planner.Plan, slope: str) -> None:
    problem, path = unicycle(slope), aside.trajectory
    assert isinstance(path, StateTrajectory)
    on = replace(aside, problem=problem, trajectory=replace(path, system=problem.system))
    assert not judge(on)[0].verified


def test_reading_again_agrees_with_reading_once(optimal: planner.Plan, law: planner.Plan) -> None:
    for plan in (optimal, law, planner.retime(optimal)):
        times = planner.certify(plan).edges
        assert times[0] == 0.0
        assert times[-1] == pytest.approx(plan.duration, rel=1e-12)
        once, motion = examine(plan)
        again, _ = examine(plan, times, motion)
        assert again.ok
        for label, margin in once.margins.items():
            if "against" not in label and "error" not in label:
                assert again.margins[label] == pytest.approx(margin, abs=1e-7), label


# -- slopes of inputs ------------------------------------------------------------------------------


def test_rounding_of_inputs_is_no_slope(paper: planner.Problem) -> None:
    """On the proof's cells the slope of a retimed input is 0.1 % off, by rounding alone."""
    rated = {"limits.input_rate_rad_s2": 5.0, "goal.duration": "free", "goal.travel": 0.829}
    plan = planner.solve(paper.changed(rated), "convex")
    certificate = planner.certify(plan)
    assert "rate of input u2" in certificate.sampled_labels
    once, motion = examine(plan)
    again, _ = examine(plan, certificate.edges, motion)
    assert plan.verified
    assert again.ok
    assert again.margins["rate of input u2"] == once.margins["rate of input u2"] > 0
    assert not examine(plan, certificate.edges)[0].ok


def test_a_slope_between_the_points_of_the_first_reading_is_seen_by_the_second() -> None:
    """A law over a ridge of 1e-13 m turns at 29 rad/s² for some 1e-7 s."""
    law = planner.solve(unicycle(SMOOTH), "polynomial")
    ridge = unicycle(f"{SMOOTH} + 1e-13*exp(-((y-0.5123)/1e-8)**2)")
    problem, label = ridge.changed({"limits.input_rate": [10.0, 10.0]}), "rate of input turn rate"
    moved = replace(law, problem=problem, trajectory=replace(law.trajectory, system=problem.system))
    assert verify(moved).ok
    certificate = planner.certify(moved)
    assert certificate[label].status == "violated"
    unknown = [c for c in certificate.claims if c.label != label]
    unknown.append(undecided_claim(label, "rad/s^2", "by hand"))
    found, check = judge(moved, replace(certificate, claims=tuple(unknown)))
    assert not found.verified
    assert [v.label for v in check.violations] == [label]
    assert check.violations[0].value == pytest.approx(28.75, rel=1e-3)
