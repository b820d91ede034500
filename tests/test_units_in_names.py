"""A name in files says the unit: metres of a vehicle are never called rad."""

from __future__ import annotations

import csv
import io
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

import planner
from planner import load_comparison, run_sweep
from planner.comparison.comparison import comparison_csv
from planner.sweep.results import read
from planner.verification.summary import plan_summary, refusal_summary, summary_keys

PROBLEMS = Path(__file__).parents[1] / "problems"
OF_CAR = {"travel_m", "peak_u1_m_s", "peak_u2_rad_s", "path_length_m"}
OF_ARM = {"travel_rad", "peak_u1_rad_s", "peak_u2_rad_s", "path_length_rad"}
EARLIER = {
    "travel": "travel_rad",
    "peak_u1": "peak_u1_rad_s",
    "peak_u2": "peak_u2_rad_s",
    "terminal_error_max_deg": "terminal_error_deg",
}


@pytest.fixture(scope="module")
def car() -> planner.Problem:
    return planner.load_problem(PROBLEMS / "car.toml", {"machine.step_s": 0.01})


def united(names: object) -> set[str]:
    """The names of travel, peak inputs and path length."""
    starts = ("travel", "peak_u", "path_length")
    return {name for name in names if name.startswith(starts)}  # type: ignore[attr-defined]


def test_a_summary_has_the_units_of_its_system(
    car: planner.Problem, paper: planner.Problem
) -> None:
    plan = planner.solve(car, "polynomial")
    told = plan_summary(plan)
    assert united(told) == OF_CAR
    assert (told["travel_m"], told["path_length_m"]) == (plan.travel, plan.path_length)
    assert (told["peak_u1_m_s"], told["peak_u2_rad_s"]) == tuple(plan.peak_u)
    assert (told["effort"], [*told]) == (plan.effort, summary_keys(car.system))
    arm = plan_summary(planner.solve(paper, "collocation"))
    assert united(arm) == {"travel_rad", "peak_u_rad_s", "path_length_rad"}
    assert len(arm["peak_u_rad_s"]) == 2
    assert arm["terminal_error_max_deg"] == max(map(abs, arm["terminal_error_deg"]))
    refused = refusal_summary(planner.NoPlanError("no"), "polynomial", car.system)
    assert {*refused} == {*told}


def test_an_analysis_has_the_units_of_its_system() -> None:
    problem = planner.load_problem(PROBLEMS / "unicycle.toml")
    analysis = planner.check(problem, ["polynomial"])
    assert united(analysis.to_dict()["methods"][0]) == OF_CAR
    domain = planner.solve(problem, "polynomial").domain
    told = replace(analysis, plain_polynomial=(2.0, domain)).to_dict()["plain_polynomial"]
    assert united(told) == {"travel_m"}


def test_a_comparison_has_them_in_every_file_and_reads_them_back(
    car: planner.Problem, tmp_path: Path
) -> None:
    found = planner.compare(car, ["polynomial", "collocation"], samples=2)
    (row, _) = found.to_dict()["rows"]
    assert united(row) == OF_CAR
    assert "terminal_error_deg" not in row
    (cells, _) = csv.DictReader(io.StringIO(comparison_csv(found)))
    assert united(cells) == OF_CAR
    assert float(cells["travel_m"]) == found.rows[0].travel == 25.0
    folder = found.save(tmp_path / "now")
    for old, new in zip(found.rows, load_comparison(folder).rows, strict=True):
        for name in ("travel", "peak_u", "path_length", "terminal_error_max_deg", "effort"):
            assert getattr(new, name) == getattr(old, name)


def test_a_comparison_of_an_earlier_version_is_read(car: planner.Problem, tmp_path: Path) -> None:
    found = planner.compare(car, ["polynomial"], samples=2)
    path = found.save(tmp_path / "then") / "comparison.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    (row,) = data["rows"]
    row["travel_rad"], row["terminal_error_deg"] = (
        row.pop(name) for name in ("travel_m", "terminal_error_max_deg")
    )
    row["peak_u_rad_s"] = [row.pop(name) for name in ("peak_u1_m_s", "peak_u2_rad_s")]
    del row["path_length_m"]
    path.write_text(json.dumps(data), encoding="utf-8")
    (back,) = load_comparison(path.parent).rows
    assert (back.travel, back.peak_u) == (found.rows[0].travel, found.rows[0].peak_u)
    assert back.terminal_error_max_deg == found.rows[0].terminal_error_max_deg
    assert back.path_length == found.rows[0].path_length  # that of the plan


@pytest.mark.parametrize("file", ["car.toml", "paper.toml"])
def test_a_sweep_has_them_whichever_version_made_its_file(file: str, tmp_path: Path) -> None:
    db, problem = tmp_path / "s.sqlite", planner.load_problem(PROBLEMS / file)
    tables = {"problem": problem, "methods": ["polynomial"], "grid": {"goal.duration": [15, 20]}}
    assert run_sweep(tables, db, workers=0).statuses == {"solved": 2}
    columns, records = read(db)
    names = OF_CAR if file == "car.toml" else OF_ARM
    assert united(columns) == united(records[0]) == names
    assert "terminal_error_max_deg" in columns
    plan = planner.solve(problem.changed({"goal.duration": 15}), "polynomial")
    travel, path = ("travel_m", "path_length_m")
    if file != "car.toml":
        travel, path = ("travel_rad", "path_length_rad")
    assert (records[0][travel], records[0][path]) == (plan.travel, plan.path_length)
    with closing(sqlite3.connect(db)) as connection, connection:
        kept = [name for _, name, *_ in connection.execute("PRAGMA table_info(cases)")]
        assert united(kept) == {"travel", "peak_u1", "peak_u2", "path_length"}
        for name, earlier in EARLIER.items():
            connection.execute(f"ALTER TABLE cases RENAME COLUMN {name} TO {earlier}")
        connection.execute("ALTER TABLE cases DROP COLUMN path_length")
    again, old = read(db)
    assert (again, old) == (columns, [{**record, path: None} for record in records])
