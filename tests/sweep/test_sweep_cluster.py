"""A sweep on a real Dask cluster of this computer: a scheduler, two workers, one of them killed."""

from __future__ import annotations

import json
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from command import main
from databases import finished, query, until

import planner
from planner.support.package import how_to_install
from planner.sweep.cluster import ClusterPool

Process = subprocess.Popen[Any]

CASES = 14
# Each case leaves the chart's domain, and the exits are found: a tenth of a second or two.
SWEEP = f"""
problem = "paper.toml"
methods = ["polynomial"]
[grid]
"goal.travel" = {{ from = 0.5, to = 0.7, count = {CASES} }}
"""


@dataclass(frozen=True)
class Scheduler:
    address: str
    process: Process

    @contextmanager
    def still(self) -> Iterator[None]:
        self.process.send_signal(signal.SIGSTOP)
        yield
        self.process.send_signal(signal.SIGCONT)


@pytest.fixture
def scheduler(start: Callable[..., Process], tmp_path: Path) -> Scheduler:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
    file = tmp_path / "scheduler.json"
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    process = start("distributed.cli.dask_scheduler", *words)
    end = time.monotonic() + 60
    while not file.exists() or not file.read_text().endswith("}"):
        assert time.monotonic() < end, "the scheduler does not start"
        time.sleep(0.02)
    return Scheduler(str(json.loads(file.read_text())["address"]), process)


def worker(start: Callable[..., Process], at: Scheduler, **options: Any) -> Process:
    words = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
    return start("distributed.cli.dask_worker", at.address, *words, **options)


