"""Several clients of one database: each case is run once, by one that lives."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from databases import column, finished, query

import planner
from planner import run_sweep
from planner.sweep import case
from planner.sweep.clients import Client, is_alive
from planner.sweep.run import Outcome

Tables = dict[str, Any]
Process = subprocess.Popen[Any]


@pytest.fixture
def db(tmp_path: Path) -> Path:
    return tmp_path / "x.sqlite"


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The duration of each case that is run in this process."""
    ran: list[float] = []
    real = case._run

    def slow(request: Any) -> Any:
        ran.append(request["tables"]["goal"]["duration"])
        time.sleep(0.02)
        return real(request)

    monkeypatch.setattr(case, "_run", slow)
    return ran


@pytest.mark.parametrize("retry", [[], ["infeasible"]], ids=["new", "again"])
def test_clients_share_the_cases(
    tables: Tables, db: Path, counted: list[float], retry: list[str]
) -> None:
    if retry:
        run_sweep(tables, db, workers=0)
        counted.clear()
    together = threading.Barrier(3)

    def run() -> Outcome:
        first = iter([together.wait])  # all know what is unfinished before one claims a case
        return run_sweep(tables, db, workers=0, retry=retry, progress=lambda *_: next(first, int)())

    with ThreadPoolExecutor(3) as threads:
        runs = [threads.submit(run) for _ in range(3)]
    outcomes = [run.result() for run in runs]
    assert sorted(counted) == column(db, "goal.duration")
    assert sum(outcome.ran for outcome in outcomes) == 10
    assert all(outcome.ran + outcome.kept == outcome.cases == 10 for outcome in outcomes)
    assert all(outcome.statuses == {"infeasible": 10} for outcome in outcomes)
    assert query(db, "SELECT * FROM claims") == []
    assert not [*db.parent.glob(".planner.*")]


def test_a_dead_clients_cases_come_free_at_once(
    tables: Tables, db: Path, start: Callable[..., Process]
) -> None:
    """The living one waits for the other's cases, and takes them when it is killed."""
    run_sweep({**tables, "grid": {"goal.duration": [0.5]}}, db, workers=0)
    (_, *keys) = [each.key for each in case.cases(planner.Sweep.from_dict(tables))]
    code = (
        "import pathlib, sqlite3, sys, time; from planner.sweep.clients import Client\n"
        "with Client(pathlib.Path(sys.argv[1])) as client:\n"
        "    db = sqlite3.connect(sys.argv[1])\n"
        "    with db: db.executemany('INSERT INTO claims VALUES (?, ?)',"
        " [(key, client.name) for key in sys.argv[2:]])\n"
        "    time.sleep(600)\n"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(db), *keys])
    told: list[str] = []

    def kill(doing: str, share: float) -> None:
        told.append(doing)
        if "waiting" in doing:
            other.kill()

    try:
        end = time.monotonic() + 60
        while not query(db, "SELECT * FROM claims"):
            assert time.monotonic() < end
        outcome = run_sweep(tables, db, workers=0, progress=kill)
    finally:
        other.kill()
        other.wait()
    assert "1 of 10 cases (1 infeasible); waiting for those of another run" in told
    assert (outcome.ran, finished(db)) == (10, 11)
    assert not [*db.parent.glob(".planner.*")]


def test_a_client_lives_as_long_as_its_lock(db: Path) -> None:
    with Client(db) as client:
        assert is_alive(client.name, db)
    assert not is_alive(client.name, db)
    other = db.parent / ".planner.client.left"
    other.touch()  # as a killed one leaves it
    assert not is_alive(other.name, db)
    assert not other.exists()


@pytest.mark.parametrize("name", ["mine.txt", "../mine.txt", "/etc/hostname", ""])
def test_a_claim_of_a_strange_name_is_nobodys_and_touches_no_file(
    tables: Tables, tmp_path: Path, name: str
) -> None:
    db, mine = tmp_path / "new/x.sqlite", [tmp_path / "mine.txt", tmp_path / "new/mine.txt"]
    run_sweep({**tables, "grid": {"goal.duration": [0.5]}}, db, workers=0)
    for file in mine:
        file.touch()
    for each in case.cases(planner.Sweep.from_dict(tables)):
        query(db, f"INSERT INTO claims VALUES ('{each.key}', '{name}')")
    assert run_sweep(tables, db, workers=0).ran == 10
    assert all(file.exists() for file in mine)


def test_a_saved_plan_outlives_a_client_that_keeps_none(
    unlimited: planner.Problem, db: Path
) -> None:
    tables = {"problem": unlimited, "methods": ["polynomial"], "grid": {"goal.travel": [0.82]}}
    run_sweep({**tables, "plans": True}, db, workers=0)
    before = column(db, "plan")
    assert before[0]
    assert run_sweep(tables, db, workers=0, retry=["solved"]).ran == 1
    assert column(db, "plan") == before
