"""Pairs of plans on the same machines, as a table: for a terminal, as Markdown, as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.support.statistics import Difference
from planner.support.tables import csv_text, markdown, markdown_code

if TYPE_CHECKING:
    from rich.table import Table

    from planner.comparison.comparison import Comparison

HEAD = ("plan", "against", "difference (deg)", "from", "to", "better on", "p (Holm)", "verdict")

NAME = 36
"""Widest name of a plan, in characters; longer ones are broken."""

TINY_DEG = 1e-9
"""What is smaller is rounding."""


def rich_differences(comparison: Comparison) -> Table | None:
    """The best plan against every other, for a terminal; None with fewer than two plans."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    best = comparison.best
    found = [_seen_from(best, d) for d in comparison.differences if best in (d.first, d.second)]
    if not found:
        return None
    table = Table(
        title=f"{best} against the others, machine by machine",
        title_justify="left",
        title_style="",
        box=SIMPLE_HEAD,
        padding=0,
        show_edge=False,
        pad_edge=False,
        caption="difference: median over the machines of E minus the other plan's E, with its 95 %"
        " interval; p: Wilcoxon's signed-rank test, corrected for all pairs.",
        caption_justify="left",
    )
    for head in HEAD[1:]:
        words = head in ("against", "verdict")
        table.add_column(
            head.replace(" (", "\n(").replace(" on", "\non"),
            justify="left" if words else "right",
            no_wrap=not words,
            overflow="fold",
            max_width=NAME if head == "against" else None,
        )
    for d in found:
        table.add_row(*_cells(d)[1:])
    return table


def _seen_from(label: str, d: Difference) -> Difference:
    """The same with this plan as the first."""
    if d.first == label:
        return d
    low, high = d.interval_deg
    return replace(
        d,
        first=d.second,
        second=d.first,
        median_deg=-d.median_deg,
        interval_deg=(-high, -low),
        first_better=1 - d.first_better,
    )


def markdown_differences(comparison: Comparison) -> str:
    """All pairs as Markdown."""
    lines = [_line(HEAD), _line(["---"] * 2 + ["---:"] * 5 + ["---"])]
    lines += [
        _line([markdown_code(d.first), markdown_code(d.second), *_cells(d)[2:]])
        for d in comparison.differences
    ]
    return f"""# Differences between plans: {markdown(comparison.problem.name)}

{chr(10).join(lines)}

Each plan met the same {comparison.samples} machines ({comparison.machine.preset}), seed \
{comparison.seed}. Difference: median over the machines of
E of the plan minus E of the other, degrees, and its 95 % interval (order statistics; exact for any
distribution). Better on: share of the machines on which the plan has the smaller E. p: Wilcoxon's
signed-rank test, corrected for {len(comparison.differences)} pairs by Holm's method; with many \
machines small differences are
significant too, so look at their size.
"""


def csv_differences(comparison: Comparison) -> str:
    """All pairs, full precision, empty where a number is not defined."""
    rows = [{**asdict(d), "significant": d.significant} for d in comparison.differences]
    keys = [*Difference.__dataclass_fields__, "significant"]
    at = keys.index("interval_deg")
    keys[at : at + 1] = ["interval_low_deg", "interval_high_deg"]
    cells: list[list[Any]] = [keys]
    for row in rows:
        low, high = row.pop("interval_deg")
        row |= {"interval_low_deg": low, "interval_high_deg": high}
        cells.append(["" if row[key] != row[key] else row[key] for key in keys])
    return csv_text(cells)


def _cells(d: Difference) -> list[str]:
    better = "better" if d.median_deg < 0 else "worse"
    return [
        d.first,
        d.second,
        *(_number(value) for value in (d.median_deg, *d.interval_deg)),
        f"{100 * d.first_better:.0f} %",
        f"{d.p_corrected:.2g}",
        better if d.significant else "not shown to differ",
    ]


def _number(value: float) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return f"{value:+.3g}" if np.isfinite(value) else "-"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
