"""The independent judge of a plan.

It integrates the plan's own input u(t) with an adaptive Runge–Kutta method (SciPy's DOP853) through
the system's NumPy kinematics, neither of which any method uses, and checks goal and limits over all
time, between the breaks too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from planner.chained import chained_form
from planner.errors import Violation
from planner.extrema import maximum, minimum, sample_times
from planner.html_table import html_table
from planner.measures import peak_inputs, peak_rates
from planner.places import Motion, clearances, passes
from planner.plan import Plan, expect_plan
from planner.systems.base import Array

GOAL_TOLERANCE = 2e-5
"""Largest error at the goal, in radians (0.0011 degrees) or metres."""

LIMIT_TOLERANCE = 1e-6
"""Largest excess over a limit, relative to the limit."""

INTERPOLANT_TOLERANCE = 1e-4
"""Largest difference between the plan's q(t) and the integrated motion, in radians or metres."""


@dataclass(frozen=True)
class Check:
    """What `verify` finds.

    Attributes:
        ok: Whether the motion reaches the goal and keeps every limit.
        terminal_error: Integrated end minus goal, shape (N,), in the coordinates' units; the path
            coordinate's is zero when the travel is free.
        terminal_error_deg: The same for the coordinates after the first that are angles, degrees.
        margins: For each requirement, how far it is kept (negative: broken), in its own unit.
        violations: The broken ones, worst first.
        interpolant_error: Largest |plan.q(t) − integrated q(t)|, in the coordinates' units.
    """

    ok: bool
    terminal_error: Array
    terminal_error_deg: Array
    margins: Mapping[str, float]
    violations: tuple[Violation, ...]
    interpolant_error: float

    def __repr__(self) -> str:
        if self.ok:
            worst = np.max(np.abs(self.terminal_error), initial=0.0)
            return f"Check(ok, largest error at the goal {worst:.2g})"
        return "Check(broken: " + "; ".join(map(str, self.violations)) + ")"

    def _repr_html_(self) -> str:
        """What a notebook shows: one row a requirement."""
        broken = {violation.label: str(violation) for violation in self.violations}
        rows = [
            (label, broken.get(label, "kept"), f"{margin:.4g}")
            for label, margin in self.margins.items()
        ]
        above = "verified" if self.ok else f"{len(broken)} of {len(rows)} requirements broken"
        return html_table(("requirement", "verdict", "margin (negative: broken)"), rows, above)


@dataclass(frozen=True)
class _Finding:
    label: str
    value: float
    limit: float
    time_s: float | None
    unit: str
    scale: float
    tolerance: float
    upper: bool = True

    @property
    def margin(self) -> float:
        return self.limit - self.value if self.upper else self.value - self.limit

    def violation(self) -> Violation | None:
        if self.margin >= -self.tolerance:  # NaN must not pass
            return None
        scaled = -self.margin / self.scale
        return Violation(self.label, self.time_s, self.value, self.limit, self.unit, scaled)


def verify(plan: Plan) -> Check:
    """Judge a plan by integrating its input.

    Args:
        plan: Any plan, verified or not.

    Returns:
        The findings; `ok` is False for a plan that cannot be executed.
    """
    expect_plan(plan)
    if not plan.executable:
        return _not_executable(plan)
    motion, times = integrate(plan)
    findings = [
        *_start(plan),
        *_goal(plan, motion),
        *_interpolant(plan, motion, times),
        *_inputs(plan),
        *_joints(plan, motion, times),
        *_chart(plan, motion, times),
        *_places(plan, motion, times),
    ]
    broken = sorted((v for f in findings if (v := f.violation())), key=lambda v: -v.scaled)
    error = _goal_error(plan, motion)
    angular = [i for i in plan.problem.system.limited if _unit(plan, i) == "rad"]
    return Check(
        ok=not broken,
        terminal_error=error,
        terminal_error_deg=np.rad2deg(error[angular]),
        margins={f.label: f.margin for f in findings},
        violations=tuple(broken),
        interpolant_error=next(f.value for f in findings if f.label == _INTERPOLANT),
    )


def integrate(plan: Plan, rtol: float = 1e-10, atol: float = 1e-12) -> tuple[Motion, Array]:
    """Integrate the plan's input from the problem's start, piece by piece.

    Returns:
        The motion, times (m,) to q (m, N), and sample times that cover all of it.
    """
    system = plan.problem.system
    edges, pieces, q = plan.t, [], plan.problem.start
    for a, b in pairwise(edges):
        last = np.nextafter(b, a) if b != edges[-1] else b

        def rates(t: float, q: Array, last: float = last) -> Array:
            return system.rates(q, plan.u(min(t, last)))

        solution = solve_ivp(rates, (a, b), q, "DOP853", rtol=rtol, atol=atol, dense_output=True)
        if not solution.success:
            raise ArithmeticError(
                f"integration stopped at t = {solution.t[-1]:g} s: {solution.message}"
            )
        pieces.append(solution.sol)
        q = solution.y[:, -1]

    def motion(t: Array) -> Array:
        t = np.atleast_1d(t)
        which = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(pieces) - 1)
        out = np.empty((len(t), system.size))
        for k in np.unique(which):
            out[which == k] = pieces[k](t[which == k]).T
        return out

    return motion, sample_times(edges)


