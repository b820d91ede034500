"""The part of a rate that a contact passes on where the rate brings the load."""

from __future__ import annotations

import numpy as np

from planner.machine.friction import contacts


def test_the_rate_brings_the_load_that_lets_this_rate_pass() -> None:
    rng, count = np.random.default_rng(3), 2000
    cosines, capacity = rng.uniform(-1, 1, count), 10.0 ** rng.uniform(-2, 1, count)
    grip = contacts.Grip(cosines, rng.uniform(0.05, 1, count), capacity)
    steady = capacity * rng.uniform(-1.2, 1.2, count)
    whole = steady + capacity * 10.0 ** rng.uniform(-4, 2, count)
    load, rate = contacts.share(grip, steady, whole)
    assert np.allclose(load, steady + (whole - steady) * np.minimum(rate, 1), rtol=1e-9)
    inside = (rate > 0) & (rate < 1)
    assert inside.sum() > count / 4
    low, high = rate - 1e-9, rate + 1e-9
    brought = [grip.transmission(steady + (whole - steady) * edge) - edge for edge in (low, high)]
    assert np.all(brought[0][inside] >= 0)
    assert np.all(brought[1][inside] <= 0)
    still = grip.transmission(steady) <= 0
    assert np.array_equal(rate == 0, still)
    assert np.all(load[still] == steady[still])


def test_few_tries_are_enough() -> None:
    """Forty halvings took 38 times as long as a replay without this."""
    grip = contacts.Grip(np.array([0.8]), np.array([0.3]), np.array([1.0]))
    asked: list[int] = []
    usual = grip.transmission
    grip.transmission = lambda load: (asked.append(1), usual(load))[1]  # type: ignore[method-assign,func-returns-value]
    contacts.share(grip, np.array([0.1]), np.array([0.9]))
    assert len(asked) < 12
