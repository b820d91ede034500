"""The independent check of a plan: `verify`.

`verify` integrates the plan's input u(t) by a Chebyshev quadrature, which no method uses, with the
system's NumPy kinematics. Goal, limits, waypoints and obstacles are checked over all time, also
between the breaks. The quadrature estimates its own error, and a plan for which the error is too
large is refused. A compensated plan is checked by the motion of its nominal machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.errors import Violation
from planner.plan.claims import turned
from planner.plan.curves import Cells
from planner.plan.plan import ROUNDING, Plan, expect_plan
from planner.plan.quadrature import (
    CONTROL_POINTS,
    POINTS,
    IntegratedMotion,
    greatest,
    integrate,
    jumps,
    slopes,
)
from planner.plan.trajectory import StateTrajectory
from planner.problem.requirements.ends import Duration, Goal, LongestDuration, Start
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.support import deadline
from planner.support.arrays import Array, Frozen
from planner.support.calculus.chebyshev import apply, points, resampling
from planner.support.calculus.extremes import FLAT_DEPTH, narrow_dips
from planner.support.tables import Column, html_table

GOAL_TOLERANCE = 2e-5
"""Largest error at the goal, in radians (0.0011 degrees) or metres. The error of a tip goal is
relative to the arm's reach: an error of one joint moves a stretched arm's tip by that fraction."""

ON_MACHINE_TOLERANCE = np.deg2rad(0.05)
"""Largest error at the goal of a compensated plan, in radians: half a step of the prototype's
encoders. The nominal machine rounds its commands, so the best input still leaves an error of some
thousandths of a degree."""

BETWEEN_TOLERANCE = ON_MACHINE_TOLERANCE
"""Largest distance of the machine, between two breaks of a compensated plan, from the range between
the machine's positions at the two breaks, in radians."""

LIMIT_TOLERANCE = 1e-6
"""Largest excess over a limit, relative to the limit."""

INTERPOLANT_TOLERANCE = 1e-4
"""Largest difference between the plan's q(t) and the integrated motion, in radians or metres."""

INTEGRATION_TOLERANCE = 1e-7
"""Largest estimated error of the integrated motion, in radians or metres: a 200th of the error
allowed at the goal."""

FINEST_SHARE = 2.0**-40
"""Step of the grid on which cells begin, as a fraction of a piece: a trillionth, the width of the
smallest cells into which the integration splits a piece."""


@dataclass(frozen=True, eq=False)
class Check(Frozen):
    """Result of `verify`.

    Attributes:
        ok: Whether the motion reaches the goal and keeps every limit.
        terminal_error: Integrated end minus goal, in user coordinates, shape (N,), in their units;
            zero for coordinates that the goal leaves free. If errors grow along the motion, it is
            integrated from the goal backwards, and this is integrated start minus start.
        terminal_error_deg: The entries of `terminal_error` that are angles, in degrees; if the user
            coordinates are the triangular ones, without the path coordinate q₁.
        margins: Margin of each requirement (negative: broken), in its own unit.
        violations: Broken requirements, the worst first.
        interpolant_error: Largest |plan.q(t) − integrated q(t)|, in the coordinates' units.
        integration_error: Estimated error of the integration, in the coordinates' units; NaN if
            nothing was integrated, infinite if the motion is lost: then margins are those of q(t).
        units: Unit of each margin.
        jumps: `Plan.jump_words`: which inputs jump at an end although their rates are limited.
    """

    ok: bool
    terminal_error: Array
    terminal_error_deg: Array
    margins: Mapping[str, float]
    violations: tuple[Violation, ...]
    interpolant_error: float
    integration_error: float = np.nan
    units: Mapping[str, str] = field(default_factory=dict)
    jumps: str = ""

    def turned(self, seconds: float) -> Check:
        """Return the check of the same motion of this duration, run backwards."""
        return replace(self, violations=turned(self.violations, seconds))

    def __repr__(self) -> str:
        if self.ok:
            worst = np.max(np.abs(self.terminal_error), initial=0.0)
            jumps = f", {self.jumps}" if self.jumps else ""
            return f"Check(ok, largest error at the ends {worst:.2g} rad or m{jumps})"
        return "Check(broken: " + "; ".join(map(str, self.violations)) + ")"

    def _repr_html_(self) -> str:
        """Return the check as an HTML table for notebooks, with one row per requirement."""
        texts = {violation.label: str(violation) for violation in self.violations}
        columns: list[Column[tuple[str, float]]] = [
            Column("requirement", "", lambda r: r[0], left=True),
            Column("verdict", "", lambda r: texts.get(r[0], "kept"), left=True),
            Column("margin", "negative: broken", lambda r: r[1], "{:.4g}".format),
            Column("unit", "", lambda r: self.units.get(r[0], ""), left=True),
        ]
        broken = f"{len(texts)} of {len(self.margins)} requirements broken"
        above = "; ".join(filter(None, ["verified" if self.ok else broken, self.jumps]))
        above += f"; integrated to {self.integration_error:.1g} rad or m"
        return html_table(columns, self.margins.items(), above)


