"""Retiming: same path, fastest clock, limits kept between the nodes too."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from by_hand import by_hand
from scipy.integrate import quad
from scipy.interpolate import BPoly, CubicSpline

import planner
from planner.plan.fastest_timing import cut_path, fastest_clock
from planner.plan.retimed import Inverse, RetimedTrajectory, arc_length
from planner.support.calculus.bernstein import Bernstein

SPEED = {"input_rad_s": [0.5, 0.4]}
RATES = {"input_rad_s": [0.5, 0.4], "input_rate_rad_s2": [3.0, 2.0]}
TOP, RATE = np.array([0.5, 0.4]), np.array([3.0, 2.0])


@pytest.fixture(scope="module")
def steep(unlimited: planner.Problem) -> planner.Plan:
    """The plain cubic at the middle of its range: u₂ starts at 83 rad/s."""
    return planner.solve(unlimited.changed({"goal.travel": 0.8112}), "polynomial")


@pytest.fixture(scope="module")
def smooth(unlimited: planner.Problem) -> planner.Plan:
    problem = unlimited.changed({"goal.travel": 0.8286})
    return planner.solve(problem, "polynomial")


@pytest.fixture(scope="module")
def fast(steep: planner.Plan) -> planner.Plan:
    return planner.retime(steep, SPEED)


@pytest.fixture(scope="module")
def rested(smooth: planner.Plan) -> planner.Plan:
    return planner.retime(smooth, RATES, rest=True, intervals=120)


def _by_hand(
    start: list[float], goal: list[float], u: np.ndarray, q: np.ndarray, T: float
) -> planner.Plan:
    """A plan on the two-joint arm from Bernstein coefficients of u and q over one piece."""
    problem = planner.Problem.from_dict(
        {
            "system": {"kind": "manipulator", "joints": 2, "K": [1.0], "k_g": 1.0},
            "start": {"theta_deg": start},
            "goal": {"theta_deg": goal, "duration": T},
        }
    )
    curves = [BPoly(np.asarray(c, dtype=float)[:, None], [0.0, T]) for c in (q, u)]
    return by_hand(problem, *curves)


def _turn(profile: str = "constant") -> planner.Plan:
    """θ₁ turns from 0 to 30° alone: at a constant rate, or starting from rest."""
    a = np.pi / 6
    if profile == "constant":
        return _by_hand([0, 0], [30, 0], [[0, a], [0, a]], [[0, 0, 0], [0, a, 0]], 1.0)
    u = [[0, 0], [0, 2 * a]]
    return _by_hand([0, 0], [30, 0], u, [[0, 0, 0], [0, 0, 0], [0, a, 0]], 1.0)


# -- input limits alone ---------------------------------------------------------------------------


def test_time_is_the_integral_of_the_larger_input(steep: planner.Plan, fast: planner.Plan) -> None:
    """By another quadrature, on logarithmic pieces towards the steep start."""

    def pace(t: float) -> float:
        return float(np.max(np.abs(steep.u(t)) / TOP))

    edges = np.concatenate([[0.0], np.geomspace(1e-7, 10.0, 30)])
    total = sum(quad(pace, a, b, epsrel=1e-11)[0] for a, b in pairwise(edges))
    assert fast.duration == pytest.approx(total, rel=1e-8)


def test_one_input_is_always_at_its_limit(fast: planner.Plan) -> None:
    times = np.sort(np.random.default_rng(1).uniform(0, fast.duration, 500))
    used = np.max(np.abs(fast.u(times)) / TOP, axis=-1)
    np.testing.assert_allclose(used, 1.0, rtol=0, atol=1e-7)


def test_it_keeps_its_path(steep: planner.Plan, fast: planner.Plan) -> None:
    """Where φ is the same, everything is (φ moves at constant v₁ in the original)."""
    times = np.linspace(0, fast.duration, 301)
    q = fast.q(times)
    original = (q[:, 0] - q[0, 0]) / steep.travel * steep.duration
    np.testing.assert_allclose(q, steep.q(original), rtol=0, atol=1e-9)
    check = planner.verify(fast)
    assert check.ok
    assert np.max(np.abs(check.terminal_error)) < 1e-6
    assert fast.verified


def test_limits_bite(steep: planner.Plan) -> None:
    limited = steep.problem.changed({f"limits.{k}": v for k, v in SPEED.items()})
    before = planner.Plan(limited, steep.method, {}, steep.trajectory)
    assert {v.label for v in planner.verify(before).violations} == {"input u2"}


def test_problem_carries_limits_and_duration(fast: planner.Plan) -> None:
    assert fast.problem.duration == fast.duration
    np.testing.assert_array_equal(fast.problem.limits.input, TOP)
    assert fast.notes["retimed_from_s"] == 10.0
    late = planner.Plan(fast.problem.changed({"goal.duration": 9.0}), "x", {}, fast.trajectory)
    assert "duration" in [v.label for v in planner.verify(late).violations]


def test_nothing_is_left_to_gain(fast: planner.Plan) -> None:
    """The length of a retimed path, measured by its own limits, is its duration."""
    again = arc_length(fast.trajectory, TOP, "max")
    assert again.c[-1, -1] == pytest.approx(fast.duration, rel=1e-7)


def test_file_and_slowing(fast: planner.Plan, tmp_path: Path) -> None:
    back = planner.load_plan(fast.save(tmp_path / "plan.json"))
    times = np.linspace(-0.1, fast.duration + 0.1, 77)
    again, curve = back.trajectory, fast.trajectory
    for a, b in ((again.q, curve.q), (again.u, curve.u), (again.z, curve.z), (again.v, curve.v)):
        np.testing.assert_array_equal(a(times), b(times))
    slow = curve.slowed(2.0)
    np.testing.assert_allclose(slow.u(2 * times), curve.u(times) / 2, rtol=0, atol=1e-12)
    assert not np.any(curve.u(np.array([-0.1, fast.duration + 0.1])))


def test_a_file_is_read_in_a_new_process(fast: planner.Plan, tmp_path: Path) -> None:
    """Nothing else has been imported there that would know retimed plans."""
    path = str(fast.save(tmp_path / "plan.json"))
    code = f"import planner; print(repr(planner.load_plan({path!r})))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == repr(fast)


def test_corners_of_the_path(unlimited: planner.Problem) -> None:
    """Inputs of the collocation plan jump at every interval, from each side to its own value."""
    plan = planner.solve(unlimited, "collocation", input="constant")
    fast = planner.retime(plan, SPEED)
    used = np.max(np.abs(fast.u(fast.t)) / TOP, axis=-1)
    before = np.max(np.abs(fast.u(np.nextafter(fast.t[1:], 0))) / TOP, axis=-1)
    np.testing.assert_allclose(np.concatenate([used, before]), 1.0, rtol=0, atol=1e-7)


def test_a_path_that_stands_still_at_first() -> None:
    fast = planner.retime(_turn("from rest"), {"input_rad_s": 0.5})
    assert fast.duration == pytest.approx(np.pi / 6 / 0.5, rel=1e-9)
    np.testing.assert_allclose(fast.u(np.array([0.0, 1e-6, 0.3]))[:, 1], 0.5, rtol=1e-6)


def test_just_before_a_leg_that_starts_at_rest() -> None:
    """A leg at speed, then one from nothing: each side of the break has its own inputs."""
    a = np.pi / 12
    u = BPoly(np.array([[[0, a], [0, 0]], [[0, a], [0, 2 * a]]]), [0.0, 1.0, 2.0])
    q = np.zeros((3, 2, 3))
    q[:, 0, 1], q[:, 1, 1] = [0, a / 2, a], [a, a, 2 * a]
    longer = _turn().problem.changed({"goal.duration": 2.0})
    plan = by_hand(longer, BPoly(q, [0.0, 1.0, 2.0]), u)
    fast = planner.retime(plan, {"input_rad_s": 0.5})
    for t in (np.nextafter(fast.t[1], 0), fast.t[1], np.nextafter(fast.t[1], 9)):
        assert fast.q(t)[1] == pytest.approx(a, abs=1e-6)
        assert fast.u(t)[1] == pytest.approx(0.5, rel=1e-6)


# -- rates too -----------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["constant", "from rest"])
def test_trapezoid(profile: str) -> None:
    """A straight path from rest to rest: S/V + V/A, or 2 √(S/A) when V is not reached."""
    S = np.pi / 6
    for V, A in ((0.5, 2.0), (10.0, 2.0)):
        limits = {"input_rad_s": V, "input_rate_rad_s2": A}
        plan = planner.retime(_turn(profile), limits, rest=True, intervals=100)
        exact = S / V + V / A if V**2 / A < S else 2 * np.sqrt(S / A)
        assert plan.duration == pytest.approx(exact, rel=2e-4)
        assert plan.duration >= exact * (1 - 1e-9)
        top = plan.u(plan.duration / 2)[1]
        if exact == S / V + V / A:
            assert top == pytest.approx(V, rel=1e-6)
        else:  # the peak may be cut off over one of the 100 intervals, where b = u² falls
            assert np.sqrt(1 - 3 / 100) <= top / np.sqrt(S * A) <= 1 + 1e-6


def test_rates_alone() -> None:
    plan = planner.retime(_turn(), {"input_rate_rad_s2": 2.0}, intervals=100)
    assert np.all(plan.u([0.0, plan.duration]) == 0)  # unless told otherwise
    assert plan.duration == pytest.approx(2 * np.sqrt(np.pi / 6 / 2.0), rel=2e-4)


def _slopes(plan: planner.Plan, times: np.ndarray) -> np.ndarray:
    h = 1e-5
    return np.asarray((plan.u(times + h) - plan.u(times - h)) / (2 * h))


def test_limits_hold_and_rest_is_rest(rested: planner.Plan) -> None:
    check = planner.verify(rested)
    assert check.ok
    assert np.max(np.abs(check.terminal_error)) < 1e-6
    assert np.max(np.abs(rested.u(np.array([0.0, rested.duration])))) < 1e-6
    times = np.random.default_rng(2).uniform(1e-4, rested.duration - 1e-4, 4000)
    assert np.all(np.max(np.abs(rested.u(times)), axis=0) <= TOP * (1 + 1e-6))
    assert np.all(np.max(np.abs(_slopes(rested, times)), axis=0) <= RATE * (1 + 1e-4))


def test_some_limit_is_always_reached(rested: planner.Plan) -> None:
    """What the fastest clock must do at almost every time (Pontryagin)."""
    times = np.linspace(0, rested.duration, 1502)[1:-1]
    used = np.maximum(
        np.max(np.abs(rested.u(times)) / TOP, axis=-1),
        np.max(np.abs(_slopes(rested, times)) / RATE, axis=-1),
    )
    assert np.mean(used > 0.95) > 0.97


def test_rest_costs_time_and_finer_is_hardly_faster(smooth: planner.Plan) -> None:
    path = smooth.trajectory
    length = arc_length(path, TOP, "euclid")

    def duration(intervals: int, rest: bool) -> float:
        clock = fastest_clock(cut_path(path, length, TOP, intervals, rest), TOP, RATE)
        return float(clock.x[-1])

    coarse, fine, finer = (duration(n, rest=True) for n in (50, 200, 800))
    assert coarse > fine > finer
    assert fine == pytest.approx(finer, rel=5e-4)
    speed_only = planner.retime(smooth, SPEED).duration
    assert speed_only < duration(200, rest=False) < fine


@dataclass
class SplinePath:
    """A path of two joints through random points, as toppra's example has it."""

    spline: CubicSpline

    @property
    def breaks(self) -> np.ndarray:
        return np.asarray(self.spline.x)

    @property
    def duration(self) -> float:
        return float(self.spline.x[-1])

    def u(self, times: np.ndarray) -> np.ndarray:
        return np.asarray(self.spline(times, 1))


