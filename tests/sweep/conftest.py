"""Sweeps whose cases take about a millisecond, because each is refused before it is planned."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import planner

ROOT = Path(__file__).parents[2]

Tables = dict[str, Any]


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
