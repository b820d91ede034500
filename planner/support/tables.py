"""Format tables for a terminal, Markdown, CSV and HTML, and clean text from users.

A table is a list of `Column`s and rows. Other modules define columns; this one formats them.

Files keep what a user wrote unchanged. Text that is *shown* (a title, a label, a name, a message)
passes `clean_text` where it enters an object that is drawn or printed, and again where it is
printed to the terminal. So a title cannot colour a terminal, reverse a line, or break the XML of a
figure. Each format then escapes its own special characters.
"""

from __future__ import annotations

import csv
import io
import re
import shlex
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from operator import itemgetter
from typing import Any, Generic, TypeVar

import numpy as np

from planner.support.arrays import jsonable
from planner.support.package import Table

R = TypeVar("R")

TABLE_WIDTH, LEAST_TEXT_WIDTH, HEAD_WIDTH = 80, 12, 11
"""Characters: width of a table in a terminal, least width of the text column of a ruled table,
width of a line of a column head."""


def short_number(value: Any) -> str:
    """Format a number in few characters; return anything else as text."""
    if isinstance(value, float):
        return number(value)
    return value if isinstance(value, str) else str(value)


def digits(count: int) -> Callable[[float], str]:
    """Return a function that formats a number with `count` significant digits."""
    return lambda value: number(value, count)


def key_with_unit(name: str, unit: str) -> str:
    """Return the key in files of a number with a unit: "travel" in "rad/s" gives "travel_rad_s"."""
    return re.sub(r"\W+", "_", f"{name} {unit}").strip("_")


class Markup(str):
    """Text that is already Markdown or HTML and is not escaped."""

    __slots__ = ()


class CommandLine(str):
    """Text that ends with a command; terminals do not wrap it, so that it can be copied."""

    __slots__ = ()

    @classmethod
    def of(cls, *words: str, after: str = "") -> CommandLine:
        """Join the words of a command for a shell, after a text."""
        return cls(after + shlex.join(words))


@dataclass(frozen=True)
class Column(Generic[R]):
    """One column of a table of rows `R`.

    Attributes:
        title: Short title.
        unit: Unit, or "".
        value: Maps a row to a number in full precision, or to text.
        shown: Formats this value for reading; None for a column of CSV only.
        key: Name in CSV, by default from title and unit; "" for a column that CSV lacks.
        left: Whether the column holds text: aligned left, and wrapped if a terminal is too narrow.
        width: Maximum characters of a narrow text column in a terminal; its text starts a new line
            after each colon. By default the width that the other columns leave.
        code: Whether Markdown shows the cells as `code`.
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
        """Title and unit on one line."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    @property
    def name(self) -> str:
        """The column's name in files."""
        return self.key or key_with_unit(self.title, self.unit)

    def text(self, row: R) -> str:
        """Return the text of this column's cell in a row."""
        assert self.shown is not None
        return self.shown(self.value(row))


def _read(columns: Iterable[Column[R]]) -> list[Column[R]]:
    return [column for column in columns if column.shown is not None]


Rows = Iterator[tuple[str, str]]
"""Rows of a table of `facts`: a name and a value each."""


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """Return a table with a name and a value in each row, without headers, for a terminal."""
    return terminal_table([Column("", "", itemgetter(k), left=True) for k in (0, 1)], rows)


def terminal_table(
    columns: Iterable[Column[R]],
    rows: Iterable[R],
    *,
    title: str = "",
    caption: str = "",
    ruled: bool = False,
    gap: int = 0,
    style: Callable[[R], str] = lambda row: "",
) -> Table:
    """Format a table for a terminal; print the result with `rich.print`.

    Args:
        columns: The columns.
        rows: The rows.
        title: A line above the table.
        caption: Text below the table.
        ruled: Whether heads have several lines above a rule and the table fits 80 columns;
            otherwise heads have one line.
        gap: Extra spaces between the columns of a ruled table.
        style: Maps a row to its style, such as "dim" or "bold".
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
    # a column with a maximum width starts a new line after each colon
    cells = [[c.text(row).replace(":", ":\n" if c.width else ":") for c in shown] for row in rows]
    widths = []
    for column, *texts in zip(shown, heads, *cells, strict=True):
        most = max(len(part) for text in texts for part in text.split("\n"))
        widths.append(min(most, column.width or most))
    excess = max(0, sum(widths) + (1 + gap) * (len(widths) - 1) - TABLE_WIDTH)
    free = [k for k, c in enumerate(shown) if c.left and c.width is None]
    if ruled and free:
        widest = max(free, key=lambda k: widths[k])
        widths[widest] = max(LEAST_TEXT_WIDTH, widths[widest] - excess)
    for column, head, width in zip(shown, heads, widths, strict=True):
        table.add_column(
            Text(head),
            justify="left" if column.left else "right",
            overflow="fold" if column.left else "ellipsis",
            no_wrap=ruled and not column.left,
            max_width=width if ruled and column.left else None,
        )
    for row, texts in zip(rows, cells, strict=True):
        table.add_row(*map(Text, texts), style=style(row))
    return table


def notebook_html(table: Table) -> str:
    """Return a terminal's table as HTML for a notebook."""
    html: str = table._repr_mimebundle_((), ())["text/html"]
    return html


