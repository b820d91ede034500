"""Whether a problem has a plan, in words: the mathematics, the answer of each method, refusals."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np

from planner.check import Analysis
from planner.problem.feasibility import End, why_too_short
from planner.report.page.words import constants
from planner.support.package import Table
from planner.support.tables import Column, Rows, terminal_table
from planner.support.tables import four_digits as number
from planner.systems.triangular_system import TriangularSystem
from planner.verification.summary import without_unit_keys


def findings(analysis: Analysis) -> Rows:
    """Yield the names and values of the mathematics of a problem, in words."""
    rule = getattr(analysis.problem.system, "k_g_rule", None)
    yield "system", constants(analysis.problem.system) + f" ({rule})" * bool(rule)
    for end in analysis.ends:
        if analysis.reach is None or end.name != "goal":
            yield from _end(analysis.problem.system, end)
    yield from _reach(analysis)
    yield from _window(analysis)
    yield "reversal", f"{analysis.reversal.verdict}: {analysis.reversal.reason}"
    bound = analysis.duration_bound
    if bound.reason:
        yield "least duration", f"{number(bound.seconds)} s: {bound.reason}"
    if analysis.plain_polynomial is not None:
        travel, report = analysis.plain_polynomial
        crossings = ", ".join(number(t) for t in report.z2_crossings_s)
        zero = f"z2 = 0 at t = {crossings} s" if crossings else "z2 keeps its sign"
        exits = ", ".join(number(t) for t in report.exits_s) or number(report.time_s)
        leaves = f"leaves the chart's domain at t = {exits} s"
        yield "plain polynomial", f"at travel {number(travel)}: {leaves}; {zero}"
    for place in analysis.nonholonomy.places:
        yield f"at {place.name}", str(place)
    if analysis.nonholonomy.recursion is not None:
        yield "paper's (12)-(15)", analysis.nonholonomy.recursion_verdict


def _end(system: TriangularSystem, end: End) -> Rows:
    z = ", ".join(number(value) if np.isfinite(value) else "free" for value in end.z)
    label, least = min(end.margins.items(), key=lambda item: item[1])
    if end.singular:
        where = f"on a singularity of the chart: {' and '.join(f'{c} = 0' for c in end.singular)}"
        if system.kind != "manipulator":
            where = f"on an edge of the chart: {', '.join(end.singular)}"
    elif end.crossed:
        where = f"on another branch of the chart than the start: {', '.join(end.crossed)}"
    else:
        where = f"inside the chart, nearest edge {number(least)} ({label})"
    yield f"{end.name} z", f"({z})"
    yield f"{end.name} chart", where


def _reach(analysis: Analysis) -> Rows:
    problem, reach = analysis.problem, analysis.reach
    if reach is None:
        return
    free = [problem.system.coordinates[i].name for i in problem.free]
    yield "goal", f"{problem.tip}; " * (problem.tip is not None) + f"{', '.join(free)} free"
    if problem.tip is not None and problem.tip.place is not None:
        away = float(np.hypot(*problem.tip.place))
        yield "reach", f"{number(away)} m from the base; the arm is {reach.reach:.4g} m long"
    if reach.branches:
        count = len(reach.branches)
        elbows = f"elbows can bend in {count} way{'s' * (count > 1)}, the one nearest to the start"
        elbows += f" ({', '.join(map(number, np.rad2deg(reach.branches[0][1:])))}) deg"
    elif reach.blocked:
        elbows = "none that keeps every limit"
    else:
        x, y, turn = reach.tip
        off = reach.missed_words
        elbows = f"none found within the limits of the joints; the nearest, {off} off, has the tip"
        elbows += f" at ({x:.4g}, {y:.4g}) m, {np.rad2deg(turn):.4g} deg"
    if reach.blocked:
        elbows += (
            f"; {reach.blocked} more break{'s' * (reach.blocked == 1)} a limit or touch something"
        )
    yield "places of the joints", elbows


def _window(analysis: Analysis) -> Rows:
    window, problem = analysis.window, analysis.problem
    travel = "free" if problem.travel is None else number(problem.travel)
    name, unit = problem.system.coordinates[0].name, problem.system.coordinates[0].unit
    if window is None:
        yield f"travel of {name}", f"{travel} {unit}".replace("free " + unit, "free")
        return
    text = travel if problem.travel is None else f"{travel} {unit}"
    if problem.travel is not None and not window.empty:
        text += ", inside the window" if problem.travel in window else ", outside the window"
    high = "no upper end" if np.isinf(window.high) else f"{window.high:.5g}"
    span = f"{window.low:.5g} to {high} {unit}"
    span += "" if window.exact else "; necessary, not sufficient"
    if window.empty:
        span = f"empty: {window.reason}"
    yield f"travel of {name}", text
    yield "travels without reversal", span


Outcome = dict[str, Any]


def methods_table(analysis: Analysis) -> Table:
    """Return what each method answers, and the figures of its plan, as a table for a terminal."""
    system = analysis.problem.system

    def figure(outcome: Outcome, name: str, place: int = 0) -> float | None:
        value: Any = without_unit_keys(outcome, system)[name]
        value = value[place] if isinstance(value, list | tuple) else value
        return None if value is None else round(value, 9) + 0.0  # no travel of -1e-16

    columns: list[Column[Outcome]] = [
        Column("method", "", itemgetter("label"), left=True, width=20, code=True),
        Column("answer", "", _answer, left=True),
        Column("travel", "", lambda o: figure(o, "travel"), number),
        Column("duration", "", lambda o: o["duration_s"], number),
        *(
            Column(f"|{c.name}|", "", partial(figure, name="peak_u", place=i), number)
            for i, c in enumerate(system.inputs)
        ),
        Column("effort", "", lambda o: o["effort"], number),
        Column("kind", "", _kind, left=True),
    ]
    return terminal_table(columns, analysis.outcomes, ruled=True)


def _answer(outcome: Outcome) -> str:
    return "solved" if outcome["verified"] else str(outcome["status"]).replace("_", " ")


def _kind(outcome: Outcome) -> str:
    where = "" if outcome["domain_ok"] else ", leaves the chart"
    return f"{outcome['direction']}{where}" if outcome["verified"] else ""


def unpromised_limits(analysis: Analysis) -> list[str]:
    """Return lines that name the requirements which each method may break."""
    lists: dict[tuple[str, ...], list[str]] = {}
    for name, labels in analysis.not_promised.items():
        lists.setdefault(labels, []).append(name)
    common = lists.pop((), [])
    out = [f"{', '.join(names)}: may break {', '.join(labels)}" for labels, names in lists.items()]
    return ["", *out, f"{', '.join(common)}: every plan keeps all limits"] if common else ["", *out]


def refusals(analysis: Analysis) -> Iterator[str]:
    """Yield the lines of each refusal: the methods that gave it, the reason, what to try."""
    refused: dict[tuple[str, ...], tuple[list[str], list[tuple[str, ...]]]] = {}
    # The verdict has the proof and the remedy.
    told = why_too_short(analysis.problem) is not None and analysis.remedy is not None
    for o in analysis.outcomes:
        if (error := analysis.refusals.get(o["label"])) is None:
            continue
        reason = error.sentence if not told or error.finding is None else error.finding
        broken = [] if o["status"] == "singular" else o["violations"][:4]  # the reason names them
        refusal = (reason and reason + error.list_head, *(f"  - {v['text']}" for v in broken))
        names, advice = refused.setdefault(refusal, ([], []))
        names.append(o["label"])
        if error.ways and not any({*error.ways} <= {*known} for known in advice):
            advice.append(error.ways)
    for (reason, *lines), (names, advice) in refused.items():
        if reason:
            tries = [f"  Try: {'; or '.join(each)}" for each in advice]
            yield from ("", f"{', '.join(names)}: {reason}", *lines, *tries)