@dataclass(frozen=True)
class _Finding:
    part: Part
    value: float
    limit: float
    time_s: float | None
    tolerance: float
    upper: bool = True
    demand: Demand | None = None

    @cached_property
    def margin(self) -> float:
        return self.limit - self.value if self.upper else self.value - self.limit

    def violation(self) -> Violation | None:
        if self.margin >= -self.tolerance:  # written so that NaN does not pass
            return None
        return Violation(self.part, self.value, self.limit, self.time_s, self.demand)


def verify(plan: Plan) -> Check:
    """Verify a plan by integrating its inputs with independent code.

    Args:
        plan: Any plan, verified or not.

    Returns:
        The result; `ok` is False for a plan that cannot be executed.
    """
    expect_plan(plan)
    other = None if _flaw(plan) else plan.backwards
    return examine(other)[0].turned(plan.duration) if other else examine(plan)[0]


def examine(
    plan: Plan, times: Array | None = None, coarse: IntegratedMotion | None = None
) -> tuple[Check, IntegratedMotion | None]:
    """Verify a plan; return the check and the motion that was judged, or None without a motion.

    Args:
        plan: Any plan.
        times: Times, seconds, at which the plan's pieces are divided further before integration;
            by default they are divided only as needed.
        coarse: The motion that a call without `times` returned. If its inputs agree with those of
            this call, limits on input rates are judged by `coarse`, since on short cells rounding
            errors of the inputs look like rates.
    """
    expect_plan(plan)
    if flaw := _flaw(plan):
        return failed_check(plan, Violation(Part(flaw))), None
    if not plan.executable:
        (outside,) = (v for f in _chart_findings(plan) if (v := f.violation()))
        return failed_check(plan, outside), None
    problem = plan.problem
    to_resolve = [r for r in problem.requirements if r.smooth and not r.is_direct]

    def row_values(q: Array, u: Array) -> Array:
        point = MotionPoint.of(problem.system, q, u, np.zeros_like(u))
        pairs = ((each.parts, each.values(point)) for each in to_resolve)
        columns = [v / part.scale for both in pairs for part, v in zip(*both, strict=True)]
        return np.stack(columns, axis=-1)

    with np.errstate(all="ignore"):  # NaN never passes
        resolved = (row_values,) if to_resolve else ()
        if plan.compensation is None:
            cells = None if times is None else Cells.between(plan.t, times, FINEST_SHARE)
            needed = plan.trajectory, problem.start, INTEGRATION_TOLERANCE, *resolved
            motion = integrate(*needed, system=problem.system, cells=cells)
            if motion.error > INTERPOLANT_TOLERANCE:  # lost: the plan's own q(t) tells more
                cells = motion.cells
                q = plan.trajectory.piece_values(cells.piece, cells.fractions(points(POINTS)))[0]
                motion = replace(motion, q=q, error=np.inf, gap=(0.0, 0.0))
            end, tolerance = motion.q[-1, -1], GOAL_TOLERANCE
        else:
            motion, end, machine_error = _motion_on_machine(plan)
            tolerance = ON_MACHINE_TOLERANCE
        smooth = [requirement for requirement in problem.requirements if requirement.smooth]
        groups = [(motion, smooth)]
        if coarse is not None and coarse.input_distance(motion) <= LIMIT_TOLERANCE:
            steep = [requirement for requirement in smooth if "du" in requirement.reads]
            others = [requirement for requirement in smooth if "du" not in requirement.reads]
            groups = [(motion, others), (coarse, steep)]
        goal = problem.goal
        error = np.asarray(end - np.where(np.isnan(goal), end, goal))
        findings = [
            *_motion_findings(plan, motion, end, error, tolerance),
            *_chart_findings(plan),
            *(f for each, limits in groups for f in _limit_findings(plan, each, limits)),
            *_waypoint_distances(plan, motion, tolerance),
            *_corner_findings(plan, motion),
        ]
        if plan.compensation is not None:
            findings += _claimed_findings(plan, machine_error)
        broken = (v for f in findings if (v := f.violation()))
        violations = sorted(broken, key=lambda v: np.nan_to_num(-v.scaled, nan=-np.inf))
        if problem.system.has_user_coordinates:
            reached, target = problem.system.user(end), problem.user_goal
            error = np.asarray(reached - np.where(np.isnan(target), reached, target))
        error_deg = np.rad2deg(error[_angular(plan)])
    check = Check(
        ok=not violations,
        terminal_error=error,
        terminal_error_deg=error_deg,
        margins={f.part.label: f.margin for f in findings},
        violations=tuple(violations),
        interpolant_error=motion.gap[0],
        integration_error=motion.error,
        units={f.part.label: f.part.unit for f in findings},
        jumps=plan.jump_words,
    )
    return check, motion


