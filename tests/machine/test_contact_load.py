"""Torque at the friction contacts: virtual work, and the load at which the machine really slips."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from

import planner
from planner import Plan
from planner.machine.friction.contact_load import contact_load

FRICTION = {"coulomb_friction_nm": [0.2, 0.3, 0.25], "viscous_friction_nms_per_rad": 0.05}


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Four joints, disk and joint 1 at constant speeds for two seconds."""
    speeds = inputs(([0.4], [0.1]), breaks=[0.0, 2.0])
    return plan_from(arm_problem([20.0, 15.0, 10.0, 5.0], 2.0), speeds, pieces=20)


def test_the_first_contact_carries_the_power_of_all_joints(plan: Plan) -> None:
    # By energy: what disk A behind P1 puts in is what the friction of joints 2 to 4 takes.
    t = np.linspace(0, plan.duration, 400)
    system, q, u = plan.problem.system, plan.q(t), plan.u(t)
    speeds = system.rates(q, u)[:, 2:]
    friction = np.array([0.2, 0.3, 0.25]) + 0.05 * np.abs(speeds)
    disk = np.abs(u[:, 0]) * np.cos(q[:, 1])
    felt = np.sum(friction * np.abs(speeds), axis=1) / disk
    found = contact_load(plan, planner.Machine.ideal(**FRICTION, friction_capacity_nm=2.0))
    assert found.torque_nm == pytest.approx([np.max(felt)], rel=1e-4)
    assert found.share == pytest.approx([np.max(felt) / 2.0], rel=1e-4)
    assert found.motor_nm == pytest.approx(np.max(felt * np.cos(q[:, 1])), rel=1e-4)
    assert "slips on 0 of 1 machine)" in repr(found)


@pytest.mark.parametrize("incline_deg", [False, 4.0])
@pytest.mark.parametrize(("part", "slips"), [(1.02, False), (0.98, True)])
def test_beyond_it_the_machine_slips(
    plan: Plan, part: float, slips: bool, incline_deg: float
) -> None:
    rigid = planner.Machine.ideal(**FRICTION, incline_deg=incline_deg, link_moment_kgm=0.05)
    torque = float(contact_load(plan, rigid).torque_nm[0])
    free = planner.replay(plan, rigid)
    held = planner.replay(plan, rigid.with_(friction_capacity_nm=part * torque))
    assert (np.max(np.abs(held.q - free.q)) > 1e-6) == slips


def test_a_slope_loads_what_goes_up_and_relieves_what_goes_down(plan: Plan) -> None:
    slope = planner.Machine.ideal(**FRICTION, incline_deg=4.0, link_moment_kgm=0.05)
    up, level = (contact_load(plan, m).torque_nm[0] for m in (slope, slope.without("incline_deg")))
    back = inputs(([-0.4], [0.1]), breaks=[0.0, 2.0])
    down = plan_from(arm_problem([20.0, 15.0, 10.0, 5.0], 2.0), back, pieces=20)
    assert contact_load(down, slope).torque_nm[0] < level < up


def test_many_pieces_take_neither_memory_nor_other_loads(plan: Plan) -> None:
    speeds = inputs(([0.4], [0.1]), breaks=[0.0, 2.0])
    many = plan_from(plan.problem, speeds, pieces=200)
    tracemalloc.start()
    found = contact_load(many, "prototype", samples=300)
    top = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert top < 20e6  # 100 MB and more, all instants at a time
    few = contact_load(plan, "prototype", samples=300)
    for ours, theirs in zip(vars(found).values(), vars(few).values(), strict=True):
        assert np.array_equal(np.isfinite(ours), np.isfinite(theirs))
        assert ours == pytest.approx(theirs, rel=1e-4)


def test_its_machines_are_those_of_a_replay(plan: Plan) -> None:
    found = contact_load(plan, "prototype", samples=5, seed=3)
    drawn = planner.replay(plan, "prototype", samples=5, seed=3).draws
    assert np.array_equal(found.capacity_nm, drawn["friction_capacity_nm"][0])
    assert np.ptp(found.torque_nm) > 0
    assert contact_load(plan, "ideal").share == 0


def test_other_systems_have_no_contacts() -> None:
    car = planner.solve(planner.load_problem("problems/unicycle.toml"), "polynomial")
    with pytest.raises(planner.InputError, match="a unicycle has no friction disks"):
        contact_load(car)
