"""The results as a frame and as files."""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from databases import query

import planner
from planner import load_sweep, run_sweep
from planner.support.package import how_to_install
from planner.sweep.results import export, recommend

Tables = dict[str, Any]


@pytest.fixture
def db(tables: Tables, tmp_path: Path) -> Path:
    path = tmp_path / "x.sqlite"
    grid = {"goal.duration": [0.05, 0.06], "limits.input_rad_s": [0.5, [0.4, 0.5]]}
    run_sweep({**tables, "grid": grid}, path, workers=0)
    return path


def test_one_column_a_varied_key(db: Path) -> None:
    pytest.importorskip("pandas")
    frame = load_sweep(db)
    assert list(frame.columns[:3]) == ["goal.duration", "limits.input_rad_s", "method"]
    assert frame["goal.duration"].tolist() == [0.05, 0.05, 0.06, 0.06]
    assert frame["goal.duration"].dtype == float
    assert frame["limits.input_rad_s"].tolist() == [0.5, [0.4, 0.5]] * 2
    assert (frame["status"] == "infeasible").all()
    assert frame["effort"].isna().all()
    assert frame["solved"].dtype == bool


def test_csv_holds_the_same(db: Path, tmp_path: Path) -> None:
    path = export(db, tmp_path / "out.csv")
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["goal.duration"] for row in rows] == ["0.05", "0.05", "0.06", "0.06"]
    assert rows[1]["limits.input_rad_s"] == "[0.4, 0.5]"
    assert rows[0]["effort"] == ""
    assert rows[0]["why"].startswith("no plan of any kind exists")


def test_parquet_comes_back_as_it_went(db: Path, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    path = export(db, tmp_path / "out.parquet")
    frame, own = pandas.read_parquet(path), load_sweep(db)
    assert list(frame.columns) == list(own.columns)
    assert frame["goal.duration"].equals(own["goal.duration"])
    assert frame["limits.input_rad_s"].tolist() == ["0.5", "[0.4, 0.5]"] * 2
    assert frame["solved"].dtype == bool


@pytest.mark.parametrize("name", ["out.txt", "out", "csv"])
def test_other_formats_are_refused(db: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(planner.InputError, match=r"\.csv or \.parquet"):
        export(db, tmp_path / name)
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize("missing", ["pandas", "pyarrow"])
def test_missing_libraries_are_named_with_their_extra(
    db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    says = rf"needs {missing}; install it with: {re.escape(how_to_install('tables'))}"
    with pytest.raises(planner.InputError, match=says):
        export(db, tmp_path / "out.parquet")
    if missing == "pandas":
        with pytest.raises(planner.InputError, match=says):
            load_sweep(db)


def test_missing_sweeps_are_named(db: Path, tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match="no such file"):
        export(tmp_path / "none.sqlite", tmp_path / "out.csv")
    with pytest.raises(planner.InputError, match=r"sweep 2\b.*: 1\b"):
        export(db, tmp_path / "out.csv", which=2)
    query(db, "DELETE FROM sweeps")
    with pytest.raises(planner.InputError, match="holds no sweep yet"):
        export(db, tmp_path / "out.csv")


@pytest.mark.parametrize(
    ("solved", "errors", "taken"),
    [
        ({"a": (1, 1), "b": (1, 0)}, {"a": 3.0, "b": 1.0}, "a"),  # it solves more
        ({"a": (1, 1), "b": (1, 1)}, {"a": 3.0, "b": 1.0}, "b"),  # it is nearer to its plan
        ({"a": (1, 1), "b": (1, 1)}, {"a": 1.05, "b": 1.0}, "a"),  # hardly less near, less effort
        ({"a": (1, 1), "b": (1, 1)}, {"a": None, "b": None}, "a"),  # nothing was replayed
        ({"a": (0, 0), "b": (0, 0)}, {"a": None, "b": None}, None),
    ],
)
def test_a_sweep_recommends_a_method(
    solved: dict[str, tuple[int, int]], errors: dict[str, float | None], taken: str | None
) -> None:
    effort = {"a": 1.0, "b": 2.0}
    records = [
        {
            "goal.duration": 10.0 * k, "method": label, "solved": bool(solved[label][k]),
            "E_median_deg": errors[label], "effort": effort[label],
        }
        for k in (0, 1)
        for label in solved
    ]  # fmt: skip
    method, sentence = recommend(["goal.duration", "method", "effort"], records)
    assert method == taken
    assert (f"{taken}: of 2 cases" in sentence) == (taken is not None)


def test_a_comparison_of_methods_counts_only_what_all_solve() -> None:
    records = [
        {"x.y": k, "method": label, "solved": label == "a" or k == 0, "E_median_deg": error,
         "effort": 1.0}
        for k, label, error in ((0, "a", 2.0), (1, "a", 90.0), (0, "b", 1.0), (1, "b", None))
    ]  # fmt: skip
    nothing = {"x.y": 0, "method": "c", "solved": False, "E_median_deg": None, "effort": None}
    _, sentence = recommend(["x.y", "method"], [*records, nothing])
    assert re.findall(r"E ([\d.]+) deg \(b ([\d.]+)\)", sentence) == [("2", "1")]
    assert "1 case that all of these solve" in sentence, "c solves none"
