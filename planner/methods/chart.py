"""What every method that plans inside the chart asks first, and how it refuses."""

from __future__ import annotations

import numpy as np

from planner.chained import chained_form
from planner.errors import InputError, SingularError
from planner.measures import peak_inputs, peak_rates
from planner.methods.refusal import BY_COLLOCATION
from planner.plan import Plan
from planner.problem import Problem
from planner.systems.base import Array
from planner.trajectory import Trajectory


def chart_ends(problem: Problem, travel: float) -> tuple[Array, Array]:
    """z(0) and z(T), shape (N,) each, of a problem that a chart method can take.

    Raises:
        SingularError: If the start or goal lies on a singularity of the chart, or the goal lies on
            another branch than the start.
    """
    goal = problem.goal.copy()
    goal[0] = problem.start[0] + travel
    labels = problem.system.margin_labels
    for name, q in (("start", problem.start), ("goal", goal)):
        margins = problem.system.chart_margins(q, problem.branch)
        if np.min(margins) > 0:
            continue
        worst = int(np.argmin(margins))
        reason = _edge(problem, name, q, *labels[worst], abs(float(margins[worst])) < 1e-15)
        raise SingularError(f"{problem.source}: {reason}", changes=[BY_COLLOCATION])
    form = chained_form(problem.system)
    return form.z(problem.start), form.z(goal)


def _edge(problem: Problem, name: str, q: Array, i: int, label: str, on_it: bool) -> str:
    coordinate = problem.system.coordinates[i]
    unit = "deg" if coordinate.unit == "rad" else coordinate.unit
    start, here = (np.rad2deg(v[i]) if unit == "deg" else v[i] for v in (problem.start, q))
    if problem.branch[i] == 0 or on_it:
        return (
            f"the {name} has {coordinate.name} = {here:.6g} {unit},"
            " where the chained-form chart is singular"
        )
    if f"{coordinate.name} = 0" in label:
        return f"{coordinate.name} changes sign on the way, which no path in the chart can do"
    return (
        f"{coordinate.name} goes from {start:.6g} to {here:.6g} {unit}, past an edge of the"
        f" chained-form chart ({label}), which no path in the chart can do"
    )


def fit_duration(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """With the duration free, the fastest uniform timing of a path within the input limits.

    A driftless path does not depend on its timing, so inputs scale with 1/T and rates with 1/T².

    Raises:
        InputError: If the duration is free and no input has a limit.
    """
    if problem.duration is not None:
        return trajectory
    limits = problem.limits
    if not np.any(np.isfinite(limits.input)):
        raise InputError(
            f"{problem.source}: goal.duration is free but [limits] holds no limit of an input;"
            " set one of them"
        )
    factor = float(np.max(peak_inputs(trajectory) / limits.input))
    if np.any(np.isfinite(limits.input_rate)):
        factor = max(factor, float(np.sqrt(np.max(peak_rates(trajectory) / limits.input_rate))))
    if not np.isfinite(factor):  # outside the domain, which is for the caller to refuse
        return trajectory
    return trajectory.slowed(factor * (1 + 1e-9))


def refuse_outside(plan: Plan) -> None:
    """Refuse a plan that leaves the chart's domain.

    Raises:
        SingularError: With the times at which it leaves and re-enters.
    """
    report = plan.domain
    if report.ok:
        return
    exits = ", ".join(f"{t:.4f}" for t in report.exits_s) or f"{report.time_s:.4f}"
    crossings = ", ".join(f"{t:.4f}" for t in report.z2_crossings_s)
    zero = (
        f"; z2 = 0 at t = {crossings} s"
        if crossings
        else "; z2 keeps its sign, yet no real angle exists there"
    )
    tried = plan.notes.get("auto_motions_tried")
    which = (
        f"the {plan.method} plan" if tried is None else f"the best {plan.method} plan of {tried}"
    )
    raise SingularError(
        f"{plan.problem.source}: {which} leaves the domain of the chained-form chart"
        f" at t = {exits} s (worst margin {report.margin:.4g} at t = {report.time_s:.4f} s:"
        f" {report.label}){zero}",
        times_s=report.singular_times_s,
        plan=plan,
        advice=f"another {plan.problem.travel_key} (or 'free') or constraint point",
        changes=[BY_COLLOCATION],
    )
