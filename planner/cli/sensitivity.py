"""`planner sensitivity`: how errors shift the end of a plan.

`planner sensitivity --pareto`: trade sensitivity against effort, duration or peak; each point of
the curve is saved at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from planner.cli.arguments import (
    Changes,
    PlanOrProblemPath,
    Seed,
    is_plan,
    join_methods,
    method_option,
    methods_option,
    out_option,
    read_problem,
    samples_option,
)
from planner.cli.output import explain_interruption, finish, job, number
from planner.comparison.compare import plan_row, specs_of
from planner.errors import InputError
from planner.machine.replay import STATISTICS
from planner.methods.desensitised.method import spreads
from planner.methods.registry import find_method
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.problem.tables.method_options import DesensitisedOptions
from planner.report.figures.robustness import entry_name, knee_sentence, size_of
from planner.report.folders import save_sensitivities, save_sensitivity
from planner.report.result_folder import refuse_unwritable_folder
from planner.robustness.machine_sensitivity import (
    MachineEntry,
    MachineSensitivity,
    machine_sensitivity,
)
from planner.robustness.sensitivities import MEANINGS, next_step, sensitivities, worth
from planner.robustness.sensitivity import Sensitivity
from planner.robustness.sensitivity import sensitivity as analyse
from planner.robustness.trade_off import TradeOff, trade_off
from planner.robustness.trade_off_axis import KINDS
from planner.robustness.trade_off_points import TradeOffPoint
from planner.solve import solve
from planner.support.files import write_figure, write_text
from planner.support.tables import Column, CommandLine, csv_table, terminal_table
from planner.support.user_tables import parse
from planner.verification.load_plan import load_plan

MAX_PARAMETERS = 12
"""Most machine parameters in the table; the parameters with the largest response are shown."""


def sensitivity(
    source: PlanOrProblemPath,
    method: Annotated[
        str, method_option("Method that makes the plan, if a problem is given.")
    ] = "collocation",
    methods: Annotated[
        list[str] | None,
        methods_option("Methods, each with options if needed (polynomial:travel=middle); or all."),
    ] = None,
    machine: Annotated[
        bool, typer.Option(help="Also show the parameters of the emulated machine.")
    ] = True,
    changes: Changes = None,
    pareto: Annotated[
        str | None,
        typer.Option(
            "--pareto",
            metavar="effort|duration|peak",
            autocompletion=lambda: ["effort", "duration", "peak"],
            help="Trace the least sensitivity against this quantity; needs a problem and --out.",
        ),
    ] = None,
    points: Annotated[int, typer.Option("--points", min=3, help="Number of points.")] = 10,
    samples: Annotated[
        int, samples_option("Number of random machines to replay each point on.")
    ] = 200,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        out_option(
            "FOLDER",
            "Save plans, figures and data in this folder; an interrupted curve continues from it.",
        ),
    ] = None,
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
    if pareto is not None:
        if methods is not None:
            raise InputError("--pareto and --methods contradict each other; give one of them")
        return run_trade_off(source, pareto, points, (samples, seed), changes=changes, out=out)
    if out is not None:
        refuse_unwritable_folder(out)
    if (named := join_methods(methods)) is not None:
        return _side_by_side(source, named, changes, out)
    with job("planning") as notice:
        plan = _plan(source, method, changes)
        notice("differentiating")
        spread = spreads(plan.problem.system, design_errors(plan))
        responses = analyse(plan)
        machine_responses = machine_sensitivity(plan) if machine else None
        heading = {"source": str(source), "method": plan.method, "duration_s": plan.duration}
        written = out and save_sensitivity(responses, machine_responses, spread, out, heading)
    data = {**heading, **responses.to_dict(spread), "written": written}
    data["machine"] = None if machine_responses is None else machine_responses.to_dict()
    title, table = f"{plan.problem.name}: {plan.method}", _response_table(responses, spread)
    parts: list[str | Table] = [title, "", table, "", _sum_text(responses, spread)]
    if machine_responses is not None:
        parts += ["", _machine_table(machine_responses), "", _machine_text(machine_responses)]
    return finish(data, *parts, "", _advice(responses))


def _side_by_side(source: Path, methods: str, changes: list[str] | None, out: Path | None) -> int:
    """Plan by each method, and show how errors shift the end of each plan.

    Raises:
        InputError: If an argument is wrong, or no method has a plan that can be executed.
    """
    if is_plan(source):
        raise InputError(f"{source} is a plan; --methods needs a problem file")
    problem = read_problem(source, changes)
    specs = specs_of(problem, methods)
    for spec in specs:
        if spec.compensated:
            raise InputError(
                f"'{spec.label}': a compensated plan has the sensitivity of the uncompensated one;"
                " leave out the word compensated"
            )
    rows = []
    with job() as notice:
        for spec in specs:
            notice(f"planning {spec.label}")
            rows.append(plan_row(problem, spec))
        notice("differentiating")
        spread = spreads(problem.system, problem.methods.desensitised)
        comparison = sensitivities({row.label: row.plan for row in rows}, spread)
        written = out and save_sensitivities(comparison, out)
    refused = {row.label: row.why for row in rows if not row.solved}
    data = {"source": str(source), **comparison.to_dict(), "refused": refused, "written": written}
    notes = [""] * 2 * bool(refused) + [
        f"{label}: {'refused' if label in comparison.plans else 'no plan'}, {why}"
        for label, why in refused.items()
    ]
    table = terminal_table(comparison.columns(), comparison.plans)
    title = f"{problem.name}: one standard deviation of each of {', '.join(spread)}"
    words = (comparison.sentence, comparison.verdict, "", MEANINGS, *notes)
    return finish(data, title, "", table, "", *words)


def design_errors(plan: Plan) -> DesensitisedOptions:
    """Return the options that contain the design errors.

    They are those of which a desensitised plan was made; for other plans, those of the problem.
    """
    if plan.method == "desensitised":
        return parse(DesensitisedOptions, dict(plan.options), "options of the plan")
    return plan.problem.methods.desensitised


def _plan(source: Path, method: str, changes: list[str] | None) -> Plan:
    if not is_plan(source):
        return solve(read_problem(source, changes), find_method(method).name)
    if changes:
        raise InputError(f"{source} is a plan; --set changes problem files only")
    return load_plan(source, strict=True)


def _response_table(responses: Sensitivity, spread: dict[str, float]) -> Table:
    coordinates = responses.plan.problem.system.coordinates
    sizes, values = responses.reference(spread), responses.contribution_deg(spread)

    def cell(angle: int, p: int) -> str:
        value = float(values[angle, p])
        if abs(value) < 5e-7:
            return ""
        return f"{value:.3g}{'*' if responses.irreducible[responses.angles[angle], p] else ' '}"

    columns: list[Column[int]] = [
        Column("error", "", lambda p: responses.parameters[p], left=True),
        Column("size", "", lambda p: size_of(float(sizes[p]), responses.units[p])),
    ]
    angles = [
        Column(coordinates[i].name, "deg", partial(cell, k)) for k, i in enumerate(responses.angles)
    ]
    loud = [p for p in range(len(sizes)) if any(angle.text(p) for angle in angles)]
    return terminal_table([*columns, *angles], loud, ruled=True, gap=1)


def _sum_text(responses: Sensitivity, spread: dict[str, float]) -> str:
    total, floor = responses.total_deg(spread), responses.floor_deg(spread)
    least = 100 * (1 - floor / total) if total else 0.0
    return (
        f"One standard deviation of each of {', '.join(spread)}: total {number(total)} deg."
        f"\n* irreducible: {number(floor)} deg."
        f"\nPassive block: {number(responses.passive_block_deg(spread))} deg.\n{MEANINGS}"
        f"\nAnother path reduces the total by at most {least:.0f} %."
    )


def _advice(responses: Sensitivity) -> str:
    """Return a sentence with the command to run next."""
    plan = responses.plan
    calm = [plan.method] if plan.method == "desensitised" else [plan.method, "desensitised"]
    return next_step(plan.problem, *map(Spec, calm))


def _machine_table(responses: MachineSensitivity) -> Table:
    columns: list[Column[MachineEntry]] = [
        Column("machine", "", entry_name, left=True),
        Column("change", "", lambda e: f"{number(e.reference)} {e.unit}".rstrip()),
        *(Column(a, "deg", partial(_contribution, k)) for k, a in enumerate(responses.angles)),
    ]
    return terminal_table(columns, responses.loudest[:MAX_PARAMETERS], ruled=True, gap=1)


def _contribution(angle: int, entry: MachineEntry) -> str:
    value = entry.contribution[angle]
    return f"{value:.3g}" if abs(value) >= 5e-5 else ""


def _machine_text(responses: MachineSensitivity) -> str:
    silent = sum(e.has_no_effect for e in responses.entries)
    rest = len(responses.entries) - silent - MAX_PARAMETERS
    more = f"; {rest} smaller ones are in --json and --out" if rest > 0 else ""
    nominal: list[Any] = [f"{e:.3g}" for e in responses.nominal_error_deg]
    return (
        f"Nominal machine: errors {', '.join(nominal)} deg; one spread of each parameter: total"
        f" {number(responses.total_deg)} deg{more}."
        f" {silent} parameters have no effect on this motion."
        f" Switched off (the machine has no such effect): {', '.join(responses.omitted) or 'none'}."
    )


PICTURE_FILE, TABLE_FILE, KNEE_FILE = "trade-off.png", "trade-off.csv", "knee.json"


def run_trade_off(
    source: Path,
    kind: str,
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
    if kind not in KINDS:
        raise InputError(f"--pareto {kind}: must be one of {', '.join(KINDS)}")
    if out is None:
        raise InputError("--pareto saves a plan for each point; give the folder with --out FOLDER")
    if is_plan(source):
        raise InputError(f"{source} is a plan; --pareto needs a problem file")
    problem = read_problem(source, changes)
    axis = next(k for k in KINDS if k == kind)
    with explain_interruption("points", out), job() as progress:
        curve = trade_off(
            problem, axis, points, out, samples=machines[0], seed=machines[1], progress=progress
        )
        write_figure(out / PICTURE_FILE, curve.figure())
        write_text(out / TABLE_FILE, csv_table(_columns(curve), curve.points))
    table = terminal_table(_columns(curve), curve.points, ruled=True)
    title = f"{problem.name}: least sensitivity against {kind}"
    knee_file = curve.knee.plan.save(out / KNEE_FILE)
    use = _use(curve, knee_file)
    data = {**curve.to_dict(), "written": out, "knee_file": knee_file}
    data["use"] = "\n".join(use)
    missing = points - len(curve.points)
    which = f"{missing} of {points} points have no plan, or no lower total than a cheaper point.\n"
    return finish(data, title, "", table, "", which * bool(missing) + _knee(curve), "", *use)


def _columns(curve: TradeOff) -> list[Column[TradeOffPoint]]:
    inputs = enumerate(curve.problem.system.inputs)
    heads = {"errors_alone": "errors", "machine": "machine", "compensated": "compensated"}
    return [
        Column("", "", lambda p: "knee" if p is curve.knee else "", key="knee", left=True),
        Column("effort", "", lambda p: p.effort, number),
        Column("time", "s", lambda p: p.duration_s, number, key="duration"),
        *(Column(f"|{u.name}|", "", partial(_peak, i), number) for i, u in inputs),
        Column("total", "deg", lambda p: p.total_deg, number),
        Column("passive", "deg", lambda p: p.passive_deg, number),
        Column("irreducible", "deg", lambda p: p.floor_deg, None),
        Column("turns", "", lambda p: p.reversals, key="reversals"),
        *(
            Column(f"{head} 95 %", "deg", partial(_end_error, kind), number, f"{kind}_95_deg")
            for kind, head in heads.items()
        ),
        *(
            Column(f"{k} {STATISTICS[key].title}", "deg", partial(_end_error, k, key=key), None)
            for k in ("machine", "compensated")
            for key in ("E_p95_deg", "end_median_deg")
        ),
    ]


def _peak(which: int, point: TradeOffPoint) -> float:
    return point.peak_u[which]


def _end_error(which: str, point: TradeOffPoint, key: str = "end_p95_deg") -> float | None:
    errors: Mapping[str, Any] = getattr(point, which) or {}
    return errors.get(key)


def _knee(curve: TradeOff) -> str:
    first, k = curve.points[0], curve.knee
    text = (
        f"{curve.problem.name}: {knee_sentence(curve)}; total {number(k.total_deg)} deg instead of"
        f" {number(first.total_deg)}, of it irreducible {number(k.floor_deg)}.\n"
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
        lines = [f"The knee: {worth(first.total_deg, k.total_deg, price, curve.kind)}."]
    before, after = (_end_error("compensated", p) for p in (first, k))
    if before and after:
        change = f"{number(before)} deg at the first point, {number(after)} at the knee"
        lines += [f"Compensated, the error at the end on the machine (95 %) is {change}."]
    export = "planner", "export", str(file), "--out", str(file.with_suffix(".csv"))
    table = CommandLine.of(*export, after=f"Knee plan: {file}; as a table: ")
    return [*lines, table, next_step(curve.problem, Spec("collocation")), MEANINGS]
