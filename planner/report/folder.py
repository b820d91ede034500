"""A comparison as a folder, written whole or not at all."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from planner.files import folder, write_text
from planner.report.provenance import command
from planner.report.table import csv_text, markdown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.comparison import Comparison

FIGURE_KINDS = ("png", "svg")


def save(comparison: Comparison, path: str | Path) -> Path:
    """Write table.md, table.csv, comparison.json, problem.toml, plans/ and figures/.

    Plans that were refused are saved as `<label>.refused.json`.

    Args:
        comparison: What to write.
        path: The folder; an earlier run's is replaced, and only when all is written.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    with folder(path) as place:
        data = comparison.to_dict()
        data["command"] = command(comparison, str(path))
        write_text(place / "table.md", markdown(comparison))
        write_text(place / "table.csv", csv_text(comparison))
        text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False)
        write_text(place / "comparison.json", text + "\n")
        _copy_problem(comparison, place)
        _write_plans(comparison, place)
        _write_figures(comparison, place)
    return Path(path)


def _copy_problem(comparison: Comparison, place: Path) -> None:
    """The file as it is; changes against it are in the command of comparison.json."""
    try:
        text = Path(comparison.problem.source).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return
    write_text(place / "problem.toml", text)


def _write_plans(comparison: Comparison, place: Path) -> None:
    (place / "plans").mkdir()
    for k, row in enumerate(comparison.rows):
        if row.plan is None:
            continue
        name = re.sub(r"[^\w.=+-]+", "-", row.label).strip("-")
        ending = ".json" if row.solved else ".refused.json"
        target = place / "plans" / (name + ending)
        if target.exists():
            target = place / "plans" / f"{name}-{k + 1}{ending}"
        row.plan.save(target)


def _write_figures(comparison: Comparison, place: Path) -> None:
    import matplotlib as mpl

    (place / "figures").mkdir()
    with mpl.rc_context({"svg.hashsalt": "planner"}):
        for name, figure in comparison.figures().items():
            _lay_out(figure)
            for kind in FIGURE_KINDS:
                metadata = {"Date": None} if kind == "svg" else {}
                target = place / "figures" / f"{name}.{kind}"
                figure.savefig(target, dpi=120, metadata=metadata)


def _lay_out(figure: Figure) -> None:
    """Place everything once, for all kinds of file: drawing twice as often is what takes time."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
