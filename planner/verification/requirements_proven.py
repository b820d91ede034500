"""A problem's requirements as functions of time that must not be negative.

Waypoints, obstacles and links that stay apart, proven.

A link from P in direction e of length l has from a disc's centre C the squared distance

    |P − C|² + m(a),   a = (P − C)·e,   m(a) = min over t in [0, l] of 2at + t²

where m is 0 for a ≥ 0, −a² for −l ≤ a ≤ 0, and linear below. On a cell within one of these ranges
the distance is a model. On one across two of them m, being concave, is replaced by its chord, and
such cells are halved until the chord is as good as m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import casadi as ca
import numpy as np

from planner.plan.claims import Claim, undecided
from planner.plan.curves import Cells, joined
from planner.problem.problem import Problem
from planner.problem.requirements.limits import ChartDomain
from planner.problem.requirements.places import Waypoint
from planner.problem.requirements.requirement import At, Part, Requirement
from planner.support import deadline
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem, arm_points_expr
from planner.verification.balls import Ball
from planner.verification.enclosure import Motion
from planner.verification.functions import Expression, UnboundedError
from planner.verification.models import (
    POINTS,
    UNIT,
    Margin,
    Model,
    halved,
    joined_models,
    least,
    nodes,
)
from planner.verification.verify import GOAL_TOLERANCE, INTERPOLANT_TOLERANCE

JUMP = 1e-7
"""Jump of an input, over its greatest value, that counts as one; as in `verify`."""

EQUAL = 1e-9
"""Excess over a limit, relative to it, that counts as equality."""


DURATION_TOLERANCE = 1e-9
"""Error of a given duration, relative to it; as in `verify`."""

INTERPOLANT = "plan's q(t) against its integrated input"
"""What `verify` calls the distance of the plan's own q(t) from the motion."""

UNBOUNDED = "no bound on the motion or its inputs is known on all of it"


@dataclass(frozen=True, eq=False)
class ToProve:
    """Every one of some functions must be ≥ 0 at all times.

    Attributes:
        label: In the words of `verify`.
        margins: (sign, value, limit) of sign · value + limit.
        scale: What the margin is compared with, in its unit.
        unit: Unit of the margin.
        required: Whether the problem asks for it.
    """

    label: str
    margins: list[Margin]
    scale: float
    unit: str
    required: bool = True


def decide(wanted: list[ToProve], cells: Cells, unbounded: str = UNBOUNDED) -> list[Claim]:
    """Bound them all and say what is proven; `unbounded` is why, where nothing is known."""
    margins = [m for w in wanted for m in w.margins]
    if not margins:
        return []
    scales = np.array([w.scale for w in wanted for _ in w.margins])
    found = iter(least(margins, cells, scales))
    out = []
    for w in wanted:
        own = [next(found) for _ in w.margins]
        guaranteed = min(x.guaranteed for x in own)
        worst = min(own, key=lambda x: x.attained)
        out.append(claim(w, guaranteed, worst.attained, worst.time_s, unbounded))
    return out


def claim(
    of: ToProve, guaranteed: float, attained: float, time: float, unbounded: str = UNBOUNDED
) -> Claim:
    """The verdict on bounds of the least margin."""
    slack, when = EQUAL * of.scale, float(time) if np.isfinite(time) else None
    known = float(attained) if np.isfinite(attained) else np.nan
    if guaranteed >= -slack:
        status, why = "proven", ""
    elif known < -slack:
        status, why = "violated", ""
    elif np.isfinite(guaranteed):
        status, why = "undecided", f"the margin lies between {guaranteed:.3g} and {known:.3g}"
    else:
        status, why = "undecided", unbounded
    return Claim(of.label, status, guaranteed, known, when, of.unit, of.required, why)  # type: ignore[arg-type]


def plain(problem: Problem, read: str, values: list[Model]) -> list[ToProve]:
    """What is asked of inputs ("u"), their rates ("du", inside the pieces) or coordinates ("q")."""
    return [
        ToProve(part.label, _between(values[part.index], part), part.scale, part.unit)
        for required in problem.requirements
        if required.plain and required.reads == {read}
        for part in required.parts
    ]


