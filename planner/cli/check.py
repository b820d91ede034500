"""`planner check`: is there a plan, of what kind, and if not, why and what would make one."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from planner.check import Analysis
from planner.check import check as analyse
from planner.cli.arguments import (
    Changes,
    Json,
    MethodNames,
    ProblemPath,
    TimeLimit,
    parse_methods,
    read_problem,
)
from planner.cli.output import facts, print_json, print_text, table, waiting
from planner.cli.plan import number
from planner.ends import End
from planner.errors import NoPlanError
from planner.reachability import TravelWindow
from planner.systems.base import TriangularSystem


def check(
    problem: ProblemPath,
    changes: Changes = None,
    method_names: MethodNames = None,
    time_limit: TimeLimit = None,
    as_json: Json = False,
) -> int:
    """Say whether there is a plan; if not, why and what would help.

    Tries every method of the registry. Ends with status 0 if one has a verified plan, else 3.

    \b
    Examples:
      planner check problems/paper.toml
      planner check problems/paper-fig5.toml --set goal.travel=0.82
      planner check problems/unreachable.toml --json
    """
    names = parse_methods(method_names)
    task = read_problem(problem, changes)
    with waiting("checking") as notice:
        analysis = analyse(task, names, progress=notice, time_limit_s=time_limit)
    status = 0 if analysis.has_plan else NoPlanError.exit_status
    if as_json:
        print_json({"file": task.source, **analysis.to_dict(), "exit_status": status})
        return status
    print_text(task.name, "", _facts(analysis), "", _methods(analysis))
    for line in _refusals(analysis):
        print_text(line)
    print_text("", analysis.verdict)
    return status


def _facts(analysis: Analysis) -> Table:
    problem = analysis.problem
    rows = [("system", _system(problem.system))]
    for end in analysis.ends:
        rows += _end(problem.system, end)
    rows += _window(analysis)
    rows.append(("reversal", f"{analysis.reversal.verdict}: {analysis.reversal.reason}"))
    if analysis.duration_bound.reason:
        bound = analysis.duration_bound
        rows.append(("least duration", f"{number(bound.seconds)} s: {bound.reason}"))
    rows += _plain_polynomial(analysis)
    rows += [(f"at {place.name}", str(place)) for place in analysis.nonholonomy.places]
    if analysis.nonholonomy.recursion is not None:
        rows.append(("paper's (12)-(15)", analysis.nonholonomy.recursion_verdict))
    return facts(rows)


def _system(system: TriangularSystem) -> str:
    constants = [
        f"{key} = {_constant(value)}"
        for key, value in system.to_dict().items()
        if key not in ("kind", "link_lengths")
    ]
    rule = getattr(system, "k_g_rule", None)
    return ", ".join([system.kind, *constants]) + (f" ({rule})" if rule else "")


def _constant(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_constant(v) for v in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _end(system: TriangularSystem, end: End) -> list[tuple[str, str]]:
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
    return [(f"{end.name} z", f"({z})"), (f"{end.name} chart", where)]


def _window(analysis: Analysis) -> list[tuple[str, str]]:
    window, problem = analysis.window, analysis.problem
    given = "free" if problem.travel is None else number(problem.travel)
    name, unit = problem.system.coordinates[0].name, problem.system.coordinates[0].unit
    if window is None:
        return [(f"travel of {name}", f"{given} {unit}".replace("free " + unit, "free"))]
    text = given if problem.travel is None else f"{given} {unit}"
    if problem.travel is not None and not window.empty:
        text += ", inside the window" if problem.travel in window else ", outside the window"
    return [(f"travel of {name}", text), ("one-way window", _range(window, unit))]


def _range(window: TravelWindow, unit: str) -> str:
    if window.empty:
        return f"empty: {window.reason}"
    note = "" if window.exact else "; necessary, not sufficient"
    high = "no upper end" if np.isinf(window.high) else f"{window.high:.5g}"
    return f"{window.low:.5g} to {high} {unit}{note}"


def _plain_polynomial(analysis: Analysis) -> list[tuple[str, str]]:
    if analysis.plain_polynomial is None:
        return []
    travel, report = analysis.plain_polynomial
    crossings = ", ".join(number(t) for t in report.z2_crossings_s)
    zero = f"z2 = 0 at t = {crossings} s" if crossings else "z2 keeps its sign"
    exits = ", ".join(number(t) for t in report.exits_s) or number(report.time_s)
    text = f"at travel {number(travel)}: leaves the chart's domain at t = {exits} s; {zero}"
    return [("plain polynomial", text)]


def _methods(analysis: Analysis) -> Table:
    names = [c.name for c in analysis.problem.system.inputs]
    out = table(
        "method", "answer", ">travel", ">duration", *(f">peak |{n}|" for n in names), "kind"
    )
    for o in analysis.outcomes:
        peaks = o["peak_u_rad_s"] or [None, None]
        kind = ""
        if o["verified"]:
            kind = o["direction"] + ("" if o["domain_ok"] else ", leaves the chart")
        answer = "solved" if o["verified"] else str(o["status"]).replace("_", " ")
        travel, duration = number(o["travel_rad"]), number(o["duration_s"])
        out.add_row(o["method"], answer, travel, duration, *(number(p) for p in peaks), kind)
    return out


def _refusals(analysis: Analysis) -> list[str]:
    out = []
    for o in analysis.outcomes:
        if o["verified"] or o["reason"] is None:
            continue
        reason = str(o["reason"]).removeprefix(f"{analysis.problem.source}: ")
        broken = [] if o["status"] == "singular" else o["violations"][:4]  # the reason says it
        out += ["", f"{o['method']}: {reason}", *(f"  - {v['text']}" for v in broken)]
        if o["advice"]:
            out.append(f"  Try: {o['advice']}")
    return out
