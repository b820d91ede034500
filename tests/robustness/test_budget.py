"""Error budgets of plans whose causes of error are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from printed import printed

import planner
from planner import Budget, Machine, error_budget, replay
from planner.machine.machine import Draws
from planner.machine.simulate import Recording, simulate
from planner.problem.tables.machine_effects import EFFECTS, effect_words

STEP = 0.01


@pytest.fixture(scope="module")
def plan(unlimited: planner.Problem) -> planner.Plan:
    changes = {"goal.travel": 0.828, "goal.duration": 4.0}
    return planner.solve(unlimited.changed(changes), "polynomial")


def test_effects_that_add_up(plan: planner.Plan) -> None:
    """Two starting errors in joint 1, of which E sees the sum; a third effect does nothing."""
    machine = Machine.ideal(
        step_s=STEP,
        initial_angle_error_deg={"value": [3.0, 0.0, 0.0], "spread": [0.5, 0.0, 0.0]},
        gearhead_backlash_deg=[0.0, 2.0],
        encoder_resolution_deg=0.1,
    )
    budget = error_budget(plan, machine, samples=40, base=32, seed=3)
    assert budget.idle == ("encoder_resolution_deg",)
    assert [cost.name for cost in budget.costs] == [
        "initial_angle_error_deg",
        "gearhead_backlash_deg",
    ]
    start, play = budget["initial_angle_error_deg"], budget["gearhead_backlash_deg"]
    drawn = replay(plan, machine, 40, 3, record_s=None).draws["initial_angle_error_deg"][0]
    assert start.alone_deg == pytest.approx(np.median(np.abs(drawn)), rel=0.35)
    assert play.alone_deg == pytest.approx(1.0, rel=0.4)
    assert play.alone_interval_deg == (play.alone_deg, play.alone_deg)  # nothing varies
    assert start.saves_deg == pytest.approx(budget.E_deg - play.alone_deg, abs=0.1)
    assert budget.none_deg < 1e-3
    assert start.between is not None
    assert start.between.total == 1.0  # alone in differing from machine to machine
    assert play.between is None
    assert start.switch.total > play.switch.total > 0
    assert budget.E_deg == replay(plan, machine, 40, 3, record_s=None).percentile(50)


@pytest.fixture(scope="module")
def whole(plan: planner.Plan) -> Budget:
    """The prototype's budget."""
    return error_budget(plan, Machine.prototype(step_s=0.001), samples=6, base=4)


def test_effects_that_need_each_other(whole: Budget) -> None:
    """Friction winds up a soft shaft; neither does anything alone, and each saves when off."""
    for name in ("coulomb_friction_nm", "shaft_stiffness_nm_per_rad"):
        assert whole[name].alone_deg < 2e-3
        assert whole[name].saves_deg > 0.3
        low, high = whole[name].saves_interval_deg
        assert low <= whole[name].saves_deg <= high


def test_costs_are_those_of_machines_without_the_effect(plan: planner.Plan, whole: Budget) -> None:
    """Simulated one machine after another, with nothing that stands for off."""
    samples, seed = whole.samples, whole.seed
    everything = replay(plan, whole.machine, samples, seed, record_s=None).index_E_deg
    assert whole.E_deg == np.median(everything)
    for name in ("shaft_stiffness_nm_per_rad", "servo_bandwidth_rad_s", "control_period_s"):
        cost, there = whole[name], whole.machine.without(name)
        left = replay(plan, there, samples, seed, record_s=None).index_E_deg
        assert cost.saves_deg == pytest.approx(np.median(everything - left), abs=1e-3)
        only = replay(plan, whole.machine.only(name), samples, seed, record_s=None)
        assert cost.alone_deg == pytest.approx(only.percentile(50), abs=1e-3)


def test_what_is_on_is_in_the_budget_or_named_as_idle(whole: Budget) -> None:
    names = {cost.name for cost in whole.costs} | set(whole.idle)
    assert names == {name for name in whole.machine.effects if not EFFECTS[name].dynamic_only}
    assert "encoder_resolution_deg" in whole.idle
    saved = [abs(cost.saves_deg) for cost in whole.costs]
    assert saved == sorted(saved, reverse=True)


