"""From a plan to its certificate: what is proven of each requirement over whole intervals.

Each kind of requirement becomes functions of time that must not be negative, on what is enclosed of
the true motion (`prove`, by the kind's class); the least values of all of them are then bounded
together (`decide`). A kind that nobody has written a proof for is undecided.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache, singledispatch

import casadi as ca
import numpy as np

from planner.plan.claims import Certificate, Claim, Status, undecided
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
from planner.verification.input_models import Source, enclosed, resolve, source_of
from planner.verification.models import Margin, Model, least
from planner.verification.places_proven import clearances, distance, joints, nearest, own_time
from planner.verification.verify import GOAL_TOLERANCE, INTERPOLANT_TOLERANCE

JUMP = 1e-7
"""Jump of an input, over its greatest value, that counts as one; as in `verify`."""

EQUAL = 1e-9
"""Excess over a limit, relative to it, that counts as equality."""

DURATION_TOLERANCE = 1e-9
"""Error of a given duration, relative to it; as in `verify`."""

OWN = Part("plan's q(t) against its integrated input", "", -np.inf, 0.0, 1.0)
"""The distance of the plan's own q(t) from the motion, as `verify` calls it."""

UNBOUNDED = "no bound on the motion or its inputs is known on all of it"

STANDSTILL = "the inputs of a retimed path are quotients of zeros where the path stands still"


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


def _unknown(problem: Problem, why: str, in_chart: bool) -> list[Claim]:
    """All requirements, where nothing could be bounded."""
    asked = [each for each in problem.demands if in_chart or not each.in_chart]
    parts = [(each, part) for each in asked for part in each.parts]
    free = np.isnan(problem.target)
    known = [p for each, p in parts if not (isinstance(each, Goal) and free[p.index])]
    return [undecided(p.label, p.unit, why) for p in [*known, OWN]]


# -- what is known, and verdicts -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Known:
    """What is enclosed on one clock.

    Attributes:
        motion: The inputs, and perhaps the coordinates.
        source: Whose inputs these are.
        reads: Which of coordinates "q", inputs "u" and their rates "du" are known.
        retimed: The trajectory along whose path this is, if the clock is the path's own.
        why: Why something on it is not bounded.
    """

    motion: Enclosure
    source: Source
    reads: frozenset[str] = frozenset({"q", "u", "du"})
    retimed: RetimedTrajectory | None = None
    why: str = UNBOUNDED

    @cached_property
    def inputs(self) -> list[Model]:
        """Models of the inputs."""
        return self.motion.models(*self.motion.u)

    @cached_property
    def rates(self) -> list[Model]:
        """Models of their rates, inside the pieces."""
        return self.motion.models(*self.source.slopes(self.motion.cells))

    @property
    def end_s(self) -> float:
        """Its own time at the end, seconds."""
        return float(self.motion.cells.breaks[-1])

    def claim(
        self, part: Part, scale: float, low: float, high: float, when: float, required: bool = True
    ) -> Claim:
        """The verdict on a least margin between two bounds; its own time becomes the plan's."""
        slack, known = EQUAL * scale, float(high) if np.isfinite(high) else np.nan
        time_s, why = float(when) if np.isfinite(when) else None, ""
        if time_s is not None and self.retimed is not None:
            time_s = self.retimed.time_of(time_s)
        status: Status = "undecided"
        if low >= -slack:
            status = "proven"
        elif known < -slack:
            status = "violated"
        else:
            open_ = f"the margin lies between {low:.3g} and {known:.3g}"
            why = open_ if np.isfinite(low) else self.why
        return Claim(part.label, status, low, known, time_s, part.unit, required, why)


@dataclass(frozen=True, eq=False)
class On:
    """What proofs of a plan rest on.

    Attributes:
        plan: The plan.
        path: The true motion, of a retimed plan in the path's own time and without its inputs.
        own: The plan's own coordinates there.
    """

    plan: Plan
    path: Known
    own: list[Model]

    @cached_property
    def timed(self) -> Known:
        """The inputs in the plan's time."""
        if self.path.retimed is None:
            return self.path
        source = source_of(self.path.retimed)
        return Known(resolve(source), source, frozenset({"u", "du"}), why=STANDSTILL)


@dataclass(frozen=True, eq=False)
class ToProve:
    """Every one of some functions must be ≥ 0 at all times.

    Attributes:
        part: Whose label and unit the claim has.
        margins: (sign, value, limit) of sign · value + limit.
        known: What the values are functions of.
        required: Whether the problem asks for it.
    """

    part: Part
    margins: list[Margin]
    known: Known
    required: bool = True


Proof = ToProve | Claim


def decide(found: list[Proof]) -> list[Claim]:
    """The claims, in order; what is still to prove on one clock is bounded all at once."""
    wanted = [each for each in found if isinstance(each, ToProve)]
    verdicts: dict[int, Claim] = {}
    for known in {id(each.known): each.known for each in wanted}.values():
        own = [each for each in wanted if each.known is known]
        scales = np.array([each.part.scale for each in own for _ in each.margins])
        margins = [margin for each in own for margin in each.margins]
        bounds = iter(least(margins, known.motion.cells, scales))
        for each in own:
            of = [next(bounds) for _ in each.margins]
            guaranteed, worst = min(x.guaranteed for x in of), min(of, key=lambda x: x.attained)
            given = each.part, each.part.scale, guaranteed, worst.attained, worst.time_s
            verdicts[id(each)] = known.claim(*given, each.required)
    return [verdicts.get(id(each), each) for each in found]  # type: ignore[arg-type]


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
    known = on.path if reads <= on.path.reads else on.timed
    shaped = reads <= known.reads - {"du"}  # nothing bounds other functions of the rates
    if not required.smooth or not (shaped or (required.plain and reads <= known.reads)):
        return _undecided(required, "no proof is written for this kind of requirement")
    if required.plain:
        of = known.motion.states if "q" in reads else known.inputs if "u" in reads else known.rates
        values = [of[part.index] for part in required.parts]
    else:
        try:
            rows = _rows(on.plan.problem.system, required)
            balls = rows(*(getattr(known.motion, name) for name in sorted(reads)))
            values = known.motion.models(*balls)
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
    (part,), slack = duration.parts, DURATION_TOLERANCE * duration.seconds
    margin = slack - abs(on.plan.duration - duration.seconds)
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
