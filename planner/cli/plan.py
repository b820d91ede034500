"""`planner plan`: one problem, one method, one verified plan.

`planner check`: is there a plan, of what kind, and if not, why and what would make one.
"""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from planner.check import Analysis
from planner.check import check as analyse
from planner.cli.arguments import (
    Changes,
    MachineFile,
    MethodNames,
    ProblemPath,
    TimeLimit,
    method_option,
    out_option,
    parse_methods,
    read_problem,
)
from planner.cli.output import (
    INTERRUPT_STATUS,
    ReportedStatus,
    facts,
    finish,
    is_interrupted,
    job,
    keep_best_on_interrupt,
    manner,
    number,
    say,
    search_ended_early,
)
from planner.errors import NoPlanError
from planner.methods.registry import find_method
from planner.plan.log import read_log
from planner.plan.measures import effort
from planner.plan.plan import Plan
from planner.problem.feasibility import End, why_too_short
from planner.problem.problem import Problem
from planner.solve import solve_and_check
from planner.support.files import refuse_unwritable, toml
from planner.support.interrupts import signal_listener
from planner.support.tables import Column, terminal_table
from planner.systems.triangular_system import TriangularSystem
from planner.verification.summary import plan_summary, refusal_summary


def plan(
    problem: ProblemPath,
    method: Annotated[
        str, method_option("The method; `planner methods` lists them.")
    ] = "collocation",
    time_limit: TimeLimit = None,
    changes: Changes = None,
    machine: MachineFile = None,
    pose_from: Annotated[
        Path | None,
        typer.Option(
            "--pose-from",
            metavar="LOG",
            help="Start from where the arm stands at the end of a recorded run (CSV), as after"
            " homing.",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("FILE", "Save the plan in this JSON file.")] = None,
) -> int:
    """Make a plan, verify it and print its properties.

    A plan that breaks a requirement is refused: the command prints what is broken and what would
    help, and ends with status 3. Ctrl-C ends the search; the best motion found so far, if any, is
    refined, verified and written, with status 130. A second Ctrl-C ends the command at once.

    \b
    Examples:
      planner plan problems/paper.toml
      planner plan problems/paper.toml --method polynomial --set goal.travel=0.82
      planner plan problems/paper.toml --set goal.duration=8 --out plan.json
      planner plan problems/paper-fig4.toml --method polynomial \\
        --set method.polynomial.allow_singular=true
      planner plan arm.toml --machine my-machine.toml --pose-from homed.csv \\
        --set machine.start_state=forward --set compensation.on=true
    """
    name = find_method(method).name
    task = read_problem(problem, changes, machine)
    if pose_from is not None:
        task = task.from_pose(read_log(pose_from).pose_deg)
    if out is not None:
        refuse_unwritable(out)
    try:
        with job(f"planning with {name}"), keep_best_on_interrupt():
            began = time.perf_counter()
            motion, check = solve_and_check(task, name, time_limit_s=time_limit)
            took = time.perf_counter() - began
            summary = plan_summary(motion, check)
    except NoPlanError as error:
        return _report_refusal(task, name, error)
    summary |= _heading(task) | {"written": out and motion.save(out)}
    status = 0
    if search_ended_early():
        status = ReportedStatus(INTERRUPT_STATUS)
        say("planner: interrupted: this is the best plan found so far")
    table = facts(_properties(task, motion, summary, took))
    parts = (f"{task.name}: {name}", table, "", _verdict(motion))
    return finish(summary, *parts, status=status, where="plan written to {}")


def _report_refusal(problem: Problem, method: str, error: NoPlanError) -> int:
    if is_interrupted() or search_ended_early():
        raise signal_listener.exception
    say(f"planner: no plan ({error.status.replace('_', ' ')})", "bold red")
    say(str(error))
    summary = _heading(problem) | refusal_summary(error, method)
    return finish({**summary, "error": str(error), "written": None}, status=error.exit_status)


def _heading(problem: Problem) -> dict[str, Any]:
    return {"problem": problem.name, "file": problem.source}


def _verdict(plan: Plan) -> str:
    if plan.verified:
        how = "verified by integrating its inputs independently"
        if plan.compensates is not None:
            how = "verified on the nominal machine, for which it is compensated"
        text = f"The plan reaches the goal and keeps every limit ({how})."
        if why := str(plan.notes.get("ended_early", "")):
            text += f"\n{why[0].upper()}{why[1:]}; more time may find a better one."
        return text
    return (
        "For study only, not executable: the path leaves the domain of the chained-form chart,"
        " where no real angles exist."
    )


Rows = Iterator[tuple[str, str]]


def _properties(problem: Problem, motion: Plan, summary: dict[str, Any], took: float) -> Rows:
    system, notes = problem.system, summary["notes"]
    path = system.coordinates[0]
    status = summary["status"].replace("_", " ") + (", verified" if summary["verified"] else "")
    yield "status", status
    travel = number(summary["travel_rad"])
    yield f"travel of {path.name}", f"{travel} {path.unit}, {summary['direction']}"
    yield "duration", f"{number(summary['duration_s'])} s"
    objective = f"{number(summary['objective'])}, {summary['objective_name']}"
    if "compensation" in notes:
        objective += (
            f"; with the compensated commands the effort is {number(effort(motion.trajectory))}"
        )
    yield "objective", objective
    for c, most, peak in zip(
        system.inputs, problem.limits.input, summary["peak_u_rad_s"], strict=True
    ):
        allowed = f", allowed {number(most)}" if np.isfinite(most) else ""
        peak_text = "undefined" if np.isnan(peak) else f"{number(peak)} {c.unit}"
        yield f"peak |{c.name}|", peak_text + allowed
    nominal = ", on the nominal machine" if "compensation" in notes else ""
    error = _worst_error(problem, summary["terminal_error"])
    yield "largest error at the goal", f"{error}{nominal}"
    if angles := notes.get("goal_theta_deg"):
        yield "joints at the goal", f"{_degrees(angles)} deg"
    margin = f"smallest margin {number(summary['domain_margin'])}"
    if summary["domain_ok"]:
        yield "chart", f"inside the domain, {margin}"
    else:
        times = ", ".join(number(t) for t in summary["singular_times_s"][:6])
        yield "chart", f"leaves the domain or touches its edge at t = {times} s, {margin}"
    yield "largest z2", number(summary["z2_max"])
    if "start" in notes:
        tried = len(notes.get("tried", ()))
        rivals = f", the best of {tried}" if tried > 1 else ""
        yield "first guess", notes["start"] + rivals
    if compensation := notes.get("compensation"):
        lead, tail = number(compensation["lead_s"]), number(compensation["tail_s"])
        before = f"{lead} s of preparatory motion, then " if compensation["lead_s"] else ""
        after = f", then {tail} s to end" if compensation["tail_s"] else ""
        holds = [end - begin for begin, end in compensation["holds_s"]]
        pauses = f" with {' and '.join(map(number, holds))} s of take-up" if holds else ""
        slower = notes.get("slowed_for_compensation", 1.0) - 1
        pace = f", {slower:.0%} slower than its fastest," if slower else ""
        yield "compensated", f"{before}the plan{pace}{pauses}{after}"
        now, plain = number(compensation["E_deg"]), number(compensation["plain_E_deg"])
        yield "off the path", f"up to {now} deg on the nominal machine, uncompensated {plain} deg"
        yield "machines differ", f"what that adds: planner compare {shlex.quote(problem.source)}"
    if proof := notes.get("optimality"):
        gap = proof["relative_gap"]
        within = "" if gap is None else f", within {gap:.1e} of the proven lower bound"
        yield "optimum", f"{proof['kind']}, of its class of paths{within}"
    if proven := summary["certificate"]:
        yield "certificate", proven["text"]
    solve, build = number(summary["solve_time_s"]), number(summary["build_time_s"])
    of_these = f"of these {solve} s to solve, {build} s to prepare"
    whole = f"{number(took)} s in all, with verification"
    yield "time", f"{whole}; {of_these}; {summary['iterations']} iterations"


def _worst_error(problem: Problem, errors: dict[str, float]) -> str:
    if any(np.isnan(e) for e in errors.values()):
        return "undefined"
    name, unit = max(
        ((c.name, c.unit) for c in problem.system.user_coordinates),
        key=lambda c: abs(errors[c[0]]),
    )
    value = np.rad2deg(errors[name]) if unit == "rad" else errors[name]
    return f"{abs(value):.1e} {'deg' if unit == 'rad' else unit} ({name})"


def _degrees(angles: Sequence[float]) -> str:
    return f"({', '.join(f'{angle:.4g}' for angle in angles)})"


def check(
    problem: ProblemPath,
    changes: Changes = None,
    method_names: MethodNames = None,
    time_limit: TimeLimit = None,
) -> int:
    """Find out whether there is a plan; if not, say why not.

    Tries every method, then changes of the problem that may help. Ends with status 0 if
    one method has a verified plan, else 3. --verbose adds the mathematics: chained
    coordinates, possible travels, controllability, which limits each method keeps.

    \b
    Examples:
      planner check problems/paper.toml
      planner check problems/paper.toml --verbose
      planner check problems/paper-fig5.toml --set goal.travel=0.82
      planner check problems/unreachable.toml --json
    """
    names = parse_methods(method_names)
    task = read_problem(problem, changes)
    with job("checking") as notice:
        analysis = analyse(task, names, progress=notice, time_limit_s=time_limit)
    status = 0 if analysis.has_plan else NoPlanError.exit_status
    return finish(
        {"file": task.source, **analysis.to_dict()},
        analysis.verdict,
        *_next_step(analysis, str(problem)),
        *("", _methods(analysis)),
        *_refusals(analysis),
        "",
        *_mathematics(analysis),
        status=status,
    )


def _mathematics(analysis: Analysis) -> list[str | Table]:
    if not manner.verbose:
        return ["The mathematics behind it: --verbose"]
    return [facts(_findings(analysis)), *_unpromised_limits(analysis)]


def _next_step(analysis: Analysis, file: str) -> Iterator[str]:
    """The command that goes on from the verdict; none where no change helped."""
    if analysis.has_plan:
        yield f"Next: planner compare {shlex.quote(file)}"
    elif analysis.remedy is not None:
        words = ["planner", "plan", file, "--method", analysis.remedy.method]
        for key, value in analysis.remedy.changes.items():
            words += ["--set", f"{key}={toml(value)}"]
        yield f"Next: {shlex.join(words)}"


def _findings(analysis: Analysis) -> Rows:
    yield "system", _system(analysis.problem.system)
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
        elbows += f" {_degrees(np.rad2deg(reach.branches[0][1:]).tolist())} deg"
    elif reach.blocked:
        elbows = "none that keeps every limit"
    else:
        angle = problem.tip is not None and problem.tip.place is None
        off = f"{np.rad2deg(reach.missed):.3g} deg" if angle else f"{reach.missed:.3g} m"
        x, y, turn = reach.tip
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


def _methods(analysis: Analysis) -> Table:
    inputs = enumerate(analysis.problem.system.inputs)
    columns: list[Column[Outcome]] = [
        Column("method", "", lambda o: o["method"], left=True),
        Column("answer", "", _answer, left=True),
        Column("travel", "", lambda o: o["travel_rad"], number),
        Column("duration", "", lambda o: o["duration_s"], number),
        *(Column(f"|{c.name}|", "", partial(_peak, i), number) for i, c in inputs),
        Column("kind", "", _kind, left=True),
    ]
    return terminal_table(columns, analysis.outcomes)


def _peak(which: int, outcome: Outcome) -> float | None:
    peaks = outcome["peak_u_rad_s"]
    return None if peaks is None else float(peaks[which])


def _answer(outcome: Outcome) -> str:
    return "solved" if outcome["verified"] else str(outcome["status"]).replace("_", " ")


def _kind(outcome: Outcome) -> str:
    where = "" if outcome["domain_ok"] else ", leaves the chart"
    return f"{outcome['direction']}{where}" if outcome["verified"] else ""


def _unpromised_limits(analysis: Analysis) -> list[str]:
    """What methods do not promise to keep, those with the same list together."""
    lists: dict[tuple[str, ...], list[str]] = {}
    for name, labels in analysis.not_promised.items():
        lists.setdefault(labels, []).append(name)
    kept = lists.pop((), [])
    out = [f"{', '.join(names)}: may break {', '.join(labels)}" for labels, names in lists.items()]
    return ["", *out, f"{', '.join(kept)}: every motion found keeps all"] if kept else ["", *out]


def _refusals(analysis: Analysis) -> Iterator[str]:
    """Why and what to try, methods with the same refusal together."""
    refused: dict[tuple[str, ...], tuple[list[str], list[str]]] = {}
    for o in analysis.outcomes:
        if o["verified"] or o["reason"] is None:
            continue
        reason = str(o["reason"]).removeprefix(f"{analysis.problem.source}: ")
        broken = [] if o["status"] == "singular" else o["violations"][:4]  # the reason says it
        refusal = (reason, *(f"  - {v['text']}" for v in broken))
        names, advice = refused.setdefault(refusal, ([], []))
        names.append(o["method"])
        if o["advice"] and not any(o["advice"] in known for known in advice):
            advice.append(o["advice"])
    proof = why_too_short(analysis.problem) or ""
    for (reason, *lines), (names, advice) in refused.items():
        if proof and analysis.remedy is not None:  # the verdict holds both
            reason = re.sub(r"^\W*The", "the", reason.removeprefix(proof))
        if reason:
            tries = [f"  Try: {each}" for each in advice]
            yield from ("", f"{', '.join(names)}: {reason}", *lines, *tries)