def test_only_what_spreads_differs_between_machines(whole: Budget) -> None:
    for cost in whole.costs:
        assert (cost.between is not None) == whole.machine.effects[cost.name].varies


def test_the_same_seed_gives_the_same_budget(plan: planner.Plan) -> None:
    machine = Machine.prototype(step_s=STEP).only("backlash_deg", "initial_play")

    def data(seed: int) -> object:
        return error_budget(plan, machine, samples=3, base=2, seed=seed).to_dict()

    assert data(1) == data(1)
    assert data(1) != data(2)


def test_many_machines_are_looked_at_block_by_block(
    plan: planner.Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine.prototype(step_s=STEP).only("backlash_deg", "encoder_resolution_deg")

    def data() -> object:
        return error_budget(plan, machine, samples=20, base=2).to_dict()

    together, sizes = data(), list[int]()

    def counted(of: planner.Plan, there: Machine, draws: Draws, **more: Any) -> Recording:
        sizes.append(draws.count)
        return simulate(of, there, draws, **more)

    monkeypatch.setattr("planner.robustness.budget.BLOCK_MACHINES", 3)
    monkeypatch.setattr("planner.robustness.budget.simulate", counted)
    assert data() == together
    assert max(sizes) <= 3 * (2 + 2 * len(machine.effects))


def test_refusals(plan: planner.Plan) -> None:
    with pytest.raises(planner.InputError, match="no effects"):
        error_budget(plan, Machine.ideal())
    with pytest.raises(planner.InputError, match="samples = 0"):
        error_budget(plan, samples=0)
    with pytest.raises(planner.InputError, match="'nothing'"):
        error_budget(plan, Machine.ideal(step_s=STEP, delay_s=0.1), samples=1, base=2)["nothing"]


@pytest.mark.parametrize("width", [80, 200])
def test_the_table_fits_a_terminal(width: int, whole: Budget) -> None:
    lines = printed(whole.table(), width)
    assert max(map(len, lines)) <= 80
    names = " ".join(line[:13].strip() for line in lines)
    for cost in whole.costs:
        assert effect_words(cost.name) in names, "names are broken, not cut"
    for word in ("switch,", "total", "95 % interval."):
        assert word in " ".join(" ".join(lines).split())


def test_a_slope_and_turned_contacts_are_in_the_budget(plan: planner.Plan) -> None:
    """Gravity needs a soft shaft to show, as friction does; sliding sideways needs a capacity."""
    machine = Machine.ideal(
        step_s=STEP,
        incline_deg=4.0,
        link_moment_kgm=0.16,
        lateral_friction=0.2,
        friction_capacity_nm=1.6,
        shaft_stiffness_nm_per_rad=3.26,
    )
    budget = error_budget(plan, machine, samples=1, base=2)
    assert {c.name for c in budget.costs} >= {"incline_deg", "link_moment_kgm", "lateral_friction"}
    assert budget["incline_deg"].alone_deg == pytest.approx(budget.none_deg, abs=1e-6)
    assert budget["incline_deg"].saves_deg == pytest.approx(
        budget["link_moment_kgm"].saves_deg, abs=1e-9
    )
    assert abs(budget["lateral_friction"].saves_deg) > 0.05
    assert budget["lateral_friction"].saves_deg == pytest.approx(
        budget["friction_capacity_nm"].saves_deg, abs=1e-9
    )


def test_readings_count_only_with_feedback(plan: planner.Plan) -> None:
    machine = Machine.ideal(step_s=STEP, control_period_s=0.02, encoder_resolution_deg=2.0)
    opened, closed = (
        error_budget(plan, machine, samples=1, base=2, feedback=way) for way in (False, True)
    )
    assert "encoder_resolution_deg" in opened.idle
    coarse, exact = (
        replay(plan, m, 1, 0, True, record_s=None).percentile(50)
        for m in (machine, machine.without("encoder_resolution_deg"))
    )
    assert closed.E_deg == coarse
    saved = closed["encoder_resolution_deg"].saves_deg
    assert saved == pytest.approx(coarse - exact, abs=0.01)
    assert saved > 0.05
