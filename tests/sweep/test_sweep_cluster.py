"""A sweep on a real Dask cluster of this computer: a scheduler, two workers, one of them killed."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from databases import finished, until

import planner
from planner.cli.app import main
from planner.support.package import how_to_install

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
def scheduler(start: Callable[..., Process], tmp_path: Path) -> str:
    """Its address."""
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
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


def test_a_missing_worker_is_told_and_a_killed_one_costs_nothing_but_time(
    start: Callable[..., Process],
    scheduler: str,
    written: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file, db = written(SWEEP), tmp_path / "x.sqlite"
    says = "has no workers; start some with 'dask worker"
    with monkeypatch.context() as patch:
        patch.setattr("planner.sweep.pools.WORKER_WAIT_S", 0.2)
        with pytest.raises(planner.InputError, match=says):
            planner.run_sweep(file, tmp_path / "none.sqlite", cluster=scheduler)
    victim = worker(start, scheduler)
    worker(start, scheduler)

    def kill_half_way() -> int:
        until(db, 3)
        victim.kill()
        return finished(db)

    with ThreadPoolExecutor(1) as threads:
        done = threads.submit(kill_half_way)
        status = main(["sweep", str(file), "--db", str(db), "--cluster", scheduler, "--json"])
        assert done.result() < CASES - 3, "it was not killed half-way"
    told = capsys.readouterr()
    assert status == 0, told.err
    found = json.loads(told.out)
    assert found["ran"] == CASES
    assert found["statuses"] == {"singular": CASES}
    assert finished(db) == CASES
    assert victim.wait() == -signal.SIGKILL


def test_a_cluster_that_is_not_there_is_told(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
    monkeypatch.setattr("planner.sweep.pools.SCHEDULER_WAIT_S", 0.2)
    for address in ("tcp://127.0.0.1:9", "tcp://no-such-host.invalid:8786"):
        with pytest.raises(planner.InputError, match=f"no Dask scheduler answers at {address}"):
            planner.run_sweep(tables, tmp_path / "x.sqlite", cluster=address)


def test_the_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(planner.InputError, match=re.escape(how_to_install("cluster"))):
        planner.run_sweep(tables, tmp_path / "x.sqlite", cluster="tcp://127.0.0.1:9")