def _flaw(plan: Plan) -> str:
    """Return why a plan has no motion to judge, such as another system; "" if it has a motion."""
    problem, inside = plan.problem, plan.compensates
    if other := problem.system.difference(plan.trajectory.system):
        return f"the plan is made for another system than the problem's: {other}"
    if not (plan.t[0] == 0 and np.isfinite(plan.t[-1]) and np.all(np.diff(plan.t) >= 0)):
        return "the times of the plan do not begin at 0 and increase"
    if inside is None:
        return ""
    if inside.problem != problem:
        return "its original plan solves another problem"
    return plan.clock.flaw and f"the clock of the original plan: {plan.clock.flaw}"


_SAID_ERROR = "largest error on the nominal machine, against the plan's own figure,"


def _motion_on_machine(plan: Plan) -> tuple[IntegratedMotion, Array, float]:
    """Return the nominal machine's motion under a compensated plan, its end (N,) and error E, deg.

    The inputs of a compensated plan allow for lost motion and lag, so the ideal kinematics would
    lead to another end. The plan's own q(t) should be linear between the machine's positions at the
    breaks; the Bernstein coefficients of q(t) bound the distance from that line. Between two breaks
    the machine should stay in the range between its positions at the two breaks; the largest
    distance from that range over the machine's steps is compared with `BETWEEN_TOLERANCE`. Limits,
    waypoints and clearances are judged by the machine's motion itself, on cells of at most 16
    steps of the machine.
    """
    from planner.machine.feedforward.prediction import predict  # only compensated plans need it
    from planner.machine.machine import Machine

    assert plan.compensation is not None
    machine = Machine.from_table(plan.compensation.machine)
    prediction, gap = predict(plan, machine), (np.inf, 0.0)
    if isinstance(plan.trajectory, StateTrajectory):
        c, ends = plan.trajectory.q_curve.c, prediction.q_at(plan.t)
        c = np.repeat(c, 2, axis=0) if len(c) == 1 else c
        share = np.linspace(0.0, 1.0, len(c))[:, None, None]
        gaps = np.max(np.abs(c - ends[:-1] - share * np.diff(ends, axis=0)), axis=(0, 2))
        piece = np.searchsorted(plan.t, prediction.t, side="right") - 1
        during = piece < len(gaps)
        piece, q = piece[during], prediction.q[during]
        low, high = np.minimum(ends[:-1], ends[1:])[piece], np.maximum(ends[:-1], ends[1:])[piece]
        outside = np.max(np.maximum(low - q, q - high), axis=1)
        np.maximum.at(gaps, piece, outside * INTERPOLANT_TOLERANCE / BETWEEN_TOLERANCE)
        worst = int(np.argmax(gaps))
        gap = float(gaps[worst]), float(plan.t[worst])

    def q_in(cells: Cells, count: int) -> Array:
        return prediction.q_at(cells.times(2 * points(count) - 1).T)

    cells = Cells.of(plan.t)
    cells = cells.split(_parts(cells.width, POINTS * machine.step_s))[0]
    # A series is smooth, so use short cells where reversed friction gives the motion a kink.
    between = apply(resampling(POINTS, CONTROL_POINTS), q_in(cells, POINTS))
    kinked = np.any(np.abs(q_in(cells, CONTROL_POINTS) - between) > LIMIT_TOLERANCE, axis=(0, 2))
    cells = cells.split(np.where(kinked, _parts(cells.width, machine.step_s), 1))[0]
    _, u = plan.trajectory.piece_values(cells.piece, cells.fractions(points(POINTS)))
    q = q_in(cells, POINTS)
    if not plan.is_compensated:  # the disk, which no one sees, is the ideal motion's
        prediction.end[0] = plan.goal[0]
    return IntegratedMotion(cells, q, u, 0.0, gap), prediction.end, prediction.error_deg