def _break_head(title: str) -> str:
    """Wrap a column's title to two lines, or to as many lines as a long title needs."""
    if len(title) <= HEAD_WIDTH + 1:
        return title.replace(" ", "\n", 1)
    return textwrap.fill(title, HEAD_WIDTH, break_long_words=False)


def markdown_table(columns: Iterable[Column[R]], rows: Iterable[R]) -> str:
    """Format a table as Markdown; all text but `Markup` is escaped."""
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
    """Format a table as CSV in full precision; cells of undefined numbers are empty."""
    named = [column for column in columns if column.key != ""]
    lines = ([jsonable(c.value(row)) for c in named] for row in rows)
    return csv_text([[c.name for c in named], *lines])


def html_table(
    columns: Iterable[Column[R]],
    rows: Iterable[R],
    above: str = "",
    *,
    kind: Callable[[R], str] | None = None,
) -> str:
    """Format a table as HTML; all text but `Markup` is escaped.

    Args:
        columns: The columns.
        rows: The rows.
        above: A line above the table.
        kind: Maps a row to its CSS class, for a page with a style sheet. Units then have their own
            elements, the first column holds row heads, and each cell repeats its column's title,
            which narrow screens show in place of heads. None: plain HTML for a notebook.
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


# C0 except tab and newline, DEL, C1, marks and overrides of direction, and halves of surrogate
# pairs (bytes of file names that are not UTF-8).
_CONTROL_CHARACTERS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
LONGEST_LINE = 200
"""Maximum characters of a title, label or name that is shown; about two lines."""


def clean_text(text: str) -> str:
    """Remove control characters, which could change the terminal or page that shows the text."""
    return _CONTROL_CHARACTERS.sub("", text)


def line(text: str, longest: int = LONGEST_LINE) -> str:
    """Return text without control characters, on one line of at most `longest` characters."""
    return shorten(" ".join(clean_text(text).split()), longest)


def error_words(error: BaseException) -> str:
    """Return the type and message of any exception, even if its `__str__` fails."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def constant_text(value: object) -> str:
    """Format a constant of a system with six digits."""
    if isinstance(value, list):
        return f"({', '.join(map(constant_text, value))})"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def shorten(text: str, longest: int = 60) -> str:
    """Shorten text to `longest` characters."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


def markdown(text: str) -> str:
    """Escape a cell or title, so that Markdown reads no columns, code, tags or links in it."""
    return re.sub(r"([\\`|<>\[\]])", r"\\\1", line(text))


def markdown_code(text: str) -> str:
    """Format text as `code` in Markdown, with backticks and a table's bars escaped."""
    return "`" + line(text).replace("`", "'").replace("|", "\\|") + "`"


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Format rows as CSV, with text marked that a spreadsheet would read as a formula."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([_cell(value) for value in row] for row in rows)
    return stream.getvalue()


def _cell(value: Any) -> Any:
    """Put an apostrophe before text that a spreadsheet would read as a formula."""
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def four_digits(value: float | None) -> str:
    """Format a number with four significant digits, or as a dash if undefined."""
    return "-" if value is None or np.isnan(value) else f"{value:.4g}"


def number(value: float, digits: int = 3) -> str:
    """Format a number in few characters; "-" if it is not finite."""
    if not np.isfinite(value):
        return "-"
    if value == 0 or 1e-3 <= abs(value) < 10**digits:
        return f"{value:.{digits}g}"
    if abs(value) < 1e5 and abs(value) >= 1:
        return f"{value:.0f}"
    return f"{value:.0e}"
