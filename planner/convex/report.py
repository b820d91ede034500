"""What is said of a convex plan or its absence: class, optimality, certificate, broken limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.convex.cuts import NO_TOUCH, Best, Impossible
from planner.convex.frame import Frame
from planner.convex.judge import DENSE
from planner.convex.look import Samples
from planner.convex.nearby import Nearby
from planner.convex.quadratic import StalledError, osqp_answer
from planner.convex.search import Found
from planner.convex.task import Task
from planner.errors import Violation
from planner.systems.base import Array

ATTAINED = 1e-6
"""Relative gap below which a bound counts as attained."""

OBJECTIVES = {
    "smooth": "smoothness: half the integral of (dz2/dz1)^2 over |z1|",
    "peak": "peak |v2|",
    "input": "greatest input over its limit",
}


def class_words(frame: Frame) -> str:
    """The class of paths, in words."""
    kind = "continuous and linear" if frame.shape.degree else "constant"
    return f"v1 constant and v2 {kind} on each of {frame.shape.pieces} equal pieces"


def global_notes(task: Task, found: Found, best: Best) -> dict[str, Any]:
    """What is known of a plan that is the optimum of a convex programme."""
    return {
        "kind": "global",
        "of": class_words(task.frame) + _where(task, found, best.frame),
        "objective": best.value,
        "lower_bound": best.bound,
        "relative_gap": best.gap,
        "proof": "cutting planes; the domain proven on every piece"
        if task.band.complete
        else "the optimum without the domain's and inputs' limits keeps them",
        "domain_excess_bound": best.proven if task.band.complete else None,
    }


def local_notes(task: Task, found: Found, nearby: Nearby) -> dict[str, Any]:
    """What is known of a plan found by successive convexification."""
    value = task.value(nearby.frame, nearby.local)
    bound = _bound_at(task, nearby.frame.travel)
    gap = None if bound is None else (value - bound) / max(abs(value), 1e-300)
    attained = gap is not None and gap <= ATTAINED
    return {
        "kind": "global" if attained else "local",
        "of": class_words(task.frame) + _where(task, found, nearby.frame),
        "objective": value,
        "lower_bound": bound,
        "relative_gap": gap,
        "proof": "the optimum without the limits that are not convex is attained"
        if attained
        else "none: limits that are not convex are active; the lower bound leaves them out",
        "local_optima_sought": nearby.tried,
    }


def _bound_at(task: Task, travel: float) -> float | None:
    """What no path of the class at this travel can be below; None for the peak input."""
    if task.aim == "input":
        return None
    try:
        answer = task.optimum(travel, NO_TOUCH, np.inf)
    except StalledError:
        return None
    return None if isinstance(answer, Impossible) else answer.bound


def _where(task: Task, found: Found, frame: Frame) -> str:
    if task.problem.travel is not None:
        return f", at travel {frame.travel:.6g}"
    return f", the best of {found.tried} travels tried (over travel it need not be convex)"


def solver_notes(task: Task, best: Best) -> dict[str, Any]:
    """Which engine solved the last programme, and OSQP's answer to the same one beside it."""
    final = best.final
    notes: dict[str, Any] = {
        "engine": final.engine,
        "programmes": best.rounds,
        "rows": len(best.b),
        "row_excess": final.excess if len(best.b) else 0.0,
    }
    if task.aim == "peak" or task.options.solver != "auto" or final.engine == "none needed":
        return notes
    answer = osqp_answer(best.A, best.b, best.y)
    if answer is not None:
        notes["osqp"] = {
            "largest_difference": float(np.max(np.abs(answer.y - best.y))),
            "row_excess": answer.excess,
            "relative_gap": answer.gap,
            "iterations": answer.iterations,
            "time_s": answer.time_s,
        }
    return notes


def certificate(refusal: Impossible) -> dict[str, Any]:
    """A certificate as plain arrays: multipliers u >= 0 show that A y <= b has no |y| <= radius."""
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


def certificate_words(task: Task, refusal: Impossible) -> str:
    """The certificate in a sentence."""
    used = int(np.sum(refusal.proof.multipliers > 1e-9))
    inside = "inside the chart's domain" if task.band.complete else ""
    floor = f"with |z2| >= {task.band.floor:.4g}" if np.isfinite(task.band.floor) else ""
    return (
        f"no path with {class_words(task.frame)} reaches the goal {inside} {floor} at travel"
        f" {refusal.frame.travel:.6g}: certificate of {used} conditions, margin"
        f" {refusal.proof.margin:.2g}"
    ).replace("  ", " ")


def broken_limits(task: Task, frame: Frame, y: Array, duration: float) -> list[Violation]:
    """What a path breaks, by label, with times."""
    samples = Samples.dense(frame.shape.pieces, DENSE)
    at = task.setting.sampled(frame, samples).look(y)
    if at is None:
        return [Violation("chart domain", None, float("nan"), 0.0, "", np.inf)]
    times = (samples.piece + samples.local) / frame.shape.pieces * duration
    system, limits = task.problem.system, task.setting.limits
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.abs(np.stack([at.v[:, 0] / at.drive, at.turned / at.slope]))
    rows = [(f"input {c.name}", u[i], limits.input[i], c.unit) for i, c in enumerate(system.inputs)]
    rows += [
        (f"joint {c.name}", np.abs(at.q[:, i]), limits.joint[i], c.unit)
        for i, c in enumerate(system.coordinates)
        if i in system.limited
    ]
    out = []
    for label, values, limit, unit in rows:
        k = int(np.argmax(values))
        value = float(values[k])
        if np.isfinite(limit) and value > limit * (1 + 1e-9):
            excess = value / limit - 1
            out.append(Violation(label, float(times[k]), value, float(limit), unit, excess))
    return out
