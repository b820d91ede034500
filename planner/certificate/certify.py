"""From a plan to its certificate."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from planner.certificate import places
from planner.certificate import requirements as need
from planner.certificate.cells import polynomials
from planner.certificate.evaluate import UnboundedError
from planner.certificate.motion import Motion, enclose
from planner.certificate.sources import Source, inverse_of, resolve, source_of
from planner.claims import Certificate, Claim, undecided
from planner.extrema import sample_times
from planner.plan import Plan
from planner.retimed import RetimedTrajectory
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory, StateTrajectory, Trajectory

STANDSTILL = "the inputs of a retimed path are quotients of zeros where the path stands still"


def certify(plan: Plan) -> Certificate:
    """Prove, over each whole interval, what `verify` checks.

    Where `verify` integrates and samples, this bounds: the true motion under the plan's input is
    enclosed on every subinterval (a polynomial and a proven radius), and the limits of inputs and
    their rates, joints, z₂, the chart's domain and the goal are decided from the enclosure, with
    bounds on rounding included.

    Args:
        plan: Any plan, verified or not.

    Returns:
        One claim a requirement: proven with a guaranteed margin, violated with a time, or
        undecided with the reason. Nothing is raised: what cannot be bounded is undecided.
    """
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
    if not plan.executable:
        return _outside(plan), nothing, 0
    path = _innermost(trajectory)
    try:
        source = source_of(path)
        cells, u, guess = resolve(source)
        motion = enclose(problem.system, cells, guess, u, problem.start)
    except UnboundedError as error:
        return need.unknown(problem, f"nothing bounds {error}", in_chart), nothing, 0
    claims = _drives(plan, source, motion)
    wanted = need.joints(problem, motion)
    for label, required, ask in (
        ("z2 margin", True, need.z2),
        ("chart domain", in_chart, need.domain),
    ):
        try:
            wanted += ask(problem, motion, required)
        except UnboundedError as error:
            claims.append(undecided(label, "", f"nothing bounds {error}", required))
    found = [
        *need.decide(wanted, cells),
        *places.obstacles(problem, motion),
        *places.waypoints(problem, motion, lambda t: _own_time(trajectory, t)),
    ]
    claims += [_on_clock(c, trajectory) for c in found]
    claims += need.goal(problem, motion)
    return claims, _motion_error(path, motion), len(cells.piece)


def _drives(plan: Plan, source: Source, motion: Motion) -> list[Claim]:
    """What is proven of the inputs and their rates, in time."""
    problem, cells, u = plan.problem, motion.cells, motion.u
    limits = problem.limits
    if not np.any(np.isfinite([limits.input, limits.input_rate])):
        return []
    if plan.trajectory is not source.trajectory:
        try:
            source = source_of(plan.trajectory)
        except UnboundedError as error:
            every = need.unknown(problem, f"nothing bounds {error}", False)
            return [c for c in every if "input" in c.label]
        cells, u, _ = resolve(source)
    wanted = need.inputs(problem, u)
    jumps: dict[str, Claim] = {}
    if np.any(np.isfinite(limits.input_rate)):
        wanted += need.rates(problem, source.slopes(cells))
        jumps = need.jumps(problem, u, cells)
    why = STANDSTILL if isinstance(plan.trajectory, RetimedTrajectory) else need.UNBOUNDED
    return [jumps.get(c.label, c) for c in need.decide(wanted, cells, why)]


def _innermost(trajectory: Trajectory) -> Trajectory:
    """The path itself: no state depends on its timing."""
    while isinstance(trajectory, RetimedTrajectory):
        trajectory = trajectory.path
    return trajectory


def _own_time(trajectory: Trajectory, time: float) -> float:
    """The innermost path's own time at a time of the plan."""
    while isinstance(trajectory, RetimedTrajectory):
        time, trajectory = float(trajectory.place(time)), trajectory.path
    return time


def _on_clock(claim: Claim, trajectory: Trajectory) -> Claim:
    """A claim in a path's own time, with its time in that of the plan (to reading accuracy)."""
    if claim.time_s is None or not isinstance(trajectory, RetimedTrajectory):
        return claim
    inner = _on_clock(claim, trajectory.path)
    times = sample_times(trajectory.breaks)
    own = trajectory.place(times)
    return replace(inner, time_s=float(np.interp(inner.time_s or 0.0, own, times)))


def _outside(plan: Plan) -> list[Claim]:
    """A path that leaves the chart's domain: one sample outside proves it; the rest is unknown."""
    report = plan.domain
    broken = Claim("chart domain", "violated", -np.inf, report.margin, report.time_s, "")
    why = "the path leaves the chart's domain, where no real coordinates exist"
    rest = need.unknown(plan.problem, why, False)
    return [broken, *rest]


def _motion_error(path: Trajectory, motion: Motion) -> Array:
    """Bound on |plan.q(t) − true motion|, shape (N,)."""
    cells = motion.cells
    if isinstance(path, StateTrajectory):
        own = polynomials(path.q_curve, cells)
    elif isinstance(path, ChainedTrajectory):
        state = inverse_of(path.system, tuple(path.branch.tolist()))
        own = state(polynomials(path.z_curve, cells))
    else:
        return np.full(len(motion.p), np.inf)
    gaps = [(a - b).size for a, b in zip(own, motion.states, strict=True)]
    return np.array([float(np.max(gap)) for gap in gaps])
