"""Write comparisons, error budgets and sensitivities, with their figures, as folders.

A folder is written completely or not at all.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from planner.comparison.comparison import Comparison, command, comparison_csv
from planner.comparison.differences import COLUMNS, csv_machines, markdown_differences, pairs
from planner.errors import InputError
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.report.figures.arm import can_draw, plot_arm
from planner.report.figures.on_the_machine import (
    median_sample,
    plot_efforts,
    plot_errors,
    plot_replays,
)
from planner.report.figures.over_time import plot
from planner.report.figures.robustness import (
    plot_machine_sensitivity,
    plot_responses,
    plot_sensitivity,
)
from planner.report.page.page import write_report
from planner.report.panels import PLAN_FIGURES
from planner.report.result_folder import folder
from planner.report.saved import values_of
from planner.robustness.budget import Budget, Cost, budget_csv, budget_markdown
from planner.robustness.machine_sensitivity import MachineSensitivity
from planner.robustness.sensitivities import Sensitivities
from planner.robustness.sensitivity import Sensitivity
from planner.robustness.sobol import Index
from planner.support.arrays import jsonable
from planner.support.files import (
    TOML_BYTES,
    expect_path,
    read_json,
    read_text,
    write_json,
    write_text,
)
from planner.support.package import Figure, versions
from planner.support.tables import csv_table, csv_text, markdown_table
from planner.verification.verdict import load_plan

MOTION_INSTANTS = 300
"""Number of instants at which replays.json has the motion of the machine with median E."""


def save(
    comparison: Comparison,
    path: str | Path,
    *,
    report: bool = False,
    partial: bool = False,
    pictures: bool = True,
) -> Path:
    """Write table.md, table.csv, comparison.json, replays.json, problem.toml, plans/ and figures/.

    Refused plans are saved as `<label>.refused.json`. If the plans were compared machine by
    machine, differences.md, differences.csv and machines.csv are added. problem.toml is left out
    if the problem does not come from a file.

    Args:
        comparison: The comparison.
        path: The folder. An earlier run's folder is replaced after everything is written; what
            others put into it stays. A partial result does not replace a complete comparison: it
            is written to a folder beside it, whose name ends in "-partial".
        report: Whether to add the page report.html; see `planner.report.page.page.write_report`.
        partial: Whether the run was interrupted although all rows are finished, as in budgets.
        pictures: Whether to draw figures/ and report.html.

    Returns:
        The folder that was written.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    target = Path(path)
    if (partial or not comparison.complete) and _holds_complete(target):
        target = Path(f"{target}-partial")
    with folder(target) as place:
        data = comparison.to_dict()
        data["command"] = command(comparison, str(path), report=report)
        write_text(place / "table.md", comparison.markdown())
        write_text(place / "table.csv", comparison_csv(comparison))
        if comparison.differences:
            write_text(place / "differences.md", markdown_differences(comparison))
            write_text(place / "differences.csv", csv_table(COLUMNS, pairs(comparison)))
            write_text(place / "machines.csv", csv_machines(comparison))
        for row, file in zip(data["rows"], _write_plans(comparison, place), strict=True):
            row["plan_file"] = file
        write_json(place / "comparison.json", data)
        write_text(place / "replays.json", json.dumps(replay_data(comparison)) + "\n")
        _copy_problem(comparison, place)
        if pictures:
            _write_figures(comparison, place)
        if report and pictures:
            write_report(place)
    return target


def _holds_complete(path: Path) -> bool:
    """Return whether a folder holds a comparison whose rows are all finished."""
    with suppress(InputError):
        return read_json(path / "comparison.json").get("complete") is True
    return False


def replay_data(comparison: Comparison) -> dict[str, Any]:
    """Return the part of the replays that replays.json stores, by label, as JSON-ready data.

    `E_deg` lists the error index E of every machine, in the order of their numbers. `median` is the
    motion of the machine with the median E: its `number`, times `t` (s), coordinates `q` (rad, m).
    """
    out = {}
    for row in comparison.rows:
        run = row.replay
        if run is None or not run.angles:
            continue
        k = median_sample(run)
        some = np.unique(np.linspace(0, len(run.t) - 1, MOTION_INSTANTS).round().astype(int))
        motion = {"number": run.numbers[k], "t": run.t[some], "q": np.round(run.motion(k)[some], 9)}
        out[row.label] = {"E_deg": np.round(run.index_E_deg, 6), "median": motion}
    return dict(jsonable(out))