def _claimed_findings(plan: Plan, error_deg: float) -> Iterator[_Finding]:
    """Check what a compensated plan says of itself: the end of its clock, and its error E.

    A wrong clock changes E, since E is measured against the original plan at the clock's time.
    """
    part = Part("end of the original plan's clock", "s", 0.0, 0.0, 1.0)
    takes, ends = plan.duration, plan.clock.t[-1]
    yield _Finding(part, ends, takes, None, ROUNDING * max(1.0, takes), ends > takes)
    said = plan.notes.get("compensation")
    said = said.get("E_deg") if isinstance(said, Mapping) else None
    if isinstance(said, int | float):
        part = Part(_SAID_ERROR, "deg", 0.0, 0.0, float(np.rad2deg(1.0)))
        slack = float(np.rad2deg(ON_MACHINE_TOLERANCE))
        yield _Finding(part, error_deg, said, None, slack, error_deg > said)


def _parts(width: Array, longest: float) -> NDArray[np.int_]:
    """Return how many parts (a power of two) split each cell into parts of at most `longest` s."""
    return np.asarray(2 ** np.ceil(np.log2(np.maximum(width / longest, 1.0))), dtype=int)


def _angular(plan: Plan) -> list[int]:
    system = plan.problem.system
    which = range(system.size) if system.has_user_coordinates else system.limited
    return [i for i in which if system.user_coordinates[i].unit == "rad"]


