"""Samples of a machine: reproducible, paired, and distributed as asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from planner import InputError, Machine
from planner.machine.machine import draw
from planner.problem.tables.machine_effects import EFFECTS


def test_a_machine_hangs_on_its_seed_and_number_alone() -> None:
    """One of a high number takes no memory for those before, what is the same on all only once;
    and an effect is drawn alike whatever the others are."""
    machine = Machine.prototype()
    many, other = (draw(machine, 3, np.arange(3000), seed) for seed in (7, 8))
    few = draw(machine, 3, np.array([2999, 0, 17, 18, 17]), 7)
    far = draw(machine, 3, np.array([10**15, 3]), 7)
    part = draw(machine.without("backlash_deg").with_(creep=0.1), 3, np.arange(3000), 7)
    assert set(many.values) == set(machine.effects)
    for name, values in many.values.items():
        assert values.shape[1] == 3000
        assert np.array_equal(values[:, [2999, 0, 17, 18, 17]], few.values[name]), name
        assert np.array_equal(values[:, 3], far.values[name][:, 1]), name
        assert (values.strides[1] == 0) is not machine.effects[name].varies, name
        assert not machine.effects[name].varies or not np.any(values == other.values[name]), name
        if name not in ("creep", "backlash_deg"):
            assert np.array_equal(values, part.values[name]), name


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
    assert stats.kstest(bias[0], stats.norm(0.1, 0.01).cdf).pvalue > 0.01
    assert np.all(bias[1] == -0.2)


@pytest.mark.parametrize(
    ("name", "value", "spread"),
    [("backlash_deg", 1.0, 1.0), ("friction_capacity_nm", 1.0, 1.0), ("initial_play", 0.5, 2.0)],
)
def test_truncated_to_what_is_possible(name: str, value: float, spread: float) -> None:
    machine = Machine.ideal(**{name: {"value": value, "spread": spread}})
    values = draw(machine, 3, np.arange(5000), 0)[name]
    low, high = {"backlash_deg": (0.0, 45.0), "initial_play": (-1.0, 1.0)}.get(name, (0.1, np.inf))
    expected = stats.truncnorm((low - value) / spread, (high - value) / spread, value, spread)
    assert values.min() >= low
    assert values.max() <= high
    assert stats.kstest(values[0], expected.cdf).pvalue > 0.01


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
    with pytest.raises(InputError, match=r"machine\.backlash_deg \D*3 "):
        draw(Machine.ideal(backlash_deg=[1, 2, 3]), 3, np.arange(1), 0)