def _copy_problem(comparison: Comparison, place: Path) -> None:
    """Copy the problem file unchanged, if there is one; comparison.json lists changes to it."""
    try:
        text = read_text(comparison.problem.source, TOML_BYTES, "a problem file is TOML")
    except InputError:
        return
    write_text(place / "problem.toml", text)


def _write_plans(comparison: Comparison, place: Path) -> list[str | None]:
    """Write the plans; return each row's file name in the folder, None without a plan."""
    (place / "plans").mkdir()
    out: list[str | None] = []
    for k, row in enumerate(comparison.rows):
        if row.plan is None:
            out.append(None)
            continue
        name = _file_name(row.label)
        ending = ".json" if row.solved else ".refused.json"
        target = place / "plans" / (name + ending)
        if target.exists():
            target = place / "plans" / f"{name}-{k + 1}{ending}"
        row.plan.save(target)
        out.append(f"plans/{target.name}")
    return out


def _file_name(label: str) -> str:
    return re.sub(r"[^\w.=+-]+", "-", label).strip("-")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    engine = figure.get_layout_engine()
    if engine is not None:  # lay out only once, since each layout draws the figure
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.set_dpi(120)  # `savefig` draws twice, once for a layout
    FigureCanvasAgg(figure).print_png(path)


FORMAT, VERSION = "planner-budget", 1


