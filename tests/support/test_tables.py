"""One list of columns as a terminal's table, Markdown, CSV and HTML."""

from __future__ import annotations

from operator import itemgetter

import numpy as np
import pytest
from printed import printed

from planner.support.tables import (
    Column,
    Markup,
    csv_table,
    html_table,
    markdown_table,
    terminal_table,
)

Row = tuple[str, float]
COLUMNS: list[Column[Row]] = [
    Column("plan", "", itemgetter(0), left=True, width=12, code=True),
    Column("why", "", lambda row: f"no [red]{row[0]}[/red] <b>", key="", left=True),
    Column("top speed", "rad/s", itemgetter(1)),
    Column("raw", "", itemgetter(1), shown=None, key="speed"),
]
ROWS = [("law:free", 1 / 3), ("=a|b", np.nan)]


def test_a_terminal_shows_titles_over_units_and_foreign_text_as_it_is() -> None:
    lines = printed(terminal_table(COLUMNS, ROWS, ruled=True, title="[b]x[/b]", caption="[i]y[/i]"))
    assert lines[0] == "[b]x[/b]"
    assert [line.split()[-1] for line in lines[1:4]] == ["top", "speed", "rad/s"]
    assert lines[5].split() == ["law:", "no", "[red]law:free[/red]", "<b>", "0.333"]
    assert lines[6] == "free"
    assert lines[-1] == "[i]y[/i]"


def test_the_longest_text_gives_way_to_eighty_columns() -> None:
    rows = [("z" * 30, 1.0), (" word" * 60, -2.0)]
    lines = printed(terminal_table(COLUMNS, rows, ruled=True))
    assert max(map(len, lines)) == 80
    assert sum(line.count("word") for line in lines) == 2 * 60
    assert "".join(lines).count("z") == 2 * 30


def test_a_list_has_one_line_of_heads() -> None:
    lines = printed(terminal_table(COLUMNS, ROWS))
    assert lines[0].split() == ["plan", "why", "top", "speed", "(rad/s)"]
    assert len(lines) == 1 + 2 + 1, "only the label with a colon takes two lines"


def test_markdown_escapes_all_but_code() -> None:
    head, rule, first, second = markdown_table(COLUMNS, ROWS).splitlines()
    assert head == "| plan | why | top speed (rad/s) |"
    assert rule == "| --- | --- | ---: |"
    assert first == r"| `law:free` | no \[red\]law:free\[/red\] \<b\> | 0.333 |"
    assert second.startswith(r"| `=a\|b` | no \[red\]=a\|b")


def test_csv_names_its_columns_and_keeps_every_digit() -> None:
    lines = csv_table(COLUMNS, ROWS).splitlines()
    assert lines == ["plan,top_speed_rad_s,speed", f"law:free,{1 / 3!r},{1 / 3!r}", "'=a|b,,"]


@pytest.mark.parametrize("above", ["", "x < y"])
def test_html_escapes_all(above: str) -> None:
    text = html_table(COLUMNS, ROWS, above)
    assert text.startswith("<p>x &lt; y</p><table>" if above else "<table>")
    assert "[red]=a|b[/red] &lt;b&gt;</td>" in text
    assert "top speed (rad/s)</th>" in text
    assert text.count("<tr>") == 3


def test_on_a_page_cells_bear_titles_and_units_and_rows_their_class() -> None:
    columns = [Column("x&y", "", lambda row: Markup("<i>a</i>")), *COLUMNS[1:]]
    text = html_table(columns, ROWS, kind=lambda row: "" if row[1] > 0 else "refused")
    assert '<th scope="col">x&amp;y</th>' in text
    assert "top speed<span class=unit>rad/s</span></th>" in text
    first, second = (line for line in text.splitlines() if line.startswith("<tr"))
    assert first.startswith('<tr><th scope="row"><i>a</i></th>')
    assert first.endswith('data-head="top speed">0.333<span class=unit>rad/s</span></td></tr>')
    assert second.startswith("<tr class=refused>")
    assert "&lt;b&gt;" in first
    assert "style" not in text
