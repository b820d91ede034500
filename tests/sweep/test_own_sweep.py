"""A run reads its own sweep, whatever else happens to the file, and whatever the clock says."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from command import main
from databases import query

import planner
from planner import run_sweep
from planner.sweep.results import read

Tables = dict[str, Any]


@pytest.fixture
def backward(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that goes back by a day each time it is read."""

    def days() -> Iterator[datetime]:
        day = datetime(2026, 6, 1, tzinfo=UTC)
        while True:
            yield day
            day -= timedelta(days=1)

    told = days()

    class Clock(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return next(told)

    monkeypatch.setattr("planner.sweep.store.datetime", Clock)


def durations(db: Path, which: int | None = None) -> list[float]:
    return [record["goal.duration"] for record in read(db, which)[1]]


@pytest.mark.usefixtures("backward")
def test_the_last_start_is_the_last_by_order_not_by_the_clock(
    tables: Tables, tmp_path: Path
) -> None:
    db = tmp_path / "x.sqlite"
    other = {**tables, "grid": {"goal.duration": [0.2, 0.3]}}
    first, second = run_sweep(tables, db, workers=0), run_sweep(other, db, workers=0)
    assert (first.sweep, second.sweep) == (1, 2)
    assert durations(db) == [0.2, 0.3]
    assert run_sweep(tables, db, workers=0).sweep == 1
    assert durations(db) == durations(db, first.sweep)
    assert len(durations(db)) == 10
    assert durations(db, second.sweep) == [0.2, 0.3]


@pytest.mark.parametrize("edited", [True, False], ids=["edited", "another file"])
def test_a_command_reports_its_own_sweep_when_another_starts_meanwhile(
    written: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    edited: bool,
) -> None:
    text = 'problem = "paper.toml"\nmethods = ["METHOD"]\n[grid]\n"goal.duration" = [0.05, LAST]\n'
    file = written(text.replace("METHOD", "piecewise").replace("LAST", "0.06"))
    second = file if edited else tmp_path / "second.toml"
    real = run_sweep

    def overtaken(*words: Any, **options: Any) -> Any:
        outcome = real(*words, **options)
        second.write_text(text.replace("METHOD", "polynomial").replace("LAST", "0.07"))
        real(second, "sweep.sqlite", workers=0)
        return outcome

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("planner.cli.sweep.run_sweep", overtaken)
    words = ["--workers", "1", "--export", "own.csv", "--figure", "own.svg", "--json"]
    assert main(["sweep", str(file), *words]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["methods"] == {"piecewise": {"solved": 0, "cases": 2}}
    assert told["sweep"] == 1
    rows = (tmp_path / "own.csv").read_text().splitlines()[1:]
    assert [row.split(",")[:2] for row in rows] == [["0.05", "piecewise"], ["0.06", "piecewise"]]
    assert "piecewise: 0 of 2" in (tmp_path / "own.svg").read_text()


def test_other_keys_of_the_same_cases_are_another_sweep(
    tables: Tables, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those of another version of planner: the rows of an earlier run stay its own."""
    db = tmp_path / "x.sqlite"
    first = run_sweep(tables, db, workers=0)
    before = read(db, first.sweep)
    real = planner.sweep.case.digest
    monkeypatch.setattr("planner.sweep.case.digest", lambda text: real(f"other {text}"))
    second = run_sweep(tables, db, workers=0)
    assert (second.sweep, second.ran) == (2, 10)
    assert read(db, first.sweep) == before


@pytest.mark.usefixtures("backward")
def test_a_study_in_a_folder_of_another_has_the_figures_of_its_own_designs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here the other's clock was ahead, and the rows come in any order."""
    study = {
        "problem": {
            "system": {"kind": "manipulator", "joints": 2, "K": [0.8], "k_g": 0.7},
            "start": {"theta_deg": [10, 10]},
            "goal": {"theta_deg": [30, 30], "duration": 0.01},
            "limits": {"input_rad_s": 0.8},
        },
        "methods": ["polynomial"],
        "compensated": False,
        "present": False,
        "replay": {"samples": 2},
        "front": ["effort"],
    }
    for rho in ([0.9, 1.0, 1.1], [1.2, 1.3]):
        planner.design_study({**study, "grid": {"rho": rho}}, tmp_path, workers=0)
    db = tmp_path / "cases.sqlite"
    for sweep, position, key in query(db, "SELECT sweep, position, key FROM points"):
        effort = 10 * sweep + position
        query(db, f"UPDATE cases SET solved = 1, effort = {effort} WHERE key = '{key}'")
    real = read
    monkeypatch.setattr(
        "planner.sweep.design.result.read", lambda *words: ([], real(*words)[1][::-1])
    )
    again = planner.design_study({**study, "grid": {"rho": [1.2, 1.3]}}, tmp_path, workers=0)
    assert [row["effort"] for row in again.rows] == [20, 21]
    assert again.recommended is again.rows[0]
