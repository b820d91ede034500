"""What collocation answers when time is up before its search has ended."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from planner.errors import TimeLimitError, Violation
from planner.methods.collocation.best import Best
from planner.methods.collocation.between_nodes import excess, look
from planner.methods.collocation.pipeline import Answer
from planner.methods.collocation.refine import Polished, polish
from planner.methods.collocation.refusals import iterate_plan
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support import progress
from planner.support.deadline import MORE_TIME, Span, TimeUpError


def in_hand(
    best: Best, span: Span, problem: Problem, options: CollocationOptions
) -> tuple[Answer, Polished]:
    """The best motion found so far, refined in the rest of the time.

    Raises:
        TimeLimitError: If there is none.
    """
    with suppress(TimeUpError):
        best.keep()
    found = [motion for motion in (best.kept, best.motion) if motion is not None]
    if not found:
        raise _refusal(best, span, problem, options)
    answers = [Answer("the best found by then", "time limit", *motion) for motion in found]
    both = [
        (answer, polish(answer.task, answer.solution, options.accuracy, options.refinements))
        for answer in answers
    ]
    return min(both, key=lambda b: (not believed(b[1], options.accuracy), b[1].solution.objective))


def believed(done: Polished, accuracy: float) -> bool:
    """Whether a motion is the true one to this accuracy, and keeps its limits between the nodes."""
    seen = look(done.task, done.solution)
    return seen.error.fine(accuracy) and not excess(done.task, seen).any()


def ended_early(plan: Plan, span: Span) -> Plan:
    """The plan, which says that its search was cut short."""
    status = "interrupted" if span.ended_by else TimeLimitError.status
    said = f"{span.why} ended the search; this is the best motion found so far"
    return replace(plan, status=status, notes={**plan.notes, "ended_early": said})


def _refusal(
    best: Best, span: Span, problem: Problem, options: CollocationOptions
) -> TimeLimitError:
    far, last, broken = progress.now(), None, list[Violation]()
    if best.nearest is not None:
        last, broken = iterate_plan(problem, *best.nearest, options)
    came = "" if far is None else f" after {far.solves} solves (it was {far.doing})"
    nearest = "; the closest attempt breaks:" if broken else ""
    return TimeLimitError(
        f"{problem.source}: {span.why} ended the search before it had found a motion{came}"
        f"{nearest}",
        plan=last,
        violations=broken,
        advice=MORE_TIME,
    )
