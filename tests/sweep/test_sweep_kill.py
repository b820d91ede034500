"""A run that is killed or interrupted half-way, as a user's would be: in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from databases import alive, finished, until

import planner

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

Process = subprocess.Popen[Any]

CASES = 200
# Each case is refused after about a millisecond: no plan can be that quick.
SWEEP = f"""
problem = "paper.toml"
methods = ["polynomial"]
[grid]
"goal.duration" = {{ from = 0.01, to = 0.3, count = {CASES} }}
"""


@pytest.fixture
def sweep(start: Callable[..., Process], written: Callable[[str], Path]) -> Callable[..., Process]:
    def begun(*words: str) -> Process:
        command = ["planner", "sweep", str(written(SWEEP)), "--workers", "1", *words]
        return start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return begun


def test_kill_9_loses_nothing_and_the_restart_runs_the_rest(
    sweep: Callable[..., Process], tmp_path: Path
) -> None:
    db = tmp_path / "sweep.sqlite"
    process = sweep()
    until(db, 10)
    workers = {child for child, parent in alive().items() if parent == process.pid}
    assert bool(workers) == bool(alive())
    process.kill()
    process.wait()
    kept = finished(db)
    assert 10 <= kept < CASES, "it was not killed half-way"
    gone = time.monotonic() + 60
    while workers & alive().keys() and time.monotonic() < gone:
        time.sleep(0.01)
    assert not workers & alive().keys(), "workers live on"
    again = planner.run_sweep(tmp_path / "sweep.toml", db, workers=0)
    assert (again.kept, again.ran) == (kept, CASES - kept)
    assert again.statuses == {"infeasible": CASES}
    assert finished(db) == CASES


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(
    sweep: Callable[..., Process], tmp_path: Path
) -> None:
    db = tmp_path / "sweep.sqlite"
    process = sweep("--json")
    until(db, 10)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert 10 <= finished(db) < CASES
    assert json.loads(out)["status"] == "interrupted"
    assert "finished cases are in sweep.sqlite; the same command runs the rest" in err
    assert "Traceback" not in err