def _motion_findings(
    plan: Plan, motion: IntegratedMotion, end: Array, error: Array, tolerance: float
) -> Iterator[_Finding]:
    """Check a plan's start, goal, duration and q(t), and the accuracy of the integrated motion."""
    for demand in plan.problem.demands:
        if isinstance(demand, Start):
            (part,), worst = demand.parts, float(np.max(np.abs(plan.q(0.0) - plan.problem.start)))
            part = replace(part, scale=GOAL_TOLERANCE)
            yield _Finding(part, worst, 0.0, 0.0, GOAL_TOLERANCE, True, demand)
        elif isinstance(demand, Goal):
            for part in demand.parts:
                far = abs(float(error[part.index]))
                yield _Finding(part, far, 0.0, plan.duration, tolerance, True, demand)
        elif isinstance(demand, Requirement) and demand.final:
            reached = demand.values(MotionPoint.of(plan.problem.system, end))
            for part, value in zip(demand.parts, map(float, reached), strict=True):
                upper = value - part.high >= part.low - value
                limit, slack = part.high if upper else part.low, tolerance * part.scale
                yield _Finding(part, value, limit, plan.duration, slack, upper, demand)
        elif isinstance(demand, Duration | LongestDuration):
            (part,), longest = demand.parts, isinstance(demand, LongestDuration)
            takes, seconds = plan.duration - (0 if longest else plan.clock.hold_s), demand.seconds
            upper = longest or takes > seconds
            yield _Finding(part, takes, seconds, None, 1e-9 * seconds, upper, demand)
    compensated, (gap, when) = plan.compensation is not None, motion.gap
    other = "the nominal machine's motion" if compensated else "its integrated input"
    part = Part(f"plan's q(t) against {other}", "", -np.inf, 0.0, 1.0)
    yield _Finding(part, gap, 0.0, when, INTERPOLANT_TOLERANCE)
    if not compensated:
        read = (
            ("plan's u(t) against the verification's series", motion.unresolved_input),
            ("requirements' values against the verification's series", motion.unresolved_values),
        )
        for label, (amount, when) in read:
            part = Part(label, "", -np.inf, 0.0, 1.0)
            yield _Finding(part, amount, 0.0, when, LIMIT_TOLERANCE)
        limit, lost = INTEGRATION_TOLERANCE, motion.error == np.inf
        doubt = "" if motion.error <= limit else " (the motion cannot be trusted)"
        cause = ": errors grow on the way, as where trailers are pushed" * (lost and plan.unstable)
        part = Part(f"integration error{doubt}{cause}", "", -np.inf, limit, limit)
        yield _Finding(part, motion.error, np.nan if lost else limit, None, 0.0)


def _chart_findings(plan: Plan) -> Iterator[_Finding]:
    """Check that a plan made in chained coordinates stays inside the chart's domain.

    The boundary of the domain counts as outside.
    """
    for demand in plan.problem.demands:
        if demand.in_chart and not plan.trajectory.in_coordinates:
            (part,), domain = demand.parts, plan.domain
            value, edge = domain.margin, -np.finfo(float).tiny
            yield _Finding(part, value, part.low, domain.time_s, edge, False, demand)


def _limit_findings(
    plan: Plan, motion: IntegratedMotion, smooth: Sequence[Requirement]
) -> Iterator[_Finding]:
    """Check smooth requirements at all times, by extremes of Chebyshev series of their values."""
    if not smooth:
        return
    system, cells = plan.problem.system, motion.cells
    point = MotionPoint.of(system, motion.q, motion.u, slopes(cells, motion.u))
    rows = ((each, zip(each.parts, each.values(point), strict=True)) for each in smooth)
    wanted = [(each, part, value) for each, pairs in rows for part, value in pairs]
    columns = np.stack([side for *_, value in wanted for side in (value, -value)], axis=-1)
    values, times = (a.reshape(-1, 2).tolist() for a in greatest(cells, columns))
    jumping = jumps(motion.u)
    for (each, part, _), (most, minus_least), when in zip(wanted, values, times, strict=True):
        below = part.low + minus_least > most - part.high
        upper = not below or part.low == -part.high  # report symmetric limits by magnitude
        value = (minus_least if upper else -minus_least) if below else most
        if "du" in each.reads and (jumping[part.index] if each.is_direct else any(jumping)):
            upper = part.high < np.inf
            value = np.inf if upper else -np.inf
        limit = part.high if upper else part.low
        time_s = when[below] if "q" in each.reads else None
        yield _Finding(part, value, limit, time_s, LIMIT_TOLERANCE * part.scale, upper, each)


