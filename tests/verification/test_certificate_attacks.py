"""Motions that are no plans must not be certified, however they are made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly

import planner
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory, Trajectory
from planner.support.calculus.bernstein import Bernstein
from planner.verification import place_proofs
from planner.verification.models import halves


@pytest.fixture(scope="module")
def rated(optimal: planner.Plan) -> planner.Plan:
    """Retimed under limits on the rates of inputs, from rest to rest."""
    limits = {"input_rad_s": 0.3, "input_rate_rad_s2": [2.0, 1.0]}
    return planner.retime(optimal, limits, rest=True, intervals=40)


def _with(plan: planner.Plan, **changes: Any) -> planner.Plan:
    """The plan with parts of its trajectory replaced."""
    return replace(plan, trajectory=replace(plan.trajectory, **changes))  # type: ignore[type-var]


def _open_labels(plan: planner.Plan, passes_verify: bool = False) -> set[str]:
    """What is not proven of a motion that is none; most of them integration alone refuses too."""
    certificate = planner.certify(plan)
    assert not certificate.ok, str(certificate)
    assert planner.verify(plan).ok == passes_verify
    return {claim.label for claim in certificate.open}


def test_good_plans_of_every_kind_are_certified(
    optimal: planner.Plan, law: planner.Plan, retimed: planner.Plan, rated: planner.Plan
) -> None:
    for plan in (optimal, law, retimed, rated):
        assert planner.certify(plan).ok, str(planner.certify(plan))


# -- clocks --------------------------------------------------------------------------------------


def test_a_clock_that_ends_half_way(retimed: planner.Plan) -> None:
    clock = retimed.trajectory.clock  # type: ignore[attr-defined]
    half = _with(retimed, clock=BPoly(clock.c / 2, clock.x))
    free = replace(half, problem=retimed.problem.changed({"limits": {}}))
    for plan in (half, free):
        assert {"goal theta1", "goal theta2", "goal theta3"} <= _open_labels(plan)
        assert "the clock goes from 0 to" in str(planner.certify(plan))


def test_a_clock_of_one_piece_over_a_path_of_forty(paper: planner.Problem) -> None:
    """The inputs are small in the middle, whose piece the whole clock was taken to lie in."""
    breaks = np.linspace(0.0, 10.0, 41)
    u = np.full((1, 40, 2), 0.01)
    u[0, 5] = 0.5
    q = np.zeros((1, 40, 4)) + paper.start
    path = StateTrajectory(paper.system, BPoly(q, breaks), BPoly(u, breaks))
    line = BPoly(np.array([[0.0], [10.0]]), [0.0, 10.0])
    fine = BPoly(np.stack([breaks[:-1], breaks[1:]]), breaks)
    problem = paper.changed({"limits": {"input_rad_s": 0.1}})
    for length in (line, fine):
        one = RetimedTrajectory(path, length, line, np.array([0.0, 10.0]))
        certificate = planner.certify(planner.Plan(problem, "by hand", {}, one))
        assert {certificate[f"input u{i}"].status for i in (1, 2)} == {"undecided"}
    many = RetimedTrajectory(path, fine, fine, breaks)
    certificate = planner.certify(planner.Plan(problem, "by hand", {}, many))
    assert {certificate[f"input u{i}"].status for i in (1, 2)} == {"violated"}


def test_a_plan_slowed_down_where_the_duration_is_given(
    optimal: planner.Plan, law: planner.Plan, retimed: planner.Plan
) -> None:
    for plan in (optimal, law, retimed):
        slow = replace(plan, trajectory=plan.trajectory.slowed(3.0))
        assert _open_labels(slow) == {"duration"}
        assert planner.certify(slow)["duration"].status == "violated"
        free = replace(slow, problem=plan.problem.changed({"goal.duration": "free"}))
        assert planner.certify(free).ok


def _late(clock: BPoly) -> BPoly:
    c = clock.c.copy()
    c[0, 0] += 0.1 * (c[-1, 0] - c[0, 0])
    return BPoly(c, clock.x)


def _jumping(clock: BPoly) -> BPoly:
    c = clock.c.copy()
    c[:, 3] = c[0, 3] + 0.5 * (c[:, 3] - c[0, 3])
    return BPoly(c, clock.x)


def _backwards(clock: BPoly) -> BPoly:
    """It overshoots in one piece and comes back, with all ends in place."""
    c = np.concatenate([clock.c[:1], clock.c[:1], clock.c[-1:], clock.c[-1:]])
    c[1, 3] += 3 * (c[-1, 3] - c[0, 3])
    return BPoly(c, clock.x)


@pytest.mark.parametrize("change", [_late, _jumping, _backwards])
def test_a_clock_that_starts_late_jumps_or_turns_back(
    retimed: planner.Plan, change: Callable[[BPoly], BPoly]
) -> None:
    assert "goal theta1" in _open_labels(_with(retimed, clock=change(retimed.trajectory.clock)))  # type: ignore[attr-defined]


def test_stations_off_their_places(retimed: planner.Plan) -> None:
    stations = retimed.trajectory.stations.copy()  # type: ignore[attr-defined]
    stations[5] = 0.5 * (stations[5] + stations[6])
    assert "input u1" in _open_labels(_with(retimed, stations=stations))


def test_stations_that_rounding_moves_before_or_behind_the_breaks(retimed: planner.Plan) -> None:
    """It is the same motion, and nothing is claimed of it that is not so."""
    own = retimed.trajectory.stations  # type: ignore[attr-defined]
    t = np.linspace(0.0, retimed.duration, 20001)
    for towards in (0.0, np.inf):
        stations = np.concatenate([own[:1], np.nextafter(own[1:-1], towards), own[-1:]])
        moved = _with(retimed, stations=stations)
        certificate = planner.certify(moved)
        assert certificate.ok, str(certificate)
        assert np.max(np.abs(moved.u(t) - retimed.u(t))) < 1e-9
        least = retimed.problem.limits.input - np.max(np.abs(moved.u(t)), axis=0)
        for label, margin in zip(("input u1", "input u2"), least, strict=True):
            assert certificate[label].guaranteed <= margin + 1e-9
            assert not certificate[label].attained < margin - 1e-9


def test_a_length_that_skips_part_of_the_path(optimal: planner.Plan) -> None:
    """Flat, or all but flat, over the middle of a path that moves there; without any limit."""
    free = optimal.problem.changed({"limits": {}, "goal.duration": "free"})
    breaks = optimal.t
    for least in (0.0, -1e-3):
        steps = np.diff(breaks).copy()
        steps[len(steps) // 3 : len(steps) // 2] *= least
        s = np.concatenate([[0.0], np.cumsum(steps)])
        length = BPoly(np.stack([s[:-1], s[1:]]), breaks)
        clock = BPoly(np.stack([s[:-1], s[1:]]), breaks)
        skipped = RetimedTrajectory(optimal.trajectory, length, clock, breaks)
        plan = replace(optimal, problem=free, trajectory=skipped)
        assert "goal theta1" in _open_labels(plan, passes_verify=least < 0.0)


def test_any_other_length_that_grows_is_as_good(optimal: planner.Plan) -> None:
    """Twice as fast along the second half, in its own measure: the same motion, on time."""
    steps = np.diff(optimal.t).copy()
    steps[len(steps) // 2 :] *= 2
    s = np.concatenate([[0.0], np.cumsum(steps)])
    both = np.stack([s[:-1], s[1:]])
    other = RetimedTrajectory(optimal.trajectory, BPoly(both, optimal.t), BPoly(both, s), optimal.t)
    time = 0.8 * other.duration
    point = {"theta_deg": np.rad2deg(other.q(time)[1:]).tolist(), "time": time}
    asked = {"limits": {}, "goal.duration": other.duration, "waypoints": [point]}
    plan = replace(optimal, problem=optimal.problem.changed(asked), trajectory=other)
    assert planner.certify(plan).ok
    assert planner.verify(plan).ok


def test_a_length_that_ends_before_the_path(retimed: planner.Plan) -> None:
    path = retimed.trajectory
    assert isinstance(path, RetimedTrajectory)
    short = RetimedTrajectory(
        path.path,
        BPoly(path.length.c[:, :-1], path.length.x[:-1]),
        BPoly(path.clock.c[:, :-1], path.clock.x[:-1]),
        path.stations[:-1],
    )
    assert "goal theta1" in _open_labels(replace(retimed, trajectory=short))


def test_retimed_twice_is_not_known(retimed: planner.Plan) -> None:
    end = retimed.duration
    s = retimed.t
    both = np.stack([s[:-1], s[1:]])
    twice = RetimedTrajectory(retimed.trajectory, BPoly(both, s), BPoly(both, s), s)
    free = retimed.problem.changed({"limits": {}})
    assert twice.duration == end
    assert (
        "retimed twice"
        in planner.certify(replace(retimed, problem=free, trajectory=twice)).open[0].why
    )


# -- curves --------------------------------------------------------------------------------------


def test_what_has_no_form_cannot_be_made(
    optimal: planner.Plan, law: planner.Plan, retimed: planner.Plan
) -> None:
    u = optimal.trajectory.u_curve  # type: ignore[attr-defined]
    v = law.trajectory.v_curve  # type: ignore[attr-defined]
    halves = BPoly(np.repeat(v.c, 2, axis=1), [0.0, 0.5 * v.x[-1], v.x[-1]])
    stations = retimed.trajectory.stations[:-1]  # type: ignore[attr-defined]
    for make in (
        lambda: _with(optimal, u_curve=BPoly(u.c * 1j, u.x)),
        lambda: _with(law, v_curve=halves),
        lambda: _with(law, branch=np.ones(2)),
        lambda: _with(retimed, stations=stations),
        lambda: replace(optimal, trajectory=optimal.trajectory.slowed(float("nan"))),
    ):
        with pytest.raises(ValueError, match=r"must|one station for each"):
            make()


def test_numbers_that_are_none(optimal: planner.Plan, law: planner.Plan) -> None:
    for plan, name in ((optimal, "q_curve"), (optimal, "u_curve"), (law, "v_curve")):
        for value in (np.nan, np.inf):
            curve = getattr(plan.trajectory, name)
            c = curve.c.copy()
            c[0, -1, 0] = value
            assert "goal theta1" in _open_labels(_with(plan, **{name: BPoly(c, curve.x)}))


def test_a_plan_whose_own_motion_is_another(optimal: planner.Plan) -> None:
    """Good inputs beside a q(t) that starts, or goes, elsewhere."""
    curve = optimal.trajectory.q_curve  # type: ignore[attr-defined]
    moved = _with(optimal, q_curve=BPoly(curve.c + np.array([0.0, 0.01, 0.0, 0.0]), curve.x))
    deviation = planner.certify(moved)["plan's q(t) against its integrated input"]
    assert _open_labels(moved) == {"start", deviation.label}
    assert deviation.status == "violated"
    assert deviation.attained == pytest.approx(1e-4 - 0.01, abs=1e-6)
    c = curve.c.copy()
    c[1:-1, len(curve.x) // 2, 3] += 0.01
    assert "plan's q(t) against its integrated input" in _open_labels(
        _with(optimal, q_curve=BPoly(c, curve.x))
    )


def test_inputs_that_nothing_bounds_leave_everything_undecided(law: planner.Plan) -> None:
    """z is zero: the chart is singular all the time, and no cell is fine enough for the inputs."""
    path = law.trajectory
    assert isinstance(path, ChainedTrajectory)
    zero = BPoly(np.zeros_like(path.z_curve.c), path.z_curve.x)
    certificate = planner.certify(_with(law, z_curve=zero))
    assert [c.label for c in certificate.claims if c.status == "proven"] == ["duration"]
    assert set(certificate.motion_error.values()) == {np.inf}


def test_a_motion_that_turns_without_end_is_not_halved_without_end(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a disc; each turn of 1,500 rad goes past it, so that no cell is far from it."""
    problem = paper.changed(
        {
            "system.link_lengths": [1.0, 1.0, 1.0],
            "obstacles": [{"centre_m": [0.0, 2.0], "radius_m": 0.2}],
        }
    )
    rows = []

    def counted(c: Any, r: Any) -> Any:
        rows.append(len(c))
        return halves(c, r)

    monkeypatch.setattr(place_proofs, "halves", counted)
    breaks = np.linspace(0.0, 10.0, 41)
    u = BPoly(np.tile([0.0, 150.0], (1, 40, 1)), breaks)
    q = BPoly(np.tile(problem.start, (1, 40, 1)), breaks)
    plan = planner.Plan(problem, "by hand", {}, StateTrajectory(problem.system, q, u))
    assert not planner.certify(plan).ok
    assert 1000 < max(rows) <= 20_000


