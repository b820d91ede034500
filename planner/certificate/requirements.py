"""A problem's requirements as functions of time that must not be negative."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from planner.certificate.cells import Cells
from planner.certificate.evaluate import Expression, UnboundedError
from planner.certificate.least import Margin, least
from planner.certificate.model import Model
from planner.certificate.motion import Motion
from planner.chained import chained_form
from planner.claims import Claim, undecided
from planner.problem import Problem
from planner.systems.base import TriangularSystem
from planner.verify import GOAL_TOLERANCE, INTERPOLANT_TOLERANCE

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
class Requirement:
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


def decide(wanted: list[Requirement], cells: Cells, unbounded: str = UNBOUNDED) -> list[Claim]:
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
    of: Requirement, guaranteed: float, attained: float, time: float, unbounded: str = UNBOUNDED
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


def inputs(problem: Problem, u: list[Model]) -> list[Requirement]:
    """|uᵢ| within its limit."""
    limits = problem.limits.input
    return [
        Requirement(f"input {c.name}", _within(u[i], limits[i]), limits[i], c.unit)
        for i, c in enumerate(problem.system.inputs)
        if np.isfinite(limits[i])
    ]


def rates(problem: Problem, slopes: list[Model]) -> list[Requirement]:
    """|duᵢ/dt| within its limit, inside the pieces."""
    limits = problem.limits.input_rate
    return [
        Requirement(
            f"rate of input {c.name}", _within(slopes[i], limits[i]), limits[i], c.rate_unit
        )
        for i, c in enumerate(problem.system.inputs)
        if np.isfinite(limits[i])
    ]


def jumps(problem: Problem, u: list[Model], cells: Cells) -> dict[str, Claim]:
    """Claims that replace those of the rates where an input jumps, or may jump, at a break."""
    out = {}
    at = cells.joints()
    for i, c in enumerate(problem.system.inputs):
        if not np.isfinite(problem.limits.input_rate[i]) or not len(at):
            continue
        before, slip = u[i].at_end()
        m = u[i].c
        after = m @ np.where(np.arange(m.shape[1]) % 2 == 0, 1.0, -1.0)
        gap = np.abs(after[at + 1] - before[at])
        doubt = slip[at] + u[i].at_end()[1][at + 1]
        peak = float(np.max(u[i].size, where=np.isfinite(u[i].size), initial=1e-12))
        label, unit = f"rate of input {c.name}", c.rate_unit
        worst = int(np.argmax(gap + doubt))
        when = float(cells.times(np.array([1.0]))[at[worst], 0])
        if np.max(gap - doubt) > JUMP * peak:
            out[label] = Claim(label, "violated", -np.inf, -np.inf, when, unit)
        elif not (gap + doubt)[worst] <= JUMP * peak:
            why = f"it may jump by {(gap + doubt)[worst]:.3g} {c.unit}"
            out[label] = Claim(label, "undecided", -np.inf, np.nan, when, unit, True, why)
    return out


def joints(problem: Problem, motion: Motion) -> list[Requirement]:
    """|qᵢ| within its limit."""
    states, out = motion.states, []
    for i, limit in enumerate(problem.limits.joint):
        if np.isfinite(limit):
            c = problem.system.coordinates[i]
            out.append(Requirement(f"joint {c.name}", _within(states[i], limit), limit, c.unit))
    return out


def z2(problem: Problem, motion: Motion, required: bool) -> list[Requirement]:
    """z₂ on the start's side of zero by its margin."""
    margin = problem.limits.z2_margin
    if margin is None:
        return []
    (value,) = _z2(problem.system)(motion.q)
    above = (float(problem.z2_sign), motion.models(value)[0], -margin)
    return [Requirement("z2 margin", [above], max(margin, 1e-3), "", required)]


def domain(problem: Problem, motion: Motion, required: bool) -> list[Requirement]:
    """Every margin of the chart positive.

    Raises:
        UnboundedError: If the system has no expression of them.
    """
    margins = _margins(problem.system, tuple(problem.branch.tolist()))(motion.q)
    wanted = [(1.0, value, 0.0) for value in motion.models(*margins)]
    return [Requirement("chart domain", wanted, 1.0, "", required)]


