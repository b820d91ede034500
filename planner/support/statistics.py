"""Confidence intervals of replay results, and tests whether two plans differ on the same machines.

Nothing is assumed about the distribution of the errors. Intervals of percentiles come from order
statistics (W. J. Conover, Practical Nonparametric Statistics, 3rd ed., section 3.2); they are exact
for any distribution and need neither resampling nor a seed. All plans run on the same machines, so
they are compared machine by machine with the sign test (same book, section 3.4). It agrees with the
interval of the median difference and, unlike Wilcoxon's test, assumes no symmetry. P-values are
corrected for the number of pairs by Holm's method (S. Holm, Scand. J. Statist. 6, 1979, 65). The
size of the difference is reported too, since with a thousand machines any difference is
significant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from planner.support.arrays import Array

CONFIDENCE = 0.95

SIGNIFICANCE_LEVEL = 0.05
"""Level below which a corrected p-value is called significant."""

LEAST_DIFFERENCE_DEG = 0.1
"""Least relevant difference of the error E, degrees: about one step of the prototype's encoders."""


@dataclass(frozen=True)
class Difference:
    """Comparison of two plans on the same machines.

    Attributes:
        first: Label of the first plan.
        second: Label of the second plan.
        median_deg: Median over machines of E(first) − E(second), degrees; negative when the first
            is better.
        interval_deg: 95 % confidence interval of the median, degrees; NaN with too few machines.
        first_better: Share of machines on which the first plan has the smaller E; ties count half.
        p_value: P-value of the two-sided sign test; machines with equal E do not count.
        p_corrected: P-value after Holm's correction for all tests of the comparison.
        threshold_deg: The smallest median difference that matters in practice, degrees.
    """

    first: str
    second: str
    median_deg: float
    interval_deg: tuple[float, float]
    first_better: float
    p_value: float
    p_corrected: float
    threshold_deg: float = 0.0

    @property
    def matters(self) -> bool:
        """Whether the difference is large enough to matter in practice."""
        return abs(self.median_deg) >= self.threshold_deg

    @property
    def significant(self) -> bool:
        """Whether the difference is significant at the level 0.05 for all pairs together."""
        return self.p_corrected < SIGNIFICANCE_LEVEL

    @property
    def is_clear(self) -> bool:
        """Whether one plan is clearly better: the difference matters, and is significant or has
        one sign on all machines."""
        return self.matters and (self.significant or self.first_better in (0.0, 1.0))


def percentile_interval(values: Array, percent: float) -> tuple[float, float]:
    """Return the 95 % confidence interval of a percentile, estimated from a sample (S,).

    Returns:
        The two ends, which are two of the values; NaN if there are too few values.
    """
    low, high = _interval_ranks(len(values), float(percent))
    ordered = np.concatenate([[np.nan], np.sort(values), [np.nan]])
    return float(ordered[low]), float(ordered[high])


@lru_cache(maxsize=64)
def _interval_ranks(count: int, percent: float) -> tuple[int, int]:
    """Return the ranks, from 1, of the values at the ends; 0 or count + 1 where there is none."""
    from scipy.special import bdtr  # slow to import

    tail = (1 - CONFIDENCE) / 2
    at_most = bdtr(np.arange(count + 1), count, percent / 100)  # P(values below it <= 0 ... count)
    return int(np.searchsorted(at_most, tail)), int(np.searchsorted(at_most, 1 - tail)) + 1


def differences(
    errors: Mapping[str, Array],
    threshold_deg: float = LEAST_DIFFERENCE_DEG,
    beside: Mapping[str, Array] | None = None,
) -> tuple[Difference, ...]:
    """Compare every pair of plans by their errors E on the same machines.

    Args:
        errors: E of each plan on the same machines, shape (S,), degrees, by label.
        threshold_deg: The smallest median difference that matters, degrees.
        beside: A second error of the same plans; Holm's correction then counts the pairs of both.

    Returns:
        One entry per pair, in the order of the labels.
    """
    gaps, others = (
        {(a, b): e[a] - e[b] for a, b in combinations(e, 2)} for e in (errors, beside or {})
    )
    p_values = [_sign_test(gap) for gap in gaps.values()]
    together = holm([*p_values, *map(_sign_test, others.values())])[: len(p_values)]
    out = []
    for (pair, gap), p, corrected in zip(gaps.items(), p_values, together, strict=True):
        better = float(np.mean(gap < 0) + np.mean(gap == 0) / 2)
        median, interval = float(np.median(gap)), percentile_interval(gap, 50)
        out.append(Difference(*pair, median, interval, better, p, corrected, threshold_deg))
    return tuple(out)


def _sign_test(gap: Array) -> float:
    from scipy.special import bdtr  # slow to import

    less, unequal = int(np.sum(gap < 0)), int(np.count_nonzero(gap))
    return min(1.0, 2 * float(bdtr(min(less, unequal - less), unequal, 0.5)))


def holm(p_values: list[float]) -> list[float]:
    """Return p-values corrected for their number by Holm's method, in the given order."""
    p = np.array(p_values)
    order = np.argsort(p, kind="stable")
    steps = np.minimum(1.0, p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.maximum.accumulate(steps)
    return [float(value) for value in corrected]
