"""One verdict: what integration misses between its points, the certificate decides."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from registered import Bump, restored
from scipy.interpolate import BPoly

import planner
from planner.plan.clock import Clock
from planner.plan.quadrature import CONTROL_POINTS, POINTS
from planner.plan.trajectory import StateTrajectory
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.support.calculus.chebyshev import points
from planner.verification.verdict import judge


@pytest.fixture(scope="module")
def bumps() -> Iterator[None]:
    with restored():
        planner.register_requirement(Bump)
        yield


def asked(plan: planner.Plan, *limits: Requirement) -> planner.Plan:
    """The plan for a problem that asks for more."""
    return replace(plan, problem=replace(plan.problem, registered_limits=limits))


def way(plan: planner.Plan) -> tuple[float, float]:
    """Where theta1 is at least and at most."""
    angles = plan.q(np.linspace(0.0, plan.duration, 20001))[:, 1]
    return float(np.min(angles)), float(np.max(angles))


# -- registered requirements ----------------------------------------------------------------------


@pytest.mark.parametrize("width", [0.1, 5e-4, 1e-7])
def test_a_bump_is_found_however_narrow_and_proven_to_be_missed(
    optimal: planner.Plan, width: float
) -> None:
    (low, high), rng = way(optimal), np.random.default_rng(int(1 / width))
    for at in rng.uniform(low, high, 5):
        found, check = judge(asked(optimal, Bump(float(at), width)))
        assert not found.verified
        assert not check.ok
        (broken,) = (v for v in check.violations if v.label == "bump")
        assert broken.limit == 0.5
        assert broken.value == pytest.approx(1.0, abs=1e-6)
        assert check.margins["bump"] == pytest.approx(-0.5, abs=1e-6)
        reached = optimal.q(broken.time_s)[1]
        assert abs(reached - at) < max(width, 1e-5)
    found, check = judge(asked(optimal, Bump(high + 0.9 * width, width)))
    assert check.ok
    assert found.verified
    assert found.certificate is not None
    claim = found.certificate["bump"]
    assert claim.status == "proven"
    assert claim.guaranteed == pytest.approx(0.5 - np.exp(-0.81), abs=max(1e-6, 1e-5 / width))


def broken(error: planner.NoPlanError) -> set[str]:
    return {violation.label for violation in error.violations}


@pytest.mark.usefixtures("bumps")
def test_whoever_returns_a_verified_plan_asks_the_certificate(
    optimal: planner.Plan, law: planner.Plan, tmp_path: Path
) -> None:
    """The integration alone sees nothing of a bump 1e-5 rad wide."""
    for made in (optimal, law):
        bump = [float(made.q(0.4321 * made.duration)[1]), 1e-5]
        narrow = replace(made, problem=made.problem.changed({"limits.bump": bump}))
        assert planner.verify(narrow).ok
        for make in (planner.retime, planner.compensate):
            with pytest.raises(planner.VerificationError) as info:
                make(replace(narrow, verified=False))
            assert "bump" in broken(info.value)
        back = planner.load_plan(narrow.save(tmp_path / "narrow.json"))
        assert (back.verified, back.certificate) == (False, None)
        assert "bump reaches 1" in back.violation
        data = json.loads(narrow.save(tmp_path / "bare.json").read_text())
        data["certificate"] = None  # as if it had not been examined
        (tmp_path / "bare.json").write_text(json.dumps(data))
        assert "bump reaches 1" in planner.load_plan(tmp_path / "bare.json").violation
    with pytest.raises(planner.VerificationError) as info:
        planner.solve(narrow.problem, "polynomial")
    assert "bump" in broken(info.value)
    assert info.value.plan.verified is False


@dataclass(frozen=True)
class Hidden(Bump):
    """The same of which no proof can say anything."""

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        (row,) = super().rows(point)
        return [ca.fmax(row, 0.0)]


def test_what_no_proof_reads_is_asked_between_the_points_too(optimal: planner.Plan) -> None:
    """And named on the optimal where nothing is proven."""
    apart = points(CONTROL_POINTS)[:, None] - points(POINTS)
    share = points(CONTROL_POINTS)[int(np.argmax(np.min(np.abs(apart), axis=1)))]
    piece = len(optimal.t) // 2
    between = optimal.t[piece] + share * (optimal.t[piece + 1] - optimal.t[piece])
    on = asked(optimal, Hidden(float(optimal.q(between)[1]), 1e-5))
    assert not judge(on)[1].ok
    beside = asked(optimal, Hidden(way(optimal)[1] + 1e-4, 1e-4))
    found, check = judge(beside)
    assert check.ok
    assert found.certificate is not None
    assert [claim.label for claim in found.certificate.open] == ["bump"]
    words = "only sampled: bump (there is no bound for the function fmax of an expression)"
    assert words in str(found.certificate)
    assert "verified, only sampled: bump" in repr(found)
    assert found.certificate.to_dict()["only_sampled"] == ["bump"]


@dataclass(frozen=True)
class Band(Requirement):
    """low ≤ θ₁ + θ₂ u₂ ≤ high."""

    low: float
    high: float
    reads = frozenset({"q", "u"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("band", "", self.low, self.high, 1.0),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.q[1] + point.q[2] * point.u[1]]


@dataclass(frozen=True)
class Spike(Band):
    """exp(−((θ₁ + θ₂ u₂ − low)/1e-6)²) ≤ ½."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("bump", "", -np.inf, 0.5, 0.5),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [ca.exp(-(((super().rows(point)[0] - self.low) / 1e-6) ** 2))]


