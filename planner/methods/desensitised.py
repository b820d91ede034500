"""Plans that errors of inputs, start and constants disturb least, against their effort."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from planner.deadline import limited, share
from planner.desensitise.augmented import augmented
from planner.desensitise.program import Shape, program
from planner.desensitise.refusal import (
    broken,
    refuse_no_room,
    refuse_one_way,
    refuse_waypoints,
)
from planner.desensitise.seeds import guess, seeds
from planner.desensitise.settle import Settled, settle
from planner.desensitise.spread import spreads
from planner.desensitise.task import Solution, Task, Weights, prepared
from planner.errors import InputError, NotConvergedError
from planner.methods.collocation import plan_collocation
from planner.ocp.form import Form
from planner.ocp.mesh import uniform
from planner.plan import Plan
from planner.problem import Problem
from planner.schema.desensitised import DesensitisedOptions
from planner.schema.methods import CollocationOptions

NAME = "desensitised"

EASY = 0.5
"""Share of the time, where that is limited, for the plan of least effort."""


@dataclass(frozen=True, eq=False)
class _Answer:
    start: str
    solution: Solution
    iterations: int
    log: list[dict[str, Any]]


def plan_desensitised(
    problem: Problem, options: DesensitisedOptions, near: Plan | None = None
) -> Plan:
    """Minimise the response to the design errors, weighed against effort.

    Motion and response are one collocation problem (`planner.desensitise`). It is solved from the
    plan of least effort and from excursions about it that let φ turn back, since optima are local;
    the best is kept (`notes["start"]`, `notes["tried"]`).

    Args:
        problem: What to solve.
        options: Weights, spreads and form.
        near: A plan of the same problem to start from, instead of all other starts: a neighbour on
            a trade-off curve.

    Raises:
        InputError: If a spread does not fit the system or options contradict each other.
        InfeasibleError: If one way is asked for and impossible, or the start has no room to back
            off.
        NotConvergedError: If no motion is found.
    """
    with limited(None, holds=lambda: False):  # the plan of least effort is no answer
        return _planned(problem, options, near)


def _planned(problem: Problem, options: DesensitisedOptions, near: Plan | None) -> Plan:
    began = time.perf_counter()
    refuse_waypoints(problem)
    if not options.reversal:
        refuse_one_way(problem)
    task = _task(problem.within_reach(), options)
    refuse_no_room(task)
    build = prepared(task)
    if near is not None:
        easy = near
    else:
        with share(EASY):
            easy = plan_collocation(problem, _easy(options))
    if not options.reversal:
        task = replace(task, direction=1.0 if easy.travel >= 0 else -1.0)
    answer = _searched(task, options, easy, near is not None)
    done = settle(task, answer.solution, options.accuracy)
    return replace(_plan(done, answer, options, began, build), problem=problem)


def _task(problem: Problem, options: DesensitisedOptions) -> Task:
    spread = spreads(problem.system, options)
    made = augmented(problem.system, tuple(spread))
    form = Form(
        intervals=options.intervals,
        input=_input_kind(problem, options),
        rate_limits=bool(np.any(np.isfinite(problem.limits.input_rate))),
        chart=problem.limits.z2_margin is not None,
    )
    limited = tuple(i for i in problem.system.limited if np.isfinite(problem.limits.joint[i]))
    return Task(
        problem=problem,
        program=program(
            made, Shape(form, limited if options.backoff > 0 else (), len(problem.obstacles))
        ),
        mesh=uniform(options.intervals),
        spread=spread,
        weights=Weights(
            options.passive,
            options.terminal,
            options.path,
            options.effort,
            options.time if problem.duration is None else 0.0,
        ),
        backoff=options.backoff,
        direction=0.0,
        effort_limit=options.effort_limit or np.inf,
        rest=options.rest,
        tolerance=options.tolerance,
        max_iterations=options.max_iterations,
    )


def _input_kind(problem: Problem, options: DesensitisedOptions) -> Literal["constant", "linear"]:
    smooth = options.rest or bool(np.any(np.isfinite(problem.limits.input_rate)))
    if options.input == "auto":
        return "linear" if smooth else "constant"
    if options.input == "constant" and smooth:
        what = "rest = true" if options.rest else "the limit on input rates"
        raise InputError(
            f"{problem.source}: method.desensitised.input = 'constant' jumps between intervals,"
            f" which contradicts {what}; use 'linear' or 'auto'"
        )
    return options.input


def _easy(options: DesensitisedOptions) -> CollocationOptions:
    return CollocationOptions(rest=options.rest, intervals=options.intervals)


def _searched(task: Task, options: DesensitisedOptions, easy: Plan, near: bool) -> _Answer:
    """The best of all starts."""
    log: list[dict[str, Any]] = []
    best: tuple[str, Solution] | None = None
    last: Solution | None = None
    iterations = 0
    for seed in seeds(options.reversal)[: 1 if near else options.starts]:
        start = guess(task, easy.trajectory, seed)
        last = task.solve(start, near)
        if not last.ok:  # the other barrier takes another way
            iterations += last.iterations
            last = task.solve(start, not near)
        iterations += last.iterations
        log.append(_entry("the plan given" if near else seed.name, last))
        if last.ok and (best is None or last.cost < best[1].cost * (1 - 1e-6)):
            best = (log[-1]["start"], last)
    if best is None:
        assert last is not None
        raise _not_converged(task, last, options, len(log))
    return _Answer(*best, iterations, log)


def _entry(name: str, solution: Solution) -> dict[str, Any]:
    return {
        "start": name,
        "status": solution.status,
        "objective": solution.cost if solution.ok else None,
        "passive_deg": solution.passive_deg if solution.ok else None,
        "total_deg": solution.total_deg if solution.ok else None,
        "effort": solution.effort if solution.ok else None,
        "iterations": solution.iterations,
    }


def _plan(
    done: Settled, answer: _Answer, options: DesensitisedOptions, began: float, build: float
) -> Plan:
    task, solution = done.task, done.solution
    w = task.weights
    terms = [
        (w.passive, "passive block^2"),
        (w.terminal, "terminal response^2"),
        (w.path, "response along the path^2"),
        (w.effort, "effort"),
        (w.time, "duration"),
    ]
    name = " + ".join(f"{weight:g} x {term}" for weight, term in terms if weight)
    return Plan(
        problem=task.problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=task.curve(solution.vector),
        objective=solution.cost,
        objective_name=f"desensitised: {name} (deg^2)",
        solve_time_s=time.perf_counter() - began - build,
        build_time_s=build,
        iterations=answer.iterations + done.iterations,
        notes={
            "start": answer.start,
            "tried": answer.log,
            "spread": task.spread,
            "passive_deg": solution.passive_deg,
            "total_deg": solution.total_deg,
            "effort": solution.effort,
            **done.notes,
        },
    )


def _not_converged(
    task: Task, solution: Solution, options: DesensitisedOptions, tried: int
) -> NotConvergedError:
    ways = [] if options.reversal else ["method.desensitised.reversal = true"]
    ways += ["method.desensitised.backoff smaller"] if options.backoff else []
    ways += ["a larger method.desensitised.effort_limit"] if options.effort_limit else []
    ways += ["more method.desensitised.starts, wider limits, or more time"]
    plan = Plan(
        problem=task.problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=task.curve(solution.vector),
        status=NotConvergedError.status,
        objective=solution.cost,
        iterations=solution.iterations,
        notes={"solver_status": solution.status},
    )
    return NotConvergedError(
        f"{task.problem.source}: no desensitised motion was found from {tried} start"
        f"{'s' if tried > 1 else ''} (the last one: {solution.status} after"
        f" {solution.iterations} iterations)",
        plan=plan,
        violations=broken(task, solution),
        advice=", or ".join(ways),
    )