@pytest.mark.parametrize("size", [1.0, 1e-8])
@pytest.mark.parametrize("seed", [3, 10, 43, 84])
def test_more_intervals_are_never_slower(seed: int, size: float) -> None:
    """And 400 are within 0.4 % of 1600. IPOPT's own scaling once made 1000 slower than 200."""
    rng = np.random.default_rng(seed)
    path: Any = SplinePath(CubicSpline(np.linspace(0, 1, 5), size * rng.uniform(-3, 3, (5, 2))))
    top, rate = 10 + rng.random(2) * 20, 10 + rng.random(2) * 2
    length = arc_length(path, top, "euclid")
    times = [
        fastest_clock(cut_path(path, length, top, n, rest=True), top, rate).x[-1]
        for n in (100, 400, 1600)
    ]
    assert times[0] > times[1] > times[2] > 0.996 * times[1]


def test_stops_at_corners(unlimited: planner.Problem) -> None:
    """v₂ jumps between slots and v₁ does not: the inputs' ratio changes, so they must vanish."""
    problem = unlimited.changed({"goal.travel": 0.835})
    plan = planner.solve(problem, "piecewise", slots=6)
    length = arc_length(plan.trajectory, TOP, "euclid")
    stretch = cut_path(plan.trajectory, length, TOP, 60, rest=False)
    clock = fastest_clock(stretch, TOP, RATE)
    assert np.sum(stretch.stops) == 5
    np.testing.assert_allclose(stretch.stations[stretch.stops], plan.t[1:-1], atol=1e-12)
    retimed = RetimedTrajectory(plan.trajectory, length, clock, stretch.stations)
    speeds = np.max(np.abs(retimed.u(retimed.breaks)), axis=-1)
    assert np.all(speeds[stretch.stops] < 1e-9)
    assert np.sum(speeds < 1e-9) == 5


