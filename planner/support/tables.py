"""Tables and foreign text, fit to be shown.

Files keep what a user wrote, and give it back as it was. What is *shown* of it (a title, a label, a
name, a message) goes through `clean` where it enters an object that others draw or print, and once
more at the one door to the terminal; so a title cannot colour a terminal, turn a line around, or
break the XML of a figure. Each format then escapes what is special to it alone.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]], above: str = "") -> str:
    """An HTML table, its first column to the left; every text is escaped.

    Args:
        head: Titles of the columns.
        rows: Their cells, as many in each.
        above: A line over the table.
    """
    lines = [_row("th", head), *(_row("td", row) for row in rows)]
    title = f"<p>{escape(above)}</p>" if above else ""
    return f"{title}<table>{''.join(lines)}</table>"


def _row(tag: str, cells: Sequence[str]) -> str:
    sides = ["left", *["right"] * (len(cells) - 1)]
    return (
        "<tr>"
        + "".join(
            f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
            for side, cell in zip(sides, cells, strict=True)
        )
        + "</tr>"
    )


# C0 but tab and newline, DEL, C1, marks and overrides of direction, and halves of surrogate pairs
# (bytes of file names that are not UTF-8).
_UNFIT = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
LONGEST = 200
"""Characters of a title, label or name that are shown: twice what fits a line."""


def clean(text: str) -> str:
    """Text of several lines without control characters, which would steer what shows it."""
    return _UNFIT.sub("", text)


def line(text: str, longest: int = LONGEST) -> str:
    """`clean` text in one line, cut where it is too long to be looked at."""
    return brief(" ".join(clean(text).split()), longest)


def brief(text: str, longest: int = 60) -> str:
    """Text cut to `longest` characters."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


def markdown(text: str) -> str:
    """One cell or title of Markdown: no new columns, code, tags or links."""
    return re.sub(r"([\\`|<>\[\]])", r"\\\1", line(text))


def markdown_code(text: str) -> str:
    """The same in `code`, where only the mark itself and a table's bar are special."""
    return "`" + line(text).replace("`", "'").replace("|", "\\|") + "`"


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as CSV; no text in it is a formula to a spreadsheet, and numbers stay numbers."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([_cell(value) for value in row] for row in rows)
    return stream.getvalue()


def _cell(value: Any) -> Any:
    """Text that begins as a formula does is led by an apostrophe, as spreadsheets have it."""
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def number(value: float, digits: int = 3) -> str:
    """A number in few characters; "-" when it is not defined."""
    if not np.isfinite(value):
        return "-"
    if value == 0 or 1e-3 <= abs(value) < 10**digits:
        return f"{value:.{digits}g}"
    if abs(value) < 1e5 and abs(value) >= 1:
        return f"{value:.0f}"
    return f"{value:.0e}"
