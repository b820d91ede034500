"""Error budgets: as tables, as bars, and as a folder, written whole or not at all."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner import display
from planner.budget import Budget, Cost, Index
from planner.display import clean, markdown_code
from planner.files import folder, write_text
from planner.report.folder import save_figure
from planner.report.provenance import versions
from planner.report.style import COLOURS, grid, legend
from planner.report.table import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

FORMAT, VERSION = "planner-budget", 1

HEAD = (
    "effect",
    "alone (deg)",
    "saves (deg)",
    "from",
    "to",
    "between, first",
    "between, total",
    "switch, first",
    "switch, total",
)
TERMINAL = (0, 1, 2, 3, 4, 6, 8)
"""Columns for which a terminal has room."""

TINY_DEG = 1e-4
"""What is smaller is shown as 0: it is that of the integration."""

EXPLAINED = (
    "alone: median error index E (eq. 29) with this effect and no other; saves: median over the"
    " machines of what E falls by when this effect alone is switched off, with its 95 % interval;"
    " between: Sobol indices of E between machines (what has no spread has none); switch: Sobol"
    " index of the effect being on or off, all others on or off at random; both with half of their"
    " 95 % interval."
)


def rich_table(budget: Budget) -> Table:
    """For a terminal, at most 100 columns wide."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=f"Error budget of {budget.plan.method}: {_total(budget)}",
        title_justify="left",
        title_style="",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        pad_edge=False,
        caption=f"{EXPLAINED} {_idle(budget)}",
        caption_justify="left",
    )
    for k in TERMINAL:
        head = HEAD[k].replace(" (", "\n(").replace(", ", ",\n")
        table.add_column(head, justify="right" if k else "left", no_wrap=k > 0, overflow="fold")
    for cost in budget.costs:
        cells = _cells(cost)
        table.add_row(*(cells[k] for k in TERMINAL))
    return table


def markdown(budgets: Mapping[str, Budget], command: str | None = None) -> str:
    """Markdown text, one table a plan."""
    lines = ["# Error budget", ""]
    for label, budget in budgets.items():
        lines += [f"## {markdown_code(label)}", "", _total(budget) + ".", "", _line(HEAD)]
        lines += [_line(["---", *["---:"] * (len(HEAD) - 1)])]
        lines += [_line(_cells(cost)) for cost in budget.costs]
        lines += ["", _idle(budget), ""]
    first = next(iter(budgets.values()))
    lines += [
        f"{first.samples} machines ({first.machine.preset}) a median; Sobol indices by Saltelli's"
        f" scheme from {first.base} base samples; seed {first.seed}.",
        "",
        EXPLAINED[0].upper() + EXPLAINED[1:],
    ]
    if command:
        lines += ["", f"Made by:\n\n    {clean(command)}"]
    return "\n".join(lines) + "\n"


def csv_text(budgets: Mapping[str, Budget]) -> str:
    """One line an effect of a plan, full precision, empty where a number is not defined."""
    ends = [
        f"{key}{end}" for key in ("alone", "saves") for end in ("_deg", "_low_deg", "_high_deg")
    ]
    parts = ("first", "first_half", "total", "total_half")
    shares = [f"{kind}_{part}" for kind in ("between", "switch") for part in parts]
    rows: list[list[Any]] = [["plan", "effect", *ends, *shares]]
    for label, budget in budgets.items():
        for cost in budget.costs:
            kinds = (cost.between, cost.switch)
            numbers = [cost.alone_deg, *cost.alone_interval_deg]
            numbers += [cost.saves_deg, *cost.saves_interval_deg]
            numbers += [getattr(i, p) if i else np.nan for i in kinds for p in parts]
            rows.append([label, cost.name, *("" if x != x else x for x in numbers)])
    return display.csv_text(rows)


