"""Pairs of plans as tables."""

from __future__ import annotations

import csv
import io

import pytest
from compared import paper_comparison
from printed import printed

from planner.comparison.differences import (
    COLUMNS,
    csv_machines,
    markdown_differences,
    pairs,
    rich_differences,
)
from planner.support.tables import csv_table


def test_markdown_names_every_pair_and_what_it_says() -> None:
    text = markdown_differences(paper_comparison())
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(lines) == 3
    assert lines[0].startswith("| `polynomial:travel=middle` | `polynomial` | +")
    assert lines[0].endswith("| worse |")
    assert "method for 3 pairs by E and as many by end" in text


def test_csv_keeps_full_precision() -> None:
    result = paper_comparison()
    rows = list(csv.DictReader(io.StringIO(csv_table(COLUMNS, pairs(result)))))
    for row, made in zip(rows, result.differences, strict=True):
        assert (row["first"], row["second"]) == (made.first, made.second)
        assert float(row["median_deg"]) == made.median_deg
        assert float(row["interval_low_deg"]) == made.interval_deg[0]
        assert row["significant"] == str(made.significant)


def test_csv_of_machines_keeps_full_precision() -> None:
    result = paper_comparison()
    rows = list(csv.DictReader(io.StringIO(csv_machines(result))))
    for made in result.rows:
        own = [row for row in rows if row["plan"] == made.label]
        if made.replay is not None:
            assert [int(row["machine"]) for row in own] == list(range(result.samples))
            assert [float(row["E_deg"]) for row in own] == made.replay.index_E_deg.tolist()
            assert [float(row["end_deg"]) for row in own] == made.replay.terminal_E_deg.tolist()
    assert rows


def test_the_terminal_sees_all_from_the_best_plan() -> None:
    result = paper_comparison()
    lines = printed(rich_differences(result))
    assert max(map(len, lines)) <= 80
    text = " ".join(lines)
    kept = " ".join(" ".join(printed(rich_differences(result), 80)).split())
    words = [word for word in text.split() if "─" not in word]
    for word in ("verdict", "corrected for all pairs.", *words):
        assert word in kept, "cut off on a narrow terminal"
    assert result.best is not None
    assert f"{result.best.label} against the others" in text
    line = next(x for x in lines if x.startswith("polynomial: "))
    worse = result.differences[1]
    assert line.split()[1] == f"{-worse.median_deg:+.2f}"
    assert float(line.split()[2]) == pytest.approx(-worse.interval_deg[1], abs=0.006)