# -- pauses --------------------------------------------------------------------------------------

PAUSING = {"input_rad_s": 0.5}, {"input_rate_rad_s2": 2.0}


def _pausing(pauses: list[int]) -> planner.Plan:
    """θ₁ turns by 15° in each of two seconds, with pauses of whole seconds before, between, after
    them."""
    a = np.pi / 12
    angles = np.repeat([0, a, 2 * a], np.add(pauses, 1))
    count = len(angles) - 1
    q, u = np.zeros((2, count, 3)), np.zeros((1, count, 2))
    q[:, :, 1], u[:, :, 1] = [angles[:-1], angles[1:]], np.diff(angles)
    problem = _turn().problem.changed({"goal.duration": float(count)})
    breaks = np.arange(count + 1.0)
    return by_hand(problem, BPoly(q, breaks), BPoly(u, breaks))


@pytest.mark.parametrize("limits", PAUSING)
@pytest.mark.parametrize("pauses", [[0, 2, 0], [1, 0, 3], [2, 1, 1]])
def test_a_pause_takes_no_time(limits: dict[str, float], pauses: list[int]) -> None:
    fast, without = (planner.retime(_pausing(each), limits) for each in (pauses, [0, 0, 0]))
    assert fast.verified
    assert fast.duration == pytest.approx(without.duration, rel=1e-12)
    times = np.linspace(0, fast.duration, 50)
    np.testing.assert_allclose(fast.q(times), without.q(times), rtol=0, atol=1e-12)
    assert fast.notes["retimed_from_s"] == 2 + sum(pauses)


