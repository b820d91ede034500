"""One class a kind: the judge and the proofs take one that they have never heard of."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import FrozenInstanceError, dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import planner
from planner import Violation
from planner.problem.requirements.motion_limits import JointLimit, Z2Margin
from planner.problem.requirements.places import Obstacle, Waypoint
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.systems.triangular_system import Coordinate

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

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.u[0] * point.u[1]]


def test_every_limit_names_the_key_that_sets_it() -> None:
    limits = {"input_rad_s": 1.0, "input_rate_rad_s2": 5.0, "joint_deg": 85, "z2_margin": 1e-4}
    changes = {f"limits.{key}": value for key, value in limits.items()}
    problem = planner.load_problem(ROOT / "problems" / "self-collision.toml", changes)

    def keys(problem: planner.Problem) -> set[str]:
        return {part.key for each in problem.requirements for part in each.parts}

    assert keys(problem) == {*changes, "limits.self_clearance_m"}
    for key in keys(problem) - {"limits.input_rad_s"}:
        assert keys(problem) - keys(problem.changed({key: None})) == {key}


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

    def certified(*limits: Requirement) -> planner.Certificate:
        asked = replace(problem, registered_limits=limits)
        return planner.certify(planner.Plan(asked, plan.method, {}, plan.trajectory))

    certificate = certified(Faster(least - 1e-3))
    assert certificate["least u1"].status == "proven"
    assert certificate["least u1"].guaranteed == pytest.approx(1e-3, abs=1e-6)
    certificate = certified(Faster(least + 1e-3))
    assert certificate["least u1"].status == "violated"
    certificate = certified(shaped)
    assert certificate["product of the inputs"].status == "proven"
    u = plan.u(np.linspace(0.0, plan.duration, 20001))
    margin = 1.0 - float(np.max(np.abs(u[:, 0] * u[:, 1])))
    assert certificate["product of the inputs"].guaranteed == pytest.approx(margin, abs=1e-6)
    certificate = certified(Cornered(-1.0))
    assert certificate["least angle"].status == "proven"
    assert (
        certificate["least angle"].guaranteed == 0.0
    )  # of the values, of which rows tell the sign
    least = float(np.min(np.abs(plan.q(np.linspace(0.0, plan.duration, 20001))[:, 1])))
    assert certificate["least angle"].attained == pytest.approx(1.0 + least, abs=1e-4)


@dataclass(frozen=True)
class Cornered(Requirement):
    """|θ₁| ≥ low, which has a corner at zero."""

    low: float
    reads = frozenset({"q"})
    smooth = False

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("least angle", "rad", self.low, np.inf, 0.1),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.q[1] ** 2]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        return [np.abs(point.q[1])]


class Blunt(Cornered):
    """|θ₁| ≤ 1, which the judge would not see."""

    parts = property(lambda self: (Part("largest angle", "rad", self.low, 1.0, 0.1),))  # type: ignore[assignment]


def test_an_upper_limit_with_corners_is_refused(paper: planner.Problem) -> None:
    assert Cornered(-1.0).fault(paper.system) is None
    assert str(Blunt(-1.0).fault(paper.system)).startswith("is not smooth and has an upper limit")


@dataclass(frozen=True)
class Gentle(Requirement):
    """low ≤ minus the square of u₂'s rate ≤ high."""

    low: float
    high: float
    reads = frozenset({"du"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("gentleness", "", self.low, self.high, 0.1, 1),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [-(point.du[1] ** 2)]


class Plain(Gentle):
    """low ≤ the rate of u₂ ≤ high."""

    rows = Requirement.rows


@pytest.mark.parametrize("kind", [Gentle, Plain])
@pytest.mark.parametrize(
    ("low", "high", "reaches"),
    [(-0.01, np.inf, -np.inf), (-np.inf, 0.01, np.inf), (-0.01, 9.0, np.inf)],
)
def test_a_jump_breaks_the_limit_that_there_is(
    kind: type[Gentle], low: float, high: float, reaches: float
) -> None:
    """The law's u₂ jumps twice, so that no limit on its rate is kept, above or below."""
    problem = planner.load_problem(ROOT / "problems/custom.toml")
    plan = planner.solve(problem, "piecewise")
    asked = replace(problem, registered_limits=(kind(low, high),))
    made = planner.Plan(asked, plan.method, {}, plan.trajectory)
    check = planner.verify(made)
    (violation,) = check.violations
    allowed = low if reaches < 0 else high
    assert (violation.value, violation.limit) == (reaches, allowed)
    assert check.margins["gentleness"] == -violation.scaled == -np.inf
    assert str(violation) == f"gentleness reaches {reaches}, allowed {allowed:g}"
    claim = planner.certify(made)["gentleness"]
    assert claim.status == ("violated" if kind is Plain else "undecided")


def kinds() -> list[tuple[planner.Problem, Requirement]]:
    """Every kind there is, as problem files ask for them.

    Random states must lie on both sides of each limit.
    """
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
    assert four.self_collision is not None
    return [*found, (four, four.self_collision)]


@pytest.mark.parametrize(("problem", "required"), kinds(), ids=lambda x: type(x).__name__)
def test_rows_and_values_are_on_the_same_side(
    problem: planner.Problem, required: Requirement
) -> None:
    """The planners' formula and the judge's, at random states."""
    assert required.fault(problem.system) is None
    rng, N = np.random.default_rng(0), problem.system.size
    q = np.pi * rng.uniform(-0.49, 0.49, (N, 4000))
    u, du = rng.normal(size=(2, 2, 4000))
    values = np.array(required.values(MotionPoint(problem.system, q, u, du)))
    symbols = [ca.SX.sym(name, size) for name, size in (("q", N), ("u", 2), ("du", 2))]
    rows = ca.Function(
        "rows", symbols, [ca.vertcat(*required.rows(MotionPoint(problem.system, *symbols)))]
    )
    found = np.asarray(rows(q, u, du))
    assert found.shape == values.shape == (len(required.parts), 4000)
    low, high, scale = (side[:, None] for side in required.bounds)
    np.testing.assert_array_equal(found >= low - 1e-12 * scale, values >= low - 1e-12 * scale)
    np.testing.assert_array_equal(found <= high + 1e-12 * scale, values <= high + 1e-12 * scale)
    inside = (values >= low) & (values <= high)
    assert np.any(inside), "no random state keeps it: choose a wider limit in `kinds`"
    assert not np.all(inside), "no random state breaks it: choose a narrower limit in `kinds`"


# -- each kind by hand ---------------------------------------------------------------------------


def _broken(demand: Any, value: float, k: int = 0) -> Violation:
    part = demand.parts[k]
    return Violation(part, value, part.low, demand=demand)


def test_a_z2_margin_is_lowered_to_what_was_reached_or_left_out() -> None:
    margin = Z2Margin(0.1, 1)
    assert Z2Margin.easing([_broken(margin, 0.02)]) == "limits.z2_margin = 0.01998 or less"
    for value in (0.0, -0.02):
        assert Z2Margin.easing([_broken(margin, value)]).startswith("leave out limits.z2_margin")


@pytest.mark.parametrize(
    ("theta1", "side", "margin", "says"),
    [
        (30, 1, 0.2, None),
        (-30, -1, 0.2, None),
        (30, 1, 0.9, "at the goal is 0.57735, but limits.z2_margin = 0.9 requires at least that"
         " distance from zero, with the sign at the start (positive); lower limits.z2_margin to"
         " 0.572, or leave it out"),
        (-30, -1, 0.9, "with the sign at the start (negative); lower limits.z2_margin to 0.572,"),
        (-30, 1, 0.2, "(positive); leave out limits.z2_margin, so that z2 may change sign, or"),
        (30, 0, 0.2, "leave out limits.z2_margin, so that z2 may change sign, or move the goal"),
    ],
)  # fmt: skip
def test_z2_at_an_end(theta1: float, side: int, margin: float, says: str | None) -> None:
    """The unicycle's z₂ is the tangent of its heading."""
    q = np.array([np.nan, np.deg2rad(theta1), 0.3])
    said = Z2Margin(margin, side).contradiction("goal", q, planner.Unicycle())
    assert said is None if says is None else says in (said or "")
    at_start = Z2Margin(margin, side).contradiction("start", q, planner.Unicycle())
    assert "the sign at the start;" in at_start if at_start else says is None
    assert Z2Margin(margin, side).contradiction("waypoint 1", q, planner.Unicycle()) is None
    at = MotionPoint(planner.Unicycle(), q[:, None] * np.ones(3))
    np.testing.assert_allclose(
        Z2Margin(margin, side).values(at), [side * np.tan(q[1:2]) * np.ones(3)], rtol=1e-14
    )


def test_z2_at_an_end_may_be_its_margin_and_no_less() -> None:
    unicycle, q = planner.Unicycle(), np.array([0.0, 0.5, 0.3])
    z2 = float(planner.chained_form(unicycle).z(q)[1])
    assert Z2Margin(z2, 1).contradiction("goal", q, unicycle) is None
    assert Z2Margin(float(np.nextafter(z2, 1.0)), 1).contradiction("goal", q, unicycle) is not None


@pytest.mark.parametrize(
    ("joint", "deg", "says"),
    [
        (2, 30.0, None),
        (2, -30.0, "theta2 changes sign"),
        (2, -85.0, "theta2 changes sign"),
        (2, -0.01, "theta2 changes sign"),
        (2, -1e-7, "singular"),  # zero but for rounding
        (2, 0.0, "singular"),
        (1, 91.0, "from 1 to 91 deg, past an edge"),
        (1, 170.0, "from 1 to 170 deg, past an edge"),
        (3, -30.0, None),  # on this one the chart does not depend
    ],
)
def test_an_end_outside_the_chart(
    paper: planner.Problem, joint: int, deg: float, says: str | None
) -> None:
    q = paper.start.copy()
    q[joint] = np.deg2rad(deg)
    said = paper.chart.contradiction("goal", q, paper.system)
    assert said is None if says is None else says in (said or "")


def test_joint_limits_are_left_out_as_far_as_their_keys_allow() -> None:
    """Angles up to a quarter turn lose their chart there; a heading turns as far as it likes."""
    named = {
        "limits.hitch_deg": 0.5,
        "limits.heading_deg": 0.5,
        "limits.q.a": 1.0,
        "limits.q.b": 2.0,
    }
    angles = (Coordinate("a coordinate", "rad"),) * len(named)
    limit = JointLimit(angles, tuple(named.values()), tuple(named))
    wide = {"limits.hitch_deg": 88.0, "limits.heading_deg": 360.0, "limits.q": {}}
    assert limit.removal() == (wide, "", "the limits on the joints")
    assert replace(limit, keys=("",) * len(named)).removal() is None


@pytest.mark.parametrize(
    ("kind", "limits", "broken", "advice"),
    [
        ("paper", {"limits.input_rad_s": 0.5}, {"input u2": 0.6}, {"limits.input_rad_s": 0.6}),
        (
            "paper",
            {"limits.input_rad_s": [0.5, 0.4]},
            {"input u2": 0.6},
            {"limits.input_rad_s": [0.5, 0.6]},
        ),
        (
            "paper",
            {"limits.joint_deg": [60, 70, 40]},
            {"joint theta1": np.deg2rad(65), "joint theta3": -np.deg2rad(50)},
            {"limits.joint_deg": [65, 70, 50]},
        ),
        ("car", {"limits.speed_m_s": 2.0}, {"input speed": 3.0}, {"limits.speed_m_s": 3.0}),
        ("car", {"limits.speed_m_s": 2.0}, {"input speed": 3.0004}, {"limits.speed_m_s": 3.003}),
        (
            "car",
            {"limits.steering_acceleration_rad_s2": 1.0},
            {"rate of input steering rate": -3.0},
            {"limits.steering_acceleration_rad_s2": 3.0},
        ),
        ("trailers", {"limits.hitch_deg": 30}, {"joint hitch1": 0.7}, {"limits.hitch_deg": 40.1}),
        ("coin", {"limits.q": {"y": 1.0}}, {"joint y": 2.0}, {"limits.q.y": 2.0}),
    ],
)
def test_advice_sets_the_keys_that_the_motion_needs(
    kind: str, limits: dict[str, Any], broken: dict[str, float], advice: dict[str, Any]
) -> None:
    file = Path(__file__).parents[2] / "problems" / f"{kind}.toml"
    problem = planner.load_problem(file, {"limits": {}}).changed(limits)
    every = {part.label: (each, part) for each in problem.demands for part in each.parts}
    found = []
    for label, value in broken.items():
        demand, part = every[label]
        limit = part.high if value > 0 else part.low
        found.append(planner.Violation(part, value, limit, demand=demand))
    words = found[0].demand.easing(found)
    assert words.endswith(" or more")
    key, value = words.removesuffix(" or more").split(" = ")
    ((wanted, size),) = advice.items()
    assert key == wanted
    assert tomllib.loads(f"value = {value}")["value"] == pytest.approx(size, rel=2e-3)
    wider = problem.changed({key: tomllib.loads(f"value = {value}")["value"]})
    for each in found:
        (part,) = (p for d in wider.demands for p in d.parts if p.label == each.label)
        assert part.low <= each.value <= part.high


def test_a_joint_that_needs_more_than_its_key_takes_has_no_limit() -> None:
    limit = JointLimit((Coordinate("theta1", "rad"),), (0.5,), ("limits.joint_deg",))
    broken = planner.Violation(limit.parts[0], 1.56, 0.5, demand=limit)
    assert limit.easing([broken]) == "leave out limits.joint_deg"


def test_a_waypoint_is_as_far_as_its_worst_coordinate() -> None:
    arm = planner.Manipulator([0.9, 0.7])
    point = Waypoint(2, np.array([np.nan, 1.0, np.nan, -2.0]), None, "rad", arm)
    q = np.array([[9.0, 1.5, 9.0, -2.25], [0.0, 1.0, 0.0, -2.0], [0.0, 0.5, 9.0, -1.25]])
    np.testing.assert_array_equal(point.distance(q), [0.5, 0.0, 0.75])
    (part,) = point.parts
    assert (part.label, part.unit, part.high) == ("distance from waypoint 2", "rad", 0.0)


@pytest.mark.parametrize(
    ("place", "held", "beside"),
    [
        ([0.5, 0.4, np.nan, np.nan], [], (0, 1)),
        ([0.5, np.nan, 1.0, 2.0], [0, 1], (0,)),
        ([np.nan, np.nan, 1.0, np.nan], [0], ()),
        ([0.5, 0.4, 1.0, 2.0], [0, 1, 2, 3], ()),
    ],
)
def test_what_a_waypoint_gives_is_held_by_q_or_beside_it(
    place: list[float], held: list[int], beside: tuple[int, ...]
) -> None:
    """A coin's heading and roll are coordinates of q; its x and y are functions of all of q."""
    point = Waypoint(1, np.array(place), None, "", planner.Coin(0.3))
    assert np.flatnonzero(~np.isnan(point.q)).tolist() == held
    assert point.beside_q == beside


def test_clearances_of_a_bent_arm() -> None:
    """Links from (0, 0) to (1, 0), (1, 1) and, of no length, (1, 1); 3-4-5 triangles."""
    arm = planner.Manipulator([0.9, 0.7], 1.0, [1.0, 1.0, 0.5])
    disc = Obstacle(3, 3, 4.0, 5.0, 0.25)
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    np.testing.assert_allclose(
        disc.clearances(points), [np.sqrt(34) - 0.25, 4.75, 4.75], rtol=1e-15
    )
    beside = Obstacle(3, 3, 0.25, -2.0, 0.5)
    np.testing.assert_allclose(
        beside.clearances(points), [1.5, np.hypot(0.75, 2) - 0.5, np.hypot(0.75, 3) - 0.5]
    )
    q = np.array([0.3, 0.0, np.pi / 2, 0.0])  # the last link ends at (1, 1.5)
    values = np.array(disc.values(MotionPoint(arm, q[:, None])))[:, 0]
    distances = np.array([np.sqrt(34), 5.0, np.hypot(3, 3.5)])
    np.testing.assert_allclose(values, distances - 0.25, rtol=1e-14)
    rows = [float(row) for row in disc.rows(MotionPoint(arm, ca.DM(q)))]
    np.testing.assert_allclose(rows, (distances**2 - 0.25**2) / 0.5, rtol=1e-13)


def test_a_disc_out_of_reach_is_settled_and_one_in_reach_is_named_by_link() -> None:
    arm = planner.Manipulator([0.9, 0.7], 1.0, [1.0, 1.0, 0.5])
    assert Obstacle(1, 3, 3.0, 4.0, 1.0).values_out_of_reach(arm) == pytest.approx([1.5] * 3)
    for radius in (2.5, 2.6):
        assert Obstacle(1, 3, 3.0, 4.0, radius).values_out_of_reach(arm) is None
    disc = Obstacle(2, 3, 1.0, 1.0, 0.2)
    labels = [part.label for part in disc.parts]
    assert labels == [f"clearance of link {k} from obstacle 2" for k in (1, 2, 3)]
    said = disc.contradiction_text("start", _broken(disc, -0.0625, 1))
    assert (
        said
        == "at the start link 2 reaches 0.0625 m into obstacle 2; move the start or the obstacle"
    )
    both = [_broken(Obstacle(n, 3, 1.0, 1.0, 0.2), -0.1) for n in (2, 1, 2)]
    assert Obstacle.easing(both) == "obstacles 1 and 2 elsewhere"


def test_a_clearance_is_kept_beyond_the_disc() -> None:
    """Rows are exact where a link is as far away as it may be, and its distances stay true."""
    arm = planner.Manipulator([0.9, 0.7], 1.0, [1.0, 1.0, 0.5])
    disc = Obstacle(1, 3, 0.5, 0.75, 0.5, 0.25)
    q = np.zeros((4, 1))
    assert [part.low for part in disc.parts] == [0.25] * 3
    assert disc.values(MotionPoint(arm, q))[0] == pytest.approx(0.25)
    assert float(disc.rows(MotionPoint(arm, ca.DM(q)))[0]) == pytest.approx(0.25)
    q[1] = 1e-4  # the link turns towards it: both change alike
    values = disc.values(MotionPoint(arm, q))[0], float(disc.rows(MotionPoint(arm, ca.DM(q)))[0])
    assert values[0] == pytest.approx(0.25 - 0.5e-4, abs=1e-8)
    assert values[1] == pytest.approx(values[0], abs=1e-8)
    assert disc.fault(arm) is None
    far = Obstacle(1, 3, 3.0, 4.0, 1.0, 1.4)
    assert far.values_out_of_reach(arm) == pytest.approx([1.5] * 3)
    assert replace(far, clearance=1.6).values_out_of_reach(arm) is None
    near = _broken(disc, 0.1, 1)
    said = disc.contradiction_text("goal", replace(near, limit=0.25))
    assert said == (
        "at the goal link 2 is 0.1 m from obstacle 1, clearance_m = 0.25; move the goal or the"
        " obstacle, or lower clearance_m to 0.0999 or less"
    )
    assert Obstacle.easing([near]) == "obstacles.clearance_m = 0.0999 or less"
    touching = _broken(disc, 0.0, 1)  # of clearances only zero would do
    assert "clearance_m" not in disc.contradiction_text("goal", touching)
    assert "clearance_m" not in Obstacle.easing([touching])


@pytest.mark.parametrize("kind", [Obstacle(1, 3, 1.0, 1.0, 0.2), Z2Margin(0.1, 1)])
def test_what_is_asked_does_not_change(kind: Any) -> None:
    """They are keys of what is kept from one problem to the next."""
    (name, *_) = vars(kind)
    with pytest.raises(FrozenInstanceError):
        setattr(kind, name, 2)
    assert hash(kind) == hash(replace(kind))