def test_what_reads_coordinates_and_inputs_is_judged_on_retimed_plans(
    optimal: planner.Plan, retimed: planner.Plan
) -> None:
    for made in (retimed, optimal):
        t = np.linspace(0.0, made.duration, 40001)
        value = made.q(t)[:, 1] + made.q(t)[:, 2] * made.u(t)[:, 1]
        low, high = float(np.min(value)), float(np.max(value))
        kept = planner.certify(asked(made, Band(low - 1e-3, high + 1e-3)))["band"]
        assert kept.status == "proven"
        assert kept.guaranteed == pytest.approx(1e-3, abs=1e-5)
        above = planner.certify(asked(made, Band(low - 1e-3, high - 1e-3)))["band"]
        assert above.status == "violated"
        assert above.attained == pytest.approx(-1e-3, abs=1e-5)
        (v,) = judge(asked(made, Band(low + 1e-3, high + 1e-3)))[1].violations
        assert v.limit == pytest.approx(low + 1e-3)
    for share in (0.2345, 0.8765):
        q, u = retimed.q(share * retimed.duration), retimed.u(share * retimed.duration)
        claim = planner.certify(asked(retimed, Spike(float(q[1] + q[2] * u[1]), 0.0)))["bump"]
        assert claim.status == "violated"
        assert claim.attained == pytest.approx(-0.5, abs=1e-6)


def test_the_side_of_a_limit_that_only_the_certificate_sees(optimal: planner.Plan) -> None:
    """A dip below the lower of two limits."""

    @dataclass(frozen=True)
    class Dip(Bump):
        @property
        def parts(self) -> tuple[Part, ...]:
            return (Part("dip", "", -0.5, 3.0, 0.5),)

        def rows(self, point: MotionPoint) -> Sequence[Any]:
            return [-row for row in super().rows(point)]

        def values(self, point: MotionPoint) -> Sequence[Any]:
            return [-row for row in super().values(point)]

    narrow = asked(optimal, Dip(float(optimal.q(0.4321 * optimal.duration)[1]), 1e-5))
    assert planner.verify(narrow).ok
    (v,) = judge(narrow)[1].violations
    assert (v.limit, v.value) == (-0.5, pytest.approx(-1.0, abs=1e-6))
    assert v.scaled == pytest.approx(1.0, abs=1e-5)  # 0.5 beyond it, in units of 0.5


# -- compensated plans -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def compensated(optimal: planner.Plan) -> planner.Plan:
    return planner.compensate(optimal)


