"""Sobol indices against known ones, and effects as switches against machines without them."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from planner import InputError, Machine
from planner.machine.machine import Draws, draw
from planner.problem.tables.machine_effects import EFFECTS
from planner.robustness import sobol
from planner.robustness.sobol import Index, indices
from planner.support.arrays import Array
from planner.support.package import how_to_install


def test_of_the_ishigami_function() -> None:
    """T. Ishigami, T. Homma, 1990: a = 7, b = 0.1; the indices are known in closed form."""

    def ishigami(places: Mapping[str, Array]) -> Array:
        x, y, z = (np.pi * (2 * places[name][0] - 1) for name in ("x", "y", "z"))
        return np.asarray(np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x))

    found = indices(dict.fromkeys("xyz", 1), ishigami, 1024, 0)
    known = {"x": (0.3139, 0.5576), "y": (0.4424, 0.4424), "z": (0.0, 0.2437)}
    for name, (first, total) in known.items():
        assert found[name].first == pytest.approx(first, abs=0.04)
        assert found[name].total == pytest.approx(total, abs=0.04)
        assert abs(found[name].first - first) < 2 * found[name].first_half + 0.01
        assert found[name].total_half < 0.12


@pytest.mark.parametrize("seed", [0, 3])
def test_the_same_seed_gives_the_same_intervals(seed: int) -> None:
    def weighted(places: Mapping[str, Array]) -> Array:
        return np.asarray(places["a"][0] + 2 * places["b"][0] * places["c"][0])

    sizes = dict.fromkeys("abc", 1)
    assert indices(sizes, weighted, 32, seed) == indices(sizes, weighted, 32, seed)


def test_values_of_one_effect_are_one_group() -> None:
    def weighted(places: Mapping[str, Array]) -> Array:
        return np.asarray(places["two"].sum(axis=0) + 2 * places["one"][0])

    found = indices({"two": 2, "one": 1}, weighted, 512, 0)  # variances 2/12 and 4/12
    assert found["two"].total == pytest.approx(1 / 3, abs=0.03)
    assert found["one"].first == pytest.approx(2 / 3, abs=0.05)


def test_the_easy_cases() -> None:
    assert indices({}, lambda _: np.zeros(1), 4, 0) == {}
    flat = indices({"a": 1, "b": 1}, lambda p: np.ones(p["a"].shape[1]), 4, 0)
    assert flat["a"] == Index(0.0, 0.0, 0.0, 0.0)
    alone = indices({"a": 1}, lambda p: p["a"][0], 4, 0)
    assert (alone["a"].first, alone["a"].total) == (1.0, 1.0)


@pytest.mark.parametrize("base", [0, 1, 3, 100])
def test_the_base_is_a_power_of_two(base: int) -> None:
    with pytest.raises(InputError, match=f"base = {base}: .* 2"):
        indices({"a": 1}, lambda p: p["a"][0], base, 0)


def test_without_salib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SALib.analyze", None)
    with pytest.raises(InputError, match=re.escape(how_to_install("budget"))):
        indices({"a": 1}, lambda p: p["a"][0], 4, 0)


def test_switches_share_what_samples_cannot_have_each_for_itself() -> None:
    """Each machine in each simulation has exactly the effects that its place says."""
    machine = Machine.prototype(servo_damping=0.7)
    names = ["control_period_s", "servo_damping", "shaft_stiffness_nm_per_rad", "backlash_deg"]
    seen: list[tuple[Machine, Draws]] = []

    def errors(there: Machine, draws: Draws) -> Any:
        seen.append((there, draws))
        on = [
            float(there.effects.get("control_period_s") is not None),
            10 * float("servo_damping" in there.effects),
            100 * (draws["shaft_stiffness_nm_per_rad"][0] < 1e5),
            1000 * (draws["backlash_deg"][0] > 0),
        ]
        return sum(on)

    found = sobol.switch_indices(machine, names, 3, errors, 8, 0)
    assert list(found) == names
    assert len(seen) == 4  # patterns of the two that are shared
    assert sum(draws.count for _, draws in seen) == 8 * (4 + 2)
    total = sum(100.0**i for i in range(4))  # variances go by squares
    for i, name in enumerate(names):
        assert found[name].total == pytest.approx(100.0**i / total, abs=0.1)
    for there, draws in seen:
        assert draws.values.keys() == there.effects.keys()
        assert not any(q.varies for q in there.effects.values())


def test_every_effect_has_a_value_that_stands_for_off() -> None:
    machine = Machine.prototype()
    names = list(machine.effects)
    flags = {name: np.array([True, False]) for name in names}
    before = draw(machine.nominal(), 3, np.arange(2), 0)
    draws = sobol.switch_off(before, flags)
    for name in names:
        off, on = draws[name][:, 0], draws[name][:, 1]
        assert np.all(np.isfinite(draws[name]))
        assert np.array_equal(on, before[name][:, 1])
        if not sobol.switches_per_sample(name):
            assert np.array_equal(on, off)
        elif np.isinf(EFFECTS[name].off_value):
            assert np.all(off >= 1e6)
        else:
            assert np.all(off == EFFECTS[name].off_value)
