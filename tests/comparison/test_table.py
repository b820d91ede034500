"""The comparison as a table."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from compared import leaving_comparison, quick_comparison, refused_comparison
from printed import printed

import planner
from planner.comparison import comparison
from planner.comparison.comparison import NOT_IN_TERMINALS
from planner.comparison.comparison import comparison_csv as csv_text
from planner.comparison.rows import Row, column_names, intervals, sweep_columns
from planner.machine.replay import STATISTICS
from planner.plan.spec import Spec
from planner.report.page.page import report_page
from planner.support.tables import Column, number
from planner.sweep.case import RESULTS
from planner.verification.summary import PlanFigures, figures, plan_summary, without_unit_keys


def test_a_narrow_terminal_keeps_the_words_of_a_verdict_whole() -> None:
    lines = printed(quick_comparison().table(), 80)
    assert max(map(len, lines)) <= 80
    assert {"solved", "reaches", "allowed"} <= set(" ".join(lines).split())


def test_terminal_table_shows_every_row_and_figure_in_eighty_columns() -> None:
    lines = printed(quick_comparison().table())
    assert max(map(len, lines)) <= 80
    words = " ".join(" ".join(lines).split())
    for word in ("polynomial:travel=middle: input u2 reaches", "no", "yes", "end", "95 %"):
        assert word in words
    row = quick_comparison()["polynomial"]
    line = next(x for x in lines if x.startswith("polynomial ") and "yes" in x)
    names = column_names(quick_comparison().problem.system)
    hidden = {names[name] for name in NOT_IN_TERMINALS}
    shown = [c for c in quick_comparison().columns if c.shown and c.name not in hidden]
    cells = dict(zip([c.name for c in shown], line.split(), strict=True))
    assert cells["duration_s"] == f"{row.duration_s:.3g}"
    assert float(cells["effort"]) == pytest.approx(row.effort, rel=1e-3)
    assert float(cells["peak_u2_rad_s"]) == pytest.approx(row.peak_u[1], rel=1e-2)
    for name in STATISTICS:
        assert float(cells[name]) == pytest.approx(getattr(row, name), rel=1e-2)


def test_a_terminal_has_room_for_every_column_and_the_names_of_methods() -> None:
    found = quick_comparison()
    rows = tuple(replace(found["polynomial"], spec=Spec(name)) for name in planner.METHODS)
    lines = printed(replace(found, rows=rows).table(), 80)
    assert max(map(len, lines)) <= 80
    whole = {line.split(" ")[0] for line in lines}
    assert whole >= {*planner.METHODS}, "too many columns: add the new one to NOT_IN_TERMINALS"


def test_markdown_has_a_line_a_method_and_the_command() -> None:
    text = quick_comparison().markdown()
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table) == 2 + 3
    cells = {len(line.replace("\\|", "").split("|")) for line in table}
    shown = [c for c in quick_comparison().columns if c.shown]
    shown += intervals(quick_comparison().problem.system)
    assert cells == {len(shown) + 2}
    assert "5 machines (prototype, unwound at the start), seed 1" in text
    assert "planner compare" in text


def test_csv_keeps_full_precision_and_leaves_undefined_empty() -> None:
    rows = list(csv.DictReader(io.StringIO(csv_text(quick_comparison()))))
    for row, made in zip(rows, quick_comparison().rows, strict=True):
        assert row["label"] == made.label
        if np.isnan(made.effort):
            assert row["effort"] == row["E_median_deg"] == ""
        else:
            assert float(row["effort"]) == made.effort
            assert float(row["peak_u2_rad_s"]) == made.peak_u[1]
    assert [row["solved"] for row in rows] == ["False", "True", "False"]


def test_a_column_is_added_in_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = comparison.columns
    added = Column("mean speed", "rad/s", lambda row: row.travel / row.duration_s)
    monkeypatch.setattr(comparison, "columns", lambda *system: [*usual(*system), added])
    found = quick_comparison()
    row = found["polynomial"]
    value = row.travel / row.duration_s
    lines = printed(found.table())
    heads = [k for k, line in enumerate(lines) if line.endswith(("mean", "speed", "rad/s"))]
    assert len(heads) == 3
    shown = number(value)
    assert next(x for x in lines if x.startswith("polynomial ")).endswith(shown)
    assert "| mean speed (rad/s) | beyond limits (%) |" in found.markdown()
    assert f" | {shown} | " in found.markdown()
    cells = next(r for r in csv.DictReader(io.StringIO(csv_text(found))) if r["label"] == row.label)
    assert float(cells["mean_speed_rad_s"]) == value
    assert "mean speed (rad/s)</th>" in found._repr_html_()
    assert f">{shown}</td>" in found._repr_html_()
    page = report_page(found, {}, found.to_dict())
    assert f'<td data-head="mean speed">{shown}<span class=unit>rad/s</span></td>' in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.nan, "-"), (np.inf, "-"), (0.0, "0"), (0.33584, "0.336"), (83.008, "83"),
        (1234.5, "1234"), (-7490.0, "-7490"), (2.3e-7, "2e-07"), (0.00123, "0.00123"),
        (1.5e7, "2e+07"),
    ],
)  # fmt: skip
def test_numbers_are_short(value: float, text: str) -> None:
    assert number(value) == text


def text_of(found: comparison.Comparison) -> str:
    return " ".join(" ".join(printed(found.table())).split())


def test_where_all_are_refused_what_would_help_is_said_in_every_form() -> None:
    found = refused_comparison()
    (advice,) = [words for label, words in found.advice.items() if label == "collocation"]
    assert advice.startswith("goal.duration = ")
    assert advice.endswith("or more (tried)")
    seconds = float(advice.split()[2])
    assert found.problem.changed({"goal.duration": seconds}).duration == seconds
    assert f"Try: {' '.join(advice.split()[:2])}" in text_of(found)
    assert f"- Try, for `collocation`: {advice}" in found.markdown()
    assert f"Try: {advice}" in found._repr_html_()
    assert report_page(found, {}, {}).count(f"Try: {advice}") == 1


def test_where_one_is_solved_no_other_asks_for_a_change() -> None:
    found = quick_comparison()
    assert any(row.advice for row in found.rows)
    assert found.advice == {}
    for text in (text_of(found), found.markdown(), report_page(found, {}, {})):
        assert "Try" not in text


def test_a_plan_may_leave_the_chart_and_says_so() -> None:
    found = leaving_comparison()
    row = found.rows[1]
    assert (row.solved, row.why, row.domain_ok) == (True, "", False)
    assert row.domain_margin < 0
    assert {"leaves", "chart,", "may."} <= set(text_of(found).split())
    assert "yes: leaves the chart, as this method may" in found.markdown()
    page = report_page(found, {}, {})
    assert page.count("leaves the chart, as this method may") == 1
    assert "leaves the chart" not in "".join(r.remark for r in quick_comparison().rows if r.solved)


def test_a_figure_of_a_plan_stands_in_one_place_and_is_everywhere() -> None:
    found = quick_comparison()
    row = found["polynomial"]
    assert row.plan is not None
    check = planner.verify(row.plan)
    summary = plan_summary(row.plan, check)
    cells = next(r for r in csv.DictReader(io.StringIO(csv_text(found))) if r["label"] == row.label)
    system = found.problem.system
    in_summary = without_unit_keys(summary, system)
    for name, one in figures(PlanFigures).items():
        keys = [head.key or name for head in one.headings] or [name]
        assert {head.key_of(name, system) for head in one.headings} <= cells.keys()
        assert not one.swept or set(keys) <= RESULTS.keys()
        assert in_summary.get(name, summary.get(name)) == getattr(row, name)
    assert set(sweep_columns()) <= RESULTS.keys()
    assert set(STATISTICS) <= figures(Row).keys(), "a field of Row for each Statistic"
    # One error an angle in a summary, the largest of them in a table.
    assert row.terminal_error_max_deg == max(abs(e) for e in summary["terminal_error_deg"])