def unsaid(problem: Problem, claims: list[Claim]) -> list[Claim]:
    """The requirements that no claim speaks of: nothing is proven by silence."""
    said = {each.label for each in claims}
    return [
        undecided(part.label, part.unit, "no proof is written for this kind of requirement")
        for required in (*problem.requirements, *problem.final)
        for part in required.parts
        if part.label not in said
    ]


def jumps(problem: Problem, u: list[Model], cells: Cells) -> dict[str, Claim]:
    """Claims that replace those of the rates where an input jumps, or may jump, at a break."""
    out = {}
    at = np.flatnonzero(np.diff(cells.piece))  # cells after which another piece begins
    rates = [each for each in problem.requirements if each.plain and "du" in each.reads]
    parts = [part for each in rates for part in each.parts]
    for part in parts if len(at) else []:
        i, label, unit = part.index, part.label, part.unit
        before, slip = u[i].at_end()
        m = u[i].c
        after = m @ np.where(np.arange(m.shape[1]) % 2 == 0, 1.0, -1.0)
        gap = np.abs(after[at + 1] - before[at])
        doubt = slip[at] + u[i].at_end()[1][at + 1]
        peak = float(np.max(u[i].size, where=np.isfinite(u[i].size), initial=1e-12))
        worst = int(np.argmax(gap + doubt))
        when = float(cells.times(np.array([1.0]))[at[worst], 0])
        if np.max(gap - doubt) > JUMP * peak:
            out[label] = Claim(label, "violated", -np.inf, -np.inf, when, unit)
        elif not (gap + doubt)[worst] <= JUMP * peak:
            why = f"it may jump by {(gap + doubt)[worst]:.3g} {problem.system.inputs[i].unit}"
            out[label] = Claim(label, "undecided", -np.inf, np.nan, when, unit, True, why)
    return out


def shaped(
    problem: Problem, motion: Motion, **given: list[Ball]
) -> tuple[list[ToProve], list[Claim]]:
    """What is asked of functions of coordinates (q), or of the inputs (u) and perhaps these too.

    Returns:
        What is to be proven, and claims for what nothing bounds.
    """
    wanted, claims = list[ToProve](), list[Claim]()
    for required in problem.requirements:
        reads = tuple(sorted(required.reads))
        known = required.reads <= given.keys() and ("u" in reads) == ("u" in given)
        if required.plain or not required.smooth or not known:
            continue
        try:
            balls = _rows(problem.system, required)(*(given[name] for name in reads))
        except UnboundedError as error:
            why = f"nothing bounds {error}"
            claims += [undecided(part.label, part.unit, why) for part in required.parts]
            continue
        for part, value in zip(required.parts, motion.models(*balls), strict=True):
            wanted.append(ToProve(part.label, _between(value, part), part.scale, part.unit))
    return wanted, claims


def domain(problem: Problem, motion: Motion, required: bool) -> tuple[list[ToProve], list[Claim]]:
    """Every margin of the chart positive, or the claim that nothing bounds them."""
    (part,) = problem.chart.parts
    try:
        margins = _margins(problem.system, problem.chart)(motion.q)
    except UnboundedError as error:
        return [], [undecided(part.label, part.unit, f"nothing bounds {error}", required)]
    wanted = [(1.0, value, -part.low) for value in motion.models(*margins)]
    return [ToProve(part.label, wanted, part.scale, part.unit, required)], []


def goal(problem: Problem, motion: Motion) -> list[Claim]:
    """The end of the true motion at the goal, within `verify`'s tolerance; also its tip."""
    target = problem.target
    time, out = float(motion.cells.times(np.array([1.0]))[-1, 0]), []
    for i, c in enumerate(problem.system.coordinates):
        if np.isnan(target[i]):
            continue
        end, doubt = (float(x[-1]) for x in motion.states[i].at_end())
        gap = abs(end - target[i])
        of = ToProve(f"goal {c.name}", [], GOAL_TOLERANCE, c.unit)
        out.append(claim(of, GOAL_TOLERANCE - gap - doubt, GOAL_TOLERANCE - gap + doubt, time))
    for required in problem.final:
        balls = _rows(problem.system, required)(motion.q)
        for part, value in zip(required.parts, motion.models(*balls), strict=True):
            end, doubt = (float(x[-1]) for x in value.at_end())
            slack = GOAL_TOLERANCE * part.scale
            margin = slack + min(end - part.low, part.high - end)
            of = ToProve(part.label, [], slack, part.unit)
            out.append(claim(of, margin - doubt, margin + doubt, time))
    return out


