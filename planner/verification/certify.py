"""Certify a plan: prove each requirement over whole intervals.

`prove`, dispatched on the kind of requirement, states functions of the enclosed true motion that
must be at least zero. Then `decide` bounds the least values of all these functions together. A
requirement of a kind without a proof is undecided.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, singledispatch

import casadi as ca
import numpy as np

from planner.plan.claims import Certificate, Claim, undecided_claim
from planner.plan.plan import Plan, expect_plan
from planner.plan.quadrature import JUMP_TOLERANCE
from planner.plan.retimed import RetimedTrajectory
from planner.problem.requirements.ends import Duration, Goal, LongestDuration, Start
from planner.problem.requirements.motion_limits import ChartDomain
from planner.problem.requirements.places import Obstacle, Waypoint
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.problem.requirements.self_collision import SelfCollision
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem
from planner.verification.balls import Ball
from planner.verification.enclosure import Enclosure
from planner.verification.evidence import EnclosedMotion, Evidence, Obligation, Proof, decide
from planner.verification.functions import Expression, UnboundedError
from planner.verification.input_models import enclose_trajectory, resolve, source_of
from planner.verification.models import Index, Margin, Model, evaluation
from planner.verification.place_proofs import (
    clearances,
    distance_bounds,
    joints,
    nearest_time,
    path_time,
    user_models,
)
from planner.verification.verify import GOAL_TOLERANCE, INTERPOLANT_TOLERANCE, LIMIT_TOLERANCE

DURATION_TOLERANCE = 1e-9
"""Largest relative error of a given duration, the same as in `verify`."""

SUBSTITUTE_GAP = 1e-6
"""Largest difference, as a fraction of the part's scale, at which a requirement's `rows`, which the
proof bounds, and its `values`, which `verify` samples, count as the same function. If they differ
more, as u²/limit from |u|, the rows prove only whether the limit is kept, not by how much."""

PLAN_DEVIATION = Part("plan's q(t) against its integrated input", "", -np.inf, 0.0, 1.0)
"""Requirement that the plan's q(t) is near the true motion, with the same label as in `verify`."""

NO_PROOF_ON_MACHINE = "nothing is proven about the emulated machine, on which the inputs act"


def certify(plan: Plan) -> Certificate:
    """Prove, over each whole interval, what `verify` checks.

    `verify` integrates and samples; this function computes bounds. It encloses the true motion
    under the plan's input on every subinterval (by a polynomial and a proven radius) and decides
    from the enclosure, bounds on rounding included, the limits of inputs and their rates, joints,
    z₂, the chart's domain, the goal and the distance from the plan's own q(t). For a compensated
    plan, whose motion is that of an emulated machine, it decides only inputs and duration.

    Args:
        plan: Any plan, verified or not.

    Returns:
        One claim per requirement: proven with a guaranteed margin, violated with a time, or
        undecided with the reason. A quantity without a bound makes its claim undecided and raises
        no error.
    """
    expect_plan(plan)
    if other := plan.backwards:
        return certify(other).turned(plan.duration)
    began = time.perf_counter()
    with np.errstate(all="ignore"):
        claims, error, cells, edges = _claims(plan)
    names = [c.name for c in plan.problem.system.coordinates]
    bounds = dict(zip(names, error.tolist(), strict=True))
    return Certificate(tuple(claims), bounds, cells, time.perf_counter() - began, edges)


def _evidence(plan: Plan) -> Evidence:
    """Return the enclosed motion of a plan.

    Raises:
        UnboundedError: If the motion cannot be bounded.
    """
    trajectory = plan.trajectory
    source, motion, plan_q = enclose_trajectory(trajectory, plan.problem.start)
    path = EnclosedMotion(motion, source)
    if isinstance(trajectory, RetimedTrajectory):
        path = EnclosedMotion(motion, source, frozenset("q"), trajectory)
    return Evidence(plan, path, plan_q)


