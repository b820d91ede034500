"""Studies whose cases take about a millisecond, and studies of figures known beforehand."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

import planner

Tables = dict[str, Any]
Known = Callable[..., planner.DesignStudy]

PAIR = {"start_deg": [10, 10], "goal_deg": [30, 30]}


@pytest.fixture
def quick() -> Tables:
    """A study of no designs yet, of whose tasks none can be solved."""
    return {
        "problem": {
            "system": {"kind": "manipulator", "joints": 2, "K": [0.8], "k_g": 0.7},
            "start": {"theta_deg": [10, 10]},
            "goal": {"theta_deg": [30, 30], "duration": 0.01},  # no plan can be that quick
            "limits": {"input_rad_s": 0.8, "joint_deg": 80},
        },
        "methods": ["polynomial"],
        "compensated": False,
        "present": False,
        "replay": {"samples": 2},
        "front": ["effort", "spread_deg"],
    }


@pytest.fixture
def known(tmp_path: Path, quick: Tables) -> Known:
    """A study of designs whose cases have these results, in place of their own.

    Those of a task of a design are its own, or those of the design; None is a task not solved.
    """

    def study(designs: Sequence[Sequence[Mapping[str, Any] | None]], **tables: Any) -> Any:
        grid = {"rho": [round(1.0 + 0.01 * k, 2) for k in range(len(designs))]}
        pairs = {"pairs": [{**PAIR, "goal_deg": [30, 30 - k]} for k in range(len(designs[0]))]}
        whole = {**quick, "grid": grid, "tasks": pairs, **tables}
        planner.design_study(whole, tmp_path, workers=0)
        cases = [results for tasks in designs for results in tasks]
        connection = sqlite3.connect(tmp_path / "cases.sqlite")
        with connection:
            last = "SELECT id FROM sweeps ORDER BY started DESC LIMIT 1"
            keys = connection.execute(
                f"SELECT key FROM points WHERE sweep = ({last}) ORDER BY position"
            )
            for (key,), results in zip(keys.fetchall(), cases, strict=True):
                for name, value in ({"solved": 1, **results} if results else {}).items():
                    name = name.removesuffix("_rad_s")  # which the file leaves to its readers
                    connection.execute(f"UPDATE cases SET {name} = ? WHERE key = ?", (value, key))
        connection.close()
        return planner.design_study(whole, tmp_path, workers=0)

    return study
