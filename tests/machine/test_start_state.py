"""How the arm stood before a motion: where axes are in play and torsion at its start."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from driven import Driven
from handmade import arm_problem, inputs, plan_from

import planner
from planner import InputError, Machine, replay
from planner.machine import simulate
from planner.machine.disk_chain import DiskChain
from planner.machine.machine import draw

BACKLASH, STIFFNESS, FRICTION, GEARHEAD = 2.0, 3.0, 0.15, 0.5
W = BACKLASH / 2 + np.rad2deg(FRICTION / STIFFNESS)
"""Half of the range in which an axis may stand while its joint rests, degrees."""


def _machine(state: str | list[Any], fidelity: str = "quasi-static") -> Machine:
    heavy = {"link_inertia_kgm2": 0.03, "motor_inertia_kgm2": 0.02}
    return Machine.ideal(
        start_state=state,
        fidelity=fidelity,
        backlash_deg=BACKLASH,
        gearhead_backlash_deg=GEARHEAD,
        shaft_stiffness_nm_per_rad=STIFFNESS,
        coulomb_friction_nm=FRICTION,
        **(heavy if fidelity == "dynamic" else {}),
    )


def _ahead(machine: Machine, samples: int = 1) -> np.ndarray:
    """How far each driven axis is ahead of its joint, (n, S), degrees."""
    arm = arm_problem([10, 10, 10]).system
    q = np.deg2rad(np.tile([[0.0], [10.0], [10.0], [10.0]], (1, samples)))
    chain = DiskChain(arm, draw(machine, 3, np.arange(samples), 0), q)
    return np.rad2deg(chain.axes - q[1:])


@pytest.mark.parametrize(("state", "side"), [("unwound", 0), ("forward", 1), ("backward", -1)])
def test_a_motion_leaves_the_axes_at_the_end_of_their_range(state: str, side: int) -> None:
    assert _ahead(_machine(state))[:, 0] == pytest.approx([side * GEARHEAD / 2, side * W, side * W])


def test_what_is_unknown_is_anywhere_in_the_range_and_the_same_for_every_plan() -> None:
    ahead = _ahead(_machine("unknown"), 400)
    assert np.all(np.abs(ahead) <= [[GEARHEAD / 2 + 1e-9], [W + 1e-9], [W + 1e-9]])
    assert np.all(np.ptp(ahead, axis=1) > [1.9 * GEARHEAD / 2, 1.9 * W, 1.9 * W])
    assert np.array_equal(ahead[:, :7], _ahead(_machine("unknown"), 7))
    assert abs(np.corrcoef(ahead)[1, 2]) < 0.2


def test_each_joint_may_stand_as_it_likes() -> None:
    ahead = _ahead(_machine(["backward", "forward", "unwound"]))[:, 0]
    assert ahead == pytest.approx([-GEARHEAD / 2, W, 0])
    with pytest.raises(InputError, match=r"start_state\D* 2 \D* 3\b"):
        _ahead(_machine(["backward", "forward"]))
    with pytest.raises(InputError, match=r"machine\.start_state\D* 2 "):
        arm_problem([10, 10, 10], machine={"start_state": ["forward"] * 2})
    with pytest.raises(InputError, match="start_state"):
        Machine.prototype(start_state="forwards")


def test_numbers_are_shares_of_each_range_and_may_begin_with_the_gearhead_of_motor_1() -> None:
    told = [0.25, -1, 0.5, "backward"]
    ahead = _ahead(_machine(told))[:, 0]
    assert ahead == pytest.approx([-GEARHEAD / 2, W / 2, -W])
    machine = _machine(told)
    assert draw(machine, 3, np.arange(2), 0).start[:, 1].tolist() == [0.25, -1, 0.5, -1]
    assert draw(_machine(told[1:]), 3, np.arange(1), 0).start[0, 0] == 0.5  # that of joint 2
    assert machine.start_words == "0.25, -1, 0.5, backward at the start"
    for same in (Machine.from_table(machine.to_dict()), machine.nominal(), machine.with_()):
        assert same == machine
        assert hash(same) == hash(machine)
    assert hash(_machine([0.0, 0, 0])) == hash(_machine([-0.0, 0, 0]))
    problem = planner.load_problem("problems/paper.toml", {"machine.start_state": told})
    assert planner.Problem.from_dict(json.loads(json.dumps(problem.to_dict()))) == problem
    for wrong in ([1.01, 0, 0], [float("nan"), 0, 0], [True, 0, 0], [0.5]):
        with pytest.raises(InputError, match="start_state"):
            _machine(wrong)
    with pytest.raises(InputError, match=r"start_state\D* 5 "):
        arm_problem([10, 10, 10], machine={"start_state": [0.0] * 5})


@pytest.mark.parametrize("fidelity", ["quasi-static", "dynamic"])
@pytest.mark.parametrize("has_kernel", [True, False])
def test_an_arm_that_rests_ends_in_the_state_in_which_it_began(
    fidelity: str, has_kernel: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = [0.25, -1, 0.5, -0.7]
    plan = plan_from(
        arm_problem([10, 10, 10], end=0.2), inputs(([0.0], [0.0]), breaks=[0.0, 0.2]), 2
    )
    if not has_kernel:
        monkeypatch.setattr(simulate, "library", lambda: None)
    slope = {"incline_deg": 5.0, "link_moment_kgm": 0.02} if fidelity == "quasi-static" else {}
    machine = _machine(told, fidelity).with_(gearhead_backlash_deg=GEARHEAD, **slope)
    run = replay(plan, machine, samples=2, settle_s=0.1)
    if slope:  # a loaded gearhead has no room
        told[1] = 0
    else:  # with inertia wound shafts push the disk back to an end of motor 1's gearhead
        told[0] = -1
    assert run.end_state == pytest.approx(np.array([told] * 2), abs=1e-3)


def test_the_mean_of_what_is_unknown_is_unwound() -> None:
    assert Machine.prototype(start_state="unknown").nominal().start_state == ("unwound",)
    mixed = Machine.prototype(start_state=["unknown", "forward", "forward"])
    assert mixed.nominal().start_state == ("unwound", "forward", "forward")
    assert Machine.from_table(mixed.to_dict()) == mixed
    assert eval(repr(mixed), {"Machine": Machine}) == mixed


def test_gravity_moves_the_range() -> None:
    """On a slope the weight turns the joint as far as friction lets it."""
    slope = {"incline_deg": 10.0, "link_moment_kgm": 0.05}
    rest = {s: _ahead(_machine(s).with_(**slope))[2, 0] for s in ("forward", "unwound", "backward")}
    assert rest["backward"] < rest["unwound"] < rest["forward"]
    width = 2 * np.rad2deg(FRICTION / STIFFNESS)
    assert rest["forward"] - rest["backward"] == pytest.approx(width + BACKLASH)


def test_with_inertia_a_wound_shaft_stays_wound() -> None:
    arm = arm_problem([10, 10, 10]).system
    q = np.deg2rad(np.array([[0.0], [10.0], [10.0], [10.0]]))
    for state, side in (("forward", 1), ("backward", -1)):
        draws = draw(_machine(state, "dynamic"), 3, np.arange(1), 0)
        chain = Driven(arm, draws, q)
        assert chain.shaft_torque[:, 0] == pytest.approx([side * FRICTION] * 2)
        assert np.rad2deg(chain.gap[:, 0]) == pytest.approx([side * BACKLASH / 2] * 2)
        for _ in range(200):
            chain.step(np.zeros((2, 2, 1)), np.zeros((1, 2, 1)), 1e-3)
        assert np.rad2deg(chain.q[1:, 0]) == pytest.approx([10, 10, 10], abs=0.01)


@pytest.mark.parametrize("fidelity", ["quasi-static", "dynamic"])
def test_a_joint_that_was_pushed_forward_follows_at_once(fidelity: str) -> None:
    """And one that was pushed back must first cross its whole range, 2 w."""
    plan = planner.solve(planner.load_problem("problems/paper.toml"), "collocation")
    late = {}
    for state in ("forward", "unwound", "backward"):
        machine = _machine(state, fidelity).with_(gearhead_backlash_deg=False)
        run = planner.replay(plan, machine, samples=1)
        late[state] = float(np.max(np.abs(run.terminal_error_deg)))
    slack = 0.05 if fidelity == "quasi-static" else 0.6
    assert late["forward"] < slack
    assert W / 2 < late["unwound"] < late["backward"]


def test_problem_files_take_it() -> None:
    problem = planner.load_problem("problems/paper.toml", {"machine.start_state": "forward"})
    assert Machine.from_table(problem.machine).start_state == ("forward",)
    assert planner.Problem.from_dict(problem.to_dict()) == problem
