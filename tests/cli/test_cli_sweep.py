"""`planner sweep` on the command line."""

from __future__ import annotations

import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PROBLEMS = Path(__file__).parents[2] / "problems"
SWEEP = """
title = "too short"
problem = "paper.toml"
methods = ["polynomial", "piecewise"]
[grid]
"goal.duration" = [0.05, 0.06, 0.07]
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copy(PROBLEMS / "paper.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "short.toml"
    path.write_text(SWEEP, encoding="utf-8")
    return path


def test_it_runs_exports_and_goes_on(run: Callable[..., Any], file: Path) -> None:
    result = run("sweep", file, "--json", "--export", "out.csv")
    assert result.status == 0
    assert result.json["ran"] == 6
    assert result.json["statuses"] == {"infeasible": 6}
    assert result.json["db"] == "short.sqlite"
    assert result.json["written"].endswith("out.csv")
    assert len((file.parent / "out.csv").read_text().splitlines()) == 7
    again = run("sweep", file, "--db", "short.sqlite")
    assert again.status == 0
    assert "were there  6" in again.out
    assert "infeasible  6" in again.out


def test_a_dry_run_counts_and_writes_nothing(run: Callable[..., Any], file: Path) -> None:
    result = run("sweep", file, "--dry-run")
    assert result.status == 0
    assert "3 points x 2 methods = 6" in result.out
    assert run("sweep", file, "--dry-run", "--json").json["runs"] == 6
    assert sorted(p.name for p in file.parent.iterdir()) == ["paper.toml", "short.toml"]


def test_its_schema_is_published(run: Callable[..., Any]) -> None:
    assert "grid" in run("schema", "sweep").json["properties"]
    result = run("schema", "swep")
    assert result.status == 2
    assert "did you mean 'sweep'" in result.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["none.toml"], "cannot read none.toml"),
        (["short.toml", "--export", "out.txt"], "must end in .csv or .parquet"),
        (["short.toml", "--export", "none/out.csv"], "there is no folder"),
        (["short.toml", "--db", "none/x.sqlite"], "there is no folder"),
        (["short.toml", "--db", "short.toml"], "cannot use the database"),
        (["short.toml", "--workers", "0"], "--workers"),
        (["short.toml", "--workers", "1", "--cluster", "tcp://127.0.0.1:1"], "not both"),
    ],
)
def test_bad_requests_end_with_2_and_write_nothing(
    run: Callable[..., Any], file: Path, words: list[str], says: str
) -> None:
    result = run("sweep", *words)
    assert result.status == 2
    assert says in result.err
    left = {p.name for p in file.parent.iterdir()} - {"paper.toml", "short.toml"}
    assert left <= {"short.sqlite"}
    assert file.read_text(encoding="utf-8") == SWEEP


def press(hidden: bool) -> None:
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        if hidden:
            raise ImportError("initialization failed") from None
        raise


@pytest.mark.parametrize("hidden", [False, True])
def test_after_ctrl_c_it_says_where_the_finished_cases_are(
    run: Callable[..., Any], file: Path, monkeypatch: pytest.MonkeyPatch, hidden: bool
) -> None:
    """Also where an error hides the signal, and after the last case."""
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["planner.sweep.run"], "_pool", lambda *_: press(hidden))
        result = run("sweep", file)
    assert result.status == 130
    assert "finished cases are in short.sqlite; the same command runs the rest" in result.err
    monkeypatch.setattr("planner.cli.sweep.export", lambda *_: press(hidden))
    result = run("sweep", file, "--workers", "1", "--export", "out.csv")
    assert result.status == 130
    assert result.err.endswith("planner: interrupted, short.sqlite was written before\n")


def test_ctrl_c_before_there_is_a_database_says_nothing_of_one(
    run: Callable[..., Any], file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planner.cli.sweep.run_sweep", lambda *_, **__: press(False))
    result = run("sweep", file)
    assert (result.status, result.err) == (130, "planner: interrupted, nothing written\n")
