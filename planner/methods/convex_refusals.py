"""How the convex method says no: with a certificate, the window in words, and a change it tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from planner.convex.nearby import Nearby
from planner.convex.report import broken_limits, certificate, certificate_words, class_words
from planner.convex.search import Found
from planner.convex.task import Task
from planner.errors import InfeasibleError, InputError, NoPlanError, NotConvergedError
from planner.methods.chart import WAY_OUT
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import TravelWindow, travel_window

Replan = Callable[[Problem, Mapping[str, Any]], Plan]
"""Plan a changed problem with some options changed."""


def window_words(window: TravelWindow | None) -> str:
    """The window of one-way travels, in words."""
    if window is None:
        return ""
    return (
        f"one-way motions of any kind have travels between {window.low:.6g} and"
        f" {window.high:.6g} rad"
    )


def travel_refusal(problem: Problem, window: TravelWindow) -> InfeasibleError:
    """The problem's travel lies outside the window."""
    return InfeasibleError(
        f"{problem.source}: goal.travel = {problem.travel:.6g} rad:"
        f" {window.reason or window_words(window)}",
        advice=WAY_OUT if window.empty else f"a goal.travel between, or 'free'; or {WAY_OUT}",
    )


def zero_refusal(problem: Problem) -> InfeasibleError:
    """The travel is zero."""
    return InfeasibleError(
        f"{problem.source}: travel = 0, and with v1 constant nothing moves but z2",
        advice=f"the method 'polynomial', which goes out and back; or {WAY_OUT}",
    )


def speed_refusal(problem: Problem, least: float, top: float) -> InfeasibleError:
    """The least travel takes longer than the duration."""
    assert problem.duration is not None
    return InfeasibleError(
        f"{problem.source}: a one-way motion must travel {least:.4g} rad, and |u1| <="
        f" {problem.limits.input[0]:.4g} rad/s allows at most {top:.4g} rad in"
        f" {problem.duration:.4g} s",
        advice=f"goal.duration longer than {problem.duration * least / top:.4g} s, or 'free'",
    )


def class_refusal(task: Task, found: Found, replan: Replan) -> NoPlanError:
    """No path of the class was found inside the domain; with a certificate where there is one."""
    problem = task.problem
    words = window_words(travel_window(problem))
    if not found.refusals:
        return NotConvergedError(
            f"{problem.source}: no path with {class_words(task.frame)} was found that stays inside"
            f" the chart's domain ({words or f'{found.tried} travels tried'})",
            advice=f"more method.convex.pieces or another {problem.travel_key}; or {WAY_OUT}",
        )
    proof = certificate_words(task, found.refusals[0])
    if problem.travel is None:
        return NotConvergedError(
            f"{problem.source}: {len(found.refusals)} of {found.tried} travels tried are proven to"
            f" have no path; for one, {proof}; {words}",
            advice=f"a smaller limits.z2_margin or more method.convex.pieces; or {WAY_OUT}",
        )
    error = InfeasibleError(
        f"{problem.source}: {proof}; {words}", advice=_other_travel(problem, replan)
    )
    error.certificate = certificate(found.refusals[0])
    return error


def _other_travel(problem: Problem, replan: Replan) -> str:
    try:
        plan = replan(problem.with_travel(None), {})
    except (NoPlanError, InputError):
        return f"a smaller limits.z2_margin or more method.convex.pieces; or {WAY_OUT}"
    ((key, value),) = problem.travel_change(plan.travel).items()
    return f"{key} = {value:.6g} (tried), or 'free'"


def limits_refusal(task: Task, nearby: Nearby, plan: Plan) -> NotConvergedError:
    """Paths inside the domain were found, but none that keeps the limits."""
    problem = task.problem
    advice = f"wider limits; or {WAY_OUT}"
    if nearby.eased and problem.duration is not None:
        seconds = problem.duration * task.eased().level(nearby.local) * 1.0001
        advice = (
            f"goal.duration = {seconds:.6g} (this path, slower, then keeps them), or 'free';"
            f" or {WAY_OUT}"
        )
    return NotConvergedError(
        f"{problem.source}: no path with {class_words(task.frame)} was found that keeps every"
        f" limit; the nearest of {nearby.tried} local optima, at travel {plan.travel:.6g}, breaks",
        plan=replace(plan, status=NotConvergedError.status),
        violations=broken_limits(task, nearby.frame, nearby.local.y, plan.duration),
        advice=advice,
    )
