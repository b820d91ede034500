"""Running the command line inside the test process."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from command import main

import planner
from planner.cli import output
from planner.sweep.pools import Pool

RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


@dataclass(frozen=True)
class Result:
    status: int
    out: str
    err: str

    @property
    def words(self) -> str:
        """Standard output as one line: tables fold their text."""
        return " ".join(self.out.split())

    @property
    def json(self) -> dict[str, Any]:
        """Standard output, which must be exactly one JSON object without NaN."""

        def refuse(name: str) -> None:
            raise ValueError(f"{name} is not JSON")

        data = json.loads(self.out, parse_constant=refuse)
        assert isinstance(data, dict)
        return data


Run = Callable[..., Result]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr(output, "LOG_INTERVAL_S", 1e6)  # or a slow machine has one line more to say

    def call(*words: str | Path) -> Result:
        capsys.readouterr()
        status = main([str(word) for word in words])
        captured = capsys.readouterr()
        return Result(status, captured.out, captured.err)

    return call


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below the folder with what is in it; of a sparse or odd one its size."""
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.is_file() else b""
        for p in folder.rglob("*")
        if not p.is_symlink()
    }


@pytest.fixture
def refused(run: Run, tmp_path: Path) -> Callable[..., None]:
    """Runs a command for people and as JSON: it must say this, briefly, and change no file."""

    def call(words: list[str | Path], *says: str, status: int = 2) -> None:
        before = tree(tmp_path)
        people, machine = run(*words), run(*words, "--json")
        assert (people.status, people.out) == (status, ""), people
        assert machine.status == machine.json["exit_status"] == status
        if status == 2:
            assert machine.json["status"] == "bad_input"
        for text in (people.err, machine.json["error"]):
            assert [say for say in says if say not in text] == [], text
            assert "Traceback" not in text
            assert "pydantic" not in text
        assert len(people.err) < 3000
        assert not RAW.search(people.err)
        assert tree(tmp_path) == before

    return call


@pytest.fixture
def law(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., Any]], None]:
    """Puts a function in the place of the method `polynomial`; it is handed what that does."""
    real = planner.METHODS["polynomial"]

    def put(function: Callable[[Callable[[], planner.Plan]], planner.Plan]) -> None:
        def plan(problem: planner.Problem, options: Any) -> planner.Plan:
            return function(lambda: real.plan(problem, options))

        monkeypatch.setitem(planner.METHODS, "polynomial", replace(real, plan=plan))

    return put


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of comparisons without figures, which take long."""
    monkeypatch.setattr("planner.report.folders._write_figures", lambda *_: None)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cases run here: a worker loads the package anew, and has tests of its own."""
    monkeypatch.setattr("planner.sweep.run.LocalPool", lambda _: Pool())