def duration(problem: Problem, seconds: float) -> list[Claim]:
    """The duration, where the problem gives one."""
    if problem.duration is None:
        return []
    slack = DURATION_TOLERANCE * problem.duration
    margin = slack - abs(seconds - problem.duration)
    return [claim(ToProve("duration", [], 1e-6 * slack, "s"), margin, margin, np.nan)]


def interpolant(problem: Problem, motion: Motion, own: list[Model]) -> list[Claim]:
    """The plan's own q(t), as models, at the start and near the true motion at all times."""
    gaps = [q - p for q, p in zip(own, motion.states, strict=True)]
    most = max(float(np.max(gap.size)) for gap in gaps)
    ends = [np.abs(end) - slip for end, slip in (gap.at_end() for gap in gaps)]
    least = max(float(np.max(np.nan_to_num(end, nan=-np.inf))) for end in ends)
    of = ToProve(INTERPOLANT, [], INTERPOLANT_TOLERANCE, "")
    tolerance = INTERPOLANT_TOLERANCE
    out = [claim(of, tolerance - most, tolerance - max(least, 0.0), np.nan)]
    first = [q.only(np.array([0])).at_begin() for q in own]
    away = [abs(float(q[0]) - q0) for (q, _), q0 in zip(first, problem.start, strict=True)]
    slips = [float(slip[0]) for _, slip in first]
    most = max(a + b for a, b in zip(away, slips, strict=True))
    least = max(a - b for a, b in zip(away, slips, strict=True))
    of = ToProve("start", [], GOAL_TOLERANCE, "")
    return [*out, claim(of, GOAL_TOLERANCE - most, GOAL_TOLERANCE - least, 0.0)]


def unknown(problem: Problem, why: str, in_chart: bool) -> list[Claim]:
    """All requirements, where nothing could be bounded."""
    asked = [each for each in problem.demands if in_chart or not each.in_chart]
    labels = [(part.label, part.unit) for each in asked for part in each.parts]
    labels.append((INTERPOLANT, ""))
    free = {f"goal {problem.system.coordinates[0].name}"} if problem.travel is None else set()
    return [undecided(label, unit, why) for label, unit in labels if label not in free]


def _between(value: Model, part: Part) -> list[Margin]:
    margins: list[Margin] = [(-1.0, value, part.high), (1.0, value, -part.low)]
    return [margin for margin in margins if np.isfinite(margin[2])]


@lru_cache(maxsize=64)
def _rows(system: TriangularSystem, required: Requirement) -> Expression:
    """The rows of a requirement, of what it reads in alphabetical order."""
    sizes = {"q": system.size, "u": 2, "du": 2}
    read = {name: ca.SX.sym(name, sizes[name]) for name in sorted(required.reads)}
    return Expression(list(read.values()), ca.vertcat(*required.rows(At(system, **read))))


@lru_cache(maxsize=32)
def _margins(system: TriangularSystem, chart: ChartDomain) -> Expression:
    q = ca.SX.sym("q", system.size)
    margins = chart.rows(At(system, q))
    if not margins:
        raise UnboundedError(f"the chart margins of system '{system.kind}'")
    return Expression([q], ca.vertcat(*margins))


HALVINGS = 10


def obstacles(problem: Problem, motion: Motion) -> list[Claim]:
    """The clearance of every link from every disc, in metres."""
    out = []
    for disc in problem.obstacles:
        centre = [Ball.constant(x) for x in disc.centre]
        out += _clear(problem, motion, centre, list(enumerate(disc.parts)), disc.radius)
    return out


