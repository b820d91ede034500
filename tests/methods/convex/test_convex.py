"""The method 'convex' through `solve`, which verifies: global optima, timings and refusals."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import planner
from planner.methods.convex import method
from planner.methods.convex.programme import StalledError
from planner.plan.measures import peak_rates
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.solve import solve_and_check

PIECES = 20


def optimality(plan: planner.Plan) -> dict:
    return plan.notes["optimality"]


@pytest.fixture(scope="module")
def wide(paper: planner.Problem) -> planner.Problem:
    """The paper's example with the margin of z₂ alone, which is convex."""
    return paper.changed({"limits": {"z2_margin": 0.01}})


@pytest.fixture(scope="module")
def smooth_wide(wide: planner.Problem) -> planner.Plan:
    return planner.solve(wide, "convex", pieces=PIECES)


@pytest.fixture(scope="module")
def smooth_limited(paper: planner.Problem) -> planner.Plan:
    return planner.solve(paper, "convex", pieces=PIECES)


def test_wide_limits_give_a_verified_global_optimum(smooth_wide: planner.Plan) -> None:
    assert smooth_wide.verified
    found = optimality(smooth_wide)
    assert found["kind"] == "global"
    assert 0 <= found["relative_gap"] < 1e-6
    assert found["domain_excess_bound"] <= 0
    assert smooth_wide.domain.ok
    assert smooth_wide.domain.z2_max <= -0.01
    assert smooth_wide.objective == pytest.approx(found["objective"])


def test_free_travel_is_the_best_of_fixed_ones(
    wide: planner.Problem, smooth_wide: planner.Plan
) -> None:
    for shift in (-0.004, 0.004):
        fixed = wide.changed({"goal.travel": smooth_wide.travel + shift})
        beside = plan_only(fixed)
        assert beside.objective > smooth_wide.objective
        assert optimality(beside)["lower_bound"] > smooth_wide.objective


def plan_only(problem: planner.Problem, **options: object) -> planner.Plan:
    """The method's plan, without the verification that other tests make."""
    method = planner.METHODS["convex"]
    return method.plan(problem, method.options(**{"pieces": PIECES, **options}))


def test_input_limits_are_kept_by_the_clock(
    smooth_wide: planner.Plan, smooth_limited: planner.Plan
) -> None:
    """With v₁ constant they are broken ten times over; the same path is run so that they hold."""
    assert smooth_wide.peak_u[1] > 5.0
    assert smooth_limited.verified
    assert np.all(smooth_limited.peak_u <= 0.5)
    assert smooth_limited.duration == pytest.approx(10.0, rel=1e-12)
    assert optimality(smooth_limited) == optimality(smooth_wide)
    # The same curve: z₂ … z₄ at equal z₁.
    t = np.linspace(0, 10, 400)
    slow, fast = smooth_wide.z(t), smooth_limited.z(t)
    for i in range(1, 4):
        along = np.interp(fast[:, 0], slow[:, 0], slow[:, i])
        np.testing.assert_allclose(fast[:, i], along, atol=2e-4)


def test_v1_is_constant_where_that_keeps_the_input_limits(wide: planner.Problem) -> None:
    slow = wide.changed({"limits.input_rad_s": [0.5, 100.0], "goal.travel": 0.82})
    plan = plan_only(slow)
    assert plan.notes["timing"] == "v1 constant"
    v1 = plan.v(np.linspace(0, 9.99, 50))[:, 0]
    np.testing.assert_allclose(v1, 0.082, rtol=1e-12)


def test_a_joint_limit_that_is_not_convex_is_left_to_the_verification(
    wide: planner.Problem,
) -> None:
    """θ₁ of three joints plays no part: a path that breaks its limit is refused."""
    narrow = {"goal.travel": 0.81, "limits": {"z2_margin": 0.01, "joint_deg": [36.0, 80.0, 80.0]}}
    with pytest.raises(planner.VerificationError) as caught:
        planner.solve(wide.changed(narrow), "convex", pieces=PIECES)
    (broken,) = caught.value.violations
    assert (broken.label, broken.part.key) == ("joint theta1", "limits.joint_deg")
    assert 39 < np.rad2deg(broken.value) < 40
    assert "collocation" in {change.method for change in caught.value.changes}
    narrow["limits"]["joint_deg"][0] = 42.0  # type: ignore[index]
    plan = planner.solve(wide.changed(narrow), "convex", pieces=PIECES)
    assert optimality(plan)["kind"] == "global"


def test_peak_objective_lowers_its_peak(wide: planner.Problem) -> None:
    at = {"goal.travel": 0.82}
    smooth, peak = plan_only(wide.changed(at)), plan_only(wide.changed(at), objective="peak")
    t = np.linspace(0, 10, 4001)
    assert optimality(peak)["kind"] == "global"
    assert optimality(peak)["relative_gap"] < 1e-6
    assert np.abs(peak.v(t)[:, 1]).max() == pytest.approx(peak.objective, rel=1e-9)
    assert peak.objective < 0.95 * np.abs(smooth.v(t)[:, 1]).max()


