"""Samples: where the draws lie, and that they can be repeated and extended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import planner

PAPER = str(Path(__file__).parents[2] / "problems/paper.toml")
ANGLE, MARGIN, SECONDS = "limits.joint_deg", "limits.z2_margin", "goal.duration"
SLOTS, TRAVEL = "method.piecewise.slots", "goal.travel"
KEYS = {
    ANGLE: {"uniform": [70.0, 80.0]},
    MARGIN: {"log_uniform": [1e-4, 1e-1]},
    SECONDS: {"normal": [50.0, 5.0]},
    SLOTS: {"integer": [3, 6]},
    TRAVEL: {"choice": ["free", 0.8]},
}


def points(**tables: Any) -> list[dict[str, Any]]:
    tables = {"problem": PAPER, "methods": ["piecewise"], **tables}
    return list(planner.Sweep.from_dict(tables).points)


def drawn(count: int, method: str, seed: int = 1) -> list[dict[str, Any]]:
    return points(sample={"count": count, "seed": seed, "method": method, **KEYS})


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_draws_follow_their_distributions(method: str) -> None:
    rows = drawn(512, method)
    column = {key: [row[key] for row in rows] for key in KEYS}
    expected = {
        ANGLE: stats.uniform(70, 10),
        MARGIN: stats.loguniform(1e-4, 1e-1),
        SECONDS: stats.norm(50, 5),
    }
    for key, law in expected.items():
        assert stats.kstest(column[key], law.cdf).pvalue > 0.01
    assert np.unique(column[SLOTS], return_counts=True)[1] == pytest.approx(128, abs=40)
    assert set(column[SLOTS]) == {3, 4, 5, 6}
    assert column[TRAVEL].count("free") == pytest.approx(256, abs=60)
    assert {type(v) for v in column[SLOTS]} == {int}


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_the_seed_decides_and_a_larger_sample_begins_with_the_smaller(method: str) -> None:
    assert drawn(37, method)[:20] == drawn(20, method)
    assert drawn(8, method, seed=1) != drawn(8, method, seed=2)


def test_sobol_fills_more_evenly_than_chance() -> None:
    def gap(method: str) -> float:
        return float(np.max(np.diff(np.sort([row[ANGLE] for row in drawn(256, method)]))))

    assert gap("sobol") < 0.5 * gap("random")


def test_logarithmic_ranges_have_equal_ratios() -> None:
    grid = {SECONDS: {"from": 1, "to": 100, "count": 3, "spacing": "log"}}
    assert [point[SECONDS] for point in points(grid=grid)] == [1.0, 10.0, 100.0]
