"""Samples of a machine: reproducible, paired, and distributed as asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from planner.errors import InputError
from planner.machine.machine import Machine, draw
from planner.problem.tables.machine_effects import EFFECTS


def test_same_seed_same_machines_whatever_the_number() -> None:
    machine = Machine.prototype()
    many = draw(machine, 3, np.arange(50), 7)
    few = draw(machine, 3, np.arange(5), 7)
    chosen = draw(machine, 3, np.array([31, 4]), 7)
    other = draw(machine, 3, np.arange(50), 8)
    assert set(many.values) == set(machine.effects)
    for name, values in many.values.items():
        assert np.array_equal(values[:, :5], few.values[name]), name
        assert np.array_equal(values[:, [31, 4]], chosen.values[name]), name
        if machine.effects[name].varies:
            assert not np.any(values == other.values[name]), name


def test_a_machine_of_a_high_number_takes_no_memory_for_those_before() -> None:
    machine = Machine.prototype()
    many = draw(machine, 3, np.arange(3000), 7)
    few = draw(machine, 3, np.array([2999, 0, 17, 18, 17]), 7)
    far = draw(machine, 3, np.array([10**15, 3]), 7)
    for name, values in many.values.items():
        assert np.array_equal(values[:, [2999, 0, 17, 18, 17]], few.values[name]), name
        assert np.array_equal(values[:, 3], far.values[name][:, 1]), name


def test_what_is_the_same_on_all_machines_takes_memory_once() -> None:
    machine = Machine.prototype()
    draws = draw(machine, 3, np.arange(50), 7)
    for name, values in draws.values.items():
        assert values.shape[1] == 50
        assert (values.strides[1] == 0) is not machine.effects[name].varies, name


def test_switching_one_effect_leaves_the_others_as_they_were() -> None:
    machine = Machine.prototype()
    full = draw(machine, 3, np.arange(9), 1)
    part = draw(machine.without("backlash_deg").with_(creep=0.1), 3, np.arange(9), 1)
    for name, values in part.values.items():
        if name != "creep":
            assert np.array_equal(values, full.values[name]), name


def test_effects_are_independent_of_each_other() -> None:
    machine = Machine.ideal(
        backlash_deg={"value": 9, "spread": 1}, gear_ratio_error={"value": 0, "spread": 1e-3}
    )
    draws = draw(machine, 3, np.arange(4000), 0)
    rows = np.concatenate([draws["backlash_deg"], draws["gear_ratio_error"]])
    off_diagonal = np.corrcoef(rows) - np.eye(4)
    assert np.max(np.abs(off_diagonal)) < 0.06


def test_values_are_normal_with_the_spread_asked_for() -> None:
    machine = Machine.ideal(input_bias_rad_s={"value": [0.1, -0.2], "spread": [0.01, 0.0]})
    bias = draw(machine, 3, np.arange(5000), 3)["input_bias_rad_s"]
    assert stats.kstest(bias[0], "norm", args=(0.1, 0.01)).pvalue > 0.01
    assert np.all(bias[1] == -0.2)


@pytest.mark.parametrize(("name", "low"), [("backlash_deg", 0.0), ("friction_capacity_nm", 0.1)])
def test_truncated_to_what_is_possible(name: str, low: float) -> None:
    machine = Machine.ideal(**{name: {"value": 1.0, "spread": 1.0}})
    values = draw(machine, 3, np.arange(5000), 0)[name]
    expected = stats.truncnorm(low - 1.0, np.inf, loc=1.0)
    if EFFECTS[name].high < np.inf:
        expected = stats.truncnorm(low - 1.0, EFFECTS[name].high - 1.0, loc=1.0)
    assert values.min() >= low
    assert stats.kstest(values[0], expected.cdf).pvalue > 0.01


def test_bounded_on_both_sides() -> None:
    play = draw(Machine.ideal(initial_play={"value": 0.5, "spread": 2}), 3, np.arange(2000), 0)
    values = play["initial_play"]
    assert values.min() >= -1
    assert values.max() <= 1
    assert np.std(values) > 0.5


def test_what_is_off_is_neutral() -> None:
    draws = draw(Machine.ideal(), 3, np.arange(2), 0)
    assert draws["backlash_deg"] == 0
    assert np.isinf(draws["shaft_stiffness_nm_per_rad"])
    assert not draws.has_effect("backlash_deg")


@pytest.mark.parametrize("joints", [2, 3, 6])
def test_one_value_each(joints: int) -> None:
    draws = draw(Machine.prototype(), joints, np.arange(4), 0)
    count = {"machine": 1, "motor": 2, "joint": joints, "passive": joints - 1}
    for name, values in draws.values.items():
        assert values.shape == (count[EFFECTS[name].owner], 4), name


def test_lists_must_fit_the_system() -> None:
    with pytest.raises(InputError, match=r"machine\.backlash_deg has 3 values"):
        draw(Machine.ideal(backlash_deg=[1, 2, 3]), 3, np.arange(1), 0)
