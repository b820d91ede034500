"""Small tables as a notebook shows them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


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