def test_of_a_compensated_plan_only_what_is_known_is_claimed(compensated: planner.Plan) -> None:
    certificate = compensated.certificate
    assert certificate is not None
    proven = {claim.label for claim in certificate.claims if claim.status == "proven"}
    assert proven == {"duration", "input u1", "input u2"}
    assert {claim.status for claim in certificate.open} == {"undecided"}
    assert "emulated machine" in certificate["goal theta1"].why
    assert certificate.cells == len(compensated.t) - 1  # each piece is a polynomial
    longer = compensated.problem.changed({"goal.duration": 11})
    assert planner.certify(replace(compensated, problem=longer))["duration"].status == "violated"
    tight = compensated.problem.changed({"limits.input_rad_s": 0.1})
    assert planner.certify(replace(compensated, problem=tight))["input u2"].status == "violated"


def _bent(data: dict[str, Any]) -> None:
    """Straight pieces become quadratic, and one of them leaves its line."""
    curve = data["trajectory"]["q"]
    first, last = (np.array(c) for c in curve["bernstein"])
    middle = (first + last) / 2
    middle[1000, 2] += 1.1
    curve["bernstein"] = [first.tolist(), middle.tolist(), last.tolist()]


def _inner_limit(data: dict[str, Any]) -> None:
    data["compensation"]["plan"]["problem"]["limits"] = {"input_rad_s": 1e-3}


def _inner_motion(data: dict[str, Any]) -> None:
    curve = data["compensation"]["plan"]["trajectory"]["u"]
    curve["bernstein"] = (1.5 * np.array(curve["bernstein"])).tolist()


def _inner_claim(data: dict[str, Any]) -> None:
    data["compensation"]["plan"]["verified"] = False


def _inner_problem(data: dict[str, Any]) -> None:
    """That of the plan inside allows more; the plan keeps both."""
    data["compensation"]["plan"]["problem"]["limits"] = {"input_rad_s": 9.0}


def _earlier(data: dict[str, Any]) -> None:
    """The plan's clock starts a second before it does: errors would be measured elsewhere."""
    clock = data["compensation"]["clock"]
    clock["t"] = [clock["t"][0], *(t - 1.0 for t in clock["t"][1:-1]), clock["t"][-1]]


def _beyond(data: dict[str, Any]) -> None:
    """The clock goes on after the commands' end, which a free duration does not tell."""
    for problem in (data["problem"], data["compensation"]["plan"]["problem"]):
        problem["goal"]["duration"] = "free"
    data["compensation"]["clock"]["t"][-1] += 1.0


EDITS = [
    (_inner_problem, "its original plan solves another problem"),
    (_earlier, "largest error on the nominal machine, against the plan's own figure, is "),
    (_beyond, "end of the original plan's clock is 16.46 s, must be 15.46 s"),
    (_bent, "plan's q(t) against the nominal machine's motion"),
    (_inner_limit, "in its original plan, input u"),
    (_inner_motion, "in its original plan, "),
    (_inner_claim, "the original plan in the file is not verified"),
]


def test_a_compensated_plan_is_judged_between_its_breaks_and_inside(
    compensated: planner.Plan, tmp_path: Path
) -> None:
    path = compensated.save(tmp_path / "plan.json")
    kept, text = planner.load_plan(path, strict=True), path.read_text()
    assert kept.verified
    assert kept.save(tmp_path / "again.json").read_text() == text
    for edit, says in EDITS:
        data = json.loads(text)
        edit(data)
        path.write_text(json.dumps(data))
        back = planner.load_plan(path)
        assert not back.verified, says
        assert says in back.violation


def test_a_plans_own_motion_is_compared_with_the_machines_piece_by_piece(
    compensated: planner.Plan,
) -> None:
    """Of a line between two breaks that is bent, it is told by how much, and where."""
    path = compensated.trajectory
    assert isinstance(path, StateTrajectory)
    first, last = path.q_curve.c
    for piece, coordinate, bend in ((1, 3, 0.3), (900, 0, -0.2), (len(first) - 1, 1, 0.1)):
        middle = (first + last) / 2
        middle[piece, coordinate] += bend
        bent = replace(path, q_curve=BPoly(np.stack([first, middle, last]), path.breaks))
        (broken,) = planner.verify(replace(compensated, trajectory=bent)).violations
        assert broken.value == pytest.approx(abs(bend), abs=1e-6)
        assert broken.time_s == path.breaks[piece]