def links_apart(problem: Problem, motion: Motion) -> list[Claim]:
    """The distance of each joint from each link that is not next to it, beyond the clearance.

    While all are proven no two links cross that did not at the start, which the problem has
    excluded: by continuity an end of one would first touch the other.
    """
    required, out = problem.self_collision, list[Claim]()
    if required is None:
        return out
    points = _points(problem.system)(motion.q)
    for part, (place, link) in zip(required.parts, required.near, strict=True):
        centre, wanted = points[2 * place : 2 * place + 2], [(link - 1, part)]
        out += _clear(problem, motion, centre, wanted, required.clearance)
    return out


def _clear(
    problem: Problem, motion: Motion, centre: list[Ball], wanted: list[tuple[int, Part]], by: float
) -> list[Claim]:
    """How far some links (from 0), each with its part, are from a place, beyond a distance."""
    balls, out = _links(problem.system)(motion.q, centre), []
    lengths = problem.system.link_lengths  # type: ignore[attr-defined]
    values = motion.models(*(balls[3 * link + k] for link, _ in wanted for k in range(3)))
    for k, (link, part) in enumerate(wanted):
        square, cells = _square(values[3 * k : 3 * k + 3], float(lengths[link]), motion.cells)
        of = ToProve(part.label, [], part.scale, part.unit)
        (found,) = least([(1.0, square, 0.0)], cells, np.array([by**2]))
        bounds = [_clearance(x, by) for x in (found.guaranteed, found.attained)]
        out.append(claim(of, bounds[0], bounds[1], found.time_s))
    return out


def waypoints(
    problem: Problem, motion: Motion, own: Callable[[float], tuple[float, float]]
) -> list[Claim]:
    """Every waypoint passed, within `verify`'s tolerance: at its time, or at some time.

    Args:
        problem: Has the waypoints.
        motion: The motion, in the path's own time.
        own: From the plan's time to the path's and its uncertainty, which is infinite for a time
            that the motion does not reach.
    """
    out = []
    for point in problem.waypoints:
        if point.time_s is None:
            (time, nowhere), doubt = _nearest(motion, point), 0.0
        else:
            (time, doubt), nowhere = own(point.time_s), True
        if not np.isfinite(doubt):
            why = f"where the motion is at t = {point.time_s:.6g} s is not known"
            out.append(undecided(point.parts[0].label, "", why))
            continue
        low, high = _distance(motion, point, time, doubt)
        best = GOAL_TOLERANCE - low if nowhere else np.nan
        of = ToProve(point.parts[0].label, [], GOAL_TOLERANCE, "")
        out.append(claim(of, GOAL_TOLERANCE - high, best, time))
    return out


@lru_cache(maxsize=32)
def _links(system: TriangularSystem) -> Expression:
    """|P − C|², a and a² of each link, of (q, C)."""
    arm: Any = system
    q, centre = ca.SX.sym("q", system.size), ca.SX.sym("C", 2)
    offset, heading, out = -centre, ca.SX(0), []
    for i, length in enumerate(arm.link_lengths, 1):
        heading = heading + q[i]
        direction = ca.vertcat(ca.cos(heading), ca.sin(heading))
        along = ca.dot(offset, direction)
        out += [ca.sumsqr(offset), along, along**2]
        offset = offset + length * direction
    return Expression([q, centre], ca.vertcat(*out))


@lru_cache(maxsize=32)
def _points(system: TriangularSystem) -> Expression:
    """x and y of the base, the joints and the tip, of q."""
    q, arm = ca.SX.sym("q", system.size), cast("Any", system)
    points = arm_points_expr([q[i] for i in range(1, system.size)], arm.link_lengths)
    return Expression([q], ca.vertcat(*(x for point in points for x in point)))


