"""The knee of a trade-off curve."""

from __future__ import annotations

import numpy as np

from planner.systems.base import Array


def knee(cost: Array, response: Array) -> int:
    """Index of the point farthest below the chord between the curve's ends.

    Both axes are scaled to the curve's range first (V. Satopaa et al., "Finding a 'Kneedle' in a
    Haystack", ICDCS Workshops 2011): beyond the knee a further share of the cost buys less than the
    same share of the response.

    Args:
        cost: Increasing, shape (m,), m ≥ 2.
        response: What the cost brings down, shape (m,).
    """
    x = (cost - cost[0]) / max(float(cost[-1] - cost[0]), 1e-300)
    span = float(np.max(response) - np.min(response))
    if span <= 0:
        return 0
    y = (response - np.min(response)) / span
    chord = y[0] + (y[-1] - y[0]) * x
    return int(np.argmax(chord - y))