@pytest.mark.parametrize(("piece", "there"), [(6, 0.2), (1, -0.2)])
def test_a_machine_that_leaves_the_range_between_two_breaks_is_told_where(
    compensated: planner.Plan, piece: int, there: float
) -> None:
    """Commands in pieces of a second, in one of which the arm goes there and back."""
    made, start = compensated.compensation, compensated.problem.start
    assert made is not None
    machine, breaks = planner.Machine.from_table(made.machine), np.arange(9.0)
    u = np.zeros((2, 8, 2)) + np.array([0.1, 0.0])
    u[:, piece, 1] = there, -there
    still = BPoly(np.zeros((1, 8, 4)) + start, breaks)
    path = StateTrajectory(compensated.problem.system, still, BPoly(u, breaks))
    made = replace(made, clock=Clock.running(8.0))
    plan = replace(compensated, trajectory=path, compensation=made)
    run = planner.replay(plan, machine.nominal(), record_s=machine.step_s)
    ends = np.stack([np.interp(breaks, run.t, q) for q in run.q[0].T], axis=1)
    own = replace(path, q_curve=BPoly(np.stack([ends[:-1], ends[1:]]), breaks))
    check = planner.verify(replace(plan, trajectory=own))
    inside = run.q[0, (run.t >= piece) & (run.t <= piece + 1.0), 1]
    beyond = float(np.max(np.sign(there) * (inside - inside[-1])))
    assert beyond > np.deg2rad(1.0)
    (gap,) = (v for v in check.violations if v.value == check.interpolant_error)
    assert gap.value == pytest.approx(beyond / np.deg2rad(0.05) * 1e-4, rel=1e-3)
    assert gap.time_s == piece


def test_a_clock_that_is_none_is_refused_by_all(compensated: planner.Plan) -> None:
    made = compensated.compensation
    assert made is not None
    for t, s in ([(0.0, 1.0), (0.0,)], [(), ()], [(0.0, np.nan), (0.0, 10.0)]):
        broken = replace(compensated, compensation=replace(made, clock=Clock(t, s)))
        assert not planner.verify(broken).ok
        assert not planner.certify(broken).ok


@dataclass(frozen=True)
class Mixed(Requirement):
    """A sum of the coordinates ≤ most."""

    most: float
    weights: tuple[float, ...] = (0.6, -0.5, 0.1, -0.6)
    reads = frozenset({"q"})

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("mixed", "rad", -np.inf, self.most, 1.0),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [sum(w * point.q[i] for i, w in enumerate(self.weights))]


def test_limits_hold_on_the_machines_motion_between_the_breaks(compensated: planner.Plan) -> None:
    """Within a tick the motion goes farther than the straight line of the plan's q(t)."""
    assert compensated.compensation is not None
    machine = planner.Machine.from_table(compensated.compensation.machine)
    run = planner.replay(compensated, machine.nominal(), record_s=machine.step_s)
    motion, breaks = run.q[0, run.t <= compensated.duration], compensated.q(compensated.t)
    tried = np.random.default_rng(1).normal(size=(2000, 4))
    beyond = (motion @ tried.T).max(axis=0) - (breaks @ tried.T).max(axis=0)
    weights = tried[np.argmax(beyond)]
    values = motion @ weights
    peak, when = float(np.max(values)), float(run.t[np.argmax(values)])
    own = float(np.max(compensated.q(compensated.t) @ weights))
    assert peak > own + 1e-4
    weighed = tuple(weights.tolist())
    (v,) = planner.verify(asked(compensated, Mixed((peak + own) / 2, weighed))).violations
    assert v.value == pytest.approx(peak, abs=1e-5)
    assert v.time_s == pytest.approx(when, abs=2 * machine.step_s)
    assert planner.verify(asked(compensated, Mixed(peak + 1e-5, weighed))).ok
    for weights in np.random.default_rng(0).normal(size=(8, 4)):
        values = run.q[0, run.t <= compensated.duration] @ weights
        peak, when = float(np.max(values)), float(run.t[np.argmax(values)])
        mixed = Mixed(peak - 1e-3, tuple(weights.tolist()))
        (v,) = planner.verify(asked(compensated, mixed)).violations
        assert v.value == pytest.approx(peak, abs=1e-5)
        if np.sum(values > peak - 1e-6) < 5:  # not at rest
            assert v.time_s == pytest.approx(when, abs=2 * machine.step_s)
