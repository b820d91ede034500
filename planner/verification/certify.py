"""From a plan to its certificate: what is proven of each requirement over whole intervals.

Each kind of requirement becomes functions of time that must not be negative, on what is enclosed of
the true motion (`prove`, by the kind's class); the least values of all of them are then bounded
together (`decide`). A kind that nobody has written a proof for is undecided.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import lru_cache, singledispatch

import casadi as ca
import numpy as np

from planner.plan.claims import Certificate, Claim, undecided
from planner.plan.plan import Plan, expect_plan
from planner.plan.retimed import RetimedTrajectory
from planner.problem.problem import Problem
from planner.problem.requirements.ends import Duration, Goal, Start
from planner.problem.requirements.limits import ChartDomain
from planner.problem.requirements.places import Obstacle, Waypoint
from planner.problem.requirements.requirement import At, Demand, Part, Requirement
from planner.problem.requirements.self_collision import SelfCollision
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem
from planner.verification.balls import Ball
from planner.verification.enclosure import Enclosure
from planner.verification.functions import Expression, UnboundedError
from planner.verification.input_models import enclosed, resolve, source_of
from planner.verification.known import Known, On, Proof, ToProve, decide
from planner.verification.models import Index, Margin, Model
from planner.verification.places_proven import clearances, distance, joints, nearest, own_time
from planner.verification.verify import GOAL_TOLERANCE, INTERPOLANT_TOLERANCE, LIMIT_TOLERANCE

JUMP = 1e-7
"""Jump of an input, over its greatest value, that counts as one; as in `verify`."""

DURATION_TOLERANCE = 1e-9
"""Error of a given duration, relative to it; as in `verify`."""

OWN = Part("plan's q(t) against its integrated input", "", -np.inf, 0.0, 1.0)
"""The distance of the plan's own q(t) from the motion, as `verify` calls it."""

ON_MACHINE = "nothing is proven of the emulated machine, on which the inputs act"