@pytest.mark.parametrize("aside_m", [1.0, 0.1, 1e-3, 1e-5, 0.0])
def test_a_peak_is_proven_least_however_small_it_is(aside_m: float) -> None:
    path = Path(__file__).parents[3] / "problems/unicycle.toml"
    plan = planner.solve(
        planner.load_problem(path, {"goal.y_m": aside_m}), "convex", objective="peak"
    )
    assert plan.objective == pytest.approx(0.4 * aside_m, rel=1e-9)
    assert abs(optimality(plan)["relative_gap"]) < 1e-11


def test_free_duration_is_the_least_of_the_path(paper: planner.Problem) -> None:
    """The one that `retime` finds, which is a few seconds where v₁ constant takes minutes."""
    free = paper.changed({"goal.duration": "free", "goal.travel": 0.83})
    plan = plan_only(free)
    assert optimality(plan)["kind"] == "global"
    u = np.abs(plan.u(np.linspace(0, plan.duration, 2001)[:-1]))
    np.testing.assert_allclose(u.max(axis=1), 0.5, rtol=2e-4)  # one of them is at its limit
    assert np.all(plan.peak_u <= 0.5)
    assert plan.duration < 3.5
    certificate = planner.certify(plan)
    assert certificate.ok, str(certificate)
    even = paper.changed({"goal.travel": 0.83, "limits": {"z2_margin": 0.01}})
    slowest = np.max(plan_only(even).peak_u) / 0.5 * 10.0
    assert slowest > 20 * plan.duration


def test_rate_limits_make_v2_continuous_and_are_kept(paper: planner.Problem) -> None:
    rated = paper.changed(
        {"limits.input_rate_rad_s2": 5.0, "goal.duration": "free", "goal.travel": 0.829}
    )
    plan = planner.solve(rated, "convex", pieces=PIECES)
    assert "continuous" in optimality(plan)["of"]
    assert np.all(peak_rates(plan.trajectory) <= 5.0)
    assert plan.duration < 4
    assert np.all(plan.u([0.0, plan.duration]) == 0)  # at rest, unless told otherwise
    slow = plan_only(rated.changed({"goal.duration": 400.0}), rest=False)
    assert slow.notes["timing"] == "v1 constant"
    breaks = slow.t[1:-1]
    np.testing.assert_allclose(slow.v(np.nextafter(breaks, 0)), slow.v(breaks), atol=1e-9)


@dataclass(frozen=True)
class RatesTogether(Requirement):
    """du₁/dt + du₂/dt ≤ 5."""

    reads, speed_power = frozenset({"du"}), 2
    parts = (Part("rates together", "rad/s²", -np.inf, 5.0, 5.0),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.du[0] + point.du[1]]


def test_a_limit_on_rates_of_any_kind_makes_v2_continuous(paper: planner.Problem) -> None:
    slow = paper.changed({"goal.duration": 400.0, "goal.travel": 0.829})
    plan = plan_only(replace(slow, registered_limits=(RatesTogether(),)))
    assert "continuous" in optimality(plan)["of"]
    check = planner.verify(plan)
    assert check.ok
    assert check.margins["rates together"] >= 0
    # The fastest clock turns u2 round within microseconds, but does not jump: slowed as a whole.
    free = plan_only(replace(slow, duration=None, registered_limits=(RatesTogether(),)))
    assert "slowed for other limits" in free.notes["timing"]
    check = planner.verify(free)
    assert check.ok
    assert check.margins["rates together"] >= 0


def test_a_path_whose_input_jumps_keeps_no_limit_on_rates(paper: planner.Problem) -> None:
    free = replace(
        paper.changed({"goal.duration": "free", "goal.travel": 0.829}),
        registered_limits=(RatesTogether(),),
    )
    with pytest.raises(planner.NotConvergedError, match="another requirement limits its rate"):
        planner.solve(free, "convex", pieces=PIECES, input="constant")


def two_joints(start: list[float], goal: list[float]) -> planner.Problem:
    return planner.Problem.manipulator(start, goal, K=[1.0], k_g=0.7)


@pytest.mark.parametrize(
    ("start", "goal", "sign"), [([10, 10], [30, 40], 1), ([-10, 40], [-30, 10], -1)]
)
def test_two_joints_are_convex_too(start: list[float], goal: list[float], sign: int) -> None:
    problem = two_joints(start, goal)
    plan = planner.solve(problem, "convex", pieces=PIECES)
    assert optimality(plan)["kind"] == "global"
    assert np.sign(plan.travel) == sign
    # Below the least travel K₂Δφ = Δθ₂ nothing exists; close above it the edge θ₁ = 0 is felt.
    near = planner.solve(problem.changed({"goal.travel": sign * 0.54}), "convex", pieces=PIECES)
    assert optimality(near)["relative_gap"] < 1e-6
    assert near.domain.ok
    with pytest.raises(planner.InfeasibleError, match="between"):
        planner.solve(problem.changed({"goal.travel": sign * 0.52}), "convex")