def test_another_branch_or_other_inputs_in_the_chart(law: planner.Plan) -> None:
    trajectory = law.trajectory
    assert isinstance(trajectory, ChainedTrajectory)
    for i in (1, 2):
        branch = trajectory.branch.copy()
        branch[i] = -branch[i]
        _open_labels(_with(law, branch=branch))
    v = trajectory.v_curve
    _open_labels(_with(law, v_curve=BPoly(v.c * np.array([1.0, 1.01]), v.x)))


def test_a_trajectory_of_another_system(optimal: planner.Plan) -> None:
    other = optimal.problem.changed({"system.K": [0.87, 0.71]}).system
    assert "goal theta1" in _open_labels(_with(optimal, system=other))


class _Louder(StateTrajectory):
    """A kind of the user's own, which evaluates in its own way."""

    kind = "louder"

    def u(self, t: Any) -> Any:
        return 2 * super().u(t)


def test_a_kind_that_nobody_knows_is_not_proven_even_without_limits(optimal: planner.Plan) -> None:
    free = optimal.problem.changed({"limits": {}, "goal.duration": "free"})
    own = optimal.trajectory
    assert isinstance(own, StateTrajectory)
    try:
        loud = _Louder(own.system, own.q_curve, own.u_curve)
        assert "goal theta1" in _open_labels(
            replace(optimal, problem=free, trajectory=loud), passes_verify=True
        )
    finally:
        Trajectory._kinds.pop("louder", None)