def _claims(plan: Plan) -> tuple[list[Claim], Array, int, Array]:
    """Return the contents of a plan's certificate.

    Returns:
        The claims, bounds (N,) on the error of the plan's q(t), the number of cells on which the
        motion is enclosed, and the ends of all cells of the proofs, s.
    """
    problem, trajectory = plan.problem, plan.trajectory
    nothing = np.full(problem.system.size, np.inf), 0, np.empty(0)
    why = trajectory.flaw or (plan.clock.flaw if plan.compensation is not None else "")
    if not why and trajectory.system != problem.system:
        why = "the trajectory belongs to another system than the problem"
    if not why and not plan.executable:  # proven by one sample outside
        report, (part,) = plan.domain, problem.chart.parts
        violation = Claim(part.label, "violated", -np.inf, report.margin, report.time_s, part.unit)
        why = "the path leaves the chart's domain, where no real coordinates exist"
        others = [each for each in problem.demands if not each.in_chart]
        return [violation, *_open_plan_claims(plan, why, others)], *nothing
    if why:
        return _open_plan_claims(plan, why), *nothing
    if plan.compensation is not None:
        count = len(trajectory.breaks) - 1
        return _claims_on_inputs(plan, NO_PROOF_ON_MACHINE), nothing[0], count, nothing[2]
    try:
        evidence = _evidence(plan)
    except UnboundedError as error:
        return _claims_on_inputs(plan, f"there is no bound for {error}"), *nothing
    proofs = [each for demand in problem.demands for each in prove(demand, evidence)]
    claims, path, plan_q = decide(proofs), evidence.path, evidence.plan_q
    gaps = [a - b for a, b in zip(plan_q, path.enclosure.states, strict=True)]
    most = np.array([np.max(gap.size) for gap in gaps])
    end, slip = np.array([gap.at_end() for gap in gaps]).swapaxes(0, 1)
    reached = np.max(np.nan_to_num(np.abs(end) - slip, nan=-np.inf), initial=0.0)
    low, high = INTERPOLANT_TOLERANCE - float(np.max(most)), INTERPOLANT_TOLERANCE - float(reached)
    claims.append(path.claim(PLAN_DEVIATION, 0.0, low, high, np.nan))
    motions = [path, *(each.motion for each in proofs if isinstance(each, Obligation))]
    edges = np.unique(np.concatenate([m.edges for m in {id(m): m for m in motions}.values()]))
    return claims, most, len(path.enclosure.cells.piece), edges


def _claims_on_inputs(plan: Plan, why: str) -> list[Claim]:
    """Return the claims on a plan whose motion has no bound: only inputs and duration are decided.

    All other claims are undecided, for the reason `why`.
    """
    try:
        source = source_of(plan.trajectory)
    except UnboundedError:
        return _open_plan_claims(plan, why)
    evidence = Evidence(plan, EnclosedMotion(resolve(source), source, frozenset({"u", "du"})), [])
    proofs: list[Proof] = []
    for demand in plan.problem.demands:
        reads = demand.reads if isinstance(demand, Requirement) else {"q"}
        if isinstance(demand, Duration | LongestDuration) or reads <= evidence.path.reads:
            proofs += prove(demand, evidence)
        else:
            proofs += _open_plan_claims(plan, why, [demand])[:-1]
    return [*decide(proofs), undecided_claim(PLAN_DEVIATION.label, PLAN_DEVIATION.unit, why)]


def _open_plan_claims(plan: Plan, why: str, demands: Sequence[Demand] | None = None) -> list[Claim]:
    """Return undecided claims, for the reason `why`, on the given demands and the plan's q(t).

    By default the demands are all that apply to the plan.
    """
    free, in_coordinates = np.isnan(plan.problem.goal), plan.trajectory.in_coordinates
    parts = [
        part
        for each in (plan.problem.demands if demands is None else demands)
        for part in each.parts
        if not ((each.in_chart and in_coordinates) or (isinstance(each, Goal) and free[part.index]))
    ]
    return [undecided_claim(part.label, part.unit, why) for part in [*parts, PLAN_DEVIATION]]


