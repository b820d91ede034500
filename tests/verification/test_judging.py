"""The judge against another integrator, and against plans that are made to fool it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from every_system import SYSTEMS
from outside import integrate
from scipy.interpolate import BPoly
from scipy.special import comb

import planner
from planner.plan import quadrature
from planner.plan.curves import Pieces
from planner.plan.measures import peak_inputs, peak_rates
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import StateTrajectory, Trajectory
from planner.support.calculus.bernstein import elevate

Array = np.ndarray

PROBLEMS = Path(__file__).parents[2] / "problems"
SPEED = {"input_rad_s": [0.5, 0.4]}
RATES = {"input_rad_s": [0.5, 0.4], "input_rate_rad_s2": [3.0, 2.0]}


def _law(paper: planner.Problem, method: str) -> planner.Plan:
    limits = {"input_rad_s": 1e3, "joint_deg": 89, "z2_margin": 1e-3}
    return planner.solve(paper.changed({"limits": limits, "goal.travel": 0.8112}), method)


MADE: dict[str, Callable[[planner.Problem], planner.Plan]] = {
    "collocation": lambda paper: planner.solve(paper),
    "polynomial": lambda paper: _law(paper, "polynomial"),
    "piecewise": lambda paper: _law(paper, "piecewise"),
    "convex": lambda paper: planner.solve(
        paper.changed({"limits": {"joint_deg": 80}, "goal.travel": 0.82}), "convex", pieces=10
    ),
    "sinusoid": lambda paper: planner.solve(
        paper.changed({"goal.travel": 0.8546247}), "sinusoid", amplitude=0.0403786
    ),
    "sinusoid_steps": lambda paper: planner.solve(
        paper.changed({"limits": {}, "goal.travel": 0.761506}), "sinusoid_steps"
    ),
    "desensitised": lambda paper: planner.solve(paper, "desensitised", starts=1, intervals=20),
    "retimed, a law in the chart": lambda paper: planner.retime(_law(paper, "polynomial"), SPEED),
    "retimed, inputs limited": lambda paper: planner.retime(planner.solve(paper), SPEED),
    "retimed, rates limited": lambda paper: planner.retime(
        planner.solve(paper), RATES, rest=True, intervals=40
    ),
    "waypoint": lambda _: planner.solve(planner.load_problem(PROBLEMS / "waypoint.toml")),
    "obstacle": lambda paper: planner.solve(
        paper.changed(
            {
                "system.link_lengths": [1.0, 1.0, 1.0],
                "obstacles": [{"centre_m": [0.0, 2.0], "radius_m": 0.2}],
            }
        ),
        intervals=20,
        starts=1,
    ),
}


@pytest.mark.parametrize("name", MADE)
def test_every_method_as_another_integrator_sees_it(paper: planner.Problem, name: str) -> None:
    """End, margins of joints and of z2, and peak inputs; 3e-11 is the rounding in a law's u."""
    plan = MADE[name](paper)
    check = planner.verify(plan)
    assert check.ok
    assert 0 < check.integration_error < 1e-10
    motion, times = integrate(plan)
    q, system = motion(times), plan.problem.system
    end = q[-1] - plan.problem.goal
    np.testing.assert_allclose(check.terminal_error[1:], end[1:], rtol=0, atol=2e-10)
    for i, limit in enumerate(plan.problem.limits.joint):
        if np.isfinite(limit):
            least = limit - np.max(np.abs(q[:, i]))
            assert check.margins[f"joint {system.coordinates[i].name}"] <= least + 1e-9
            assert check.margins[f"joint {system.coordinates[i].name}"] >= least - 1e-5
    if plan.problem.limits.z2_margin is not None:
        z2 = plan.problem.z2_sign * planner.chained_form(system).z(q)[:, 1]
        least = np.min(z2) - plan.problem.limits.z2_margin
        assert least - 1e-5 <= check.margins["z2 margin"] <= least + 1e-9
    for disc in plan.problem.obstacles:
        clear = disc.clearances(system.arm_points(q[:, 1:]))  # type: ignore[attr-defined]
        for part, least in zip(disc.parts, np.min(clear, axis=0), strict=True):
            margin = check.margins[part.label]
            assert least - 1e-5 <= margin <= least + 1e-9
    for point in plan.problem.waypoints:
        least = np.min(point.distance(q))
        assert -least - 1e-9 <= check.margins[point.parts[0].label] <= 0
    sampled = np.max(np.abs(plan.u(times)), axis=0)
    peaks = plan.peak_u
    assert np.all(peaks >= sampled * (1 - 1e-10))
    np.testing.assert_allclose(peaks, sampled, rtol=1e-4)


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_every_system_as_another_integrator_sees_it(name: str) -> None:
    """Two pieces of polynomial inputs, from a claimed motion that is nowhere near."""
    system, rng = SYSTEMS[name], np.random.default_rng(3)
    breaks, start = [0.0, 1.0, 2.5], rng.uniform(0.1, 0.4, SYSTEMS[name].size)
    u = BPoly(rng.uniform(-0.6, 0.6, (4, 2, 2)), breaks)
    q = BPoly(np.broadcast_to(start, (2, 2, system.size)).copy(), breaks)
    plan = _bare(StateTrajectory(system, q, u), start)
    motion = quadrature.integrate(plan.trajectory, start)
    outside, times = integrate(plan)
    off = np.max(np.abs(motion.q[-1, -1] - outside(times[-1:])[0]))
    assert off <= max(motion.error, 1e-12)
    for t in times[::397]:  # between its steps DOP853 is of lower order than at them
        np.testing.assert_allclose(motion.q_at_time(t), outside(t)[0], rtol=0, atol=1e-10)
    assert motion.error < 1e-7
    assert motion.gap[0] == pytest.approx(np.max(np.abs(outside(times) - start)), rel=1e-2)


