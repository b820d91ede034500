"""A comparison as a folder, written whole or not at all."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.files import folder, write_text
from planner.jsonable import jsonable
from planner.reading import TOML_BYTES, read_text
from planner.report.differences import csv_differences, markdown_differences
from planner.report.html import write_report
from planner.report.provenance import command
from planner.report.replays import median_sample
from planner.report.table import csv_text, markdown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.comparison import Comparison

FIGURE_KINDS = ("png", "svg")
MOTION = 300
"""Instants kept of the median machine's motion."""


def save(comparison: Comparison, path: str | Path, *, report: bool = False) -> Path:
    """Write table.md, table.csv, comparison.json, replays.json, problem.toml, plans/ and figures/.

    Plans that were refused are saved as `<label>.refused.json`.

    Args:
        comparison: What to write.
        path: The folder; an earlier run's is replaced, and only when all is written.
        report: Whether to add the page report.html; see `planner.report.html.write_report`.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    with folder(path) as place:
        data = comparison.to_dict()
        data["command"] = command(comparison, str(path), report=report)
        write_text(place / "table.md", markdown(comparison))
        write_text(place / "table.csv", csv_text(comparison))
        if comparison.differences:
            write_text(place / "differences.md", markdown_differences(comparison))
            write_text(place / "differences.csv", csv_differences(comparison))
        for row, file in zip(data["rows"], _write_plans(comparison, place), strict=True):
            row["plan_file"] = file
        text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False)
        write_text(place / "comparison.json", text + "\n")
        write_text(place / "replays.json", json.dumps(replay_data(comparison)) + "\n")
        _copy_problem(comparison, place)
        _write_figures(comparison, place)
        if report:
            write_report(place)
    return Path(path)


def replay_data(comparison: Comparison) -> dict[str, Any]:
    """What is kept of the replays, by label, JSON-ready.

    `E_deg` is the error index of every machine, in the order of their numbers; `median` the motion
    of the machine whose E is the median: its `number`, times `t` (s) and coordinates `q` (rad, m).
    """
    out = {}
    for row in comparison.rows:
        run = row.replay
        if run is None or not run.angles:
            continue
        k = median_sample(run)
        some = np.unique(np.linspace(0, len(run.t) - 1, MOTION).round().astype(int))
        motion = {"number": run.numbers[k], "t": run.t[some], "q": np.round(run.q[k, some], 9)}
        out[row.label] = {"E_deg": np.round(run.index_E_deg, 6), "median": motion}
    return dict(jsonable(out))


def _copy_problem(comparison: Comparison, place: Path) -> None:
    """The file as it is; changes against it are in the command of comparison.json."""
    try:
        text = read_text(comparison.problem.source, TOML_BYTES, "a problem file is TOML")
    except InputError:
        return
    write_text(place / "problem.toml", text)


def _write_plans(comparison: Comparison, place: Path) -> list[str | None]:
    """Where each row's plan is, in the folder; None for rows without one."""
    (place / "plans").mkdir()
    out: list[str | None] = []
    for k, row in enumerate(comparison.rows):
        if row.plan is None:
            out.append(None)
            continue
        name = re.sub(r"[^\w.=+-]+", "-", row.label).strip("-")
        ending = ".json" if row.solved else ".refused.json"
        target = place / "plans" / (name + ending)
        if target.exists():
            target = place / "plans" / f"{name}-{k + 1}{ending}"
        row.plan.save(target)
        out.append(f"plans/{target.name}")
    return out


def _write_figures(comparison: Comparison, place: Path) -> None:
    import matplotlib as mpl

    (place / "figures").mkdir()
    with mpl.rc_context({"svg.hashsalt": "planner"}):
        for name, figure in comparison.figures().items():
            save_figure(figure, place / "figures" / name)


def save_figure(figure: Figure, stem: Path) -> None:
    """Write a figure in every kind of file, `stem` with each ending."""
    engine = figure.get_layout_engine()
    if engine is not None:  # place everything once: drawing twice as often is what takes time
        engine.execute(figure)
        figure.set_layout_engine("none")
    for kind in FIGURE_KINDS:
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(f"{stem}.{kind}", dpi=120, metadata=metadata)
