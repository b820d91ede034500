"""Pairs of plans on the same machines, as a table: for a terminal, as Markdown, as CSV."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.support.statistics import Difference
from planner.support.tables import Column, csv_table, markdown, markdown_table, terminal_table

if TYPE_CHECKING:
    from rich.table import Table

    from planner.comparison.comparison import Comparison

TINY_DEG = 1e-9
"""What is smaller is rounding."""


def _signed_number(value: float) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return f"{value:+.3g}" if np.isfinite(value) else "-"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _p_value(p: float) -> str:
    return "<1e-6" if p < 1e-6 else f"{p:.2g}"


def _verdict(d: Difference) -> str:
    if not d.significant:
        return "not shown to differ"
    if not d.matters:
        return "no difference that matters"
    return "better" if d.median_deg < 0 else "worse"


COLUMNS: list[Column[Difference]] = [
    Column("plan", "", lambda d: d.first, key="first", left=True, code=True),
    Column("against", "", lambda d: d.second, key="second", left=True, code=True),
    Column("difference (deg)", "", lambda d: d.median_deg, _signed_number, key="median_deg"),
    Column("from", "", lambda d: d.interval_deg[0], _signed_number, key="interval_low_deg"),
    Column("to", "", lambda d: d.interval_deg[1], _signed_number, key="interval_high_deg"),
    Column("better on", "", lambda d: d.first_better, _percent, key="first_better"),
    Column("p_value", "", lambda d: d.p_value, None),
    Column("p (Holm)", "", lambda d: d.p_corrected, _p_value, key="p_corrected"),
    Column("verdict", "", _verdict, key="", left=True),
    Column("significant", "", lambda d: d.significant, None),
    Column("matters", "", lambda d: d.matters, None),
]


def rich_differences(comparison: Comparison) -> Table | None:
    """The best plan against every other, for a terminal; None with fewer than two plans."""
    best = comparison.best
    pairs = [_reverse(best, d) for d in comparison.differences if best in (d.first, d.second)]
    if not pairs:
        return None
    return terminal_table(
        COLUMNS[1:],
        pairs,
        ruled=True,
        title=f"{best} against the others, machine by machine",
        caption="difference: median over the machines of E minus the other plan's E, with its 95 %"
        " interval; p: sign test, corrected for all pairs.",
    )


def _reverse(label: str, d: Difference) -> Difference:
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
    return f"""# Differences between plans: {markdown(comparison.problem.name)}

{markdown_table(COLUMNS, comparison.differences)}

Each plan met the same {comparison.samples} machines ({comparison.machine.preset}), seed \
{comparison.seed}. Difference: median over the machines of
E of the plan minus E of the other, degrees, with its 95 % interval (order statistics; exact for any
distribution). Better on: share of the machines on which the plan has the smaller E. p: sign
test, corrected for {len(comparison.differences)} pairs by Holm's method; with many \
machines small differences are
significant too, but those below {comparison.threshold_deg:g} degrees are too small to matter.
"""


def csv_differences(comparison: Comparison) -> str:
    """All pairs, full precision, empty where a number is not defined."""
    return csv_table(COLUMNS, comparison.differences)
