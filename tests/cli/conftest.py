"""Running the command line inside the test process."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from planner.cli import output
from planner.cli.app import main

PROBLEMS = Path(__file__).parents[2] / "problems"


@dataclass(frozen=True)
class Result:
    status: int
    out: str
    err: str

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


@pytest.fixture
def edited(tmp_path: Path) -> Callable[[dict[str, str]], Path]:
    """The paper's problem file with some of its text replaced."""

    def write(edits: dict[str, str]) -> Path:
        text = (PROBLEMS / "paper.toml").read_text(encoding="utf-8")
        for old, new in edits.items():
            assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in the file"
            text = text.replace(old, new)
        path = tmp_path / "edited.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write