def test_nothing_asked_is_not_everything_proven() -> None:
    assert not planner.Certificate((), {}, 0, 0.0).ok


# -- places --------------------------------------------------------------------------------------


def test_a_waypoint_after_the_end(optimal: planner.Plan) -> None:
    """The last piece, continued beyond the end, goes through it; the motion does not."""
    early = optimal.trajectory.slowed(0.5)
    beyond = early.duration * 1.01
    curve = early.q_curve  # type: ignore[attr-defined]
    point = {"theta_deg": np.rad2deg(curve(beyond)[1:]).tolist(), "time": beyond}
    problem = optimal.problem.changed({"limits": {}, "waypoints": [point]})
    plan = replace(optimal, problem=problem, trajectory=early)
    assert _open_labels(plan) == {"duration", "distance from waypoint 1"}
    assert "is not known" in planner.certify(plan)["distance from waypoint 1"].why


def test_a_waypoint_on_a_retimed_clock(retimed: planner.Plan) -> None:
    for share in (0.3, 0.7):
        time = share * retimed.duration
        point = {"theta_deg": np.rad2deg(retimed.q(time)[1:]).tolist(), "time": time}
        problem = retimed.problem.changed({"waypoints": [point]})
        assert planner.certify(replace(retimed, problem=problem)).ok
        point = {**point, "time": time + 0.01}
        problem = retimed.problem.changed({"waypoints": [point]})
        assert _open_labels(replace(retimed, problem=problem)) == {"distance from waypoint 1"}


