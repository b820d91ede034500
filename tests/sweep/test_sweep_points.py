"""Samples: where the draws lie, and that they can be repeated and extended."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from planner.sweep.sweep_file import SweepFile, points

KEYS = {
    "limits.a": {"uniform": [2.0, 3.0]},
    "limits.b": {"log_uniform": [1e-3, 1.0]},
    "limits.c": {"normal": [5.0, 0.5]},
    "limits.d": {"integer": [3, 6]},
    "limits.e": {"choice": ["x", "y"]},
}


def drawn(count: int, method: str, seed: int = 1) -> list[dict[str, Any]]:
    sample = {"count": count, "seed": seed, "method": method, **KEYS}
    table = SweepFile.model_validate({"problem": "p", "methods": ["m"], "sample": sample})
    return points(table, "test")


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_draws_follow_their_distributions(method: str) -> None:
    rows = drawn(512, method)
    column = {key: [row[key] for row in rows] for key in KEYS}
    expected = {
        "limits.a": stats.uniform(2, 1),
        "limits.b": stats.loguniform(1e-3, 1),
        "limits.c": stats.norm(5, 0.5),
    }
    for key, law in expected.items():
        assert stats.kstest(column[key], law.cdf).pvalue > 0.01
    assert np.unique(column["limits.d"], return_counts=True)[1] == pytest.approx(128, abs=40)
    assert set(column["limits.d"]) == {3, 4, 5, 6}
    assert column["limits.e"].count("x") == pytest.approx(256, abs=60)
    assert {type(v) for v in column["limits.d"]} == {int}


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_a_larger_sample_begins_with_the_smaller(method: str) -> None:
    assert drawn(37, method)[:20] == drawn(20, method)


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_the_seed_decides(method: str) -> None:
    assert drawn(8, method, seed=1) == drawn(8, method, seed=1)
    assert drawn(8, method, seed=1) != drawn(8, method, seed=2)


def test_sobol_fills_more_evenly_than_chance() -> None:
    def gap(method: str) -> float:
        values = np.sort([row["limits.a"] for row in drawn(256, method)])
        return float(np.max(np.diff(values)))

    assert gap("sobol") < 0.5 * gap("random")


def test_logarithmic_ranges_have_equal_ratios() -> None:
    grid = {"limits.a": {"from": 0.01, "to": 1, "count": 3, "spacing": "log"}}
    table = SweepFile.model_validate({"problem": "p", "methods": ["m"], "grid": grid})
    assert [p["limits.a"] for p in points(table, "test")] == [0.01, 0.1, 1.0]
