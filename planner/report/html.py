"""A comparison as one page that opens from disk: no network, no other files."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from planner.comparison import Comparison, Row
from planner.files import write_text
from planner.report.load import load_comparison, load_replays, read_json
from planner.report.series import page_data
from planner.report.table import columns
from planner.report.words import answers, facts, question, subscripted, verdict

SCRIPTS = ("scale.js", "chart.js", "kinds.js", "motion.js", "main.js")
"""Read in this order into one script."""


def write_report(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write the page of a comparison's folder.

    Args:
        folder: A folder that `Comparison.save` (or `planner compare --out`) wrote.
        out: The page; report.html in the folder when left out.

    Returns:
        The page's path.

    Raises:
        InputError: If the folder is not that of a comparison, or the page cannot be written.
    """
    place = Path(folder)
    comparison, replays = load_comparison(place), load_replays(place)
    made = read_json(place / "comparison.json", "")
    target = place / "report.html" if out is None else Path(out)
    return write_text(target, report_page(comparison, replays, made))


def report_page(comparison: Comparison, replays: Mapping[str, Any], made: Mapping[str, Any]) -> str:
    """The page.

    Args:
        comparison: With its plans.
        replays: What `load_replays` gives.
        made: `command` and `versions`, as in comparison.json.
    """
    page = files("planner.report").joinpath("page")
    script = "\n".join(page.joinpath(name).read_text(encoding="utf-8") for name in SCRIPTS)
    data = json.dumps(page_data(comparison, replays), separators=(",", ":"), ensure_ascii=False)
    return Template(page.joinpath("page.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(comparison.problem.name),
        style=page.joinpath("page.css").read_text(encoding="utf-8"),
        question=question(comparison.problem),
        verdict=verdict(comparison),
        answers=_answers(comparison),
        facts=_definitions(facts(comparison)),
        table=_table(comparison),
        samples=str(comparison.samples),
        command=html.escape(made.get("command") or "made from Python"),
        versions=_definitions(list(dict(made.get("versions") or {}).items())),
        machine=html.escape(json.dumps(comparison.machine.to_dict(), indent=1)),
        problem=html.escape(json.dumps(comparison.problem.to_dict(), indent=1)),
        data=data.replace("<", "\\u003c"),
        script=script,
    )


def _answers(comparison: Comparison) -> str:
    items = []
    for k, (row, text) in enumerate(zip(comparison.rows, answers(comparison), strict=True)):
        items.append(f"<li>{_swatch(k, row)} <b>{html.escape(row.label)}</b> {text}</li>")
    return "\n".join(items)


def _definitions(pairs: Sequence[tuple[str, str]]) -> str:
    return "\n".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in pairs
    )


def _table(comparison: Comparison) -> str:
    shown = columns(comparison)
    heads = [(_symbols(c.title), html.escape(c.unit)) for c in shown]
    head = "".join(
        f'<th scope="col">{title}{f"<span class=unit>{unit}</span>" if unit else ""}</th>'
        for title, unit in heads
    )
    body = []
    for k, row in enumerate(comparison.rows):
        cells = "".join(
            f'<td data-head="{title}">{html.escape(c.text(row)).replace("-", "−")}'
            f"{f'<span class=unit>{unit}</span>' if unit else ''}</td>"
            for c, (title, unit) in zip(shown, heads, strict=True)
        )
        body.append(f"<tr{'' if row.solved else ' class=refused'}>{_name(k, row)}{cells}</tr>")
    return (
        f'<thead><tr><th scope="col">plan</th>{head}</tr></thead>\n'
        f"<tbody>\n{chr(10).join(body)}\n</tbody>"
    )


def _name(k: int, row: Row) -> str:
    badge = "solved" if row.solved else "refused"
    why = "" if row.solved else f"<span class=why>{html.escape(row.why)}</span>"
    label = html.escape(row.label).replace(":", ":<wbr>")
    return (
        f'<th scope="row">{_swatch(k, row)} {label} <span class="badge {badge}">{badge}</span>'
        f"{why}</th>"
    )


def _swatch(k: int, row: Row) -> str:
    dashed = "" if row.solved else " dashed"
    return f'<span class="swatch plan-{k % 9}{dashed}" aria-hidden="true"></span>'


def _symbols(title: str) -> str:
    """|u1| becomes |u₁|."""
    return html.escape("|".join(subscripted(part) for part in title.split("|")))