def test_two_joints_keep_a_joint_limit_globally() -> None:
    problem = two_joints([10, 10], [30, 40]).changed({"goal.travel": 0.85})
    free = plan_only(problem)
    largest = np.rad2deg(free.q(np.linspace(0, 10, 2000))[:, 1].max())
    assert largest > 37
    limited = problem.changed({"limits": {"joint_deg": [36, 80]}})
    kept = planner.solve(limited, "convex", pieces=PIECES)
    assert optimality(kept)["kind"] == "global"
    assert kept.objective > free.objective


def four_joints(seed: int, bumps: bool) -> planner.Problem:
    """A goal reached by a known motion of travel 0.6 (that comes close to the chart's edge)."""
    rng = np.random.default_rng([4, seed, 7])
    start, K = rng.uniform(2, 20, 4), [0.9**i for i in range(3)]
    sizes = rng.uniform(-1, 1, 3) if bumps else np.zeros(3)
    system = planner.Manipulator(K, 0.7)

    def slope(s: float, passive: np.ndarray) -> np.ndarray:
        wave = np.exp(1.5 * sizes @ np.sin(np.arange(1, 4) * np.pi * s))
        theta1 = np.deg2rad(start[0] + 10 * s) * wave
        return 0.6 * system.slopes(np.array([0.0, theta1, *passive]))

    end = solve_ivp(slope, (0, 1), np.deg2rad(start[1:]), rtol=1e-10).y[:, -1]
    goal = [start[0] + 10, *np.rad2deg(end)]
    return planner.Problem.manipulator(start, goal, travel=0.6, K=K, k_g=0.7)


def test_four_joints_inside_the_domain() -> None:
    """The optimum without the domain is the optimum where it stays inside."""
    plan = planner.solve(four_joints(3, bumps=False), "convex", pieces=30)
    assert optimality(plan)["kind"] == "global"
    assert optimality(plan)["relative_gap"] <= 1e-6
    assert plan.domain.ok


@pytest.mark.parametrize("seed", [3, 10])
def test_four_joints_at_the_edge_of_the_domain(seed: int) -> None:
    """The optimum without the domain leaves it, and that domain is not convex."""
    with pytest.raises(planner.NotConvergedError, match="is not convex") as caught:
        planner.solve(four_joints(seed, bumps=True), "convex", pieces=30)
    assert "collocation" in {change.method for change in caught.value.changes}


@pytest.mark.parametrize(
    ("stalled", "words"),
    [
        (1, "at every travel tried at which it was found (24)"),
        (25, "no best path was found at any of 25 travels tried"),
    ],
)
def test_programmes_that_stall_are_not_laid_on_the_domain(
    monkeypatch: pytest.MonkeyPatch, stalled: int, words: str
) -> None:
    solve, calls = method.optimum_by_cuts, count()

    def stall(*given: Any) -> Any:
        if next(calls) < stalled:
            raise StalledError
        return solve(*given)

    monkeypatch.setattr(method, "optimum_by_cuts", stall)
    problem = four_joints(3, bumps=True).changed({"goal.travel": "free"})
    with pytest.raises(planner.NotConvergedError, match=re.escape(words)) as caught:
        planner.solve(problem, "convex", pieces=30)
    assert "method.convex.pieces" in caught.value.ways[0]


@pytest.mark.parametrize("name", ["car", "unicycle", "trailers", "ball-gear"])
def test_other_systems(name: str) -> None:
    """Their domain is no obstacle here, so the unconstrained optimum is the optimum."""
    problem = planner.load_problem(Path(__file__).parents[3] / f"problems/{name}.toml")
    plan = planner.solve(problem, "convex", pieces=16)
    assert plan.verified
    assert optimality(plan)["kind"] == "global"


# -- refusals ------------------------------------------------------------------------------


def test_travel_outside_the_window(wide: planner.Problem) -> None:
    with pytest.raises(planner.InfeasibleError, match=r"0\.78635\d* and 0\.8966"):
        planner.solve(wide.changed({"goal.travel": 0.78}), "convex")


