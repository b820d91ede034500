"""The properties of a plan in words, as a table for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.machine.machine import load_machine
from planner.plan.measures import effort_unit, path_coordinates
from planner.plan.plan import UNSTABLE, Plan
from planner.problem.problem import Problem
from planner.problem.settings import problem_words
from planner.problem.tables.machine_effects import Worth
from planner.support.package import Table
from planner.support.tables import CommandLine, Rows, facts
from planner.support.tables import four_digits as number
from planner.verification.summary import plan_summary


def plan_table(plan: Plan) -> Table:
    """Return a plan's properties as a table; see `Plan.table`."""
    return facts(properties(plan, plan_summary(plan)))


def properties(motion: Plan, summary: Mapping[str, Any], machine_file: Path | None = None) -> Rows:
    """Yield the names and values of a plan's properties in words.

    Args:
        motion: The plan.
        summary: Its `plan_summary`.
        machine_file: File of the machine, which the next command then names.
    """
    problem = motion.problem
    system, notes = problem.system, summary["notes"]
    path = system.coordinates[0]
    state = summary["status"].replace("_", " ") + ", verified" * summary["verified"]
    yield "status", state + f", {UNSTABLE}" * motion.unstable
    if motion.worth:
        yield "on the arm", _end_on_the_arm(motion, motion.worth, summary["terminal_error_deg"])
    yield f"travel of {path.name}", f"{number(motion.travel)} {path.unit}, {summary['direction']}"
    if turn := problem.heading_turn:
        yield "turn of heading", turn
    yield "duration", f"{number(summary['duration_s'])} s"
    commands = "of the compensated commands, " * ("compensation" in notes)
    yield "objective", f"{number(summary['objective'])}, {summary['objective_name']}"
    if motion.executable:
        yield "effort", f"{commands}{number(motion.effort)} {effort_unit(system)}"
        length, unit = number(motion.path_length), path_coordinates(system)[1]
        yield "path length", f"{length} {unit}"
    for c, most, peak in zip(system.inputs, problem.limits.input, motion.peak_u, strict=True):
        allowed = f", allowed {number(most)} {c.unit}" if np.isfinite(most) else ""
        peak_text = "undefined" if np.isnan(peak) else f"{number(peak)} {c.unit}"
        yield f"peak |{c.name}|", peak_text + allowed
    nominal = ", on the nominal machine" if "compensation" in notes else ""
    error = _worst_error(problem, summary["terminal_error"])
    yield "largest error at the ends", f"{error}{nominal}"
    if angles := notes.get("goal_theta_deg"):
        yield "joints at the goal", f"({', '.join(map(number, angles))}) deg"
    margin = f"smallest margin {number(summary['domain_margin'])}"
    if summary["domain_ok"]:
        yield "chart", f"inside the domain, {margin}"
    else:
        times = ", ".join(number(t) for t in summary["singular_times_s"][:6])
        yield "chart", f"leaves the domain or touches its edge at t = {times} s, {margin}"
    yield "largest z2", number(summary["z2_max"])
    if "start" in notes:
        tried = len(notes.get("tried", ()))
        yield "first guess", notes["start"] + (f", the best of {tried}" if tried > 1 else "")
    yield from _compensated(motion, machine_file)
    if proof := notes.get("optimality"):
        gap = proof["relative_gap"]
        within = "" if gap is None else f", within {gap:.1e} of the proven lower bound"
        yield "optimum", f"{proof['kind']}, of its class of paths{within}"
    if proven := summary["certificate"]:
        yield "certificate", proven["text"]


def _end_on_the_arm(motion: Plan, worth: Worth, errors_deg: Sequence[float]) -> str:
    if motion.compensation is None or worth.half_width_deg is None:
        return worth.words
    end = max(map(abs, errors_deg))
    return f"{end:.1g} +- {worth.half_width_deg:.2g} deg off at the goal: {worth.words}"


def _compensated(motion: Plan, machine_file: Path | None) -> Rows:
    notes = motion.notes
    if away := notes.get("from_ideal_deg"):
        yield "holds", motion.start_words
        yield "errors", f"from the predicted motion, up to {number(away)} deg off the ideal one"
    if not (compensation := notes.get("compensation")):
        return
    lead, tail = number(compensation["lead_s"]), number(compensation["tail_s"])
    before = f"{lead} s of preparatory motion, then " if compensation["lead_s"] else ""
    after = f", then {tail} s to end" if compensation["tail_s"] else ""
    holds = [end - begin for begin, end in compensation["holds_s"]]
    pauses = f" with {' and '.join(map(number, holds))} s of take-up" if holds else ""
    slower = notes.get("slowed_for_compensation", 1.0) - 1
    pace = f", {slower:.0%} slower than its fastest," if slower else ""
    yield "compensated", f"{before}the plan{pace}{pauses}{after}"
    yield "holds", motion.start_words
    state = [f"{each:.3g}" for each in notes.get("end_state", ())]
    yield "ends in the state", ", ".join(state) or "not told"
    now, plain = number(compensation["E_deg"]), number(compensation["plain_E_deg"])
    yield "off the path", f"up to {now} deg on the nominal machine, uncompensated {plain} deg"
    file, changes = [], None
    if machine_file is not None:
        file = ["--machine", str(machine_file)]
        changes = {"machine": load_machine(machine_file).to_dict()}
    words = problem_words(motion.problem, file, changes)
    yield "on random machines", CommandLine.of("planner", "compare", *words)


def _worst_error(problem: Problem, errors: Mapping[str, float]) -> str:
    if any(np.isnan(e) for e in errors.values()):
        return "undefined"
    worst = max(problem.system.user_coordinates, key=lambda c: abs(errors[c.name]))
    value, unit = errors[worst.name], worst.unit
    value, unit = (np.rad2deg(value), "deg") if unit == "rad" else (value, unit)
    return f"{abs(value):.1e} {unit} ({worst.name})"