def _bare(trajectory: Trajectory, start: Array) -> planner.Plan:
    """A plan without a problem file, as far as integrating it goes."""

    problem = SimpleNamespace(system=trajectory.system, start=start)
    return planner.Plan(problem, "by hand", {}, trajectory)  # type: ignore[arg-type]


# -- the error estimate and the extremes -------------------------------------------------------


@dataclass(frozen=True, repr=False)
class _Shaped(StateTrajectory):
    """Inputs that no polynomial is: u1 a shape of the fraction of the piece, u2 = 0.1."""

    kind = "shaped"
    shape: Callable[[Array], Array] = np.sqrt

    def u(self, t: object) -> Array:
        x = np.asarray(t, dtype=float) / self.duration
        return np.stack([self.shape(x), 0.1 + 0 * x], axis=-1)

    def piece_values(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        q, _ = super().piece_values(piece, fraction)
        return q, self.u(fraction * self.duration)


def _shaped(paper: planner.Problem, shape: Callable[[Array], Array]) -> _Shaped:
    q = BPoly(np.broadcast_to(paper.start, (1, 1, 4)).copy(), [0.0, 10.0])
    u = BPoly(np.zeros((1, 1, 2)), [0.0, 10.0])
    return _Shaped(paper.system, q, u, shape)


def test_an_input_that_starts_like_a_root_is_resolved(paper: planner.Problem) -> None:
    """Its slope is infinite at the start, where a coarse cell would read a peak that is not one."""
    trajectory = _shaped(paper, lambda x: 0.2 - 0.1 * np.sqrt(x))
    motion = quadrature.integrate(trajectory, paper.start)
    end = integrate(_bare(trajectory, paper.start), rtol=1e-12)[0](np.array([10.0]))[0]
    assert motion.error < 1e-9
    np.testing.assert_allclose(motion.q[-1, -1], end, rtol=0, atol=1e-9)
    assert peak_inputs(trajectory)[0] == pytest.approx(0.2, rel=1e-9)
    assert peak_rates(trajectory)[0] > 1e3


def test_a_step_inside_a_piece_is_resolved(paper: planner.Problem) -> None:
    trajectory = _shaped(paper, lambda x: np.where(x < 1 / 3, 0.2, -0.1))
    motion = quadrature.integrate(trajectory, paper.start)
    pieces = StateTrajectory(
        paper.system,
        BPoly(np.broadcast_to(paper.start, (1, 2, 4)).copy(), [0.0, 10 / 3, 10.0]),
        BPoly(np.array([[[0.2, 0.1], [-0.1, 0.1]]]), [0.0, 10 / 3, 10.0]),
    )
    exact = quadrature.integrate(pieces, paper.start)
    assert motion.error < 1e-9
    np.testing.assert_allclose(motion.q[-1, -1], exact.q[-1, -1], rtol=0, atol=1e-9)
    assert peak_rates(trajectory)[0] > 1e9
    assert np.isinf(peak_rates(pieces)[0])


def test_what_cannot_be_integrated_is_refused(paper: planner.Problem) -> None:
    """An input of pure noise: no cell is fine enough, and the verdict says so first."""
    rng = np.random.default_rng(5)
    noisy = _shaped(paper, lambda x: 0.1 + rng.uniform(-1e-5, 1e-5, np.shape(x)))
    check = planner.verify(planner.Plan(paper, "by hand", {}, noisy))
    assert check.integration_error > 1e-7
    assert "cannot be trusted" in check.violations[0].label
    assert not check.ok


def test_an_input_is_judged_by_its_highest_top_wherever_that_is(paper: planner.Problem) -> None:
    """Parabolas on four pieces, the highest one's samples lowest: 6e-4 of the limit lie between."""
    grid = (1 - np.cos(np.pi * np.arange(33) / 32)) / 2
    tops = np.array([grid[16], grid[16], grid[16], (grid[16] + grid[17]) / 2])
    heights = np.array([0.2, 0.2, 0.2, 0.2002])
    low = heights - tops**2
    u2 = np.stack([low, low + tops, low + 2 * tops - 1])  # Bernstein form of heights − (x − tops)²
    breaks = np.arange(5.0)
    u = BPoly(np.stack([0 * u2, u2], axis=-1), breaks)
    q = BPoly(np.broadcast_to(paper.start, (1, 4, 4)).copy(), breaks)
    tight = paper.changed({"limits": {"input_rad_s": [0.5, 0.2001]}, "goal.duration": 4.0})
    check = planner.verify(planner.Plan(tight, "by hand", {}, StateTrajectory(paper.system, q, u)))
    assert u(3 + grid)[:, 1].max() < 0.1999
    assert check.margins["input u2"] == pytest.approx(-1e-4, abs=1e-12)
    (broken,) = (v for v in check.violations if v.label == "input u2")
    assert broken.value == pytest.approx(0.2002, abs=1e-12)


def test_peak_rate_at_a_singular_start(unlimited: planner.Problem) -> None:
    """The law's steepest instant is its first; there du/dt follows from its two derivatives."""
    plan = planner.solve(unlimited.changed({"goal.travel": 0.803}), "polynomial")
    h = 1e-9
    fine = plan.u(h * np.arange(5.0))
    exact = np.abs(fine[:5].T @ np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12 / h)
    found = peak_rates(plan.trajectory)
    assert exact[1] > 1e5
    assert found[1] == pytest.approx(exact[1], rel=1e-4)


def test_reading_by_piece_is_reading_by_time(paper: planner.Problem) -> None:
    for plan in (
        planner.solve(paper),
        _law(paper, "polynomial"),
        planner.retime(_law(paper, "polynomial"), SPEED),
    ):
        count = len(plan.t) - 1
        piece = np.arange(count)
        fraction = np.random.default_rng(0).uniform(0.01, 0.99, (7, count))
        times = plan.t[:-1] + fraction * np.diff(plan.t)
        q, u = plan.trajectory.piece_values(piece, fraction)
        np.testing.assert_allclose(q, plan.q(times), rtol=0, atol=1e-10)
        np.testing.assert_allclose(u, plan.u(times), rtol=1e-8, atol=1e-10)


# -- plans that are made to fool it --------------------------------------------------------------


def test_a_clock_of_one_piece_over_a_path_of_many(paper: planner.Problem) -> None:
    """Inputs of the path jump inside the clock's only piece, above the limit in one short part."""
    plan = planner.solve(paper, input="constant")
    path = plan.trajectory
    ends = np.array([0.0, plan.duration])
    line = BPoly(ends[:, None], ends)
    peak = peak_inputs(path)
    trajectory = RetimedTrajectory(path, line, line, ends)
    np.testing.assert_allclose(peak_inputs(trajectory), peak, rtol=0.2)
    assert np.all(peak_inputs(trajectory) >= peak * (1 - 1e-9))
    tight = paper.changed({"limits.input_rad_s": (peak * 0.99).tolist()})
    check = planner.verify(planner.Plan(tight, "by hand", {}, trajectory))
    judged = "plan's u(t) against the verification's series"  # none follows a jump inside a piece
    assert {v.label for v in check.violations} == {"input u1", "input u2", judged}


def test_a_microsecond_between_the_points_it_is_read_at(paper: planner.Problem) -> None:
    """At first u2 is 0.9 rad/s for part of a microsecond, which moves nothing, and zero at the 16
    points of the piece."""
    plan = planner.solve(paper)
    path = plan.trajectory
    assert isinstance(path, StateTrajectory)
    order, x = np.arange(17), (1 - np.cos(np.pi * np.arange(17) / 16)) / 2
    points = (1 - np.cos(np.pi * np.arange(16) / 15)) / 2
    basis = comb(16, order) * x[:, None] ** order * (1 - x[:, None]) ** (16 - order)
    wiggle = np.linalg.solve(basis, np.prod(x[:, None] - points, axis=1))
    first = np.zeros((17, 1, 2))
    first[:, 0, 1] = 0.9 * wiggle / np.max(basis @ wiggle)
    breaks = np.append(0.0, path.breaks + 1e-6)
    still = np.repeat(paper.start[None, None], len(path.q_curve.c), 0)
    trajectory = StateTrajectory(
        paper.system,
        BPoly(np.concatenate([still, path.q_curve.c], axis=1), breaks),
        BPoly(np.concatenate([first, elevate(path.u_curve.c, 16)], axis=1), breaks),
    )
    later = paper.changed({"goal.duration": paper.duration + 1e-6})
    check = planner.verify(replace(plan, problem=later, trajectory=trajectory))
    assert [v.label for v in check.violations] == ["input u2"]
    assert check.violations[0].value > 0.9 * (1 - 1e-9)
    inputs = trajectory.u_curve.c.copy()
    inputs[:, 0] = 0
    calm = replace(trajectory, u_curve=BPoly(inputs, breaks))
    assert planner.verify(replace(plan, problem=later, trajectory=calm)).ok


def test_inputs_that_are_no_numbers_have_no_peak(optimal: planner.Plan) -> None:
    path = optimal.trajectory
    assert isinstance(path, StateTrajectory)
    for place in (slice(None), (0, 3)):
        c = path.u_curve.c.copy()
        c[place] = np.nan
        broken = replace(path, u_curve=BPoly(c, path.u_curve.x))
        assert np.any(np.isnan(peak_inputs(broken)))
        check = planner.verify(replace(optimal, trajectory=broken))
        assert not check.ok
        assert not check.integration_error < 1e-10


def test_times_that_run_back_or_begin_late(paper: planner.Problem) -> None:
    plan = planner.solve(paper)
    path = plan.trajectory
    assert isinstance(path, StateTrajectory)
    endless = np.append(path.breaks[:-1], np.inf)
    for x in (path.breaks[::-1].copy(), path.breaks + 1.0, -path.breaks, endless):
        curves = BPoly(path.q_curve.c, x), BPoly(path.u_curve.c, x)
        with pytest.raises(ValueError, match="must increase from 0"):
            StateTrajectory(path.system, *curves)
        # What is made by other means is judged all the same.
        forged = object.__new__(StateTrajectory)
        names = ("system", "q_curve", "u_curve")
        vars(forged).update(zip(names, (path.system, *curves), strict=True))
        check = planner.verify(replace(plan, trajectory=forged))
        assert not check.ok
        assert "begin at 0 and increase" in str(check.violations[0])


def test_no_polynomial_has_more_terms_than_are_read(paper: planner.Problem) -> None:
    curves = [BPoly(np.zeros((n, 1, k)), [0.0, 1.0]) for n, k in ((52, 4), (2, 2), (51, 4))]
    with pytest.raises(ValueError, match="q_curve has degree 51; at most 50 is allowed"):
        StateTrajectory(paper.system, *curves[:2])
    assert StateTrajectory(paper.system, *curves[:0:-1]).degree == 50