_INTERPOLANT = "plan's q(t) against its integrated input"


def _unit(plan: Plan, i: int) -> str:
    return plan.problem.system.coordinates[i].unit


def _goal_error(plan: Plan, motion: Motion) -> Array:
    problem = plan.problem
    goal = problem.goal.copy()
    end = motion(np.array([plan.duration]))[0]
    goal[0] = end[0] if problem.travel is None else problem.start[0] + problem.travel
    return np.asarray(end - goal)


def _start(plan: Plan) -> list[_Finding]:
    worst = float(np.max(np.abs(plan.q(0.0) - plan.problem.start)))
    return [_Finding("start", worst, 0.0, 0.0, "", GOAL_TOLERANCE, GOAL_TOLERANCE)]


def _goal(plan: Plan, motion: Motion) -> list[_Finding]:
    out = []
    for i, error in enumerate(_goal_error(plan, motion)):
        label = f"goal {plan.problem.system.coordinates[i].name}"
        out.append(
            _Finding(label, abs(error), 0.0, plan.duration, _unit(plan, i), 1.0, GOAL_TOLERANCE)
        )
    wanted = plan.problem.duration
    if wanted is not None:
        late = abs(plan.duration - wanted)
        out.append(_Finding("duration", late, 0.0, None, "s", wanted, 1e-9 * wanted))
    return out


def _interpolant(plan: Plan, motion: Motion, times: Array) -> list[_Finding]:
    gap = np.max(np.abs(motion(times) - plan.q(times)), axis=-1)
    k = int(np.argmax(gap))
    tolerance = INTERPOLANT_TOLERANCE
    return [_Finding(_INTERPOLANT, float(gap[k]), 0.0, float(times[k]), "", 1.0, tolerance)]


def _inputs(plan: Plan) -> list[_Finding]:
    limits, out = plan.problem.limits, []
    kinds = [("input", limits.input, peak_inputs), ("rate of input", limits.input_rate, peak_rates)]
    for kind, limit, measure in kinds:
        if not np.any(np.isfinite(limit)):
            continue
        peaks = measure(plan.trajectory)
        for i, coordinate in enumerate(plan.problem.system.inputs):
            unit = coordinate.unit + ("/s" if kind != "input" else "")
            label = f"{kind} {coordinate.name}"
            slack = LIMIT_TOLERANCE * limit[i]
            out.append(_Finding(label, peaks[i], limit[i], None, unit, limit[i], slack))
    return [f for f in out if np.isfinite(f.limit)]


def _joints(plan: Plan, motion: Motion, times: Array) -> list[_Finding]:
    out = []
    for i, limit in enumerate(plan.problem.limits.joint):
        if not np.isfinite(limit):
            continue
        value, when = maximum(lambda t, i=i: np.abs(motion(t)[:, i]), times)  # type: ignore[misc]
        label = f"joint {plan.problem.system.coordinates[i].name}"
        slack = LIMIT_TOLERANCE * limit
        out.append(_Finding(label, value, limit, when, _unit(plan, i), limit, slack))
    return out


def _chart(plan: Plan, motion: Motion, times: Array) -> list[_Finding]:
    margin = plan.problem.limits.z2_margin
    if margin is None:
        return []
    form, sign = chained_form(plan.problem.system), plan.problem.z2_sign
    value, when = minimum(lambda t: sign * form.z(motion(t))[:, 1], times)
    slack = LIMIT_TOLERANCE * max(margin, 1e-3)
    return [_Finding("z2 margin", value, margin, when, "", max(margin, 1e-3), slack, upper=False)]


def _places(plan: Plan, motion: Motion, times: Array) -> list[_Finding]:
    """Waypoints passed, and obstacles cleared by every link."""
    problem, tolerance = plan.problem, GOAL_TOLERANCE
    return [
        *(
            _Finding(label, value, 0.0, when, unit, 1.0, tolerance)
            for label, value, when, unit in passes(problem, motion, times)
        ),
        *(
            _Finding(label, value, 0.0, when, "m", size, LIMIT_TOLERANCE * size, upper=False)
            for label, value, when, size in clearances(problem, motion, times)
        ),
    ]


def _not_executable(plan: Plan) -> Check:
    domain = plan.domain
    unknown = np.full(plan.problem.system.size, np.nan)
    violation = Violation(
        f"chart domain ({domain.label})", domain.time_s, domain.margin, 0.0, "", -domain.margin
    )
    angular = [i for i in plan.problem.system.limited if _unit(plan, i) == "rad"]
    return Check(
        ok=False,
        terminal_error=unknown,
        terminal_error_deg=unknown[angular],
        margins={"chart domain": domain.margin},
        violations=(violation,),
        interpolant_error=np.nan,
    )