# -- at random -----------------------------------------------------------------------------------


def _mutated(plan: planner.Plan, rng: np.random.Generator) -> planner.Plan:
    """One coefficient, break, station or sign of a plan, changed by a little or a lot."""
    trajectory: Any = plan.trajectory
    if trajectory.kind == "retimed" and rng.random() < 0.5:
        inner = _mutated(replace(plan, trajectory=trajectory.path), rng)
        return _with(plan, path=inner.trajectory)
    size = 10.0 ** rng.uniform(-6, 0)
    names = [n for n in vars(trajectory) if isinstance(vars(trajectory)[n], Bernstein)]
    names = [n for n in names if not n.startswith("_")]
    if trajectory.kind == "retimed" and rng.random() < 0.2:
        stations = trajectory.stations.copy()
        stations[rng.integers(len(stations))] *= 1 + size
        return _with(plan, stations=stations)
    if trajectory.kind == "chained" and rng.random() < 0.2:
        branch = trajectory.branch.copy()
        branch[rng.integers(len(branch))] *= -1
        return _with(plan, branch=branch)
    name = names[rng.integers(len(names))]
    curve = getattr(trajectory, name)
    if len(curve.x) > 2 and rng.random() < 0.2:
        breaks = curve.x.copy()
        k = rng.integers(1, len(breaks) - 1)
        breaks[k] += size * (breaks[k + 1] - breaks[k])
        both = [n for n in names if trajectory.kind != "retimed"] or [name]
        return _with(plan, **{n: BPoly(getattr(trajectory, n).c, breaks) for n in both})
    c = curve.c.copy()
    c[tuple(rng.integers(n) for n in c.shape)] += size * rng.choice([-1.0, 1.0])
    return _with(plan, **{name: BPoly(c, curve.x)})


@pytest.mark.parametrize(
    ("kind", "count"), [("optimal", 24), ("law", 8), ("retimed", 12), ("rated", 6)]
)
def test_what_verify_refuses_is_never_certified(
    kind: str, count: int, request: pytest.FixtureRequest
) -> None:
    plan: planner.Plan = request.getfixturevalue(kind)
    rng = np.random.default_rng(20)
    proven = 0
    for _ in range(count):
        try:
            changed = _mutated(plan, rng)
        except ValueError:  # it cannot even be made
            continue
        certificate = planner.certify(changed)
        proven += certificate.ok
        if certificate.ok:  # only these need the judge, which is slower
            check = planner.verify(changed)
            assert check.ok, (str(certificate), str(check))
    assert proven < count