def test_a_killed_worker_costs_nothing_but_time(
    start: Callable[..., Process],
    scheduler: Scheduler,
    written: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, db = written(SWEEP), tmp_path / "x.sqlite"
    victim = worker(start, scheduler)
    worker(start, scheduler)

    def kill_half_way() -> int:
        until(db, 3)
        victim.kill()
        return finished(db)

    with ThreadPoolExecutor(1) as threads:
        done = threads.submit(kill_half_way)
        words = ["sweep", str(file), "--db", str(db), "--cluster", scheduler.address, "--json"]
        status = main(words)
        assert done.result() < CASES - 3, "it was not killed half-way"
    told = capsys.readouterr()
    assert status == 0, told.err
    found = json.loads(told.out)
    assert found["ran"] == CASES
    assert found["statuses"] == {"singular": CASES}
    assert finished(db) == CASES
    assert victim.wait() == -signal.SIGKILL


def test_a_cluster_leaves_other_clients_what_its_workers_have_no_room_for(
    start: Callable[..., Process],
    scheduler: Scheduler,
    written: Callable[[str], Path],
    tmp_path: Path,
) -> None:
    """First it has no worker, and claims two cases; another client runs the rest meanwhile."""
    file, db = written(SWEEP), tmp_path / "x.sqlite"
    claimed, manned = threading.Event(), threading.Event()

    def hold(doing: str, share: float) -> None:
        if query(db, "SELECT * FROM claims"):
            claimed.set()

    def man(doing: str, share: float) -> None:
        assert share <= (CASES - 2) / CASES or manned.is_set()
        if share == (CASES - 2) / CASES and not manned.is_set():
            manned.set()
            worker(start, scheduler)

    with ThreadPoolExecutor(1) as threads:
        other = threads.submit(
            planner.run_sweep, file, db, cluster=scheduler.address, progress=hold
        )
        assert claimed.wait(60)
        outcome = planner.run_sweep(file, db, workers=0, progress=man)
    assert (other.result().ran, outcome.ran) == (2, CASES - 2)
    assert outcome.statuses == {"singular": CASES}


def test_the_room_for_cases_follows_the_workers(
    start: Callable[..., Process], scheduler: Scheduler
) -> None:
    pool = ClusterPool(scheduler.address)
    try:
        workers = []
        for count in (0, 1, 2, 1):
            if count < len(workers):
                workers.pop().kill()
            elif count > len(workers):
                workers.append(worker(start, scheduler))
            end = time.monotonic() + 60
            while pool.window != 2 * max(1, count):
                assert pool.trouble() == ""
                assert time.monotonic() < end
                time.sleep(0.05)
    finally:
        pool.close()


def test_a_cluster_that_stands_still_is_told_and_waited_for(
    start: Callable[..., Process],
    scheduler: Scheduler,
    written: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At first nobody answers; then there is no worker; then nobody answers half-way."""
    monkeypatch.setattr("planner.sweep.cluster.PATIENCE_S", 1.0)
    db, still = tmp_path / "x.sqlite", ExitStack()
    still.enter_context(scheduler.still())
    steps = iter(
        [
            ("has not answered", still.close),
            ("has no workers; start some with 'dask worker", lambda: worker(start, scheduler)),
            ("has not answered", still.close),
        ]
    )
    expected, act = next(steps)
    told = []

    def hear(message: Warning | str, *_: Any, **__: Any) -> None:
        nonlocal expected, act
        told.append(str(message))
        assert expected in str(message)
        act()
        # A busy machine may lose the worker that stood still: that is told, too.
        expected, act = next(steps, ("has no", lambda: worker(start, scheduler)))

    def stop_half_way(doing: str, share: float) -> None:
        if len(told) == 2 and 0 < share < 1:
            still.enter_context(scheduler.still())

    with still, warnings.catch_warnings():
        warnings.simplefilter("always")
        monkeypatch.setattr(warnings, "showwarning", hear)
        outcome = planner.run_sweep(
            written(SWEEP), db, cluster=scheduler.address, progress=stop_half_way
        )
    assert len(told) >= 3
    assert outcome.statuses == {"singular": CASES}


@pytest.mark.parametrize("probed", [True, False], ids=["probed", "by its first row"])
@pytest.mark.parametrize("name", ["planner", "casadi"])
def test_a_worker_of_another_version_is_refused(
    start: Callable[..., Process],
    scheduler: Scheduler,
    written: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    probed: bool,
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import planner.support.package as package\n"
        "real = package.versions\n"
        f"package.versions = lambda: {{**real(), '{name}': '0.0.7'}}\n"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    worker(start, scheduler, env={**os.environ, "PYTHONPATH": path})
    if not probed:
        monkeypatch.setattr("planner.sweep.cluster.ClusterPool._probe", lambda *_: None)
    with pytest.raises(planner.InputError, match=rf"worker.* has {name} 0\.0\.7 \(here "):
        planner.run_sweep(written(SWEEP), tmp_path / "x.sqlite", cluster=scheduler.address)
    assert finished(tmp_path / "x.sqlite") == 0


@pytest.mark.parametrize("end", ["ctrl-c", "ctrl-c, no answer", "killed"])
def test_an_end_of_a_run_or_a_scheduler_is_told_in_our_words(
    start: Callable[..., Process],
    scheduler: Scheduler,
    written: Callable[[str], Path],
    tmp_path: Path,
    end: str,
) -> None:
    words = ["sweep", str(written(SWEEP)), "--cluster", scheduler.address, "--quiet"]
    db = tmp_path / "sweep.sqlite"
    if end == "ctrl-c, no answer":
        scheduler.process.send_signal(signal.SIGSTOP)
    else:
        worker(start, scheduler)
    run = start("planner", *words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if end == "ctrl-c, no answer":
        while not db.exists():
            time.sleep(0.05)
        time.sleep(1)
    else:
        until(db, 2)
    if end == "killed":
        scheduler.process.kill()
    else:
        run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=30)
    if end == "killed":
        says = f"planner: the Dask cluster at {scheduler.address} has failed; finished cases are"
        assert (run.returncode, out.startswith(says)) == (2, True), out
    else:
        says = "planner: interrupted; finished cases are in sweep.sqlite; the same command"
        assert (run.returncode, out.startswith(says)) == (130, True), out
    assert len(out.strip().splitlines()) == 1


def test_of_cases_that_the_end_of_a_run_cancels_nothing_is_logged(
    scheduler: Scheduler, caplog: pytest.LogCaptureFixture
) -> None:
    """Dask's thread may find them cancelled while it waits for them; other errors are shown."""
    from distributed.client import FutureCancelledError

    ClusterPool(scheduler.address).close()
    for error in (FutureCancelledError("run_case-1", "unknown"), OSError("another")):
        logging.getLogger("tornado.application").error("in a callback", exc_info=error)
    (told,) = caplog.records
    assert told.exc_info is not None
    assert isinstance(told.exc_info[1], OSError)


def test_a_cluster_that_is_not_there_is_told(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed: pip install '.[cluster]'")
    monkeypatch.setattr("planner.sweep.cluster.CONNECTION_WAIT_S", 0.2)
    for address in ("tcp://127.0.0.1:9", "tcp://no-such-host.invalid:8786"):
        with pytest.raises(planner.InputError, match=address):
            planner.run_sweep(tables, tmp_path / "x.sqlite", cluster=address)


def test_the_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tables: dict[str, Any], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(planner.InputError, match=re.escape(how_to_install("cluster"))):
        planner.run_sweep(tables, tmp_path / "x.sqlite", cluster="tcp://127.0.0.1:9")