def plot_budget(budget: Budget, *, axes: Any = None) -> tuple[Figure, Any]:
    """What each effect costs, and its shares of the variance, as bars with 95 % intervals.

    Args:
        budget: The budget.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).
    """
    ours = axes is None
    high = 0.3 * len(budget.costs) + 1.2
    figure, axes = grid(1, 2, axes, size=(5.2, high), share=("none", "all"))
    left, right = axes[0]
    places = np.arange(len(budget.costs))
    costs = budget.costs
    _bars(left, places - 0.2, [c.saves_deg for c in costs], _reach(costs, "saves"), 0, "saves")
    _bars(left, places + 0.2, [c.alone_deg for c in costs], _reach(costs, "alone"), 1, "alone")
    left.set_xlabel("error index E (deg)")
    for k, kind in enumerate(("between", "switch")):
        known = [getattr(c, kind) or Index(np.nan, np.nan, np.nan, np.nan) for c in costs]
        half = np.array([i.total_half for i in known])
        label = "between machines" if kind == "between" else "on or off"
        values = [i.total for i in known]
        _bars(right, places + (k - 0.5) * 0.4, values, np.stack([half, half]), 2 + k, label)
    right.set_xlabel("total Sobol index: share of the variance of E")
    right.set_xlim(left=min(0.0, right.get_xlim()[0]), right=min(1.2, right.get_xlim()[1]))
    left.set_yticks(places, [_words(c.name) for c in costs])
    left.set_ylim(len(costs) - 0.4, -0.6)
    if ours:
        figure.suptitle(f"Error budget of {budget.plan.method}: {_total(budget)}", fontsize=11)
    handles = [h for ax in (left, right) for h in ax.get_legend_handles_labels()[0]]
    legend(figure, axes, handles, ours=ours, abreast=4)
    return figure, axes


def save(budgets: Mapping[str, Budget], path: str | Path, command: str | None = None) -> Path:
    """Write budget.md, budget.csv, budget.json and a figure for each plan.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    import matplotlib as mpl

    data = {
        "format": FORMAT,
        "version": VERSION,
        "command": command,
        "versions": versions(),
        "budgets": {label: budget.to_dict() for label, budget in budgets.items()},
    }
    with folder(path) as place, mpl.rc_context({"svg.hashsalt": "planner"}):
        write_text(place / "budget.md", markdown(budgets, command))
        write_text(place / "budget.csv", csv_text(budgets))
        text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False)
        write_text(place / "budget.json", text + "\n")
        for label, budget in budgets.items():
            name = re.sub(r"[^\w.=+-]+", "-", label).strip("-")
            save_figure(budget.figure(), place / f"budget-{name}")
    return Path(path)


def _bars(ax: Any, places: Any, values: Any, reach: Any, colour: int, label: str) -> None:
    style = {"height": 0.38, "color": COLOURS[colour], "label": label}
    ax.barh(places, values, xerr=reach, error_kw={"linewidth": 0.9, "ecolor": "#444444"}, **style)


def _reach(costs: tuple[Cost, ...], kind: str) -> Any:
    """How far the interval reaches to either side, (2, effects); nothing where it is unknown."""
    middle = np.array([getattr(c, f"{kind}_deg") for c in costs])
    ends = np.array([getattr(c, f"{kind}_interval_deg") for c in costs]).reshape(-1, 2)
    return np.nan_to_num(np.maximum([middle - ends[:, 0], ends[:, 1] - middle], 0.0))


def _cells(cost: Cost) -> list[str]:
    low, high = (_degrees(x, "+.2g") for x in cost.saves_interval_deg)
    between = cost.between
    return [
        cost.name,
        _degrees(cost.alone_deg, ".3g"),
        _degrees(cost.saves_deg, "+.3g"),
        low,
        high,
        _share(between.first, between.first_half) if between else "-",
        _share(between.total, between.total_half) if between else "-",
        _share(cost.switch.first, cost.switch.first_half),
        _share(cost.switch.total, cost.switch.total_half),
    ]


def _degrees(value: float, style: str) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return format(value, style) if np.isfinite(value) else "-"


def _share(value: float, half: float) -> str:
    return f"{value:.2f} +- {half:.2f}"


def _total(budget: Budget) -> str:
    """The median error with its interval, and what is left without any effect."""
    low, high = (number(x) for x in budget.E_interval_deg)
    none = _degrees(budget.none_deg, ".3g")
    return f"median E {number(budget.E_deg)} deg ({low} to {high}), {none} without any effect"


def _idle(budget: Budget) -> str:
    if not budget.idle:
        return ""
    return f"On, and without influence here: {', '.join(budget.idle)}."


def _words(name: str) -> str:
    """An effect's name without its unit."""
    units = r"(?<!per)_(deg|s|nm|nm_per_rad|nms_per_rad|rad_s|rad_s2|kgm2)$"
    return re.sub(units, "", name).replace("_", " ")


def _line(cells: Any) -> str:
    return "| " + " | ".join(cells) + " |"
