"""`planner sensitivity`: how errors shift the end of a plan.

`planner sensitivity --pareto`: trade sensitivity against effort, duration or peak; each point of
the curve is saved at once.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from planner.cli.arguments import (
    Changes,
    Folder,
    MethodName,
    PlannedMethods,
    PlanOrProblemPath,
    Samples,
    Seed,
    is_plan,
    join_methods,
    read_problem,
    refuse_given,
)
from planner.cli.output import explain_interruption, finish, job, number
from planner.comparison.compare import plan_rows
from planner.errors import InputError
from planner.methods.desensitised.method import spreads
from planner.methods.registry import parse_spec
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.problem.tables.method_options import DesensitisedOptions
from planner.report.figures.robustness import knee_sentence
from planner.report.folders import save_sensitivity
from planner.report.result_folder import refuse_unwritable_folder
from planner.robustness.machine_sensitivity import machine_sensitivity
from planner.robustness.sensitivities import next_step, sensitivities, worth
from planner.robustness.sensitivity import MEANINGS
from planner.robustness.sensitivity import sensitivity as analyse
from planner.robustness.trade_off import TradeOff, end_error, trade_off
from planner.robustness.trade_off_points import Kind
from planner.solve import solve
from planner.support.files import write_figure, write_text
from planner.support.tables import CommandLine, csv_table
from planner.support.user_tables import parse
from planner.verification.verdict import load_plan


def sensitivity(
    context: typer.Context,
    source: PlanOrProblemPath,
    method: MethodName = "collocation",
    methods: PlannedMethods = None,
    machine: Annotated[
        bool, typer.Option(help="Also show the parameters of the emulated machine.")
    ] = True,
    changes: Changes = None,
    pareto: Annotated[
        Kind | None,
        typer.Option(
            "--pareto",
            metavar="effort|duration|peak",
            help="Trace the least sensitivity against this quantity; needs a problem and --out.",
        ),
    ] = None,
    points: Annotated[int, typer.Option("--points", min=3, help="Number of points.")] = 10,
    samples: Samples = 200,
    seed: Seed = 0,
    out: Folder = None,
) -> int:
    """Compute how errors shift the end of a plan.

    The errors are those of inputs, timing, start, gears and machine. Each response is to an error
    of the size shown: one standard deviation from the table [method.desensitised], or a typical
    size where that is zero. With --methods: compares several plans; a refused plan is included if
    it is a complete motion. With --pareto: plans of least sensitivity along a curve. Each point is
    saved at once, and after Ctrl-C the same command continues.

    \b
    Examples:
      planner sensitivity problems/paper.toml
      planner sensitivity problems/paper.toml --method desensitised --out out/s
      planner sensitivity problems/paper.toml --methods sinusoid,collocation
      planner sensitivity plan.json --json
      planner sensitivity problems/paper.toml --pareto effort --out out/trade-off
    """
    only = ["points", "samples", "seed"]
    if is_plan(source):
        names = ["method", "methods", "pareto", *only, "changes"]
        refuse_given(context, names, f"for a problem, but {source} is named as a plan")
    if pareto is None:
        refuse_given(context, only, "without effect, unless --pareto is given")
    if methods is not None:
        refuse_given(context, ["method", "machine"], "without effect beside --methods")
    if pareto is not None:
        refuse_given(context, ["method", "methods", "machine"], "without effect beside --pareto")
        return _trade_off(source, pareto, points, (samples, seed), changes=changes, out=out)
    refuse_unwritable_folder(out)
    if (named := join_methods(methods)) is not None:
        return _side_by_side(source, named, changes, out)
    with job("planning") as notice:
        plan = _plan(source, method, changes)
        spec = Spec.of_label(plan.label) if is_plan(source) else parse_spec(method)
        notice("differentiating")
        designed = plan.problem.methods.desensitised
        if plan.method == "desensitised":
            designed = parse(DesensitisedOptions, dict(plan.options), "options of the plan")
        spread = spreads(plan.problem.system, designed)
        responses = analyse(plan)
        machine_responses = machine_sensitivity(plan) if machine else None
        heading = {"source": str(source), "method": spec.text, "duration_s": plan.duration}
        written = out and save_sensitivity(responses, machine_responses, spread, out, heading)
    data = {**heading, **responses.to_dict(spread), "written": written}
    data["machine"] = None if machine_responses is None else machine_responses.to_dict()
    title, table = f"{plan.problem.name}: {spec.text}", responses.table(spread)
    parts: list[str | Table] = [title, "", table]
    if machine_responses is not None:
        parts += ["", machine_responses.table()]
    return finish(data, *parts, "", _advice(plan, spec))


def _side_by_side(source: Path, methods: str, changes: list[str] | None, out: Path | None) -> int:
    """Plan by each method, and show how errors shift the end of each plan.

    Raises:
        InputError: If an argument is wrong, or no method has a plan that can be executed.
    """
    problem = read_problem(source, changes)
    with job() as progress:
        rows = plan_rows(problem, methods, progress)
        progress("differentiating", 1.0)
        spread = spreads(problem.system, problem.methods.desensitised)
        comparison = sensitivities({row.label: row.plan for row in rows}, spread)
        written = out and comparison.save(out)
    refused = {row.label: row.why for row in rows if not row.solved}
    data = {"source": str(source), **comparison.to_dict(), "refused": refused, "written": written}
    notes = [""] * 2 * bool(refused) + [
        f"{label}: {'refused' if label in comparison.plans else 'no plan'}, {why}"
        for label, why in refused.items()
    ]
    title = f"{problem.name}: one standard deviation of each of {', '.join(spread)}"
    words = (comparison.sentence, comparison.verdict, *notes)
    return finish(data, title, "", comparison.table(), "", *words)


def _plan(source: Path, method: str, changes: list[str] | None) -> Plan:
    if is_plan(source):
        return load_plan(source, strict=True)
    return solve(read_problem(source, changes), method)


def _advice(plan: Plan, spec: Spec) -> str:
    """Return a sentence with the command to run next."""
    calm = Spec("desensitised", compensated=spec.compensated)
    return next_step(plan.problem, spec, *[calm] * (spec.method != calm.method))


PICTURE_FILE, TABLE_FILE, KNEE_FILE = "trade-off.png", "trade-off.csv", "knee.json"


def _trade_off(
    source: Path,
    kind: Kind,
    points: int,
    machines: tuple[int, int],
    *,
    changes: list[str] | None,
    out: Path | None,
) -> int:
    """Trace the curve of least sensitivity against a cost; save and print it.

    Raises:
        InputError: If an argument is wrong.
        NoPlanError: If the problem has no plan.
        Interruption: After Ctrl-C; finished points are kept.
    """
    if out is None:
        raise InputError("--pareto saves a plan for each point; give the folder with --out FOLDER")
    problem = read_problem(source, changes)
    with explain_interruption("points", out), job() as progress:
        curve = trade_off(
            problem, kind, points, out, samples=machines[0], seed=machines[1], progress=progress
        )
        write_figure(out / PICTURE_FILE, curve.plot())
        write_text(out / TABLE_FILE, csv_table(curve.columns, curve.points))
    table = curve.table()
    title = f"{problem.name}: least sensitivity against {kind}"
    knee_file = curve.knee.plan.save(out / KNEE_FILE)
    use = _use(curve, knee_file)
    data = {**curve.to_dict(), "written": out, "knee_file": knee_file, "use": "\n".join(use)}
    missing = points - len(curve.points)
    which = f"{missing} of {points} points have no plan, or no lower total than a cheaper point.\n"
    return finish(data, title, "", table, "", which * bool(missing) + _knee(curve), "", *use)


def _knee(curve: TradeOff) -> str:
    first, k = curve.points[0], curve.knee
    text = (
        f"{curve.problem.name}: {knee_sentence(curve)}; total {number(k.total_deg)} deg instead of"
        f" {number(first.total_deg)}, of it the floor {number(k.floor_deg)}.\n"
        "The knee lies farthest below the chord between the curve's ends. Errors are the largest"
        " joint error at the end: under the design errors alone, and on the problem's machine, with"
        " the plan as it is and with the plan compensated. Turns: how often the drive reverses."
    )
    refused = [(p.compensated or {}).get("refused") for p in curve.points]
    why = next((text for text in refused if text), None)
    return text if why is None else f"{text}\n'-': the plan cannot be compensated, since {why}"


def _use(curve: TradeOff, file: Path) -> list[str]:
    """Return lines: whether the knee is worth its cost, where its plan is, how to use it."""
    first, k = curve.points[0], curve.knee
    lines = []
    if k is not first:
        price = curve.cost[curve.knee_index] / curve.cost[0]
        lines = [
            f"The knee: {worth(first.total_deg, k.total_deg, k.floor_deg, price, curve.kind)}."
        ]
    before, after = (end_error("compensated", p) for p in (first, k))
    if before and after:
        change = f"{number(before)} deg at the first point, {number(after)} at the knee"
        lines += [f"Compensated, the error at the end on the machine (95 %) is {change}."]
    export = "planner", "export", str(file), "--out", str(file.with_suffix(".csv"))
    table = CommandLine.of(*export, after=f"Knee plan: {file}; as a table: ")
    return [*lines, table, next_step(curve.problem, Spec("collocation")), MEANINGS]