@pytest.mark.parametrize("limits", PAUSING)
def test_a_pause_in_the_chart_takes_no_time(limits: dict[str, float], smooth: planner.Plan) -> None:
    path: Any = smooth.trajectory
    z, v, x = path.z_curve.c, path.v_curve.c, path.breaks
    still = np.broadcast_to(z[-1:, -1:], (len(z), 1, z.shape[2]))
    later = np.append(x, x[-1] + 3.0)
    z_curve = Bernstein(np.concatenate([z, still], axis=1), later)
    v_curve = Bernstein(np.concatenate([v, np.zeros_like(v[:, :1])], axis=1), later)
    problem = smooth.problem.changed({"goal.duration": float(later[-1])})
    waiting = replace(path, z_curve=z_curve, v_curve=v_curve)
    fast = planner.retime(planner.Plan(problem, "x", {}, waiting), limits)
    assert isinstance(fast.trajectory, RetimedTrajectory)
    assert fast.trajectory.path == path
    assert fast.duration == planner.retime(smooth, limits).duration


@pytest.mark.parametrize("limits", [None, {"input_rate_rad_s2": 2.0}])
@pytest.mark.parametrize("motion", [planner.homing, planner.seating])
def test_motions_that_pause_to_turn_back(
    paper: planner.Problem, motion: Any, limits: dict[str, float] | None
) -> None:
    plan = motion(paper)
    fast = planner.retime(plan, limits)
    assert fast.verified
    assert fast.duration < plan.duration


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "rest", "message"),
    [
        ({}, False, "u1 moves and has no limit"),
        ({"input_rate_rad_s2": [1.0]}, False, "has 1 values"),
        (SPEED, True, "rest at the ends needs limits"),
        ({"input_rads": 1.0}, False, "did you mean 'input_rad_s'"),
    ],
)
def test_bad_limits(
    smooth: planner.Plan, limits: dict[str, object], rest: bool, message: str
) -> None:
    with pytest.raises(planner.InputError, match=message):
        planner.retime(smooth, limits, rest=rest)


