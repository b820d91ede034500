"""Tables: a list of columns and rows, for a terminal, as Markdown, CSV or HTML. Foreign text.

Who has something to tabulate owns `Column`s; how a table looks is here alone.

Files keep what a user wrote, and give it back as it was. What is *shown* of it (a title, a label, a
name, a message) goes through `clean_text` where it enters an object that others draw or print, and
once more at the one door to the terminal; so a title cannot colour a terminal, turn a line around,
or break the XML of a figure. Each format then escapes what is special to it alone.
"""

from __future__ import annotations

import csv
import io
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from planner.support.arrays import jsonable

if TYPE_CHECKING:
    from rich.table import Table

R = TypeVar("R")

TABLE_WIDTH, LEAST_TEXT_WIDTH, HEAD_WIDTH = 80, 10, 11
"""Characters of a table in a terminal, the fewest that the text of a ruled one is given, and those
of a line of its heads."""


def short_number(value: Any) -> str:
    """A number in few characters, anything else as it is."""
    if isinstance(value, float):
        return number(value)
    return value if isinstance(value, str) else str(value)


def digits(count: int) -> Callable[[float], str]:
    """A format for numbers with this many significant digits."""
    return lambda value: number(value, count)


class Markup(str):
    """Text of the format's own, Markdown or HTML, which is not escaped."""

    __slots__ = ()


@dataclass(frozen=True)
class Column(Generic[R]):
    """One column of a table of rows `R`.

    Attributes:
        title: What it holds, in few words.
        unit: Its unit, or "".
        value: From a row to a number in full precision or to text.
        shown: From this value to what is read; None for a column of CSV alone.
        key: Its name in CSV, by default of title and unit; "" for a column that CSV lacks.
        left: Whether it is text: to the left, and folded where a terminal is too narrow.
        width: Most characters of a narrow column of text in a terminal, where it begins a line
            after each colon; by default the others leave the room.
        code: Whether Markdown shows it as `code`.
    """

    title: str
    unit: str
    value: Callable[[R], Any]
    shown: Callable[[Any], str] | None = short_number
    key: str | None = None
    left: bool = False
    width: int | None = None
    code: bool = False

    @property
    def head(self) -> str:
        """Title and unit in one line."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    @property
    def name(self) -> str:
        """Its name in files."""
        return self.key or re.sub(r"\W+", "_", f"{self.title} {self.unit}").strip("_")

    def text(self, row: R) -> str:
        """Text of a row's cell."""
        assert self.shown is not None
        return self.shown(self.value(row))


def _read(columns: Iterable[Column[R]]) -> list[Column[R]]:
    return [column for column in columns if column.shown is not None]


