"""From a plan to its certificate."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from planner.plan.claims import Certificate, Claim
from planner.plan.plan import Plan, expect_plan
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory, Trajectory
from planner.support.arrays import Array
from planner.support.one_variable import sample_times
from planner.verification import requirements_proven
from planner.verification import requirements_proven as need
from planner.verification.enclosure import Motion, strayed
from planner.verification.functions import UnboundedError, on, polynomials, refined
from planner.verification.input_models import Source, inverse_of, resolve, source_of
from planner.verification.models import POINTS, Model, evaluation, least

STANDSTILL = "the inputs of a retimed path are quotients of zeros where the path stands still"

REFINING = 1e-13
"""What rounding does to a path's inputs written on more pieces, relative to them."""


def certify(plan: Plan) -> Certificate:
    """Prove, over each whole interval, what `verify` checks.

    Where `verify` integrates and samples, this bounds: the true motion under the plan's input is
    enclosed on every subinterval (a polynomial and a proven radius), and the limits of inputs and
    their rates, joints, z₂, the chart's domain, the goal and the distance from the plan's own q(t)
    are decided from the enclosure, with bounds on rounding included.

    Args:
        plan: Any plan, verified or not.

    Returns:
        One claim per requirement: proven with a guaranteed margin, violated with a time, or
        undecided with the reason. It raises no errors: what cannot be bounded is undecided.
    """
    expect_plan(plan)
    began = time.perf_counter()
    with np.errstate(all="ignore"):
        claims, error, cells = _claims(plan)
    names = [c.name for c in plan.problem.system.coordinates]
    bounds = dict(zip(names, error.tolist(), strict=True))
    return Certificate(tuple(claims), bounds, cells, time.perf_counter() - began)


def _claims(plan: Plan) -> tuple[list[Claim], Array, int]:
    problem, trajectory = plan.problem, plan.trajectory
    in_chart = not trajectory.in_coordinates
    nothing = np.full(problem.system.size, np.inf)
    if why := _unfit(plan):
        return need.unknown(problem, why, in_chart), nothing, 0
    if not plan.executable:
        return _outside(plan), nothing, 0
    try:
        path = _path(trajectory)
        source = source_of(path)
        motion = resolve(source, problem.start)
        if path is not trajectory:
            motion = strayed(problem.system, motion, _left_out(trajectory, motion))
        own = _own(path, motion)
    except UnboundedError as error:
        return need.unknown(problem, f"nothing bounds {error}", in_chart), nothing, 0
    claims = _drives(plan, source, motion)
    wanted, unbounded = need.shaped(problem, motion, q=motion.q)
    claims += unbounded
    wanted = need.plain(problem, "q", motion.states) + wanted
    inside, unbounded = need.domain(problem, motion, in_chart)
    claims += unbounded
    found = [
        *need.decide(wanted + inside, motion.cells),
        *requirements_proven.obstacles(problem, motion),
        *requirements_proven.links_apart(problem, motion),
        *requirements_proven.waypoints(problem, motion, lambda t: _own_time(trajectory, t)),
    ]
    claims += _on_clock(found, trajectory)
    claims += need.goal(problem, motion)
    claims += need.duration(problem, plan.duration)
    claims += need.interpolant(problem, motion, own)
    claims += need.unsaid(problem, claims)
    gaps = [(a - b).size for a, b in zip(own, motion.states, strict=True)]
    return claims, np.array([float(np.max(gap)) for gap in gaps]), len(motion.cells.piece)


def _unfit(plan: Plan) -> str:
    """Why nothing can be said of a trajectory; empty where the proofs have what they rest on."""
    if plan.trajectory.flaw:
        return plan.trajectory.flaw
    if plan.trajectory.system != plan.problem.system:
        return "the trajectory belongs to another system than the problem"
    return ""


def _path(trajectory: Trajectory) -> Trajectory:
    """What moves: no state depends on its timing. A retimed path comes on the length's pieces."""
    if type(trajectory) is not RetimedTrajectory:
        return trajectory
    path, breaks = trajectory.path, trajectory.length.x
    if type(path) is StateTrajectory:
        return replace(
            path, q_curve=refined(path.q_curve, breaks), u_curve=refined(path.u_curve, breaks)
        )
    if type(path) is ChainedTrajectory:
        return replace(
            path, z_curve=refined(path.z_curve, breaks), v_curve=refined(path.v_curve, breaks)
        )
    twice = isinstance(path, RetimedTrajectory)
    raise UnboundedError("a path that is retimed twice" if twice else f"kind '{path.kind}'")


