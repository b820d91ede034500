"""The database file: what it refuses, and that it loses nothing."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from databases import finished, query, until

import planner

Tables = dict[str, Any]


@pytest.fixture
def db(tables: Tables, tmp_path: Path) -> Path:
    path = tmp_path / "x.sqlite"
    planner.run_sweep(tables, path, workers=0)
    return path


def test_another_schema_version_is_refused_with_the_way_out(tables: Tables, db: Path) -> None:
    query(db, "UPDATE schema_version SET version = 2")
    says = "x.sqlite has schema version 2; this planner reads and writes version 1; .* new file"
    with pytest.raises(planner.InputError, match=says):
        planner.run_sweep(tables, db, workers=0)
    with pytest.raises(planner.InputError, match=says):
        planner.load_sweep(db)


def test_a_file_from_before_a_result_was_known_is_read_and_goes_on(
    tables: Tables, db: Path
) -> None:
    query(db, "ALTER TABLE cases DROP COLUMN contact_load")
    assert "contact_load" in planner.load_sweep(db)
    query(db, "ALTER TABLE cases DROP COLUMN contact_load")
    more = {**tables, "grid": {"goal.duration": [0.01, 0.5]}}
    outcome = planner.run_sweep(more, db, workers=0)
    assert (outcome.ran, outcome.kept) == (1, 1)


def test_a_database_of_something_else_is_refused_and_left_alone(
    tables: Tables, tmp_path: Path
) -> None:
    other = tmp_path / "other.sqlite"
    query(other, "CREATE TABLE birds (name TEXT)")
    before = other.read_bytes()
    with pytest.raises(planner.InputError, match="a database of something else"):
        planner.run_sweep(tables, other, workers=0)
    assert other.read_bytes() == before


def test_what_is_no_database_is_refused_and_left_alone(tables: Tables, tmp_path: Path) -> None:
    text = tmp_path / "text.sqlite"
    text.write_text("this is not a database, and long enough to be seen as none" * 20)
    with pytest.raises(planner.InputError, match=r"text\.sqlite"):
        planner.run_sweep(tables, text, workers=0)
    assert text.read_text().startswith("this is not")
    with pytest.raises(planner.InputError, match="it is a folder"):
        planner.run_sweep(tables, tmp_path, workers=0)
    with pytest.raises(planner.InputError, match="is a file, not a folder"):
        planner.run_sweep(tables, text / "x.sqlite", workers=0)
    planner.run_sweep(tables, tmp_path / "new" / "x.sqlite", workers=0)
    assert (tmp_path / "new" / "x.sqlite").is_file()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_file_that_cannot_be_written_is_refused(tables: Tables, db: Path) -> None:
    db.chmod(0o400)
    with pytest.raises(planner.InputError, match="no permission"):
        planner.run_sweep(tables, db, workers=0)


@pytest.mark.parametrize("endings", [["-shm"], ["", "-wal", "-shm"]], ids=["index", "all"])
def test_a_file_made_immutable_half_way_is_told_in_one_line(
    start: Callable[..., Any], written: Callable[[str], Path], tmp_path: Path, endings: list[str]
) -> None:
    """SQLite maps the index into memory: a write to it would end the process by a signal."""
    change = shutil.which("chattr") or "false"
    trial = tmp_path / "trial"
    trial.touch()
    if subprocess.run([change, "+i", trial], capture_output=True, check=False).returncode:
        pytest.skip("needs `chattr +i`")
    subprocess.run([change, "-i", trial], check=True)
    grid = '[grid]\n"goal.duration" = { from = 0.01, to = 0.3, count = 2000 }\n'
    file = written(f'problem = "paper.toml"\nmethods = ["polynomial"]\n{grid}')
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    run = start("planner", "sweep", str(file), "--workers", "1", "--quiet", **streams)
    files = [f"{tmp_path}/sweep.sqlite{ending}" for ending in endings]
    until(tmp_path / "sweep.sqlite", 5)
    subprocess.run([change, "+i", *files], check=True)
    try:
        out, _ = run.communicate(timeout=60)
    finally:
        subprocess.run([change, "-i", *files], check=True)
    assert out.startswith("planner: cannot use the database sweep.sqlite: "), out
    assert (run.returncode, len(out.strip().splitlines())) == (2, 1)
    assert finished(tmp_path / "sweep.sqlite") >= 5


def test_one_key_is_one_row_by_the_databases_own_rule(db: Path) -> None:
    with pytest.raises(sqlite3.IntegrityError, match="UNIQUE"):
        query(db, "INSERT INTO cases SELECT * FROM cases LIMIT 1")


def test_a_commit_is_seen_by_other_readers_at_once(tables: Tables, tmp_path: Path) -> None:
    path = tmp_path / "y.sqlite"
    seen: list[int] = []
    planner.run_sweep(tables, path, workers=0, progress=lambda *_: seen.append(finished(path)))
    assert seen == list(range(11))


def test_a_full_disk_is_told_and_loses_nothing(
    tables: Tables, db: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect = sqlite3.connect

    def small(*args: Any, **options: Any) -> sqlite3.Connection:
        connection = connect(*args, **options)
        connection.execute("PRAGMA max_page_count = 20")
        return connection

    monkeypatch.setattr(sqlite3, "connect", small)
    grid = {"goal.duration": {"from": 0.01, "to": 0.5, "count": 50}}
    with pytest.raises(planner.InputError, match="database or disk is full"):
        planner.run_sweep({**tables, "grid": grid}, db, workers=0)
    monkeypatch.undo()
    assert finished(db) >= 10
    assert planner.run_sweep({**tables, "grid": grid}, db, workers=0).statuses == {"infeasible": 50}


@pytest.mark.parametrize("says", ["database or disk is full", "disk I/O error"])
def test_a_full_disk_leaves_no_stub(
    tables: Tables, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: str
) -> None:
    """The first page is written, and then there is no room for the tables, or for the log."""

    class Full(sqlite3.Connection):
        def execute(self, statement: str, *values: Any) -> sqlite3.Cursor:
            if "I/O" not in says:
                super().execute("PRAGMA max_page_count = 1")
            elif Path(tmp_path / "new.sqlite").stat().st_size:
                raise sqlite3.OperationalError(says)
            return super().execute(statement, *values)

    real = sqlite3.connect
    monkeypatch.setattr(
        sqlite3, "connect", lambda *words, **options: real(*words, **options, factory=Full)
    )
    with pytest.raises(planner.InputError, match=rf"new\.sqlite: {says}"):
        planner.run_sweep(tables, tmp_path / "new.sqlite", workers=0)
    assert list(tmp_path.iterdir()) == []