@pytest.mark.parametrize("limits", PAUSING)
def test_a_plan_that_stays_has_nothing_to_retime(
    paper: planner.Problem, limits: dict[str, float]
) -> None:
    there = paper.changed({"start.theta_deg": [9.0, 9.0, 9.0], "goal.theta_deg": [9.0, 9.0, 9.0]})
    with pytest.raises(planner.InputError):
        planner.retime(planner.solve(there), limits)


def test_a_solver_that_fails_is_a_refusal(
    smooth: planner.Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    failure = SimpleNamespace(x=None, message="numerical trouble")
    monkeypatch.setattr("planner.plan.fastest_timing.linprog", lambda *_, **__: failure)
    with pytest.raises(planner.NotConvergedError, match="numerical trouble"):
        planner.retime(smooth, {"input_rate_rad_s2": 1.0})


def test_singular_plan(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.travel": 0.79})
    plan = planner.solve(problem, "polynomial", allow_singular=True)
    with pytest.raises(planner.SingularError, match="no inputs to retime"):
        planner.retime(plan, SPEED)


# -- the parts -----------------------------------------------------------------------------------


def test_length_and_its_inverse(steep: planner.Plan) -> None:
    length = arc_length(steep.trajectory, TOP, "euclid")
    inverse = Inverse(length)
    sigma = np.geomspace(1e-8, 9.999, 200)
    k = np.searchsorted(length.x, sigma, side="right") - 1
    back = inverse(length(sigma), length.x[k], length.x[k + 1])
    np.testing.assert_allclose(back, sigma, rtol=1e-7, atol=1e-14)
    speed = np.linalg.norm(steep.u(sigma) / TOP, axis=-1)
    np.testing.assert_allclose(inverse.slope(sigma), speed, rtol=1e-8)


def test_retimed_again_is_the_path_timed_anew(smooth: planner.Plan) -> None:
    """No clock is put on a clock, so that the second can be proven as the first is."""
    for limits in (SPEED, RATES):
        once = planner.retime(smooth, limits)
        again = planner.retime(planner.retime(smooth, {"input_rad_s": [0.4, 0.6]}), limits)
        proven = [
            {claim.label for claim in made.certificate.claims if claim.status == "proven"}
            for made in (again, once)
            if made.certificate is not None
        ]
        assert proven[0] == proven[1] >= {"goal theta1", "input u1", "chart domain"}
        assert isinstance(again.trajectory, RetimedTrajectory)
        assert again.trajectory.path == smooth.trajectory
        assert again.duration == pytest.approx(once.duration, rel=1e-12)