def certify(plan: Plan) -> Certificate:
    """Prove, over each whole interval, what `verify` checks.

    Where `verify` integrates and samples, this bounds: the true motion under the plan's input is
    enclosed on every subinterval (a polynomial and a proven radius), and the limits of inputs and
    their rates, joints, z₂, the chart's domain, the goal and the distance from the plan's own q(t)
    are decided from the enclosure, with bounds on rounding included. Of a compensated plan, whose
    motion is that of an emulated machine, only inputs and duration are.

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
    nothing = np.full(problem.system.size, np.inf)
    why = trajectory.flaw
    if not why and trajectory.system != problem.system:
        why = "the trajectory belongs to another system than the problem"
    if not why and not plan.executable:  # one sample outside proves that
        report, (part,) = plan.domain, problem.chart.parts
        broken = Claim(part.label, "violated", -np.inf, report.margin, report.time_s, part.unit)
        why = "the path leaves the chart's domain, where no real coordinates exist"
        return [broken, *_unknown(problem, why, in_chart=False)], nothing, 0
    if why:
        return _unknown(problem, why, not trajectory.in_coordinates), nothing, 0
    try:
        if plan.compensation is not None:
            return _of_commands(plan), nothing, len(trajectory.breaks) - 1
        source, motion, own = enclosed(trajectory, problem.start)
    except UnboundedError as error:
        why = f"nothing bounds {error}"
        return _unknown(problem, why, not trajectory.in_coordinates), nothing, 0
    path = Known(motion, source)
    if isinstance(trajectory, RetimedTrajectory):
        path = Known(motion, source, frozenset("q"), trajectory)
    on = On(plan, path, own)
    claims = decide([found for demand in problem.demands for found in prove(demand, on)])
    gaps = [a - b for a, b in zip(own, motion.states, strict=True)]
    most = np.array([float(np.max(gap.size)) for gap in gaps])
    ends = [np.abs(end) - slip for end, slip in (gap.at_end() for gap in gaps)]
    reached = max(float(np.max(np.nan_to_num(end, nan=-np.inf))) for end in ends)
    low, high = (INTERPOLANT_TOLERANCE - x for x in (max(most.tolist()), max(reached, 0.0)))
    claims.append(path.claim(OWN, INTERPOLANT_TOLERANCE, low, high, np.nan))
    return claims, most, len(motion.cells.piece)


def _of_commands(plan: Plan) -> list[Claim]:
    """Of a compensated plan, whose inputs are commands: only these, and how long they take."""
    source = source_of(plan.trajectory)
    on = On(plan, Known(resolve(source), source, frozenset({"u", "du"})), [])
    found: list[Proof] = []
    for demand in plan.problem.demands:
        reads = demand.reads if isinstance(demand, Requirement) else {"q"}
        if isinstance(demand, Duration) or reads <= on.path.reads:
            found += prove(demand, on)
        elif not demand.in_chart:
            found += _undecided(demand, ON_MACHINE)
    return [*decide(found), undecided(OWN.label, OWN.unit, ON_MACHINE)]


def _unknown(problem: Problem, why: str, in_chart: bool) -> list[Claim]:
    """All requirements, where nothing could be bounded."""
    asked = [each for each in problem.demands if in_chart or not each.in_chart]
    parts = [(each, part) for each in asked for part in each.parts]
    free = np.isnan(problem.target)
    known = [p for each, p in parts if not (isinstance(each, Goal) and free[p.index])]
    return [undecided(p.label, p.unit, why) for p in [*known, OWN]]


# -- one proof for each kind of requirement ------------------------------------------------------


@singledispatch
def prove(demand: Demand, on: On) -> Iterable[Proof]:
    """What to prove of a demand, or claims that are decided already."""
    return _undecided(demand, "no proof is written for this kind of requirement")


def _undecided(demand: Demand, why: str, required: bool = True) -> list[Claim]:
    return [undecided(part.label, part.unit, why, required) for part in demand.parts]


@prove.register
def _(required: Requirement, on: On) -> Iterable[Proof]:
    """By its rows: at all times, or at the end alone."""
    reads = required.reads
    if not required.smooth or ("du" in reads and not required.plain):
        return _undecided(required, "no proof is written for this kind of requirement")
    known = on.known(reads)
    if required.plain:
        of = known.motion.states if "q" in reads else known.inputs if "u" in reads else known.rates
        values = [of[part.index] for part in required.parts]
    else:
        try:
            known, values = _shaped(required, on, known)
        except UnboundedError as error:
            return _undecided(required, f"nothing bounds {error}")
    found: list[Proof] = []
    for part, value in zip(required.parts, values, strict=True):
        margins: list[Margin] = [(-1.0, value, part.high), (1.0, value, -part.low)]
        if required.final:
            end, doubt = (float(x[-1]) for x in value.at_end())
            slack = GOAL_TOLERANCE * part.scale
            margin = slack + min(end - part.low, part.high - end)
            found.append(known.claim(part, slack, margin - doubt, margin + doubt, known.end_s))
        elif "du" in reads and (jump := _jump(part, known)):
            found.append(jump)
        else:
            finite = [margin for margin in margins if np.isfinite(margin[2])]
            found.append(ToProve(part, finite, known))
    return found


def _shaped(required: Requirement, on: On, known: Known) -> tuple[Known, list[Model]]:
    """Models of its rows; on finer cells where a remainder hides whether a limit is kept."""
    rows, names = _rows(on.plan.problem.system, required), sorted(required.reads)

    def values(motion: Enclosure) -> list[Model]:
        return motion.models(*rows(*(getattr(motion, name) for name in names)))

    def coarse(motion: Enclosure, found: list[Model]) -> Index:
        hidden = np.zeros(len(motion.cells.piece), dtype=bool)
        for part, value in zip(required.parts, found, strict=True):
            open_ = (value.low < part.low) | (value.high > part.high)
            hidden |= open_ & (value.r > LIMIT_TOLERANCE * part.scale)
        read = [ball for name in names for ball in getattr(motion, name)]
        return np.asarray(hidden & np.all([np.isfinite(ball.range[0]) for ball in read], axis=0))

    found = values(known.motion)
    if not required.final and np.any(coarse(known.motion, found)):
        known = on.finer(known, lambda motion: coarse(motion, values(motion)))
        found = values(known.motion)
    return known, found


@lru_cache(maxsize=64)
def _rows(system: TriangularSystem, required: Requirement | ChartDomain) -> Expression:
    """The rows of a requirement, of what it reads in alphabetical order."""
    sizes = {"q": system.size, "u": 2, "du": 2}
    read = {name: ca.SX.sym(name, sizes[name]) for name in sorted(required.reads)}
    rows = required.rows(At(system, **read))
    if not rows:
        raise UnboundedError(f"the chart margins of system '{system.kind}'")
    return Expression(list(read.values()), ca.vertcat(*rows))


def _jump(part: Part, known: Known) -> Claim | None:
    """The claim on a rate where the input jumps, or may jump, at a break; else None."""
    cells, u = known.motion.cells, known.inputs[part.index]
    breaks = np.flatnonzero(np.diff(cells.piece))  # cells after which another piece begins
    if not len(breaks):
        return None
    (end, slip), (begin, _) = u.at_end(), u.at_begin()
    gap, doubt = np.abs(begin[breaks + 1] - end[breaks]), slip[breaks] + slip[breaks + 1]
    peak = float(np.max(u.size, where=np.isfinite(u.size), initial=1e-12))
    worst = int(np.argmax(gap + doubt))
    when, most = float(cells.times(np.array([1.0]))[breaks[worst], 0]), (gap + doubt)[worst]
    if np.max(gap - doubt) > JUMP * peak:
        return Claim(part.label, "violated", -np.inf, -np.inf, when, part.unit)
    if most <= JUMP * peak:
        return None
    unit = known.source.trajectory.system.inputs[part.index].unit
    why = f"it may jump by {most:.3g} {unit}"
    return Claim(part.label, "undecided", -np.inf, np.nan, when, part.unit, True, why)


@prove.register
def _(chart: ChartDomain, on: On) -> Iterable[Proof]:
    """Every margin of the chart is positive; asked only of a plan in chained coordinates."""
    asked = not on.plan.trajectory.in_coordinates
    try:
        margins = _rows(on.plan.problem.system, chart)(on.path.motion.q)
    except UnboundedError as error:
        return _undecided(chart, f"nothing bounds {error}", asked)
    (part,) = chart.parts
    wanted: list[Margin] = [(1.0, value, -part.low) for value in on.path.motion.models(*margins)]
    return [ToProve(part, wanted, on.path, asked)]


@prove.register
def _(start: Start, on: On) -> Iterable[Proof]:
    """The plan's own q(t) begins there, as the true motion does."""
    (part,) = start.parts
    ends = [(float(q[0]), float(slip[0])) for q, slip in (model.at_begin() for model in on.own)]
    away = [(abs(q - q0), slip) for (q, slip), q0 in zip(ends, on.plan.problem.start, strict=True)]
    most, least = max(a + b for a, b in away), max(a - b for a, b in away)
    bounds = GOAL_TOLERANCE - most, GOAL_TOLERANCE - least
    return [on.path.claim(part, GOAL_TOLERANCE, *bounds, 0.0)]