def _left_out(trajectory: Trajectory, motion: Motion) -> Array:
    """How much of the path's inputs a retimed motion may leave out, shape (2,).

    The clock runs along the length, and so skips any stretch of the path over which the length does
    not grow. With |u| ≤ M length' + η everywhere, the inputs skipped add up to at most η times the
    stretch; M may be anything, and η is what the choice of M leaves over.
    """
    assert isinstance(trajectory, RetimedTrajectory)
    (rate,) = polynomials(trajectory.length, motion.cells, 1)
    pace, out = rate.c @ evaluation(rate.c.shape[1]).T, []
    mean = trajectory.length.c[-1, -1] / trajectory.length.x[-1]
    for ball, model in zip(motion.u, motion.models(*motion.u), strict=True):
        size = np.abs(ball.c[:, :POINTS])
        steep = float(np.max(size / pace, where=pace > 1e-3 * mean, initial=0.0))
        bound = rate.scaled(np.full(len(pace), 2 * steep))
        scale = np.full(2, max(float(np.mean(size)), 1e-12))
        both = [(1.0, bound + model, 0.0), (1.0, bound - model, 0.0)]
        found = least(both, motion.cells, scale)
        left = np.max([0.0, *(-x.guaranteed for x in found)])  # not a number stays one
        eta = float(left) + REFINING * float(np.max(size))
        out.append(eta if eta >= 0 else np.inf)
    return np.array(out)


def _own(path: Trajectory, motion: Motion) -> list[Model]:
    """The plan's own coordinates as models."""
    if isinstance(path, StateTrajectory):
        return polynomials(path.q_curve, motion.cells)
    assert isinstance(path, ChainedTrajectory)
    state = inverse_of(path.system, tuple(path.branch.tolist()))
    return motion.models(*state(on(path.z_curve, motion.cells)))


def _drives(plan: Plan, source: Source, motion: Motion) -> list[Claim]:
    """What is proven of the inputs and their rates, in time."""
    problem = plan.problem
    asked = [r for r in problem.requirements if r.reads & {"u", "du"}]
    if not asked:
        return []
    retimed = plan.trajectory is not source.trajectory
    if retimed:
        try:
            source = source_of(plan.trajectory)
        except UnboundedError as error:
            every = need.unknown(problem, f"nothing bounds {error}", False)
            labels = {part.label for required in asked for part in required.parts}
            return [c for c in every if c.label in labels]
        motion = resolve(source)
    cells, u = motion.cells, motion.models(*motion.u)
    wanted, unbounded = need.shaped(
        problem, motion, u=motion.u, **({} if retimed else {"q": motion.q})
    )
    wanted = need.plain(problem, "u", u) + wanted
    jumps: dict[str, Claim] = {}
    if any("du" in required.reads for required in asked):
        wanted += need.plain(problem, "du", motion.models(*source.slopes(cells)))
        jumps = need.jumps(problem, u, cells)
    why = STANDSTILL if isinstance(plan.trajectory, RetimedTrajectory) else need.UNBOUNDED
    return [jumps.get(c.label, c) for c in need.decide(wanted, cells, why)] + unbounded


def _own_time(trajectory: Trajectory, time: float) -> tuple[float, float]:
    """The path's own time at a time of the plan, and how far off it may be."""
    if not 0 <= time <= trajectory.duration:
        return time, np.inf
    if not isinstance(trajectory, RetimedTrajectory):
        return time, 0.0
    length, s, own = trajectory.length, trajectory.clock(time), float(trajectory.place(time))
    off = 1e-9 * length.x[-1]
    low, high = max(own - off, 0.0), min(own + off, length.x[-1])
    return own, off if length(low) <= s <= length(high) else np.inf


def _on_clock(claims: list[Claim], trajectory: Trajectory) -> list[Claim]:
    """Claims in a path's own time, with their times in that of the plan (to reading accuracy)."""
    if not isinstance(trajectory, RetimedTrajectory):
        return claims
    times = sample_times(trajectory.breaks)
    own = trajectory.place(times)
    return [
        replace(c, time_s=None if c.time_s is None else float(np.interp(c.time_s, own, times)))
        for c in claims
    ]


def _outside(plan: Plan) -> list[Claim]:
    """A path that leaves the chart's domain: one sample outside proves it; the rest is unknown."""
    report = plan.domain
    (part,) = plan.problem.chart.parts
    broken = Claim(part.label, "violated", -np.inf, report.margin, report.time_s, part.unit)
    why = "the path leaves the chart's domain, where no real coordinates exist"
    rest = need.unknown(plan.problem, why, False)
    return [broken, *rest]
