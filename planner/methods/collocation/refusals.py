"""Refusals by collocation, each with the violations of the last motion and changes to try."""

from __future__ import annotations

import numpy as np

from planner.errors import InfeasibleError, NoPlanError, NotConvergedError, Violation
from planner.methods.collocation.best import Candidate, Record
from planner.methods.collocation.path import needed_duration
from planner.methods.collocation.task import stretch_to
from planner.methods.refusal import (
    Change,
    duration_change,
    duration_changes,
    looser_limits,
    path_changes,
    reach_changes,
    travel_changes,
)
from planner.plan.plan import Plan
from planner.problem.feasibility import why_too_short
from planner.problem.problem import Problem
from planner.problem.reach import goal_reach
from planner.problem.tables.method_options import CollocationOptions
from planner.verification.verify import verify

NAME = "collocation"

LONGER_DURATION = 1.05
"""Factor on the shortest duration found, for a longer duration to try if the shortest fails."""


def no_goal(problem: Problem) -> NoPlanError:
    """Return the refusal of a goal with free joints for which no pose within limits is found."""
    reach, tip = goal_reach(problem), problem.tip
    assert reach is not None
    why = f"put {tip}" if tip else "keep all limits"
    if tip and reach.blocked:
        why += " and keep all limits there"
    elif tip:
        why += f"; the nearest angles found miss the goal by {reach.missed_words}"
    return NotConvergedError(
        f"no joint angles within the limits were found that {why}",
        source=problem.source,
        changes=[*reach_changes(problem, reach), *path_changes(problem)],
        advice="another goal",
    )


def too_short(problem: Problem, fastest: Candidate, options: CollocationOptions) -> NoPlanError:
    """Return the refusal of a duration that is shorter than the fastest motion found.

    The refusal lists the violations of the fastest motion, shortened to the given duration.
    """
    fastest_s, given = fastest.solution.iterate.duration, problem.duration
    proof = why_too_short(problem)
    finding = f"fastest motion found takes {fastest_s:.4g} s"
    why = f"{proof}. The" if proof else f"goal.duration = {given:g} s is too short: the"
    plan, violations = iterate_plan(problem, fastest, options)
    error = (InfeasibleError if proof else NotConvergedError)(
        f"{why} {finding}",
        source=problem.source,
        list_head=f". Shortened to {given:g} s, that motion breaks:",
        plan=plan,
        violations=violations,
        changes=[
            *motion_changes(problem, options),
            duration_change(fastest_s),
            duration_change(LONGER_DURATION * fastest_s),
        ],
        advice=f"larger {problem.limits.input_words}",
    )
    error.finding = f"the {finding}" if proof else None
    return error


def refusal(problem: Problem, record: Record, options: CollocationOptions) -> NoPlanError:
    """Return the refusal of a search that found only too slow motions, no path, or no motion.

    Paths are the same for every duration. So if no path was found, only changes of the requirements
    that paths keep can help.
    """
    if record.fastest is not None:
        return too_short(problem, record.fastest, options)
    assert record.last is not None
    solution = record.last.solution
    plan, violations = iterate_plan(problem, record.last, options)
    proof = why_too_short(problem)
    changes = path_changes(problem)
    if record.pathless:
        changes += travel_changes(problem, "the travel")
    else:
        changes = motion_changes(problem, options) + duration_changes(problem) + changes
    if options != CollocationOptions(time_limit_s=options.time_limit_s):
        words = "the default options of method.collocation"
        changes.append(Change({"method.collocation": {}}, words, defaults=True))
    count = len(record.log)
    starts = f"{count} start{'s' * (count != 1)}" if record.pathless else "the paths found"
    said = f" (solver status: {solution.status} after {solution.iterations} iterations)"
    finding = f"the solver found no motion from {starts}{'' if solution.ok else said}"
    error = (InfeasibleError if proof else NotConvergedError)(
        f"{proof}; and {finding}" if proof else finding,
        source=problem.source,
        plan=plan,
        violations=violations,
        changes=changes,
        advice=", or ".join(["another start or goal", *looser_limits(problem, record.pathless)]),
    )
    error.finding = finding if proof else None
    return error


def motion_changes(problem: Problem, options: CollocationOptions) -> list[Change]:
    """Return the change that allows motion at the ends, in a list; [] unless `rest` forbids it."""
    change = Change({f"method.{NAME}.rest": False})
    resting = options.rest == "auto" and problem.rests("auto")
    return [change] if resting else []


def iterate_plan(
    problem: Problem, candidate: Candidate, options: CollocationOptions
) -> tuple[Plan | None, list[Violation]]:
    """Make an unverified plan of an iterate in the given duration; return it and its violations.

    The violations refer to the original problem, not to the task's variant. The result is None and
    an empty list if the iterate's duration is infinite or NaN.
    """
    job, solution = candidate.task, candidate.solution
    iterate = solution.iterate
    if not np.isfinite(iterate.duration):
        return None, []
    needed = needed_duration(problem, job.mesh, iterate)
    iterate = stretch_to(iterate, problem.duration or needed or iterate.duration)
    plan = Plan(
        problem=problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=job.curve(iterate),
        status=NotConvergedError.status,
        objective=solution.objective,
        aim=job.objective,
        iterations=solution.iterations,
        notes={"solver_status": solution.status, "largest_residual": solution.residual},
    )
    try:
        return plan, list(verify(plan).violations)
    except (ArithmeticError, ValueError):  # an iterate may have any values
        return plan, []