@prove.register
def _(goal: Goal, on: On) -> Iterable[Proof]:
    """The true motion ends there."""
    target = on.plan.problem.target
    for part in goal.parts:
        if not np.isnan(target[part.index]):
            end, doubt = (float(x[-1]) for x in on.path.motion.states[part.index].at_end())
            margin = GOAL_TOLERANCE - abs(end - target[part.index])
            bounds = margin - doubt, margin + doubt
            yield on.path.claim(part, GOAL_TOLERANCE, *bounds, on.path.end_s)


@prove.register
def _(duration: Duration, on: On) -> Iterable[Proof]:
    (part,), slack, plan = duration.parts, DURATION_TOLERANCE * duration.seconds, on.plan
    margin = slack - abs(plan.duration - plan.lead_s - plan.tail_s - duration.seconds)
    return [on.path.claim(part, 1e-6 * slack, margin, margin, np.nan)]


@prove.register
def _(disc: Obstacle, on: On) -> Iterable[Proof]:
    centre = [Ball.constant(x) for x in disc.centre]
    return _clear(on, centre, list(range(disc.links)), disc.parts, disc.radius)


@prove.register
def _(required: SelfCollision, on: On) -> Iterable[Proof]:
    """Each joint keeps off each link that is not next to it.

    While all are proven no two links cross that did not at the start, which the problem has
    excluded: by continuity an end of one would first touch the other.
    """
    points = joints(on.plan.problem.system, on.path.motion)
    for part, (place, link) in zip(required.parts, required.near, strict=True):
        centre = points[2 * place : 2 * place + 2]
        yield from _clear(on, centre, [link - 1], (part,), required.clearance)


def _clear(
    on: On, centre: list[Ball], links: list[int], parts: tuple[Part, ...], by: float
) -> Iterable[Proof]:
    found = clearances(on.plan.problem.system, on.path.motion, centre, links, by)
    for part, bound in zip(parts, found, strict=True):
        yield on.path.claim(part, part.scale, bound.guaranteed, bound.attained, bound.time_s)


@prove.register
def _(point: Waypoint, on: On) -> Iterable[Proof]:
    """It is passed, within `verify`'s tolerance: at its time, or at some time."""
    (part,), asked = point.parts, point.time_s
    if asked is None:
        (when, nowhere), doubt = nearest(on.path.motion, point, GOAL_TOLERANCE), 0.0
    else:
        (when, doubt), nowhere = own_time(on.plan.trajectory, asked), True
    if not np.isfinite(doubt):
        why = f"where the motion is at t = {asked:.6g} s is not known"
        return [undecided(part.label, "", why)]
    low, high = distance(on.path.motion, point, when, doubt)
    best = GOAL_TOLERANCE - low if nowhere else np.nan
    return [on.path.claim(part, GOAL_TOLERANCE, GOAL_TOLERANCE - high, best, when)]