def _square(values: list[Model], length: float, cells: Cells) -> tuple[Model, Cells]:
    """A model that is nowhere above the squared distance, close to it where it may be least, and
    its cells."""
    kept: list[tuple[Cells, list[Model]]] = []
    best = np.inf
    for step in range(HALVINGS + 1):
        deadline.check_stopped()
        square, along, _ = values
        low, high = along.low, along.high
        best = np.fmin(best, np.fmin.reduce(square.high + _least_of(high, length)))
        far = square.low + _least_of(low, length) > best
        one = (low >= 0) | (high <= -length) | ((high <= 0) & (low >= -length))
        settled = one | far | (step == HALVINGS) | ~np.isfinite(along.r)
        kept.append((cells.only(settled), [x.only(settled) for x in values]))
        if np.all(settled):
            break
        values = [Model(*halved(x.c[~settled], x.r[~settled])) for x in values]
        cells = cells.only(~settled).halved()
    square, along, twice = (joined_models([m[k] for _, m in kept]) for k in range(3))
    return _lower(square, along, twice, length), joined([c for c, _ in kept])


def _lower(square: Model, along: Model, twice: Model, length: float) -> Model:
    """|P − C|² + m(a), or with the chord of m on cells across two of its ranges."""
    low, high = np.clip(along.low, -1e6, 1e6), np.clip(along.high, -1e6, 1e6)
    behind, beyond, beside = low >= 0, high <= -length, (high <= 0) & (low >= -length)
    at_low, at_high = _least_of(low, length), _least_of(high, length)
    slope = np.divide(at_high - at_low, high - low, out=np.zeros_like(low), where=high > low)
    slope = np.where(behind | beside, 0.0, np.where(beyond, 2 * length, slope))
    level = np.where(behind | beside, 0.0, np.where(beyond, length**2, at_low - slope * low))
    doubt = 16 * UNIT * (np.abs(slope * low) + np.abs(level) + np.abs(at_low) + np.abs(at_high))
    straight = along.scaled(slope) + Model(level[:, None], doubt)
    return square + straight + twice.scaled(np.where(beside, -1.0, 0.0))


def _least_of(a: Array, length: float) -> Array:
    t = np.clip(-a, 0.0, length)
    return np.asarray(2 * a * t + t**2)


def _clearance(square: float, by: float) -> float:
    return float(np.sqrt(max(square, 0.0)) - by) if np.isfinite(square) else square


def _nearest(motion: Motion, point: Waypoint) -> tuple[float, bool]:
    """A time at which the motion is near a waypoint, and whether it provably is nowhere near."""
    places = np.array([-1.0, *nodes(), 1.0])
    basis = np.polynomial.chebyshev.chebvander(places, POINTS - 1)
    q = np.stack([p.c @ basis[:, : p.c.shape[1]].T for p in motion.states], axis=-1)
    cell, place = np.unravel_index(np.argmin(point.distance(q)), q.shape[:2])
    time = float(motion.cells.times(places)[cell, place])
    fixed = np.flatnonzero(~np.isnan(point.q))
    states = [motion.states[i] - float(point.q[i]) for i in fixed]
    away = np.max([np.maximum(s.low, -s.high) for s in states], axis=0)
    return time, bool(np.all(away > GOAL_TOLERANCE))


def _distance(motion: Motion, point: Waypoint, time: float, slip: float) -> tuple[float, float]:
    """Bounds of the distance at a time that is known to within `slip`."""
    ends = motion.cells.times(np.array([-1.0, 1.0]))
    k = int(np.clip(np.searchsorted(ends[:, 0], time, side="right") - 1, 0, len(ends) - 1))
    tau = 2 * (time - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
    low, high = 0.0, 0.0
    for i in np.flatnonzero(~np.isnan(point.q)):
        c = motion.states[i].c[k]
        value = abs(np.polynomial.chebyshev.chebval(tau, c) - point.q[i])
        doubt = float(motion.states[i].r[k]) + 1e-14 * len(c) ** 2 * float(np.sum(np.abs(c)))
        steepest = float(np.arange(len(c)) ** 2 @ np.abs(c))  # |Tₖ'| ≤ k²
        doubt += 2 * slip / (ends[k, 1] - ends[k, 0]) * steepest
        low, high = max(low, value - doubt), max(high, value + doubt)
    return low, high