def goal(problem: Problem, motion: Motion) -> list[Claim]:
    """The end of the true motion at the goal, within `verify`'s tolerance."""
    target = problem.target
    time, out = float(motion.cells.times(np.array([1.0]))[-1, 0]), []
    for i, c in enumerate(problem.system.coordinates):
        if np.isnan(target[i]):
            continue
        end, doubt = (float(x[-1]) for x in motion.states[i].at_end())
        gap = abs(end - target[i])
        of = Requirement(f"goal {c.name}", [], GOAL_TOLERANCE, c.unit)
        out.append(claim(of, GOAL_TOLERANCE - gap - doubt, GOAL_TOLERANCE - gap + doubt, time))
    return out


def duration(problem: Problem, seconds: float) -> list[Claim]:
    """The duration, where the problem gives one."""
    if problem.duration is None:
        return []
    slack = DURATION_TOLERANCE * problem.duration
    margin = slack - abs(seconds - problem.duration)
    return [claim(Requirement("duration", [], 1e-6 * slack, "s"), margin, margin, np.nan)]


def interpolant(problem: Problem, motion: Motion, own: list[Model]) -> list[Claim]:
    """The plan's own q(t), as models, at the start and near the true motion at all times."""
    gaps = [q - p for q, p in zip(own, motion.states, strict=True)]
    most = max(float(np.max(gap.size)) for gap in gaps)
    ends = [np.abs(end) - slip for end, slip in (gap.at_end() for gap in gaps)]
    least = max(float(np.max(np.nan_to_num(end, nan=-np.inf))) for end in ends)
    of = Requirement(INTERPOLANT, [], INTERPOLANT_TOLERANCE, "")
    tolerance = INTERPOLANT_TOLERANCE
    out = [claim(of, tolerance - most, tolerance - max(least, 0.0), np.nan)]
    first = [q.only(np.array([0])).at_begin() for q in own]
    away = [abs(float(q[0]) - q0) for (q, _), q0 in zip(first, problem.start, strict=True)]
    slips = [float(slip[0]) for _, slip in first]
    most = max(a + b for a, b in zip(away, slips, strict=True))
    least = max(a - b for a, b in zip(away, slips, strict=True))
    of = Requirement("start", [], GOAL_TOLERANCE, "")
    return [*out, claim(of, GOAL_TOLERANCE - most, GOAL_TOLERANCE - least, 0.0)]


def unknown(problem: Problem, why: str, in_chart: bool) -> list[Claim]:
    """All requirements, where nothing could be bounded."""
    limits, system = problem.limits, problem.system
    labels = [
        ("start", "", 0.0),
        *(
            (f"goal {c.name}", c.unit, value)
            for c, value in zip(system.coordinates, problem.target, strict=True)
        ),
        ("duration", "s", np.inf if problem.duration is None else 0.0),
        (INTERPOLANT, "", 0.0),
    ]
    labels += [(f"input {c.name}", c.unit, limits.input[i]) for i, c in enumerate(system.inputs)]
    labels += [
        (f"rate of input {c.name}", c.rate_unit, limits.input_rate[i])
        for i, c in enumerate(system.inputs)
    ]
    labels += [
        (f"joint {c.name}", c.unit, limits.joint[i]) for i, c in enumerate(system.coordinates)
    ]
    labels += [("z2 margin", "", np.inf if limits.z2_margin is None else 0.0)]
    labels += [("chart domain", "", 0.0 if in_chart else np.inf)]
    labels += [(point.label, "", 0.0) for point in problem.waypoints]
    links = range(1, 1 + len(getattr(system, "link_lengths", ())))
    labels += [(disc.label(i), "m", 0.0) for disc in problem.obstacles for i in links]
    return [undecided(label, unit, why) for label, unit, limit in labels if np.isfinite(limit)]


def _within(value: Model, limit: float) -> list[Margin]:
    return [(-1.0, value, limit), (1.0, value, limit)]


@lru_cache(maxsize=32)
def _z2(system: TriangularSystem) -> Expression:
    q = ca.SX.sym("q", system.size)
    return Expression([q], chained_form(system).z_expr(q)[1])


@lru_cache(maxsize=32)
def _margins(system: TriangularSystem, branch: tuple[float, ...]) -> Expression:
    q = ca.SX.sym("q", system.size)
    margins = system.chart_margins_expr(q, np.array(branch))
    if not margins:
        raise UnboundedError(f"the chart margins of system '{system.kind}'")
    return Expression([q], ca.vertcat(*margins))
