"""Intervals that hold what they promise, and tests that find what is there and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from planner.support.statistics import differences, holm, percentile_interval


@pytest.mark.parametrize(("percent", "count"), [(50, 40), (95, 400), (95, 1000)])
def test_intervals_hold_the_truth_as_often_as_they_say(percent: float, count: int) -> None:
    """A skewed distribution whose percentiles are known: the exponential."""
    stream, truth = np.random.default_rng(0), -np.log(1 - percent / 100)
    held = 0
    for _ in range(200):
        low, high = percentile_interval(stream.exponential(size=count), percent)
        held += low <= truth <= high
    assert held >= 0.92 * 200  # 95 % are promised, at least
    assert held < 200


@pytest.mark.parametrize("percent", [2.5, 50, 95])
@pytest.mark.parametrize("count", [1, 2, 5, 30, 100, 997])
def test_the_ends_are_those_of_scipy(count: int, percent: float) -> None:
    values = np.round(np.random.default_rng(count).normal(size=count), 1)  # with ties
    test = stats.quantile_test(values, q=0.0, p=percent / 100)
    np.testing.assert_array_equal(
        percentile_interval(values, percent), test.confidence_interval(0.95)
    )


@pytest.mark.parametrize(("less", "more"), [(0, 0), (0, 3), (12, 30), (30, 12), (500, 500)])
def test_the_sign_test_is_that_of_scipy(less: int, more: int) -> None:
    errors = {"a": np.zeros(less + more + 1), "b": np.repeat([1.0, -1.0, 0.0], [less, more, 1])}
    p = stats.binomtest(less, less + more).pvalue if less + more else 1.0
    assert differences(errors)[0].p_value == pytest.approx(p, rel=1e-11)


def test_too_few_values_bound_nothing() -> None:
    low, high = percentile_interval(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 95)
    assert np.isfinite(low)
    assert np.isnan(high)


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == pytest.approx([1.0, 1.0])
    assert holm([]) == []


def test_a_small_shift_is_found_between_pairs_though_machines_differ_much() -> None:
    stream = np.random.default_rng(1)
    machines = stream.normal(5, 2, 300)
    errors = {
        "a": machines + stream.normal(0, 0.05, 300),
        "b": machines + 0.1 + stream.normal(0, 0.05, 300),
        "c": machines + stream.normal(0, 0.05, 300),
    }
    found = {(d.first, d.second): d for d in differences(errors)}
    assert list(found) == [("a", "b"), ("a", "c"), ("b", "c")]
    better = found["a", "b"]
    assert better.significant
    assert better.interval_deg[0] < -0.1 < better.interval_deg[1]
    assert better.median_deg == pytest.approx(np.median(errors["a"] - errors["b"]))
    assert better.first_better == np.mean(errors["a"] < errors["b"]) > 0.8
    assert better.p_corrected >= better.p_value
    assert not found["a", "c"].significant


def test_chance_is_rarely_called_significant() -> None:
    """Three plans without any difference, 60 times: some 5 % of the families show one."""
    stream, wrong = np.random.default_rng(2), 0
    for _ in range(60):
        machines = stream.exponential(size=60)
        errors = {str(k): machines + stream.normal(size=60) for k in range(3)}
        wrong += any(d.significant for d in differences(errors))
    assert wrong <= 6


def test_two_errors_of_one_comparison_are_one_family() -> None:
    stream = np.random.default_rng(4)
    ends = {str(k): stream.normal(size=60) for k in range(3)}
    errors = {**ends, "0": ends["0"] + 2.0}
    alone, both = differences(errors), differences(errors, beside=ends)
    assert [d.p_value for d in both] == [d.p_value for d in alone]
    least = int(np.argmin([d.p_value for d in alone]))
    assert alone[least].p_corrected == pytest.approx(3 * alone[least].p_value)
    assert both[least].p_corrected == pytest.approx(min(1.0, 6 * both[least].p_value))


def test_equal_plans_do_not_differ() -> None:
    (same,) = differences({"a": np.arange(9.0), "b": np.arange(9.0)})
    assert (same.p_value, same.p_corrected, same.median_deg) == (1.0, 1.0, 0.0)
    assert same.first_better == 0.5
    assert not same.significant


def test_the_test_and_the_interval_say_the_same_of_skewed_differences() -> None:
    """Half a degree worse now and then, a little better mostly: ranks would call that even."""
    stream = np.random.default_rng(3)
    for _ in range(40):
        gap = np.where(stream.random(200) < 0.4, stream.exponential(1.0, 200), -0.02)
        (found,) = differences({"a": gap, "b": np.zeros(200)})
        low, high = found.interval_deg
        assert (found.p_value < 0.05) == (low > 0 or high < 0)
