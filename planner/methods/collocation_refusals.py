"""How collocation says no: the fastest motion found, what stands in the way, a change it tried."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.duration import why_too_short
from planner.errors import InfeasibleError, NoPlanError, NotConvergedError
from planner.ocp.polish import Polished
from planner.ocp.refusal import obstacle
from planner.ocp.search import Search
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched
from planner.ocp.violations import broken_limits, broken_rows
from planner.plan import Plan
from planner.schema.methods import CollocationOptions

NAME = "collocation"


def too_short(job: Task, shortest: Polished, options: CollocationOptions) -> NoPlanError:
    """The fastest motion found, squeezed into the duration asked for, shows what that breaks."""
    wanted, found = job.problem.duration, shortest.solution.iterate.duration
    assert wanted is not None
    task = job.on(shortest.task.mesh)
    iterate = stretched(shortest.solution.iterate, wanted)
    squeezed = replace(shortest.solution, iterate=iterate)
    proof = why_too_short(job.problem)
    error = InfeasibleError if proof else NotConvergedError
    why = f"{proof}. The" if proof else f"goal.duration = {wanted:g} s is too short: the"
    return error(
        f"{job.problem.source}: {why} fastest motion found takes {found:.4g} s. Squeezed into"
        f" {wanted:g} s it breaks:",
        plan=_iterate_plan(task, squeezed, options),
        violations=broken_limits(task, squeezed),
        advice=f"goal.duration = {_rounded_up(found)} or more (a motion of {found:.4g} s was"
        " found); or wider limits on the inputs",
    )


def no_path(job: Task, result: Search, options: CollocationOptions) -> NotConvergedError:
    """No start led to a path: what stands in the way, found by leaving it out."""
    last = result.last or result.found[0].solution
    found = obstacle(job)
    if found is None:
        return not_converged(job, last, options, f"{len(result.log)} starts")
    return NotConvergedError(
        f"{job.problem.source}: no motion from start to goal was found from {len(result.log)}"
        f" starts; without {found.what} there is one, which breaks:",
        plan=_iterate_plan(job, found.solution, options),
        violations=found.violations,
        advice=found.advice,
    )


def not_converged(
    job: Task, solution: Solution, options: CollocationOptions, tried: str
) -> NotConvergedError:
    """The solver stopped short of a motion."""
    return NotConvergedError(
        f"{job.problem.source}: the solver found no motion from {tried} (it says"
        f" {solution.status} after {solution.iterations} iterations)",
        plan=_iterate_plan(job, solution, options),
        violations=broken_rows(job, solution),
        advice="more method.collocation.intervals, more attempts, or goal.travel and goal.duration"
        ' "free"',
    )


def _iterate_plan(job: Task, solution: Solution, options: CollocationOptions) -> Plan:
    """A last iterate, for study."""
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


def _rounded_up(value: float) -> str:
    digits = 4 - int(np.ceil(np.log10(value)))
    return f"{np.ceil(value * 10.0**digits) / 10.0**digits:g}"