# -- one proof for each kind of requirement ------------------------------------------------------


@singledispatch
def prove(demand: Demand, evidence: Evidence) -> Iterable[Proof]:
    """Return what is to be proven of a demand, such as a limit or the goal.

    These are obligations, for `decide` to prove, or claims that are decided already.
    """
    return _open_claims(demand, "there is no proof for this kind of requirement")


def _open_claims(demand: Demand, why: str, required: bool = True) -> list[Claim]:
    return [undecided_claim(part.label, part.unit, why, required) for part in demand.parts]


@prove.register
def _(requirement: Requirement, evidence: Evidence) -> Iterable[Proof]:
    """State the proof of a requirement by bounds on its `rows`, at all times or only at the end."""
    reads = requirement.reads
    if "du" in reads and not requirement.is_direct:
        return _open_claims(requirement, "there is no proof for this kind of requirement")
    motion, margins_of = evidence.motion_for(reads), dict[str, MarginAt]()
    if requirement.is_direct:
        if "q" in reads:
            models = motion.enclosure.states
        else:
            models = motion.inputs if "u" in reads else motion.rates
        values = [models[part.index] for part in requirement.parts]
    else:
        try:
            motion, values = _row_models(requirement, evidence, motion)
        except UnboundedError as error:
            return _open_claims(requirement, f"there is no bound for {error}")
        margins_of = _own_margins(requirement, evidence.plan.problem.system, motion, values)
    proofs: list[Proof] = []
    for part, value in zip(requirement.parts, values, strict=True):
        margins: list[Margin] = [(-1.0, value, part.high), (1.0, value, -part.low)]
        if requirement.final:
            end, doubt = np.array(value.at_end())[:, -1].tolist()
            slack = GOAL_TOLERANCE * part.scale
            margin = slack + min(end - part.low, part.high - end)
            proofs.append(motion.claim(part, 0.0, margin - doubt, margin + doubt, motion.end_s))
        elif "du" in reads and (jump := _jump(part, motion)):
            proofs.append(jump)
        else:
            finite = [margin for margin in margins if np.isfinite(margin[2])]
            slack, margin_at = LIMIT_TOLERANCE * part.scale, margins_of.get(part.label)
            proofs.append(Obligation(part, finite, motion, slack, margin_at=margin_at))
    return proofs


def _row_models(
    requirement: Requirement, evidence: Evidence, motion: EnclosedMotion
) -> tuple[EnclosedMotion, list[Model]]:
    """Return models of a requirement's rows, and the motion on whose cells they are given.

    The motion is the given one, with cells split where a model's remainder leaves open whether a
    limit is kept.
    """
    rows, names = _rows(evidence.plan.problem.system, requirement), sorted(requirement.reads)

    def models_of(enclosure: Enclosure) -> list[Model]:
        return enclosure.models(*rows(*(getattr(enclosure, name) for name in names)))

    def coarse_cells(enclosure: Enclosure, models: list[Model]) -> Index:
        hidden = np.zeros(len(enclosure.cells.piece), dtype=bool)
        for part, value in zip(requirement.parts, models, strict=True):
            open_ = (value.low < part.low) | (value.high > part.high)
            hidden |= open_ & (value.r > LIMIT_TOLERANCE * part.scale)
        if requirement.final:
            hidden[:-1] = False
        read = [ball for name in names for ball in getattr(enclosure, name)]
        return np.asarray(hidden & np.all([np.isfinite(ball.range[0]) for ball in read], axis=0))

    models = models_of(motion.enclosure)
    if np.any(coarse_cells(motion.enclosure, models)):
        motion = evidence.refine(motion, lambda each: coarse_cells(each, models_of(each)))
        models = models_of(motion.enclosure)
    return motion, models


MarginAt = Callable[[Array, Array], float]
"""Function from coordinates (N,) and inputs (2,) to the margin of one part of a requirement."""