def test_empty_class_has_a_certificate_and_a_way_out(wide: planner.Problem) -> None:
    with pytest.raises(planner.InfeasibleError) as caught:
        planner.solve(wide.changed({"goal.travel": 0.787}), "convex", pieces=PIECES)
    proof = caught.value.certificate
    assert proof is not None
    combined = proof["A"].T @ proof["multipliers"]
    assert np.all(proof["multipliers"] >= 0)
    assert proof["b"] @ proof["multipliers"] + proof["radius"] * np.linalg.norm(combined) < 0
    assert "motions without reversal have travels" in str(caught.value)
    # The travel it advises has a plan.
    travel = next(
        change.keys["goal.travel"]
        for change in caught.value.changes
        if "goal.travel" in change.keys
    )
    assert optimality(plan_only(wide.changed({"goal.travel": travel})))["kind"] == "global"


def test_a_proof_names_the_distance_from_the_edge_that_it_is_about(wide: planner.Problem) -> None:
    ends = {"start.theta_deg": [20, 20, 20], "goal.theta_deg": [20, 30, 30], "limits": {}}
    problem = wide.changed({**ends, "goal.travel": 0.318})
    with pytest.raises(planner.InfeasibleError, match=r"sin\^2\(theta1\) >= 0\.05849 ") as caught:
        solve_and_check(problem, "convex", {"edge": 0.099}, advice=False)  # half the ends' distance
    assert "method.convex.edge" in str(caught.value.advice)
    assert planner.solve(problem, "convex").verified


def test_no_travel_at_all(wide: planner.Problem) -> None:
    """|z₂| ≥ 0.0215 from 0.0217 at the end: every travel tried has a certificate, none a plan."""
    tight = wide.changed(
        {
            "start.theta_deg": [30, 1, 1],
            "goal.theta_deg": [1, 1.5, 30],
            "limits.z2_margin": 0.02,
        }
    )
    with pytest.raises(planner.NotConvergedError, match=r"\d+ of \d+ travels tried are proven"):
        planner.solve(tight, "convex", pieces=PIECES)


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"goal.travel": 0.83, "goal.duration": 3.0}, planner.NotConvergedError, r"takes 3\.3"),
        ({"goal.duration": 2.2}, planner.InfeasibleError, "at most"),
    ],
)
def test_too_short_a_duration_names_one_that_works(
    paper: planner.Problem, changes: dict[str, float], error: type[Exception], says: str
) -> None:
    short = paper.changed(changes)
    with pytest.raises(error, match=says) as caught:
        planner.solve(short, "convex", pieces=PIECES)
    seconds = float(caught.value.advice.split("goal.duration = ")[1].split()[0])  # type: ignore[attr-defined]
    plan = planner.solve(short.changed({"goal.duration": seconds}), "convex", pieces=PIECES)
    assert plan.duration == pytest.approx(seconds, rel=1e-12)


def test_zero_travel_and_crossings_are_sent_elsewhere(wide: planner.Problem) -> None:
    for changes, error, words in (
        ({"goal.travel": 0.0}, planner.InfeasibleError, "travel is 0"),
        ({"goal.theta_deg": [-30, 30, 30]}, planner.SingularError, "theta1 changes sign"),
    ):
        with pytest.raises(error, match=words) as caught:
            planner.solve(wide.changed(changes), "convex")
        assert "collocation" in {change.method for change in caught.value.changes}


def test_unreachable_four_joints_is_not_called_impossible() -> None:
    problem = four_joints(3, bumps=False).changed({"goal.theta_deg": [20.0] * 4})
    with pytest.raises(planner.NoPlanError) as caught:
        planner.solve(problem.changed({"goal.travel": "free"}), "convex", pieces=30)
    assert not isinstance(caught.value, planner.SingularError)


def test_options_are_checked(wide: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match="pieces"):
        planner.solve(wide, "convex", pieces=5)
    with pytest.raises(planner.InputError, match="objective"):
        planner.solve(wide, "convex", objective="least")
    with pytest.raises(planner.InputError, match="rest = true needs limits on the inputs' rates"):
        planner.solve(wide, "convex", rest=True)
    with pytest.raises(planner.InputError, match="no limit of input u1"):
        planner.solve(wide.changed({"goal.duration": "free"}), "convex", pieces=PIECES)


# -- the plan as a record --------------------------------------------------------------------


def test_nothing_is_said_on_standard_output(
    wide: planner.Problem, capfd: pytest.CaptureFixture[str]
) -> None:
    plan_only(wide.changed({"goal.travel": 0.84}), pieces=30)
    assert "".join(capfd.readouterr()) == ""


def test_middle_of_the_travels(wide: planner.Problem) -> None:
    plan = plan_only(wide, travel="middle")
    window = planner.travel_window(wide)
    assert window is not None
    assert plan.travel == pytest.approx((window.low + window.high) / 2, abs=0.01)


def test_same_problem_same_plan(paper: planner.Problem) -> None:
    problem = paper.changed({"goal.travel": 0.82})
    a, b = plan_only(problem), plan_only(problem)
    assert np.array_equal(a.z(np.linspace(0, 10, 50)), b.z(np.linspace(0, 10, 50)))