def _corner_findings(plan: Plan, motion: IntegratedMotion) -> Iterator[_Finding]:
    """Check, at all times, the requirements that are not smooth functions, such as clearances.

    A requirement that every motion of the system keeps is taken as kept without a search.
    """
    system = plan.problem.system
    for requirement in plan.problem.requirements:
        if requirement.smooth:
            continue
        parts, settled = requirement.parts, requirement.values_out_of_reach(system)
        values, times = np.array(settled or []), np.zeros(len(parts))
        if settled is None:
            values, times = _least_values(
                motion,
                lambda q, r=requirement: np.stack(r.values(MotionPoint.of(system, q)), axis=-1),  # type: ignore[misc]
            )
        for part, value, when in zip(parts, values.tolist(), times.tolist(), strict=True):
            slack = LIMIT_TOLERANCE * part.scale
            yield _Finding(part, value, part.low, when, slack, False, requirement)


def failed_check(plan: Plan, violation: Violation) -> Check:
    """Return the failed check of a plan that has no motion to integrate."""
    unknown = np.full(plan.problem.system.size, np.nan)
    return Check(
        ok=False,
        terminal_error=unknown,
        terminal_error_deg=unknown[_angular(plan)],
        margins={violation.label: violation.value},
        violations=(violation,),
        interpolant_error=np.nan,
        units={violation.label: violation.unit},
    )


def _waypoint_distances(
    plan: Plan, motion: IntegratedMotion, tolerance: float
) -> Iterator[_Finding]:
    """Check the distance at which the motion passes each waypoint.

    A waypoint with a time is checked at that time of the plan's clock, a waypoint without a time by
    the least distance.
    """
    for point in plan.problem.waypoints:
        if point.time_s is None:
            values, times = _least_values(motion, lambda q, p=point: p.distance(q)[..., None])  # type: ignore[misc]
            value, when = float(values[0]), float(times[0])
        else:
            when = plan.clock.when(point.time_s)
            value = float(point.distance(motion.q_at_time(when)))
        (part,) = point.parts
        yield _Finding(part, value, 0.0, when, tolerance, True, point)


def _least_values(
    motion: IntegratedMotion, function: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """Return the least value over all time of each of F functions of q, and its time, both (F,).

    `function` maps q (…, N) to values (…, F). The functions have kinks, so dips between samples are
    narrowed without derivatives, all of them together. A dip is left out if its value, lowered by
    twice the rise to its higher neighbour, is still above the least sample.
    """
    grid, q = motion.samples()
    values = function(q)
    walls = np.full((1, *values.shape[1:]), np.inf)
    before, after = np.concatenate([walls, values[:-1]]), np.concatenate([values[1:], walls])
    sides = [np.where(np.isfinite(side), side - values, 0.0) for side in (before, after)]
    deep, least = np.maximum(*sides), np.min(values, axis=(0, 1))
    dips = (values <= before) & (values <= after) & (values - 2 * deep <= least)
    # Of what stays at the least value, as a distance from the base may, one sample will do.
    lowest = values == least
    count = np.cumsum(lowest.reshape(-1, values.shape[-1]), axis=0).reshape(values.shape)
    dips &= (deep > FLAT_DEPTH) | (lowest & (count == 1))
    sample, cell, which = np.nonzero(dips)
    low, high = grid[np.maximum(sample - 1, 0)], grid[np.minimum(sample + 1, len(grid) - 1)]
    row = np.arange(len(cell))

    def dip_values(x: Array) -> Array:
        deadline.check_stopped()
        return function(motion.q_in_cells(cell, x))[:, row, which]

    best, times_of_dips = narrow_dips(dip_values, low, high)
    out = np.full(values.shape[-1], np.nan), np.full(values.shape[-1], np.nan)
    for f in range(values.shape[-1]):
        dips_of_row = np.flatnonzero(which == f)
        if len(dips_of_row):  # empty if the motion is NaN
            k = dips_of_row[np.argmin(best[dips_of_row])]
            out[0][f], out[1][f] = best[k], motion.cells.time(cell[k], times_of_dips[k])
    return out
