"""How collocation says no: the fastest motion found, what stands in the way, a change it tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planner.duration import why_too_short
from planner.errors import InfeasibleError, NoPlanError, NotConvergedError
from planner.methods.remedies import Change, UnexplainedError, least, longer, travelling, tried
from planner.ocp.pipeline import Pipeline
from planner.ocp.polish import Polished
from planner.ocp.refusal import Obstacle, obstacles
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched
from planner.ocp.violations import broken_limits, broken_rows
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.methods import CollocationOptions

NAME = "collocation"

Planning = Callable[[Problem, CollocationOptions], Plan]

NONE_HELPS = "another start or goal, or wider limits; in vain were tried {}"


def refusal(search: Pipeline) -> UnexplainedError:
    """Why a search has no answer."""
    assert search.last is not None
    job, last = search.last
    if search.fastest is not None:
        return too_short(job, search.fastest, search.options)
    if search.pathless:
        return no_path(job, last, f"{len(search.log)} starts", search.options)
    return not_converged(job, last, search.options, "the paths found")


def too_short(job: Task, shortest: Polished, options: CollocationOptions) -> UnexplainedError:
    """The fastest motion found, squeezed into the duration asked for, shows what that breaks."""
    problem, wanted = job.problem, job.problem.duration
    found = shortest.solution.iterate.duration
    assert wanted is not None

    def explained(plan: Planning) -> NoPlanError:
        def again(changed: Problem) -> Plan:
            return plan(changed, options)

        iterate = stretched(shortest.solution.iterate, wanted)
        squeezed = replace(shortest.solution, iterate=iterate)
        task, proof = shortest.task.asking(problem, job.objective), why_too_short(problem)
        error = InfeasibleError if proof else NotConvergedError
        why = f"{proof}. The" if proof else f"goal.duration = {wanted:g} s is too short: the"
        return error(
            f"{problem.source}: {why} fastest motion found takes {found:.4g} s. Squeezed into"
            f" {wanted:g} s it breaks:",
            plan=iterate_plan(task, squeezed, options),
            violations=broken_limits(task, squeezed),
            advice=tried(longer(problem, share * found, again, " or more") for share in (1.0, 1.05))
            or "a longer goal.duration, or wider limits on the inputs",
        )

    return UnexplainedError(explained)


def no_path(
    job: Task, last: Solution, starts: str, options: CollocationOptions
) -> UnexplainedError:
    """No start led to a path: what stands in the way, found by leaving it out."""

    def explained(plan: Planning) -> NoPlanError:
        for found in obstacles(job):
            if advice := tried([_without(found, plan, options)]):
                return _obstructed(job, found, starts, options, advice)
        return not_converged(job, last, options, starts).explained(plan)

    return UnexplainedError(explained)


def _without(found: Obstacle, plan: Planning, options: CollocationOptions) -> Change:
    return Change(lambda _: found.advice, lambda: plan(found.problem, options))


def _obstructed(
    job: Task, found: Obstacle, starts: str, options: CollocationOptions, advice: str
) -> NotConvergedError:
    return NotConvergedError(
        f"{job.problem.source}: no motion from start to goal was found from {starts}; without"
        f" {found.what} there is one, which breaks:",
        plan=iterate_plan(job, found.solution, options),
        violations=found.violations,
        advice=advice,
    )


def not_converged(
    job: Task, solution: Solution, options: CollocationOptions, starts: str
) -> UnexplainedError:
    """The solver stopped short of a motion."""

    def explained(plan: Planning) -> NoPlanError:
        named, proof = _changes(job.problem, options, plan), why_too_short(job.problem)
        error = InfeasibleError if proof else NotConvergedError
        in_vain = NONE_HELPS.format(", ".join(named) or "no changes")
        return error(
            f"{job.problem.source}: {f'{proof}; and ' if proof else ''}the solver found no motion"
            f" from {starts} (it says {solution.status} after {solution.iterations} iterations)",
            plan=iterate_plan(job, solution, options),
            violations=broken_rows(job, solution),
            advice=tried(named.values()) or in_vain,
        )

    return UnexplainedError(explained)


def _changes(problem: Problem, options: CollocationOptions, plan: Planning) -> dict[str, Change]:
    """Changes by name: options left out, then what the problem prescribes."""
    out, default = {}, CollocationOptions(time_limit_s=options.time_limit_s)
    anywhere = problem.with_travel(None)
    if options != default:
        what = "the default options of method.collocation"
        out[what] = Change(lambda _: what, lambda: plan(problem, default))
    if problem.duration is not None:
        out['goal.duration = "free"'] = Change(
            lambda found: f'goal.duration = {least(found.duration)} or "free"',
            lambda: plan(replace(problem, duration=None), default),
        )
    if problem.travel is not None:
        out["a free travel"] = Change(travelling, lambda: plan(anywhere, default))
    if problem.duration is not None and problem.travel is not None:
        out["both"] = Change(
            lambda found: f"{travelling(found)} and goal.duration = {least(found.duration)}",
            lambda: plan(replace(anywhere, duration=None), default),
        )
    return out


def iterate_plan(job: Task, solution: Solution, options: CollocationOptions) -> Plan | None:
    """A last iterate, for study; None if even its duration is no number any more."""
    if not np.isfinite(solution.iterate.duration):
        return None
    return Plan(
        problem=job.problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=job.curve(solution.iterate),
        status=NotConvergedError.status,
        objective=solution.objective,
        objective_name=job.objective.name,
        iterations=solution.iterations,
        notes={"solver_status": solution.status, "largest_residual": solution.residual},
    )
