"""`planner plan`: one problem, one method, one verified plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from planner.cli.arguments import Changes, Json, ProblemPath, TimeLimit, read_problem
from planner.cli.output import (
    INTERRUPTED,
    Told,
    ended_with_the_best,
    ends_with_the_best,
    facts,
    interrupted,
    note,
    print_json,
    print_text,
    say,
    waiting,
)
from planner.errors import NoPlanError
from planner.files import refuse_unwritable
from planner.interrupts import hearing
from planner.methods import METHODS
from planner.plan import Plan
from planner.problem import Problem
from planner.solve import find_method, solve_and_check
from planner.summary import plan_summary, refusal_summary


def plan(
    problem: ProblemPath,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
            help="A method; `planner methods` lists them.",
            autocompletion=lambda: [(name, m.summary) for name, m in METHODS.items()],
        ),
    ] = "collocation",
    time_limit: TimeLimit = None,
    changes: Changes = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the plan to this JSON file.", show_default=False),
    ] = None,
    as_json: Json = False,
) -> int:
    """Make a plan, verify it and print what it is worth.

    A plan that breaks a requirement is not a plan: the command then says what is broken and what
    would help, and ends with status 3. Ctrl-C while a motion is held already ends the search: the
    best one found by then is refined, verified and written, with status 130; once more ends all.

    \b
    Examples:
      planner plan problems/paper.toml
      planner plan problems/paper.toml --method polynomial --set goal.travel=0.82
      planner plan problems/paper.toml --set method.collocation.intervals=20 --out plan.json
      planner plan problems/paper-fig4.toml --method polynomial \\
        --set method.polynomial.allow_singular=true
    """
    name = find_method(method).name
    task = read_problem(problem, changes)
    if out is not None:
        refuse_unwritable(out)
    try:
        with waiting(f"planning with {name}"), ends_with_the_best():
            found, check = solve_and_check(task, name, time_limit_s=time_limit)
            summary = plan_summary(found, check)
    except NoPlanError as error:
        return _refused(task, name, error, as_json)
    written = None if out is None else str(found.save(out))
    status = Told(INTERRUPTED) if ended_with_the_best() else 0
    if as_json:
        print_json({**_heading(task), **summary, "exit_status": status, "written": written})
    else:
        print_text(f"{task.name}: {name}", _table(task, summary), "", _verdict(found))
    if written is not None:
        note(f"plan written to {written}")
    if status:
        say("planner: interrupted: this is the best plan found by then")
    return status


def _refused(problem: Problem, method: str, error: NoPlanError, as_json: bool) -> int:
    if interrupted() or ended_with_the_best():
        raise hearing.exception
    if as_json:
        summary = refusal_summary(error, method)
        extra = {"error": str(error), "exit_status": error.exit_status, "written": None}
        print_json({**_heading(problem), **summary, **extra})
    say(f"planner: no plan ({error.status.replace('_', ' ')})", "bold red")
    say(str(error))
    return error.exit_status


def _heading(problem: Problem) -> dict[str, Any]:
    return {"problem": problem.name, "file": problem.source}


def _verdict(plan: Plan) -> str:
    if plan.verified:
        return (
            "The plan reaches the goal and keeps every limit"
            " (verified by integrating its inputs independently)." + _early(plan)
        )
    return (
        "For study only, not executable: the path leaves the domain of the chained-form chart,"
        " where no real angles exist."
    )


def _early(plan: Plan) -> str:
    why = str(plan.notes.get("ended_early", ""))
    return f"\n{why[0].upper()}{why[1:]}; more time may find a better one." if why else ""


def _table(problem: Problem, summary: dict[str, Any]) -> Table:
    system = problem.system
    rows = [
        (
            "status",
            summary["status"].replace("_", " ") + (", verified" if summary["verified"] else ""),
        ),
        (
            f"travel of {system.coordinates[0].name}",
            f"{number(summary['travel_rad'])} {system.coordinates[0].unit}, {summary['direction']}",
        ),
        ("duration", f"{number(summary['duration_s'])} s"),
        ("objective", f"{number(summary['objective'])}, {summary['objective_name']}"),
        *_inputs(problem, summary["peak_u_rad_s"]),
        ("largest error at the goal", _worst_error(problem, summary["terminal_error"])),
        ("chart", _chart(summary)),
        ("largest z2", number(summary["z2_max"])),
        *_start(summary["notes"]),
        *_optimality(summary["notes"]),
        *_certificate(summary),
        (
            "time",
            f"{number(summary['solve_time_s'])} s to solve, {number(summary['build_time_s'])} s to"
            f" prepare, {summary['iterations']} iterations",
        ),
    ]
    return facts(rows)


def _inputs(problem: Problem, peaks: list[float]) -> list[tuple[str, str]]:
    out = []
    for i, coordinate in enumerate(problem.system.inputs):
        limit = problem.limits.input[i]
        allowed = f", allowed {number(limit)}" if np.isfinite(limit) else ""
        peak = "undefined" if np.isnan(peaks[i]) else f"{number(peaks[i])} {coordinate.unit}"
        out.append((f"peak |{coordinate.name}|", peak + allowed))
    return out


def _worst_error(problem: Problem, errors: dict[str, float]) -> str:
    if any(np.isnan(e) for e in errors.values()):
        return "undefined"
    name, unit = max(
        ((c.name, c.unit) for c in problem.system.coordinates), key=lambda c: abs(errors[c[0]])
    )
    value = np.rad2deg(errors[name]) if unit == "rad" else errors[name]
    return f"{abs(value):.1e} {'deg' if unit == 'rad' else unit} ({name})"


def _chart(summary: dict[str, Any]) -> str:
    margin = f"smallest margin {number(summary['domain_margin'])}"
    if summary["domain_ok"]:
        return f"inside its domain, {margin}"
    times = ", ".join(number(t) for t in summary["singular_times_s"][:6])
    return f"leaves its domain or touches the edge at t = {times} s, {margin}"


def _start(notes: dict[str, Any]) -> list[tuple[str, str]]:
    if "start" not in notes:
        return []
    tried = len(notes.get("tried", ()))
    return [("first guess", notes["start"] + (f", the best of {tried}" if tried > 1 else ""))]


def _optimality(notes: dict[str, Any]) -> list[tuple[str, str]]:
    found = notes.get("optimality")
    if found is None:
        return []
    gap = found["relative_gap"]
    within = "" if gap is None else f", within {gap:.1e} of the best that its bound allows"
    return [("optimum", f"{found['kind']}, of its class of paths{within}")]


def _certificate(summary: dict[str, Any]) -> list[tuple[str, str]]:
    found = summary["certificate"]
    return [] if found is None else [("certificate", found["text"])]


def number(value: float | None) -> str:
    """Four significant digits; a dash where undefined."""
    return "-" if value is None or np.isnan(value) else f"{value:.4g}"
