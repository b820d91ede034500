"""The convex method: find the best path in the chart, time the path, and make the plan."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InfeasibleError, InputError, NoPlanError, NotConvergedError
from planner.methods.convex.band import Band, band_of
from planner.methods.convex.global_optimum import (
    MOST_SLOPE,
    BestTravel,
    BoundAboveCeiling,
    ClassOptimum,
    EmptyClass,
    Touch,
    optimum_by_cuts,
    search_travels,
)
from planner.methods.convex.paths import Frame, Shape, input_shape
from planner.methods.laws.free_numbers import candidate_travels
from planner.methods.laws.law import chart_ends, refuse_zero_drive
from planner.methods.refusal import BY_COLLOCATION, Change, duration_change, travel_changes
from planner.plan.fastest_timing import fastest_motion
from planner.plan.measures import Objective, peak_inputs, slowing_factor, worst_margin
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory, Trajectory
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.method_options import ConvexOptions, Rest
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, elevate
from planner.support.calculus.extremes import sample_times
from planner.systems.manipulator import Manipulator

NAME = "convex"

OBJECTIVES = {
    "smooth": Objective("smoothness", {"chart smoothness": 1.0}),
    "peak": Objective("peak", {"chart peak": 1.0}),
}

SLACK = 1e-4
"""Time added to the fastest motion, as a fraction of its time. With less, the certificate's
enclosures cannot distinguish an input at its limit from an input above the limit."""


def plan_convex(problem: Problem, options: ConvexOptions) -> Plan:
    """Plan along the best path whose dz₂/dz₁ is constant or linear on equal pieces of the travel.

    For n = 2 and 3 the chart's domain is convex: at a given travel the path is the global optimum
    of this class with a proven gap, or a certificate shows that the class is empty; for a free
    travel the result is the best of those tried. For longer chains and other systems the method
    ignores the domain and accepts the optimum if it stays inside; `plan.notes["optimality"]` says
    what is proven. Input limits affect only the timing. v₁ is constant if this keeps the limits and
    no rest at the ends is required. Otherwise the fastest motion along the path is slowed uniformly
    to the given duration. The method ignores some other requirements (see
    `planner.methods.keeping`), so `verify` may refuse the path.

    Raises:
        InfeasibleError: If no path of the class meets travel, domain and z₂ margin (the error then
            has a `certificate`), or no one-way motion meets travel and duration.
        NotConvergedError: If no path was found, without a proof that none exists, or the best path
            takes longer than the duration within the input limits.
        SingularError: If start or goal are not in one branch of the chart, or the path passes a
            place where the drive is zero.
        InputError: If there are too few pieces, or the duration is free and an input has no limit.
    """
    began = time.perf_counter()
    start, goal = chart_ends(problem, problem.travel or 1.0)
    _refuse_input(problem, options, 2 * len(start))
    travels = _travels(problem, options)
    linear = options.input == "linear" or (options.input == "auto" and problem.reads("du"))
    frame = Frame(input_shape(options.pieces, int(linear)), start, goal, 1.0)
    band = band_of(problem, start, goal, options.edge)
    built = time.perf_counter()
    search = _best_path(problem, options, frame, band, travels)
    if search.best is None:
        raise _no_path(problem, frame.shape, band, search)
    path = _path(problem, search.best.frame, search.best.y)
    refuse_zero_drive(problem, NAME, path)
    trajectory, timing = _time_path(problem, path, options.rest)
    value = search.best.value
    return Plan(
        problem=problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=trajectory,
        objective=value / trajectory.duration if options.objective == "peak" else value,
        aim=OBJECTIVES[options.objective],
        iterations=search.best.rounds,
        build_time_s=built - began,
        solve_time_s=time.perf_counter() - built,
        notes=_notes(problem, band, search, search.best) | {"timing": timing},
    )


def _refuse_input(problem: Problem, options: ConvexOptions, fewest: int) -> None:
    if options.pieces < fewest:
        raise InputError(
            f"method.convex.pieces = {options.pieces} is too few for"
            f" {fewest // 2} coordinates; use at least {fewest}",
            source=problem.source,
        )
    if options.rest is True and not problem.rests("auto"):
        raise InputError(
            "method.convex.rest = true needs limits on the inputs' rates in [limits]",
            source=problem.source,
        )
    for i in np.flatnonzero(problem.limits.unlimited):
        if problem.duration is None:
            raise InputError(
                f"goal.duration is free but [limits] holds no limit of input"
                f" {problem.system.inputs[i].name}, so there is no fastest motion; set that limit,"
                " or goal.duration",
                source=problem.source,
            )


def _travels(problem: Problem, options: ConvexOptions) -> Array:
    """Return the travels to try: the given travel alone, or the travels to scan, increasing.

    Raises:
        InfeasibleError: If no motion without reversal meets the given travel and duration.
    """
    window, travel = travel_window(problem), problem.travel
    if window is not None and window.empty:
        raise _infeasible(problem, f"no motion without reversal exists: {window.reason}", [])
    if travel == 0:
        why = "the travel is 0, but a path of this method cannot reverse"
        raise _infeasible(problem, why, [])
    words = "" if window is None else f"between {window.low:.6g} and {window.high:.6g} rad"
    if travel is not None and window is not None and travel not in window:
        why = f"goal.travel = {travel:.6g} rad: motions without reversal have travels {words}"
        raise _infeasible(problem, why, travel_changes(problem))
    if window is not None and problem.duration is not None:
        assert isinstance(problem.system, Manipulator)  # no other has a window
        top = problem.system.k_g * problem.limits.input[0] * problem.duration
        shortest = min(abs(window.low), abs(window.high)) if travel is None else abs(travel)
        if shortest > top:
            why = (
                f"a motion without reversal needs a travel of {shortest:.4g} rad, but |u1| <="
                f" {problem.limits.input[0]:.4g} rad/s allows at most {top:.4g} rad in"
                f" {problem.duration:.4g} s"
            )
            raise _infeasible(problem, why, [Change({"goal.duration": "free"})])
    return candidate_travels(problem, options.scan) if travel is None else np.array([travel])


def _best_path(
    problem: Problem, options: ConvexOptions, frame: Frame, band: Band, travels: Array
) -> BestTravel:
    ends = np.stack([problem.start, np.where(np.isnan(problem.goal), problem.start, problem.goal)])
    margins = problem.system.chart_margins(ends, problem.branch)
    least_margin = min(options.edge, float(np.min(margins)) / 2)

    def solve(
        travel: float, rows: Touch, ceiling: float
    ) -> ClassOptimum | EmptyClass | BoundAboveCeiling | None:
        goal, most = options.objective, options.max_cuts
        answer = optimum_by_cuts(frame.at(travel), band, goal, rows, most, ceiling)
        if isinstance(answer, ClassOptimum) and not band.complete:
            path = _path(problem, answer.frame, answer.y)
            if np.min(worst_margin(path.margins(sample_times(path.breaks)))) < least_margin:
                return None
        return answer

    middle = options.travel == "middle" and len(travels) > 1
    search = search_travels(solve, travels, prune=not middle)
    if middle and search.best is not None:
        return search_travels(solve, np.array([sum(search.range) / 2]))
    return search


def _path(problem: Problem, frame: Frame, y: Array) -> ChainedTrajectory:
    """Return path y as a trajectory with constant v₁ over the problem's duration, or over 1 s."""
    duration = problem.duration or 1.0
    breaks = frame.shape.breaks
    omega, *rest = frame.bernstein(y)
    z1 = frame.start[0] + frame.travel * np.stack([breaks[:-1], breaks[1:]])
    degree = len(rest[-1]) - 1
    z = np.stack([elevate(c, degree) for c in (z1, *rest)], axis=-1)
    v = np.stack([np.full_like(omega, frame.travel), omega], axis=-1) / duration
    z_curve, v_curve = (Bernstein(c, breaks * duration) for c in (z, v))
    return ChainedTrajectory(problem.system, z_curve, v_curve, problem.branch)


