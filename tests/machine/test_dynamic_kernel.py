"""The dynamic manipulator in compiled code against the one in NumPy; and the solver itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import EVENTS, CompiledMarch, c_march, chain, drive
from handmade import arm_problem, inputs, plan_from

from planner import Machine, replay
from planner.machine.bodies import StageLaws, StateRows
from planner.machine.compiled import MOST_PASSIVE
from planner.machine.march import GAMMA


def jumps(t: float) -> np.ndarray:
    return np.array([0.8, 0.5]) * np.sign(np.sin(np.array([9.0, 13.0]) * t + 0.1))


@pytest.mark.parametrize("name", EVENTS)
@pytest.mark.parametrize("n", [*(pytest.param(n, marks=pytest.mark.campaign) for n in (2, 4)), 3])
def test_both_give_the_same(library: Any, use: Any, name: str, n: int) -> None:
    spread = {"value": 0.05, "spread": 0.01}
    effects = {**EVENTS[name], "link_inertia_kgm2": spread, "gearhead_backlash_deg": 0.3}
    found = []
    for which in (library, None):
        use(which)
        plant = chain(n, samples=3, **effects)
        assert isinstance(plant._march, CompiledMarch) is (which is not None)
        history = drive(plant, 80, jumps, 0.4, lambda plant=plant: plant._y.copy())
        found.append((history, plant.work_J, plant.lost_J))
    for ours, theirs in zip(*found, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-11)
    assert len(set(found[0][1])) == 3


def test_code_counts_rows_as_python_does_and_says_what_it_has_no_room_for(library: Any) -> None:
    def refused(m: int, rows: int) -> bool:
        return bool(c_march(library)(m, rows, 0, 1.0, 0.5, GAMMA, 1.0, *[None] * 8))

    assert not refused(MOST_PASSIVE, StateRows(MOST_PASSIVE).count)
    assert refused(MOST_PASSIVE + 1, StateRows(MOST_PASSIVE + 1).count)
    assert refused(2, StateRows(2).count + 1)


WHOLE: dict[str, dict[str, Any]] = {
    "as it is": {},
    "second order, many delays": {
        "servo_damping": 0.7,
        "delay_s": {"value": 0.005, "spread": 0.002},
    },
    "little torque": {"torque_limit_nm": 0.2, "friction_capacity_nm": 0.1},
    "continuous": {"control_period_s": False},
    "links with length": {"link_length_m": 0.1},
    "pushed": {"start_state": "backward"},
}


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("n", [pytest.param(2, marks=pytest.mark.campaign), 3])
def test_whole_replays_are_the_same(library: Any, use: Any, name: str, n: int) -> None:
    u = inputs(([1.2], [0.5, 0.1]), ([-0.8], [0.3]), breaks=[0.0, 0.2, 0.4])
    plan = plan_from(arm_problem(list(range(10, 10 + n)), end=0.4), u, pieces=10)
    machine = Machine.prototype(fidelity="dynamic", step_s=0.005, **WHOLE[name])
    runs = []
    for which in (library, None):
        use(which)
        runs.append(replay(plan, machine, samples=3, seed=1, settle_s=0.1))
    assert len(set(runs[0].q[:, -1, 2])) == 3
    for part in ("q", "motor_rates", "saturated_s", "slip_s", "deviation", "end_state"):
        compiled, stepwise = (getattr(run, part) for run in runs)
        assert compiled == pytest.approx(stepwise, abs=1e-12, rel=0)
    if name == "little torque":
        assert np.all(runs[0].saturated_s > 0.05)


# -- the solver ----------------------------------------------------------------------------


def imbalance(stage: StageLaws, v: np.ndarray) -> np.ndarray:
    """Torque left over at every body, (rows, S), N m."""
    rows, m = stage.rows, stage.rows.m
    held, pressed = stage.torques(v)
    left = stage.drag * v - stage.push
    left[rows.links] += np.einsum("jks,ks->js", stage.coupling, v[rows.links])
    left[rows.motors] -= held[:2]
    for j, driver in enumerate(rows.drivers):
        left[driver] += stage.first[j] * held[2 + j]
    left[rows.stages] += stage.second * held[2 + m : 2 + 2 * m] - held[2 : 2 + m]
    left[rows.axes] -= held[2 + m : 2 + 2 * m]
    left[rows.links] += held[2 + 2 * m : 3 + 3 * m]
    left[rows.disk] += held[3 + 3 * m]
    left[rows.stages] += held[4 + 3 * m :]
    left[rows.before] += pressed
    left[rows.after] -= pressed
    return left


@pytest.mark.parametrize("full_steps", [12, 0])
def test_every_stage_balances_all_torques(
    monkeypatch: pytest.MonkeyPatch, use: Any, full_steps: int
) -> None:
    """Also when each pass goes only as far as the convex function falls."""
    solve, worst, passes = StageLaws.solve, [], []

    def checked(self: StageLaws, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v, found = solve(self, pieces)
        worst.append(np.max(np.abs(imbalance(self, v))))
        passes.append(np.any(found != pieces))
        return v, found

    monkeypatch.setattr(StageLaws, "solve", checked)
    monkeypatch.setattr("planner.machine.bodies.FULL_PASSES", full_steps)
    use(None)
    rng = np.random.default_rng(0)
    for name in ("play", "coulomb", "slip", "all"):
        plant = chain(3, samples=4, **EVENTS[name], gearhead_backlash_deg=0.5)
        plant._y[plant._place.v] = rng.normal(size=plant._y[plant._place.v].shape)
        drive(plant, 20, jumps, 0.2)
    assert max(worst) < 1e-5  # a rigid law turns the rounding of speeds, 5e-14, into torque
    assert 10 < sum(passes) < len(passes)