def _own_margins(
    requirement: Requirement, system: TriangularSystem, motion: EnclosedMotion, rows: list[Model]
) -> dict[str, MarginAt]:
    """Return a function for the margin of each part whose row only replaces its value, by label.

    A row always lies on the same side of the limit as the value that `verify` uses, but may differ
    from it: u²/limit can replace |u|.
    """
    out: dict[str, MarginAt] = {}
    if type(requirement).values is Requirement.values:
        return out
    enclosure = motion.enclosure
    q, u = (np.array([ball.points.c for ball in group]) for group in (enclosure.q, enclosure.u))
    values = requirement.values(MotionPoint(system, q, u, np.zeros_like(u)))
    for k, (part, row, value) in enumerate(zip(requirement.parts, rows, values, strict=True)):
        finite = np.isfinite(row.r)
        gap = np.abs(row.c @ evaluation(row.c.shape[1]).T - value)[finite]
        if np.any(gap > (SUBSTITUTE_GAP * part.scale + row.r[finite])[:, None]):

            def margin_at(q: Array, u: Array, k: int = k, part: Part = part) -> float:
                value = float(requirement.values(MotionPoint(system, q, u, np.zeros(2)))[k])
                return min(part.high - value, value - part.low)

            out[part.label] = margin_at
    return out


@lru_cache(maxsize=64)
def _rows(system: TriangularSystem, requirement: Requirement | ChartDomain) -> Expression:
    """Return the rows of a requirement as an expression that balls can evaluate.

    The arguments are those of "du", "q", "u" that the requirement reads, in this order.
    """
    sizes = {"q": system.size, "u": 2, "du": 2}
    read = {name: ca.SX.sym(name, sizes[name]) for name in sorted(requirement.reads)}
    rows = requirement.rows(MotionPoint(system, **read))
    if not rows:
        raise UnboundedError(f"the chart margins, for which '{system.kind}' has no formula")
    return Expression(list(read.values()), ca.vertcat(*rows))


def _jump(part: Part, motion: EnclosedMotion) -> Claim | None:
    """Return the claim on the rate of an input that jumps, or may jump, at a break; else None.

    A jump violates every limit on the rate.
    """
    cells, u = motion.enclosure.cells, motion.inputs[part.index]
    breaks = np.flatnonzero(np.diff(cells.piece))  # last cells of the pieces
    if not len(breaks):
        return None
    (end, slip), (begin, _) = u.at_end(), u.at_begin()
    gap, doubt = np.abs(begin[breaks + 1] - end[breaks]), slip[breaks] + slip[breaks + 1]
    peak = float(np.max(u.size, where=np.isfinite(u.size), initial=1e-12))
    worst = int(np.argmax(gap + doubt))
    when, most = float(cells.times(np.array([1.0]))[breaks[worst], 0]), (gap + doubt)[worst]
    if np.max(gap - doubt) > JUMP_TOLERANCE * peak:
        return Claim(part.label, "violated", -np.inf, -np.inf, when, part.unit)
    if most <= JUMP_TOLERANCE * peak:
        return None
    unit = motion.source.trajectory.system.inputs[part.index].unit
    why = f"the input may jump by {most:.3g} {unit}"
    return Claim(part.label, "undecided", -np.inf, np.nan, when, part.unit, True, why)


@prove.register
def _(chart: ChartDomain, evidence: Evidence) -> Iterable[Proof]:
    """State that the motion stays in the chart's domain, where all margins are positive.

    Only a plan in chained coordinates is required to.
    """
    required = not evidence.plan.trajectory.in_coordinates
    try:
        balls = _rows(evidence.plan.problem.system, chart)(evidence.path.enclosure.q)
    except UnboundedError as error:
        return _open_claims(chart, f"there is no bound for {error}", required)
    (part,) = chart.parts
    values = evidence.path.enclosure.models(*balls)
    margins: list[Margin] = [(1.0, value, -part.low) for value in values]
    return [Obligation(part, margins, evidence.path, -np.finfo(float).tiny, required)]


