"""The optimal plan at constant v₁ with v₂ piecewise constant (or linear): see `planner.convex`."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from scipy.interpolate import BPoly

from planner.convex.cuts import Above, Best, Impossible, Touch
from planner.convex.frame import Frame
from planner.convex.nearby import Nearby, local_best
from planner.convex.quadratic import StalledError
from planner.convex.report import OBJECTIVES, global_notes, local_notes, solver_notes
from planner.convex.search import Found, search, search_one
from planner.convex.task import Task
from planner.duration import why_too_short
from planner.errors import InfeasibleError, InputError, SingularError
from planner.methods.chart import chart_ends, fit_duration
from planner.methods.convex_refusals import (
    chart_refusal,
    class_refusal,
    duration_refusal,
    limits_refusal,
    one_way_refusal,
    speed_refusal,
    travel_refusal,
    zero_refusal,
)
from planner.methods.remedies import UnexplainedError
from planner.methods.travel import candidate_travels
from planner.pieces import elevate
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import travel_window
from planner.schema.methods import ConvexOptions
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator
from planner.trajectory import ChainedTrajectory

NAME = "convex"


def plan_convex(problem: Problem, options: ConvexOptions) -> Plan:
    """Plan optimally among the paths with v₁ constant and v₂ of one shape on equal pieces.

    For n = 2 and 3 the chart's domain is convex: at a given travel the result is the global optimum
    of its class with a proven gap, or a certificate that the class is empty, and
    `plan.notes["optimality"]` says which. With the travel free it is the best of the travels
    tried. Limits that are not convex (inputs, θ₁, longer chains) are first left out; where the
    optimum breaks them, successive convexification takes over and the result is labelled local.

    Raises:
        InfeasibleError: With `certificate`, if no path of the class meets travel, domain and z₂
            margin; or without, if no one-way motion at all meets travel and duration.
        NotConvergedError: If no plan was found and that proves nothing.
        SingularError: If start or goal are not in one branch of the chart.
        InputError: If there are too few pieces, or the duration is free and no input has a limit.
    """
    try:
        return planned_convex(problem, options)
    except UnexplainedError as refusal:
        raise refusal.explained(lambda changed: planned_convex(changed, options)) from None
    except SingularError as error:
        raise chart_refusal(error, problem) from None


def planned_convex(problem: Problem, options: ConvexOptions) -> Plan:
    """As `plan_convex`, but its refusals are not explained yet.

    Raises:
        UnexplainedError: In place of `plan_convex`'s refusals, but for SingularError.
    """
    began = time.perf_counter()
    if why := why_too_short(problem):
        raise duration_refusal(problem, why)
    start, goal = chart_ends(problem, problem.travel or 1.0)
    if options.pieces < 2 * len(start):
        raise InputError(
            f"{problem.source}: method.convex.pieces = {options.pieces} is too few for"
            f" {len(start)} coordinates; use at least {2 * len(start)}"
        )
    try:
        travels = _travels(problem, options)
    except InfeasibleError as error:
        raise one_way_refusal(error, problem) from None
    task = Task.of(problem, options, start, goal)
    built = time.perf_counter()
    found = _convex(task, travels)
    nearby = None
    if found.best is None and task.band.complete:
        raise class_refusal(task, found)
    if found.best is None or task.aim == "input" or task.complaint(*_path(found)) > 0:
        nearby = local_best(task, found, travels)
        if nearby is None:
            raise class_refusal(task, found)
    plan = _plan(task, found, nearby)
    plan = replace(plan, build_time_s=built - began, solve_time_s=time.perf_counter() - built)
    if nearby is not None and (nearby.eased or not nearby.local.kept):
        raise limits_refusal(task, nearby, plan)
    return plan


def _travels(problem: Problem, options: ConvexOptions) -> Array:
    """The travel, or those to scan, increasing, within the window and the drive's speed."""
    window, top = travel_window(problem), _top_travel(problem)
    if problem.travel is None:
        travels = candidate_travels(problem, options.scan)
        least = float(np.min(np.abs(travels)))
        if window is not None:
            least = min(abs(window.low), abs(window.high))
        if least >= top:
            raise speed_refusal(problem, least, top)
        near = travels[np.abs(travels) <= top]
        if len(near) < len(travels) and window is not None:  # all of the scan where it can be
            near = np.sort(np.sign(travels[0]) * np.linspace(least, top, options.scan + 2)[1:-1])
        return np.asarray(near)
    if problem.travel == 0:
        raise zero_refusal(problem)
    if window is not None and problem.travel not in window:
        raise travel_refusal(problem, window)
    if abs(problem.travel) > top:
        raise speed_refusal(problem, abs(problem.travel), top)
    return np.array([problem.travel])


def _top_travel(problem: Problem) -> float:
    """Greatest |travel| that the drive's limit allows in the time."""
    if problem.duration is None or not isinstance(problem.system, Manipulator):
        return np.inf
    return float(problem.system.k_g * problem.limits.input[0] * problem.duration)


def _convex(task: Task, travels: Array) -> Found:
    """The optimum of all that is convex, at the travel or over the travels."""

    def solve(travel: float, rows: Touch, ceiling: float) -> Best | Impossible | Above:
        answer = task.optimum(travel, rows, ceiling)
        if isinstance(answer, Best) and not task.band.complete:
            outside = np.isinf(task.complaint(answer.frame, answer.y))
            if outside:
                raise StalledError("the path leaves the chart's domain")
        return answer

    if len(travels) == 1:
        return search_one(solve, float(travels[0]))
    middle = task.options.travel == "middle"
    found = search(solve, travels, prune=not middle)
    if middle and found.best is not None:
        return search_one(solve, (found.low + found.high) / 2)
    return found


def _path(found: Found) -> tuple[Frame, Array]:
    assert found.best is not None
    return found.best.frame, found.best.y


def _plan(task: Task, found: Found, nearby: Nearby | None) -> Plan:
    problem = task.problem
    frame, y = _path(found) if nearby is None else (nearby.frame, nearby.local.y)
    trajectory = fit_duration(problem, _trajectory(problem, frame, y))
    duration = trajectory.duration
    notes = {"travels_tried": found.tried, "travel_range": [found.low, found.high]}
    if nearby is None:
        assert found.best is not None
        notes |= {"optimality": global_notes(task, found, found.best)}
        notes |= {"solver": solver_notes(task, found.best)}
        value, steps = found.best.value, found.best.rounds
    else:
        notes |= {"optimality": local_notes(task, found, nearby)}
        value, steps = task.value(frame, nearby.local), nearby.local.steps
    scale = {"smooth": 1.0, "peak": 1 / duration, "input": task.setting.duration / duration}
    return Plan(
        problem=problem,
        method=NAME,
        options=task.options.model_dump(),
        trajectory=trajectory,
        objective=value * scale[task.aim],
        objective_name=OBJECTIVES[task.aim],
        iterations=steps,
        notes=notes,
    )


def _trajectory(problem: Problem, frame: Frame, y: Array) -> ChainedTrajectory:
    """The path run at constant speed over the problem's duration, or one second."""
    duration = problem.duration or 1.0
    breaks = frame.shape.breaks
    omega, *rest = frame.bernstein(y)
    z1 = frame.start[0] + frame.travel * np.stack([breaks[:-1], breaks[1:]])
    degree = len(rest[-1]) - 1
    z = np.stack([elevate(c, degree) for c in (z1, *rest)], axis=-1)
    v = np.stack([np.full_like(omega, frame.travel), omega], axis=-1) / duration
    times = breaks * duration
    return ChainedTrajectory(problem.system, BPoly(z, times), BPoly(v, times), problem.branch)
