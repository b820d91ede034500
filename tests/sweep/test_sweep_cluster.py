"""A sweep on a real Dask cluster of this computer: a scheduler, two workers, one of them killed."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import planner
from planner.errors import InputError
from planner.support.package import how_to_install
from planner.sweep.run import run_sweep
from planner.sweep.store import Store

Process = subprocess.Popen[Any]

CASES = 14
# Each case leaves the chart's domain, and the exits are found: a tenth of a second or two.
SWEEP = f"""
problem = "paper.toml"
methods = ["polynomial"]
[grid]
"goal.travel" = {{ from = 0.5, to = 0.7, count = {CASES} }}
"""


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Starts `python -m …` in its own session; ended with the test."""
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
    begun: list[Process] = []

    def begin(*words: str, **options: Any) -> Process:
        log = (tmp_path / f"{len(begun)}.log").open("w")
        options = {"stdout": log, "stderr": log, **options}
        process: Process = subprocess.Popen(
            [sys.executable, "-m", *words], cwd=tmp_path, start_new_session=True, **options
        )
        log.close()
        begun.append(process)
        return process

    yield begin
    for process in begun:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture
def scheduler(start: Callable[..., Process], tmp_path: Path) -> str:
    """Its address."""
    file = tmp_path / "scheduler.json"
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    start("distributed.cli.dask_scheduler", *words)
    end = time.monotonic() + 30
    while not file.exists():
        assert time.monotonic() < end, "the scheduler does not start"
        time.sleep(0.02)
    return str(json.loads(file.read_text())["address"])


def worker(start: Callable[..., Process], address: str) -> Process:
    words = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
    return start("distributed.cli.dask_worker", address, *words)


def rows(db: Path) -> int:
    try:
        with Store(db) as store:
            return len(store.finished())
    except InputError:  # not there yet
        return 0


def test_a_killed_worker_costs_nothing_but_time(
    start: Callable[..., Process],
    scheduler: str,
    written: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    file, db = written(SWEEP), tmp_path / "x.sqlite"
    victim = worker(start, scheduler)
    worker(start, scheduler)
    command = ["planner", "sweep", str(file), "--db", str(db), "--cluster", scheduler, "--json"]
    sweep = start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60
    while rows(db) < 3:
        assert sweep.poll() is None, sweep.communicate()
        assert time.monotonic() < end, "the sweep does not get on"
        time.sleep(0.01)
    victim.kill()
    assert rows(db) < CASES - 3, "it was not killed half-way"
    out, err = sweep.communicate(timeout=60)
    assert sweep.returncode == 0, err
    found = json.loads(out)
    assert found["ran"] == CASES
    assert found["statuses"] == {"singular": CASES}
    assert rows(db) == CASES
    assert victim.wait() == -signal.SIGKILL


def test_a_cluster_without_workers_is_told(
    scheduler: str, monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    monkeypatch.setattr("planner.sweep.pools.PATIENCE_S", 0.2)
    with pytest.raises(planner.InputError, match="has no workers; start some with 'dask worker"):
        run_sweep(tables, tmp_path / "x.sqlite", cluster=scheduler)


def test_a_cluster_that_is_not_there_is_told(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
    monkeypatch.setattr("planner.sweep.pools.ANSWER_S", 0.2)
    for address in ("tcp://127.0.0.1:9", "tcp://no-such-host.invalid:8786"):
        with pytest.raises(planner.InputError, match=f"no Dask scheduler answers at {address}"):
            run_sweep(tables, tmp_path / "x.sqlite", cluster=address)


def test_the_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(planner.InputError, match=re.escape(how_to_install("cluster"))):
        run_sweep(tables, tmp_path / "x.sqlite", cluster="tcp://127.0.0.1:9")
