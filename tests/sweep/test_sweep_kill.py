"""A run that is killed or interrupted half-way, as a user's would be: in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from planner.errors import InputError
from planner.sweep.store import Store

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

CASES = 200
# Each case is refused after about a millisecond: no plan can be that quick.
SWEEP = f"""
problem = "paper.toml"
methods = ["polynomial"]
[grid]
"goal.duration" = {{ from = 0.01, to = 0.3, count = {CASES} }}
"""


@pytest.fixture
def start(
    written: Callable[[str], Path], tmp_path: Path
) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    file = written(SWEEP)
    begun: list[subprocess.Popen[str]] = []

    def begin(*words: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "planner", "sweep", str(file), "--workers", "1", *words]
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        begun.append(process)
        return process

    yield begin
    for process in begun:
        process.kill()
        process.communicate()


def rows(db: Path) -> int:
    try:
        with Store(db) as store:
            return len(store.finished())
    except InputError:  # not there yet
        return 0


def until(db: Path, count: int) -> None:
    end = time.monotonic() + 60
    while rows(db) < count:
        assert time.monotonic() < end, "the sweep does not get on"
        time.sleep(0.005)


def alive() -> dict[int, int]:
    """Processes that run, and their parents; empty where there is no /proc."""
    out = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                out[int(stat.parent.name)] = int(parent)
    return out


def test_kill_9_loses_nothing_and_the_restart_runs_the_rest(
    start: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    db = tmp_path / "sweep.sqlite"
    process = start()
    until(db, 10)
    workers = {child for child, parent in alive().items() if parent == process.pid}
    assert bool(workers) == bool(alive())
    process.kill()
    process.wait()
    kept = rows(db)
    assert 10 <= kept < CASES, "it was not killed half-way"
    gone = time.monotonic() + 10
    while workers & alive().keys() and time.monotonic() < gone:
        time.sleep(0.01)
    assert not workers & alive().keys(), "workers live on"
    out, err = start("--json").communicate(timeout=60)
    found = json.loads(out)
    assert found["kept"] == kept, err
    assert found["ran"] == CASES - kept
    assert found["statuses"] == {"infeasible": CASES}
    assert rows(db) == CASES


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(
    start: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    db = tmp_path / "sweep.sqlite"
    process = start("--json")
    until(db, 10)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert 10 <= rows(db) < CASES
    assert json.loads(out)["status"] == "interrupted"
    assert "finished cases are in sweep.sqlite; the same command runs the rest" in err
    assert "Traceback" not in err