@prove.register
def _(start: Start, evidence: Evidence) -> Iterable[Proof]:
    """Decide whether the plan's q(t) begins at the start, as the true motion does."""
    (part,) = start.parts
    q, slip = np.array([model.at_begin() for model in evidence.plan_q])[:, :, 0].T
    away = np.abs(q - evidence.plan.problem.start)
    low, high = (GOAL_TOLERANCE - float(np.max(x)) for x in (away + slip, away - slip))
    return [evidence.path.claim(part, 0.0, low, high, 0.0)]


@prove.register
def _(goal: Goal, evidence: Evidence) -> Iterable[Proof]:
    """Decide for each coordinate with a goal whether the true motion ends there."""
    target = evidence.plan.problem.goal
    for part in goal.parts:
        if not np.isnan(target[part.index]):
            state = evidence.path.enclosure.states[part.index]
            end, doubt = np.array(state.at_end())[:, -1].tolist()
            margin = GOAL_TOLERANCE - abs(end - target[part.index])
            bounds = margin - doubt, margin + doubt
            yield evidence.path.claim(part, 0.0, *bounds, evidence.path.end_s)


@prove.register
def _(limit: Duration | LongestDuration, evidence: Evidence) -> Iterable[Proof]:
    (part,), slack, plan = limit.parts, DURATION_TOLERANCE * limit.seconds, evidence.plan
    margin = slack - abs(plan.duration - plan.clock.hold_s - limit.seconds)
    if isinstance(limit, LongestDuration):
        margin = slack + limit.seconds - plan.duration
    return [evidence.path.claim(part, 0.0, margin, margin, np.nan)]


@prove.register
def _(disc: Obstacle, evidence: Evidence) -> Iterable[Proof]:
    centre, links = [Ball.constant(x) for x in disc.centre], list(range(disc.links))
    return _clearance_claims(evidence, centre, links, disc.parts, disc.thickness)


@prove.register
def _(requirement: SelfCollision, evidence: Evidence) -> Iterable[Proof]:
    """Decide whether each joint keeps clear of each link that is not adjacent to the joint.

    Then no two links cross: the problem excludes crossing at the start, and by continuity an end
    of one link would first touch the other.
    """
    points = joints(evidence.plan.problem.system, evidence.path.enclosure)
    for part, (place, link) in zip(requirement.parts, requirement.joint_link_pairs, strict=True):
        centre = points[2 * place : 2 * place + 2]
        yield from _clearance_claims(evidence, centre, [link - 1], (part,), requirement.clearance)


def _clearance_claims(
    evidence: Evidence, centre: list[Ball], links: list[int], parts: tuple[Part, ...], radius: float
) -> Iterable[Proof]:
    system, motion = evidence.plan.problem.system, evidence.path.enclosure
    bounds = clearances(system, motion, centre, links, radius)
    for part, bound in zip(parts, bounds, strict=True):
        slack = LIMIT_TOLERANCE * part.scale
        yield evidence.path.claim(part, slack, bound.guaranteed, bound.attained, bound.time_s)


@prove.register
def _(point: Waypoint, evidence: Evidence) -> Iterable[Proof]:
    """Decide whether the motion passes a waypoint within `GOAL_TOLERANCE`.

    The distance is taken at the waypoint's time, or at any time if the waypoint has no time.
    """
    (part,), time_s = point.parts, point.time_s
    motion = evidence.path.enclosure
    try:
        states = user_models(point.system, motion)
    except UnboundedError as error:
        return [undecided_claim(part.label, "", f"there is no bound for {error}")]
    if time_s is None:
        (when, nowhere), doubt = nearest_time(motion.cells, states, point, GOAL_TOLERANCE), 0.0
    else:
        (when, doubt), nowhere = path_time(evidence.plan.trajectory, time_s), True
    if not np.isfinite(doubt):
        return [undecided_claim(part.label, "", f"the position at t = {time_s:.6g} s is not known")]
    low, high = distance_bounds(motion.cells, states, point, when, doubt)
    best = GOAL_TOLERANCE - low if nowhere else np.nan
    return [evidence.path.claim(part, 0.0, GOAL_TOLERANCE - high, best, when)]