def _time_path(problem: Problem, path: ChainedTrajectory, asked: Rest) -> tuple[Trajectory, str]:
    """Time a path within the limits, in the given or least duration; also return how, in words."""
    limits, duration = problem.limits, problem.duration
    peaks = peak_inputs(path)
    if np.any(np.isnan(peaks)):  # outside the domain somewhere, which verification reports
        return path, "v1 constant"
    rest = problem.rests(asked)
    if duration is not None and not rest and slowing_factor(problem.requirements, path) <= 1:
        return path, "v1 constant"
    # An input without a limit gets its peak at constant v1 as the limit.
    limits = replace(limits, input=np.where(limits.unlimited, peaks, limits.input))
    moving = peaks > 1e-12
    fastest, notes = fastest_motion(path, limits, problem.requirements, moving, rest)
    fastest = fastest.slowed(1 + SLACK)
    other = ", slowed for other limits" if "slowed_for_other_limits" in notes else ""
    if duration is None:
        return fastest, f"as fast as the input limits allow{other}"
    if fastest.duration > duration:
        raise NotConvergedError(
            f"the best path takes {fastest.duration:.4g} s within the input"
            f" limits{other}; goal.duration is {duration:.4g} s",
            source=problem.source,
            changes=[duration_change(fastest.duration), BY_COLLOCATION],
        )
    return fastest.slowed(duration / fastest.duration), "in proportion to the fastest motion"


