"""Tables that compare pairs of plans on the same machines: terminal, Markdown and CSV."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from planner.comparison.comparison import Comparison
from planner.support.package import Table
from planner.support.statistics import Difference
from planner.support.tables import Column, csv_text, markdown, markdown_table, terminal_table

TINY_DEG = 1e-9
"""Difference below which a number is a rounding error and shown as 0, in degrees."""


def _signed_number(value: float) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return f"{value:+.3g}" if np.isfinite(value) else "-"


def _verdict(d: Difference) -> str:
    if not d.significant:
        return "not shown to differ"
    if not d.matters:
        return "no difference that matters"
    return "better" if d.median_deg < 0 else "worse"


VERDICT = ""
"""Key of the verdicts, which CSV lacks."""

TERMINAL_KEYS = ("second", "median_deg", "interval_low_deg", "interval_high_deg", "end_median_deg",
                 VERDICT)  # fmt: skip
"""Keys of the columns shown on a terminal."""

Pair = tuple[Difference, Difference]
"""Differences between two plans: of their E, and of their errors at the end."""


def _figures(k: int, prefix: str, word: str) -> Iterator[Column[Pair]]:
    """Yield the columns of the k-th difference of a pair (0: E, 1: error at the end).

    Their keys in CSV begin with `prefix`; `word` is the title of the difference itself.
    """

    def column(
        title: str, value: Callable[[Difference], Any], shown: Any, name: str, left: bool = False
    ) -> Column[Pair]:
        key = name and f"{prefix}{name}"
        return Column(title, "", lambda pair: value(pair[k]), shown, key=key, left=left)

    yield column(f"{word} (deg)", lambda d: d.median_deg, _signed_number, "median_deg")
    yield column("from", lambda d: d.interval_deg[0], _signed_number, "interval_low_deg")
    yield column("to", lambda d: d.interval_deg[1], _signed_number, "interval_high_deg")
    yield column(
        "better on", lambda d: d.first_better, lambda x: f"{100 * x:.0f} %", "first_better"
    )
    yield column("p_value", lambda d: d.p_value, None, "p_value")
    yield column(
        "p (Holm)",
        lambda d: d.p_corrected,
        lambda p: "<1e-6" if p < 1e-6 else f"{p:.2g}",
        "p_corrected",
    )
    yield column("verdict", _verdict, str, VERDICT, left=True)
    yield column("significant", lambda d: d.significant, None, "significant")
    yield column("matters", lambda d: d.matters, None, "matters")


COLUMNS: list[Column[Pair]] = [
    Column("plan", "", lambda pair: pair[0].first, key="first", left=True, code=True),
    Column("against", "", lambda pair: pair[0].second, key="second", left=True, code=True),
    *_figures(0, "", "E"),
    *_figures(1, "end_", "end"),
]


def rich_differences(comparison: Comparison) -> Table | None:
    """Return a table that compares the recommended plan with every other; None if no other exists.

    If no plan is verified, the plan with the smallest median E counts as the recommended plan.
    """
    take = comparison.recommended or comparison.best
    best = take.label if take else ""
    rows = [
        (_reverse(best, d), _reverse(best, end))
        for d, end in pairs(comparison)
        if best in (d.first, d.second)
    ]
    if not rows:
        return None
    return terminal_table(
        [_narrow(c) for c in COLUMNS if c.key in TERMINAL_KEYS],
        rows,
        ruled=True,
        title=f"{best} against the others, machine by machine",
        caption="E, end: median over the machines of its error minus the other plan's, with the"
        " 95 % interval; verdict: by the sign test, corrected for all pairs.",
    )


def _narrow(column: Column[Pair]) -> Column[Pair]:
    """Return a column narrowed for a terminal of 80 characters."""
    if column.left:
        return replace(column, width=14 if column.key == VERDICT else 20)
    return replace(column, shown=lambda x: f"{x:+.2f}" if np.isfinite(x) else "-")


def pairs(comparison: Comparison) -> list[Pair]:
    """Return the differences of every pair of plans, in E and at the end."""
    return list(zip(comparison.differences, comparison.end_differences, strict=True))


def _reverse(label: str, d: Difference) -> Difference:
    """Return the same difference with the plan `label` as the first of the pair."""
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
    """Return the differences of all pairs of plans as Markdown."""
    return f"""# Differences between plans: {markdown(comparison.problem.name)}

{markdown_table(COLUMNS, pairs(comparison))}

Each plan met the same {comparison.samples} machines ({comparison.machine.preset}), seed \
{comparison.seed}. E: median over the machines of
E of the plan minus E of the other, degrees, with its interval (order statistics: it holds the true
median with at least 95 %, whatever the distribution). End: the same for the error at the end.
Better on: share of the machines on which the plan has the smaller error. p: sign
test, corrected by Holm's method for {len(comparison.differences)} pairs by E and as many by end; \
with many machines small differences are
significant too, but those below {comparison.threshold_deg:g} degrees are too small to matter.
"""


def csv_machines(comparison: Comparison) -> str:
    """Return E and the error at the end of every plan on every machine as CSV, full precision."""
    rows = [
        (row.label, k, *errors)
        for row in comparison.rows
        if row.machine_errors_deg is not None
        for k, errors in enumerate(row.machine_errors_deg.T.tolist())
    ]
    return csv_text([("plan", "machine", "E_deg", "end_deg"), *rows])