def save_budget(
    budgets: Mapping[str, Budget], path: str | Path, command: str | None = None
) -> Path:
    """Write budget.md, budget.csv, budget.json, and each plan with its figure.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    files = {label: f"plans/{_file_name(label)}.json" for label in budgets}
    each = {k: {**budget.to_dict(), "plan_file": files[k]} for k, budget in budgets.items()}
    head = {"format": FORMAT, "version": VERSION, "command": command, "versions": versions()}
    with folder(path) as place:
        write_text(place / "budget.md", budget_markdown(budgets, command))
        write_text(place / "budget.csv", budget_csv(budgets))
        write_json(place / "budget.json", {**head, "budgets": each})
        (place / "plans").mkdir()
        for label, budget in budgets.items():
            budget.plan.save(place / files[label])
            save_figure(budget.plot(), place / f"budget-{_file_name(label)}.png")
    return Path(path)


def load_budgets(path: str | Path) -> dict[str, Budget]:
    """Read the folder that `Budget.save` or `planner budget --out` wrote, and verify its plans.

    Returns:
        The budgets by the labels of their plans.

    Raises:
        InputError: If the folder is missing, damaged, or of a version without plans.
    """
    place = expect_path(path)
    data = read_json(place / "budget.json", "`planner budget --out FOLDER` writes it")
    if data.get("format") != FORMAT or data.get("version") != VERSION:
        raise InputError(f"{place / 'budget.json'} is not a budget that this planner reads")
    try:
        return {
            label: _budget(each, load_plan(place / each["plan_file"]))
            for label, each in data["budgets"].items()
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{place / 'budget.json'} is damaged: {error!r}; compute the budget again"
        ) from None


def _budget(data: Mapping[str, Any], plan: Plan) -> Budget:
    own = {field.name for field in fields(Budget)} - {"plan", "machine", "costs"}
    costs = tuple(
        Cost(**values_of(each) | {k: each[k] and Index(**each[k]) for k in ("between", "switch")})
        for each in data["costs"]
    )
    machine = Machine.from_table(data["machine"])
    return Budget(plan, machine, costs=costs, **values_of({k: data[k] for k in own}))


def figures(comparison: Comparison) -> dict[str, Figure]:
    """Draw all figures of a comparison, by name, except those for which no plan has the data."""
    plans, system = comparison.plans, comparison.problem.system
    motions = [plan for plan in plans.values() if plan is not None]
    out: dict[str, Figure] = {}
    for name, kind in PLAN_FIGURES.items():
        if kind.fits(system) and any(p.executable or not kind.executable for p in motions):
            out[name] = plot(name, plans, machine=comparison.machine)[0]
    if can_draw(system) and any(plan.executable for plan in motions):
        out["arm"] = plot_arm(plans)[0]
    if any(row.replay is not None and row.replay.angles for row in comparison.rows):
        out |= {name: draw(comparison)[0] for name, draw in REPLAY_FIGURES.items()}
    return out


def _plot_errors(comparison: Comparison) -> tuple[Figure, Any]:
    runs = {row.label: row.replay for row in comparison.rows}
    errors = {k: None if run is None else run.index_E_deg for k, run in runs.items()}
    return plot_errors(errors, refused={row.label for row in comparison.rows if not row.solved})


REPLAY_FIGURES: dict[str, Callable[[Comparison], tuple[Figure, Any]]] = {
    "errors": _plot_errors,
    "effort": plot_efforts,
    "replay": lambda found: plot_replays({row.label: row.replay for row in found.rows}),
}
"""Figures of the replays in a comparison, by name; a name is in `PLAN_FIGURES` or here."""


def draw(comparison: Comparison, name: str) -> Figure:
    """Draw the figure with the given name, one of `figures`; see `Comparison.plot`."""
    if name in REPLAY_FIGURES:
        return REPLAY_FIGURES[name](comparison)[0]
    if name == "arm":
        return plot_arm(comparison.plans)[0]
    return plot(name, comparison.plans, machine=comparison.machine)[0]


def save_sensitivity(
    responses: Sensitivity,
    machine: MachineSensitivity | None,
    spread: Mapping[str, float],
    path: str | Path,
    extra: Mapping[str, Any] | None = None,
) -> Path:
    """Write sensitivity.json, matrix.csv, plan.json, heat-map.png, along.png and machine.png.

    Args:
        responses: Sensitivities to a plan's own parameters.
        machine: Sensitivities to the machine's parameters; None leaves out machine.png.
        spread: Standard deviations of the errors.
        path: The folder. An earlier run's folder is replaced after everything is written.
        extra: Further keys of sensitivity.json.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    with folder(path) as place:
        data = {**(extra or {}), **responses.to_dict(spread)}
        data["machine"] = None if machine is None else machine.to_dict()
        write_json(place / "sensitivity.json", jsonable(data))
        write_text(place / "matrix.csv", _csv(responses))
        responses.plan.save(place / "plan.json")
        plot_sensitivity(responses, spread)[0].savefig(place / "heat-map.png", dpi=120)
        plot_responses(responses, spread)[0].savefig(place / "along.png", dpi=120)
        if machine is not None:
            plot_machine_sensitivity(machine)[0].savefig(place / "machine.png", dpi=120)
    return Path(path)


def save_sensitivities(found: Sensitivities, path: str | Path) -> Path:
    """Write sensitivities.json, .md, .csv and .png, and the plans in plans/.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    with folder(path) as place:
        write_json(place / "sensitivities.json", jsonable(found.to_dict()))
        table = markdown_table(found.columns, found.plans)
        write_text(place / "sensitivities.md", f"{table}\n\n{found.sentence}\n")
        write_text(place / "sensitivities.csv", csv_table(found.columns, found.plans))
        found.plot().savefig(place / "sensitivities.png", dpi=120)
        (place / "plans").mkdir()
        for label, each in found.plans.items():
            each.plan.save(place / "plans" / f"{_file_name(label)}.json")
    return Path(path)


def _csv(responses: Sensitivity) -> str:
    """Return S(T), the sensitivities at the end, as CSV: coordinates by parameters, with units."""
    columns = zip(responses.parameters, responses.units, strict=True)
    rows = [["coordinate", *(f"{name} ({unit})" for name, unit in columns)]]
    for c, row in zip(responses.plan.problem.system.coordinates, responses.terminal, strict=True):
        rows.append([f"{c.name} ({c.unit})", *(f"{value:.10g}" for value in row)])
    return csv_text(rows)


def _write_figures(comparison: Comparison, place: Path) -> None:
    (place / "figures").mkdir()
    for name, figure in comparison.figures().items():
        save_figure(figure, place / "figures" / f"{name}.png")
