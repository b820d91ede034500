"""Sweeps whose cases take about a millisecond, because each is refused before it is planned."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import planner

ROOT = Path(__file__).parents[2]

Tables = dict[str, Any]
Process = subprocess.Popen[Any]


@pytest.fixture
def tables(paper: planner.Problem) -> Tables:
    """A sweep of ten durations that no plan can keep."""
    return {
        "title": "too short",
        "problem": paper.to_dict(),
        "methods": ["polynomial"],
        "grid": {"goal.duration": {"from": 0.01, "to": 0.1, "count": 10}},
    }


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    """A sweep file beside a copy of the paper's problem file."""
    problem = (ROOT / "problems/paper.toml").read_text(encoding="utf-8")
    (tmp_path / "paper.toml").write_text(problem, encoding="utf-8")

    def write(text: str) -> Path:
        path = tmp_path / "sweep.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Starts `python -m …` in its own session; ended with the test."""
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
