"""How the convex method says no: with a certificate, the window in words, and a change it tried."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from planner.convex.nearby import Nearby
from planner.convex.report import broken_limits, certificate, certificate_words, class_words
from planner.convex.search import Found
from planner.convex.task import Task
from planner.duration import least_duration
from planner.errors import (
    InfeasibleError,
    InputError,
    NoPlanError,
    NotConvergedError,
    SingularError,
)
from planner.methods.remedies import (
    TRIED,
    Change,
    UnexplainedError,
    least,
    longer,
    travelling,
    tried,
)
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import TravelWindow, travel_window
from planner.verify import verify

Replan = Callable[[Problem], Plan]
"""Plan a changed problem with the same options."""

COLLOCATION, OTHER_ENDS = "use the method 'collocation'", "another start or goal, or wider limits"

AMPLE = 2.0
"""Times the duration that the travel alone needs: what else has to move then often has time."""

MORE = (1.0, 1.1, 1.5)
"""Times a duration in which one path keeps the limits: the method may settle on another."""

Refusal = Callable[[str], NoPlanError]
"""From advice to the refusal."""


def window_words(window: TravelWindow | None) -> str:
    """The window of one-way travels, in words."""
    if window is None:
        return ""
    return (
        f"one-way motions of any kind have travels between {window.low:.6g} and"
        f" {window.high:.6g} rad"
    )


def travel_refusal(problem: Problem, window: TravelWindow) -> UnexplainedError:
    """The problem's travel lies outside the window."""
    why = f"goal.travel = {problem.travel:.6g} rad: {window.reason or window_words(window)}"
    advice = OTHER_ENDS if window.empty else "a goal.travel between, or 'free'"
    return _refused(problem, lambda ways: _infeasible(problem, why, ways), advice)


def duration_refusal(problem: Problem, why: str) -> UnexplainedError:
    """No motion of any kind keeps the duration."""
    ample = AMPLE * least_duration(problem).seconds
    return _refused(problem, lambda ways: _infeasible(problem, why, ways), OTHER_ENDS, ample)


def zero_refusal(problem: Problem) -> UnexplainedError:
    """The travel is zero."""
    why = "travel = 0, and with v1 constant nothing moves but z2"
    return _refused(problem, lambda ways: _infeasible(problem, why, ways), OTHER_ENDS)


def one_way_refusal(error: InfeasibleError, problem: Problem) -> UnexplainedError:
    """No one-way motion exists, whatever its travel."""
    return _refused(problem, lambda ways: InfeasibleError(error.reason, advice=ways), OTHER_ENDS)


def speed_refusal(problem: Problem, least: float, top: float) -> UnexplainedError:
    """The least travel takes longer than the duration."""
    assert problem.duration is not None
    why = (
        f"a one-way motion must travel {least:.4g} rad, and |u1| <="
        f" {problem.limits.input[0]:.4g} rad/s allows at most {top:.4g} rad in"
        f" {problem.duration:.4g} s"
    )
    needed = problem.duration * least / top
    advice = f"goal.duration longer than {needed:.4g} s"
    return _refused(problem, lambda ways: _infeasible(problem, why, ways), advice, AMPLE * needed)


def chart_refusal(error: SingularError, problem: Problem) -> SingularError:
    """Start and goal are not in one branch of the chart."""
    return SingularError(
        error.reason,
        times_s=error.times_s,
        plan=error.plan,
        violations=error.violations,
        advice=_by_collocation(problem) or error.advice,
    )


def class_refusal(task: Task, found: Found) -> UnexplainedError:
    """No path of the class was found inside the domain; with a certificate where there is one."""
    problem = task.problem
    words = window_words(travel_window(problem))
    advice = "a smaller limits.z2_margin or more method.convex.pieces"
    if not found.refusals:
        why = (
            f"no path with {class_words(task.frame)} was found that stays inside the chart's"
            f" domain ({words or f'{found.tried} travels tried'})"
        )
        advice = f"more method.convex.pieces or another {problem.travel_key}"
        return _refused(problem, lambda ways: _not_found(problem, why, ways), advice)
    proof = certificate_words(task, found.refusals[0])
    if problem.travel is None:
        why = (
            f"{len(found.refusals)} of {found.tried} travels tried are proven to have no path; for"
            f" one, {proof}; {words}"
        )
        return _refused(problem, lambda ways: _not_found(problem, why, ways), advice)

    def refusal(ways: str) -> NoPlanError:
        error = _infeasible(problem, f"{proof}; {words}", ways)
        error.certificate = certificate(found.refusals[0])
        return error

    return _refused(problem, refusal, advice)


def limits_refusal(task: Task, nearby: Nearby, plan: Plan) -> UnexplainedError:
    """Paths inside the domain were found, but none that keeps the limits."""
    problem, slower = task.problem, None
    if nearby.eased and problem.duration is not None:
        slower = problem.duration * task.eased().level(nearby.local) * 1.0001
    last = replace(plan, status=NotConvergedError.status)

    def refusal(ways: str) -> NoPlanError:
        return NotConvergedError(
            f"{problem.source}: no path with {class_words(task.frame)} was found that keeps every"
            f" limit; the nearest of {nearby.tried} local optima, at travel {plan.travel:.6g},"
            " breaks",
            plan=last,
            violations=broken_limits(task, nearby.frame, nearby.local.y, plan.duration),
            advice=ways,
        )

    return _refused(problem, refusal, "wider limits", slower, last)


def _infeasible(problem: Problem, why: str, ways: str) -> InfeasibleError:
    return InfeasibleError(f"{problem.source}: {why}", advice=ways)


def _not_found(problem: Problem, why: str, ways: str) -> NotConvergedError:
    return NotConvergedError(f"{problem.source}: {why}", advice=ways)


def _refused(
    problem: Problem,
    refusal: Refusal,
    advice: str,
    slower: float | None = None,
    last: Plan | None = None,
) -> UnexplainedError:
    """A refusal whose advice is the first change that works, or else these words."""

    def explained(replan: Replan) -> NoPlanError:
        def own() -> str | None:
            return tried(_changes(problem, replan, slower))

        def other() -> str | None:
            return _by_collocation(problem)

        first, second = (other, own) if problem.travel == 0 else (own, other)
        return refusal(first() or second() or advice)

    return UnexplainedError(explained, last)


def _changes(problem: Problem, replan: Replan, slower: float | None) -> Iterator[Change]:
    """More time where that is known to help, another travel, any time."""
    for seconds in [] if slower is None else [share * slower for share in MORE]:
        yield longer(problem, seconds, replan)
    if problem.travel is not None:
        anywhere = problem.with_travel(None)
        yield Change(travelling, lambda: replan(anywhere))
    if problem.duration is not None:
        unhurried = replace(problem, duration=None)
        yield Change(
            lambda plan: f"goal.duration = {least(plan.duration)}", lambda: replan(unhurried)
        )


def _by_collocation(problem: Problem) -> str | None:
    """The other method, if need be with a change that it has tried; None if that does not help."""
    from planner.methods.collocation import plan_collocation  # which asks this method for starts

    try:
        plan = plan_collocation(problem, problem.methods.collocation)
    except InputError:
        return None
    except NoPlanError as error:
        helps = error.advice is not None and error.advice.endswith(TRIED)
        return f"{COLLOCATION} with {error.advice}" if helps else None
    return COLLOCATION + TRIED if verify(plan).ok else None
