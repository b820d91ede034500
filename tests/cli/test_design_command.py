"""`planner design` on the command line."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import planner

STUDY = """
title = "two designs"
methods = ["collocation"]
compensated = false
present = false
[problem]
system = { kind = "manipulator", joints = 2, K = [0.8], k_g = 0.7 }
start = { theta_deg = [10, 10] }
goal = { theta_deg = [30, 30], duration = 3.0 }
machine = { step_s = 0.01, control_period_s = 0.05 }
[grid]
kappa = [0.7, 1.5]
[replay]
samples = 2
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


@pytest.mark.usefixtures("in_this_process")
def test_it_prints_a_table_and_a_reason_and_goes_on(run: Callable[..., Any], file: Path) -> None:
    first = run("design", "small.toml", "--workers", "1")
    assert first.status == 0, first.err
    assert re.search(r"kappa = 1\.5 +take +1 of 1", first.out)
    assert "Take kappa = 1.5." in first.out
    assert {p.name for p in (file.parent / "small").iterdir()} >= {"cases.sqlite", "design.png"}
    again = run("design", "small.toml", "--json")
    assert again.json["recommended"] == "kappa = 1.5"
    assert again.json["written"] == "small"
    assert [each["design"] for each in again.json["designs"]] == ["kappa = 0.7", "kappa = 1.5"]


def test_a_dry_run_counts_and_names_what_cannot_be_built(
    run: Callable[..., Any], file: Path
) -> None:
    file.write_text(STUDY.replace("kappa = [0.7, 1.5]", "link_lengths = [[1.1, 1], [2, 1]]"))
    result = run("design", file, "--dry-run")
    assert result.status == 0
    assert "cannot be built: contact P3 of joint 1 cannot meet disk A'" in result.words
    counted = run("design", file, "--dry-run", "--json").json
    assert (counted["designs"], counted["runs"]) == (2, 1)
    assert [p.name for p in file.parent.iterdir()] == ["small.toml"]


@pytest.mark.usefixtures("in_this_process")
def test_no_design_for_any_task_ends_with_3(run: Callable[..., Any], file: Path) -> None:
    file.write_text(STUDY.replace("duration = 3.0 }", "duration = 0.001 }\nlimits.input_rad_s = 1"))
    result = run("design", file, "--workers", "1", "--out", "none")
    assert result.status == 3, result.err
    assert "No design solves a task by collocation: no plan of any kind exists" in result.out


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_keeps_what_is_done(file: Path) -> None:
    many = ", ".join(f"{0.5 + 0.001 * k:.3f}" for k in range(100))
    file.write_text(STUDY.replace("0.7, 1.5", many))
    process = subprocess.Popen(
        [sys.executable, "-m", "planner", "design", "small.toml", "--workers", "1"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    kept = 0
    while process.poll() is None and kept < 2:
        with suppress(planner.InputError):  # not there yet
            kept = len(planner.load_sweep("small/cases.sqlite"))
        time.sleep(0.1)
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "finished cases are in small/cases.sqlite; the same command" in err
    assert "Traceback" not in err