def terminal_table(
    columns: Iterable[Column[R]],
    rows: Iterable[R],
    *,
    title: str = "",
    caption: str = "",
    ruled: bool = False,
    gap: int = 0,
    dim: Callable[[R], bool] = lambda row: False,
) -> Table:
    """For a terminal: `rich.print` shows it.

    Args:
        columns: Its columns.
        rows: Its rows.
        title: A line over it.
        caption: Text under it.
        ruled: Whether it has heads of several lines over a rule and is made to fit 80 columns;
            otherwise heads have one line.
        gap: Further spaces between columns of a ruled one.
        dim: Which rows are shown weakly.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    shown, rows = _read(columns), list(rows)
    table = Table(
        box=SIMPLE_HEAD if ruled else None,
        padding=(0, gap if ruled else 2, 0, 0),
        show_header=any(column.title for column in shown),
        show_edge=False,
        pad_edge=False,
        title=Text(title) if title else None,
        title_justify="left",
        caption=Text(caption, style="table.caption") if caption else None,
        caption_justify="left",
    )
    heads = [c.head for c in shown]
    if ruled:
        heads = [_break_head(c.title) + (f"\n{c.unit}" if c.unit else "") for c in shown]
    cells = [[_break_lines(c.text(row), c.width) for c in shown] for row in rows]
    widths = []
    for column, *texts in zip(shown, heads, *cells, strict=True):
        most = max(len(part) for text in texts for part in text.split("\n"))
        widths.append(min(most, column.width or most))
    over = max(0, sum(widths) + (1 + gap) * (len(widths) - 1) - TABLE_WIDTH)
    free = [k for k, c in enumerate(shown) if c.left and c.width is None]
    if ruled and free:
        widest = max(free, key=lambda k: widths[k])
        widths[widest] = max(LEAST_TEXT_WIDTH, widths[widest] - over)
    for column, head, width in zip(shown, heads, widths, strict=True):
        table.add_column(
            Text(head),
            justify="left" if column.left else "right",
            overflow="fold" if column.left else "ellipsis",
            no_wrap=ruled and not column.left,
            max_width=width if ruled and column.left else None,
        )
    for row, texts in zip(rows, cells, strict=True):
        table.add_row(*map(Text, texts), style="dim" if dim(row) else "")
    return table


def _break_head(title: str) -> str:
    """A head in two lines, or as many as a longer one needs."""
    if len(title) <= HEAD_WIDTH + 1:
        return title.replace(" ", "\n", 1)
    return textwrap.fill(title, HEAD_WIDTH, break_long_words=False)


def _break_lines(text: str, width: int | None) -> str:
    """Text of a narrow column begins a line after each colon."""
    return text.replace(":", ":\n") if width else text


def markdown_table(columns: Iterable[Column[R]], rows: Iterable[R]) -> str:
    """Lines of Markdown; all text but `Markup` is escaped."""
    shown = _read(columns)
    lines = [
        [markdown(c.head) for c in shown],
        ["---" if c.left else "---:" for c in shown],
        *([_mark_code(c.text(row), c.code) for c in shown] for row in rows),
    ]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _mark_code(text: str, code: bool) -> str:
    if isinstance(text, Markup):
        return text
    return markdown_code(text) if code else markdown(text)


def csv_table(columns: Iterable[Column[R]], rows: Iterable[R]) -> str:
    """CSV in full precision, empty where a number is not defined."""
    kept = [column for column in columns if column.key != ""]
    lines = ([jsonable(c.value(row)) for c in kept] for row in rows)
    return csv_text([[c.name for c in kept], *lines])


def html_table(
    columns: Iterable[Column[R]],
    rows: Iterable[R],
    above: str = "",
    *,
    kind: Callable[[R], str] | None = None,
) -> str:
    """An HTML table; all text but `Markup` is escaped.

    Args:
        columns: Its columns.
        rows: Its rows.
        above: A line over it.
        kind: From a row to its class, on a page with a style sheet: units then have their own
            elements, the first column heads its row, and each cell bears its column's title, which
            is read where a screen is too narrow for heads. Left out for a notebook.
    """
    shown, heads, around = _read(columns), [], []
    for k, c in enumerate(shown):
        if kind is None:
            style = f'style="text-align:{"left" if c.left else "right"}"'
            heads.append(f"<th {style}>{escape(c.head)}</th>")
            around.append((f"<td {style}>", "</td>"))
        else:
            unit = f"<span class=unit>{escape(c.unit)}</span>" if c.unit else ""
            heads.append(f'<th scope="col">{escape(c.title)}{unit}</th>')
            tag = f'td data-head="{escape(c.title)}"' if k else 'th scope="row"'
            around.append((f"<{tag}>", f"{unit}</{tag[:2]}>"))
    lines = []
    for row in rows:
        name = kind(row) if kind else ""
        texts = [c.text(row) for c in shown]
        inside = [text if isinstance(text, Markup) else escape(text) for text in texts]
        cells = "".join(a + cell + b for (a, b), cell in zip(around, inside, strict=True))
        lines.append((f"<tr class={name}>" if name else "<tr>") + cells + "</tr>")
    title, body = f"<p>{escape(above)}</p>" if above else "", "\n".join(lines)
    return (
        f"{title}<table>\n<thead><tr>{''.join(heads)}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody>\n</table>"
    )


# C0 but tab and newline, DEL, C1, marks and overrides of direction, and halves of surrogate pairs
# (bytes of file names that are not UTF-8).
_CONTROL_CHARACTERS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
LONGEST_LINE = 200
"""Characters of a title, label or name that are shown: twice what fits a line."""


def clean_text(text: str) -> str:
    """Text of several lines without control characters, which would steer what shows it."""
    return _CONTROL_CHARACTERS.sub("", text)


def line(text: str, longest: int = LONGEST_LINE) -> str:
    """Clean text in one line, cut where it is too long to be looked at."""
    return shorten(" ".join(clean_text(text).split()), longest)


def error_words(error: BaseException) -> str:
    """Type and message of any exception, whose own code may fail."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def shorten(text: str, longest: int = 60) -> str:
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