def _class_words(shape: Shape) -> str:
    kind = "continuous and linear" if shape.degree else "constant"
    return f"paths with dz2/dz1 {kind} on each of {shape.pieces} equal pieces"


def _notes(problem: Problem, band: Band, search: BestTravel, best: ClassOptimum) -> dict[str, Any]:
    unit = problem.system.coordinates[0].unit
    where = f", at travel {best.frame.travel:.6g} {unit}"
    if problem.travel is None:
        where = f", the best of {search.tried} travels tried (not a proof over all travels)"
    proof = "the optimum without the chart's domain stays inside it"
    return {
        "travels_tried": search.tried,
        "travel_range": list(search.range),
        "optimality": {
            "kind": "global",
            "of": _class_words(best.frame.shape) + where,
            "objective": best.value,
            "lower_bound": best.bound,
            "relative_gap": best.gap,
            "proof": "cutting planes; the domain proven on every piece" if band.complete else proof,
            "domain_excess_bound": best.proven if band.complete else None,
        },
        "solver": {"programmes": best.rounds, "row_excess": max(best.final.excess, -1.0)},
    }


# -- refusals --------------------------------------------------------------------------------------


def _no_path(problem: Problem, shape: Shape, band: Band, search: BestTravel) -> NoPlanError:
    """Return the refusal of a problem for which no path was found, with a certificate if known."""
    changes = [*travel_changes(problem), BY_COLLOCATION]
    if not search.refusals:
        stalls, words = search.stalls, _class_words(shape)
        why = f"no best path was found at any of {stalls} travels tried, of {words}"
        ways = "other method.convex.pieces, or more method.convex.max_cuts" if stalls else None
        if left := search.tried - stalls:
            found = " at which it was found" if stalls else ""
            why = (
                f"the best of all {words} leaves the chart's domain at every travel tried{found}"
                f" ({left}); for this system the domain is not convex, so the method cannot stay"
                " inside it"
            )
        return NotConvergedError(why, source=problem.source, advice=ways, changes=changes)
    first = search.refusals[0]
    steepest = "" if band.complete else f" and |dz2/dtau| up to {MOST_SLOPE:.0e}"
    unit = problem.system.coordinates[0].unit
    proof = (
        f"no path {band.words}{steepest} reaches the goal at travel {first.frame.travel:.6g}"
        f" {unit}, of {_class_words(shape)}: certificate of"
        f" {int(np.sum(first.proof.multipliers > 1e-9))} conditions, margin"
        f" {first.proof.margin:.2g}"
    )
    window = travel_window(problem)
    if window is not None:
        proof += f"; motions without reversal have travels between {window.low:.6g} and"
        proof += f" {window.high:.6g} rad"
    ways = "a smaller limits.z2_margin"
    ways += " or method.convex.edge" if band.complete else ""
    ways += ", or more method.convex.pieces"
    if problem.travel is None:
        why = f"{len(search.refusals)} of {search.tried} travels tried are proven to have no path"
        why = f"{why}; for one, {proof}"
        return NotConvergedError(why, source=problem.source, advice=ways, changes=changes)
    error = _infeasible(problem, proof, travel_changes(problem), ways)
    error.certificate = _certificate(first)
    return error


def _certificate(refusal: EmptyClass) -> dict[str, Any]:
    """Return a certificate as arrays: u >= 0 proves that no |y| <= radius solves A y <= b."""
    return {
        "travel": refusal.frame.travel,
        "A": refusal.A,
        "b": refusal.b,
        "multipliers": refusal.proof.multipliers,
        "residual": refusal.proof.residual,
        "value": refusal.proof.value,
        "radius": refusal.proof.radius,
        "margin": refusal.proof.margin,
        "tau": refusal.touch.tau,
        "tangent_at_z3": refusal.touch.at,
    }


def _infeasible(
    problem: Problem, why: str, changes: Sequence[Change], ways: str | None = None
) -> InfeasibleError:
    changes = [*changes, BY_COLLOCATION]
    return InfeasibleError(why, source=problem.source, advice=ways, changes=changes)
