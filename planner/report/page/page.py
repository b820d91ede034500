"""Write a comparison as one page that opens from disk, without network or other files."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from planner.comparison.comparison import Comparison
from planner.comparison.differences import COLUMNS, pairs
from planner.comparison.rows import FEEDBACK_NOTE, Row
from planner.errors import InputError
from planner.machine.replay import ERROR_WORDS, PERCENTILE_WORDS, STATISTICS
from planner.report.charts.scripts import script, source, stylesheet
from planner.report.figures.mechanism import mechanism_svg
from planner.report.figures.style import readable_name
from planner.report.page.series import page_data
from planner.report.page.words import colour_places, question, task_facts, verdict_html
from planner.report.panels import PLAN_FIGURES
from planner.report.result_folder import list_file
from planner.report.saved import load_comparison
from planner.support.files import expect_path, read_json, write_text
from planner.support.tables import Column, Markup, R, html_table

PACKAGE = "planner.report.page"
NO_BREAK = "\N{NO-BREAK SPACE}"

SCRIPTS = ("machines.js", "motion.js", "main.js")
"""Scripts of the page, in order; in the page they follow the scripts of the charts."""


def write_report(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write the web page of a comparison from the comparison's folder.

    Args:
        folder: A folder that `Comparison.save` (or `planner compare --out`) wrote.
        out: The page; by default report.html in the folder.

    Returns:
        The page's path.

    Raises:
        InputError: If the folder is not that of a comparison, a plan in it is no longer valid, or
            the page cannot be written.
    """
    place = expect_path(folder)
    comparison, kept = load_comparison(place, strict=True), place / "replays.json"
    replays = read_json(kept) if kept.exists() else {}
    data = read_json(place / "comparison.json")
    target = place / "report.html" if out is None else Path(out)
    try:
        page = report_page(comparison, replays, data)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder} is damaged, its files do not match: {error!r:.200}; compare again"
        ) from None
    written = write_text(target, page)
    if out is None:
        list_file(written)
    return written


def report_page(comparison: Comparison, replays: Mapping[str, Any], data: Mapping[str, Any]) -> str:
    """Return the page of a comparison as HTML.

    Args:
        comparison: The comparison with its plans.
        replays: Content of the folder's replays.json (`folders.replay_data`), {} without it.
        data: The content of comparison.json, of which `command`, `versions` and `rows` are used.
    """
    svg = mechanism_svg(comparison.problem.system)  # "" for systems without a drawing
    drawing = base64.b64encode(svg.encode()).decode()
    page = json.dumps(page_data(comparison, replays), separators=(",", ":"), ensure_ascii=False)
    return _fill(
        "page.html",
        title=html.escape(comparison.problem.name),
        style=stylesheet(PACKAGE, "page.css"),
        question=question(comparison.problem),
        verdict=verdict_html(comparison),
        facts=_definitions(task_facts(comparison)),
        partial="" if comparison.complete else _PARTIAL,
        table=_table(comparison),
        differences=_differences(comparison),
        worst=_worst(data.get("rows") or []),
        mechanism=drawing and _fill("mechanism.html", data=drawing),
        figures=_figures(),
        samples=str(comparison.samples),
        errors=ERROR_WORDS,
        percentiles=PERCENTILE_WORDS,
        middle=STATISTICS["E_median_deg"].title,
        high=STATISTICS["E_p95_deg"].title,
        closed=FEEDBACK_NOTE if any(row.feedback for row in comparison.rows) else "",
        command=html.escape(data.get("command") or "made from Python"),
        versions=_definitions(list(dict(data.get("versions") or {}).items())),
        machine=html.escape(json.dumps(comparison.machine.to_dict(), indent=1)),
        problem=html.escape(json.dumps(comparison.problem.to_dict(), indent=1)),
        data=page.replace("<", "\\u003c"),
        script=script(PACKAGE, SCRIPTS),
    )


def _fill(template: str, **texts: str) -> str:
    """Return a template of this folder with its fields filled in."""
    return Template(source(PACKAGE, template)).substitute(texts)


_PARTIAL = "<p><b>Partial: interrupted before all methods were finished.</b></p>"


def _definitions(pairs: Sequence[tuple[str, str]]) -> str:
    return "\n".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in pairs
    )


def _figures() -> str:
    """Return a hidden, empty figure with a caption for each entry of `PLAN_FIGURES`.

    The page's script fills and shows the figures for which there is data.
    """
    return "\n".join(
        f'<figure id="fig-{one.id}" hidden>\n<figcaption><b>{html.escape(one.title)}.</b>'
        f' {html.escape(one.caption)}</figcaption>\n<div class="panels"></div>\n</figure>'
        for one in PLAN_FIGURES.values()
    )


def _table(comparison: Comparison) -> str:
    place, tries = colour_places(comparison), comparison.advice
    name = Column[Row]("plan", "", lambda row: _name(place[row.label], row, tries.get(row.label)))
    numbers = [
        _typeset(c, "|".join(map(readable_name, c.title.split("|"))).replace(" %", NO_BREAK + "%"))
        for c in comparison.columns
        if c.shown is not None and not c.left
    ]
    taken = comparison.recommended

    def kind(row: Row) -> str:
        return "taken" * (row is taken) if row.solved else "refused"

    return html_table([name, *numbers], comparison.in_order, kind=kind)


def _typeset(column: Column[R], title: str) -> Column[R]:
    """Return the column with another title, and with typographic minus signs."""
    return Column(title, column.unit, lambda row: column.text(row).replace("-", "−"))


def _differences(comparison: Comparison) -> str:
    """Return a collapsed table that compares each two plans on the same machines, or ""."""
    if not comparison.differences:
        return ""
    columns = [_typeset(c, c.title) for c in COLUMNS if c.shown is not None]
    table = html_table(columns, pairs(comparison), kind=lambda _: "")
    return _fill("differences.html", table=table)


def _worst(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a collapsed list of commands, each of which replays one plan on its worst machine."""
    finite = [
        f"# {row['label']}: machine {row['worst']}\n{row['worst_command']}"
        for row in rows
        if row.get("worst_command")
    ]
    if not finite:
        return ""
    lines = html.escape("\n\n".join(finite))
    return (
        "<details><summary>The worst machine of each plan, alone</summary>"
        f'<pre class="wrapped" tabindex="0">{lines}</pre></details>'
    )


def _name(k: int, row: Row, advice: str | None) -> Markup:
    badge = "solved" if row.solved else "refused"
    label = html.escape(row.label).replace(":", ":<wbr>")
    why = f'<span class="badge {badge}">{badge}</span> {html.escape(row.remark)}'
    tries = f"<span class=why>Try: {html.escape(advice)}</span>" if advice else ""
    style = " closed" if row.feedback else "" if row.solved else " dashed"
    swatch = f'<span class="swatch plan-{k}{style}" data-label="{html.escape(row.label)}"'
    swatch += ' aria-hidden="true"></span>'
    return Markup(f"{swatch} {label}<span class=why>{why}</span>{tries}")
