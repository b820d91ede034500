"""A comparison as a table: for a terminal, as Markdown, as CSV."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from planner import display
from planner.display import clean, markdown_code
from planner.html_table import html_table
from planner.report.provenance import command, worst_command

if TYPE_CHECKING:
    from rich.table import Table

    from planner.comparison import Comparison, Row


CLOSED = (
    " Rows with feedback: the same plan with the tracker closing the loop; effort is the median of"
    " what it commanded, |u1| and |u2| the largest motor speeds on any machine."
)

WIDTH, NAME = 100, 20
"""Widest table, and widest name of a method in it, in characters."""


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        title: What it holds, in few words.
        unit: Its unit, or "".
        text: From row to cell.
    """

    title: str
    unit: str
    text: Callable[[Row], str]


def columns(comparison: Comparison) -> list[Column]:
    """The columns of issue and design, in their order."""
    system = comparison.problem.system
    length, (first, second) = system.coordinates[0].unit, system.inputs
    return [
        Column("travel", length, lambda r: number(r.travel_rad, 4)),
        Column("effort", "", lambda r: number(r.effort, 4)),
        Column("|u1|", first.unit, lambda r: number(r.peak_u[0])),
        Column("|u2|", second.unit, lambda r: number(r.peak_u[1])),
        Column("domain margin", "", lambda r: number(r.domain_margin)),
        Column("ideal error", "deg", lambda r: number(r.terminal_error_deg, 2)),
        Column("E 50 %", "deg", lambda r: number(r.E_median_deg)),
        Column("E 95 %", "deg", lambda r: number(r.E_p95_deg)),
        Column("solve", "s", lambda r: number(r.solve_time_s, 2)),
    ]


INTERVALS = [
    Column("E 50 % from", "deg", lambda r: number(r.E_median_interval_deg[0])),
    Column("E 50 % to", "deg", lambda r: number(r.E_median_interval_deg[1])),
    Column("E 95 % from", "deg", lambda r: number(r.E_p95_interval_deg[0])),
    Column("E 95 % to", "deg", lambda r: number(r.E_p95_interval_deg[1])),
]
"""More columns, for which a terminal has no room: 95 % confidence intervals."""


def verdict(row: Row) -> str:
    """Solved, or why not."""
    word = "yes" if row.solved else "no"
    return f"{word}: {row.why}" if row.why or not row.solved else word


def number(value: float, digits: int = 3) -> str:
    """A number in few characters; "-" when it is not defined."""
    if not np.isfinite(value):
        return "-"
    if value == 0 or 1e-3 <= abs(value) < 10**digits:
        return f"{value:.{digits}g}"
    if abs(value) < 1e5 and abs(value) >= 1:
        return f"{value:.0f}"
    return f"{value:.0e}"


def rich_table(comparison: Comparison) -> Table:
    """For a terminal, at most 100 columns wide."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        box=SIMPLE_HEAD,
        padding=0,
        show_edge=False,
        pad_edge=False,
        caption=_explained(comparison),
        caption_justify="left",
    )
    shown = columns(comparison)
    heads = [c.title.replace(" ", "\n", 1) + (f"\n{c.unit}" if c.unit else "") for c in shown]
    cells = [[column.text(row) for column in shown] for row in comparison.rows]
    names = [row.label.replace(":", ":\n") for row in comparison.rows]
    name_width = min(NAME, _width(["method", *names]))
    figures = sum(1 + _width([head, *column]) for head, *column in zip(heads, *cells, strict=True))
    table.add_column("method", width=name_width, overflow="fold")
    table.add_column("solved", max_width=WIDTH - name_width - 1 - figures, overflow="fold")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for row, name, texts in zip(comparison.rows, names, cells, strict=True):
        table.add_row(name, verdict(row), *texts, style="" if row.solved else "dim")
    return table


def _width(texts: Sequence[str]) -> int:
    """Columns that the widest line takes."""
    return max(len(part) for text in texts for part in text.split("\n"))


def markdown(comparison: Comparison) -> str:
    """Markdown text with a heading, the table, what it says, and how to make it again."""
    shown = [*columns(comparison), *INTERVALS]
    titles = ["method", "solved", *(_titled(column) for column in shown)]
    rule = ["---", "---", *("---:" for _ in shown)]
    body = [
        [markdown_code(row.label), display.markdown(verdict(row)), *(c.text(row) for c in shown)]
        for row in comparison.rows
    ]
    lines = ["| " + " | ".join(cells) + " |" for cells in (titles, rule, *body)]
    repeat = command(comparison)
    again = (
        f"Made by:\n\n    {clean(repeat)}\n"
        if repeat
        else "Made from Python; `comparison.json` holds the problem, the machine and the seed.\n"
    )
    heading = f"# Comparison: {display.markdown(comparison.problem.name)}\n"
    if not comparison.complete:
        heading += "\n**Partial: interrupted before all methods were done.**\n"
    after = ["", _explained(comparison), "", *_worst(comparison), again]
    return "\n".join([heading, *lines, *after])


def html(comparison: Comparison) -> str:
    """What a notebook shows: the table of the terminal."""
    shown = columns(comparison)
    titles = [column.title + (f" ({column.unit})" if column.unit else "") for column in shown]
    rows = [(row.label, verdict(row), *(c.text(row) for c in shown)) for row in comparison.rows]
    table = html_table(("method", "solved", *titles), rows, comparison.problem.name)
    return f"{table}<p><small>{escape(_explained(comparison))}</small></p>"


def _worst(comparison: Comparison) -> list[str]:
    """The machine with the largest error of each plan, and the command that replays it alone."""
    lines = [
        f"- {markdown_code(row.label)}: E {number(float(row.replay.index_E_deg.max()))} deg"
        f" on machine {row.worst}: `{clean(str(worst_command(comparison, row)))}`"
        for row in comparison.rows
        if row.replay is not None and row.worst is not None
    ]
    if not lines or command(comparison) is None:
        return []
    return ["Worst machine of each plan:", "", *lines, ""]


def csv_text(comparison: Comparison) -> str:
    """One line a method, full precision, empty where a number is not defined."""
    rows = [_flat(row) for row in comparison.rows]
    return display.csv_text([list(rows[0]), *(list(row.values()) for row in rows)])


def _flat(row: Row) -> dict[str, Any]:
    data = row.to_dict()
    data["peak_u1_rad_s"], data["peak_u2_rad_s"] = data.pop("peak_u_rad_s")
    for name in ("E_median", "E_p95"):
        low, high = data.pop(f"{name}_interval_deg")
        data |= {f"{name}_low_deg": low, f"{name}_high_deg": high}
    del data["replay"]
    return data


def _titled(column: Column) -> str:
    return display.markdown(column.title + (f" ({column.unit})" if column.unit else ""))


def _explained(comparison: Comparison) -> str:
    return (
        "effort: integral of u1^2 + u2^2 dt; ideal error: largest joint error at the goal by exact"
        " kinematics; E: largest joint error on the machine at any time (eq. 29), median and 95th"
        f" percentile over {comparison.samples} machines ({comparison.machine.preset}), seed"
        f" {comparison.seed}, the same machines for every plan; refused plans that can be executed"
        " are replayed for study."
        + (CLOSED if any(row.feedback for row in comparison.rows) else "")
        + "".join(f" {row.label}: {row.note}." for row in comparison.rows if row.note)
    )
