"""How the arm stood before a motion: where axes are in play and torsion at its start."""

from __future__ import annotations

import numpy as np
import pytest
from driven import Driven
from handmade import arm_problem

import planner
from planner import InputError, Machine
from planner.machine.disk_chain import DiskChain
from planner.machine.machine import draw

BACKLASH, STIFFNESS, FRICTION, GEARHEAD = 2.0, 3.0, 0.15, 0.5
W = BACKLASH / 2 + np.rad2deg(FRICTION / STIFFNESS)
"""Half of the range in which an axis may stand while its joint rests, degrees."""


def _machine(state: str | list[str], fidelity: str = "quasi-static") -> Machine:
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
    with pytest.raises(InputError, match=r"machine\.start_state has 2 words, but needs one, or 3"):
        _ahead(_machine(["backward", "forward"]))
    with pytest.raises(InputError, match=r"machine\.start_state has 2 words"):
        arm_problem([10, 10, 10], machine={"start_state": ["forward"] * 2})
    with pytest.raises(InputError, match="start_state"):
        Machine.prototype(start_state="forwards")


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
