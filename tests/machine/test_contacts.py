"""Contacts that are turned, against masses and Coulomb friction in the plane, step by step.

The reference knows no formula of the package: rims with a little mass, and at each contact a
friction force in the plane that opposes the sliding velocity and is regularised where that is zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from driven import SOFT, arm, chain, constant, drive
from handmade import arm_problem, draws_of, inputs, plan_from
from scipy.integrate import solve_ivp

import planner
from planner.machine.disk_chain import DiskChain
from planner.machine.friction.contact_load import contact_load
from planner.machine.friction.contacts import Grip

SHARP = 1e-6
"""Speed below which a contact hardly slides."""


def friction(V: float, v: float, theta: float, C: float, eps: float) -> tuple[float, float]:
    """Force on the driven rim along its direction, and on the driver along its own, negative.

    In the plane: the driver's rim moves at V (cosθ, sinθ), the driven one at (v, 0).
    """
    along, across = V * np.cos(theta) - v, V * np.sin(theta)
    size = np.sqrt(along**2 + (eps * across) ** 2 + SHARP**2)
    force = C * np.array([along, eps**2 * across]) / size
    return force[0], float(force @ [np.cos(theta), np.sin(theta)])


def simulated(
    angles: Any, C: float, eps: float, loads: Any, ratios: Any = (), V: float = 0.3
) -> tuple[np.ndarray, float]:
    """Speeds of the driven axes over V once they are steady, and the torque that motor 1 feels.

    A stage is a rim A behind P1, a rim behind P2 and one behind P3, which `loads` rubs on. The next
    stage's driver turns `ratios` times as fast as A.
    """
    m, mass = len(angles), 0.02

    def balance(v: np.ndarray) -> tuple[np.ndarray, float]:
        force, felt = np.zeros_like(v), 0.0
        for j, theta in enumerate(angles):
            driver, lever = (V, 1.0) if j == 0 else (ratios[j - 1] * v[j - 1, 0], ratios[j - 1])
            push, pull = friction(driver, v[j, 0], theta, C, eps)
            force[j, 0] += push
            if j == 0:
                felt = pull
            else:
                force[j - 1, 0] -= lever * pull
            for i in (1, 2):
                push, pull = friction(v[j, i - 1], v[j, i], theta, C, eps)
                force[j, i] += push
                force[j, i - 1] -= pull
            force[j, 2] -= loads[j] * v[j, 2] / np.sqrt(v[j, 2] ** 2 + SHARP**2)
        return force, felt

    start = V * np.stack([np.cos(t) ** np.arange(1, 4) for t in angles])
    run = solve_ivp(
        lambda t, v: balance(v.reshape(m, 3))[0].ravel() / mass,
        (0, 4.0), start.ravel(), "BDF", rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    assert run.success
    end = run.y[:, -1].reshape(m, 3)
    return end[:, 2] / V, balance(end)[1]


@pytest.mark.parametrize(
    ("degrees", "share", "eps"),
    [
        (0, 0.9, 1.0),
        (20, 0.5, 1.0),
        (40, 0.7, 1.0),
        (60, 0.3, 1.0),
        (40, 0.9, 0.2),
        (-40, 0.5, 0.2),
    ],
)
def test_one_contact(degrees: float, share: float, eps: float) -> None:
    """Only P1 is turned here: the other two pass all on below the capacity."""
    C, theta = 1.6, np.deg2rad(degrees)
    V, v, mass, load = 0.3, 0.0, 0.02, share * C

    def rate(t: float, v: np.ndarray) -> list[float]:
        return [(friction(V, v[0], theta, C, eps)[0] - load) / mass]

    v = solve_ivp(rate, (0, 5.0), [V * np.cos(theta)], "BDF", rtol=1e-9, atol=1e-11).y[0, -1]
    grip = Grip(np.array([np.cos(theta)]), np.array([eps]), np.array([C]))
    assert grip.transmission(np.array([load])) * np.cos(theta) == pytest.approx(v / V, abs=2e-5)
    felt = friction(V, v, theta, C, eps)[1]
    assert grip.driver_torque(np.array([load])) == pytest.approx(felt, abs=2e-4)


@pytest.mark.parametrize(("share", "stands"), [(0.98, False), (1.02, True)])
def test_gross_slip_begins_where_friction_in_the_plane_gives_in(share: float, stands: bool) -> None:
    C, eps, theta = 1.0, 0.8, np.deg2rad(50)
    grip = Grip(np.array([np.cos(theta)]), np.array([eps]), np.array([C]))
    load = share * float(grip.most[0])

    def rate(t: float, v: np.ndarray) -> list[float]:
        rubbing = load * v[0] / np.sqrt(v[0] ** 2 + SHARP**2)
        return [(friction(0.3, v[0], theta, C, eps)[0] - rubbing) / 0.02]

    v = solve_ivp(rate, (0, 5.0), [0.2], "BDF", rtol=1e-9, atol=1e-11).y[0, -1]
    assert (v < 1e-4) == stands
    assert (float(grip.transmission(np.array([load]))[0]) == 0) == stands


CHAINS = [
    # θ1, θ2 in degrees, capacity, ε, friction of joints 2 and 3
    (38.0, 20.0, 1.58, 0.2, (0.19, 0.2)),
    (10.0, 5.0, 1.58, 1.0, (0.05, 0.05)),
    (40.0, 25.0, 1.6, 0.1, (0.15, 0.19)),
    (30.0, -30.0, 1.6, 0.3, (0.2, 0.0)),
    (15.0, 12.0, 1.0, 1.0, (0.0, 0.0)),
    (25.0, 30.0, 0.8, 1.0, (0.3, 0.1)),  # slips grossly
]


def effects_of(C: float, eps: float, loads: tuple[float, float]) -> dict[str, Any]:
    return {
        "friction_capacity_nm": C,
        "lateral_friction": eps,
        "coulomb_friction_nm": list(loads),
    }


def rates_of(q: np.ndarray, **effects: Any) -> tuple[np.ndarray, DiskChain]:
    """Of the passive joints at q (N, 1) while motor 1 turns at 1 rad/s; and the chain."""
    n, h = len(q) - 1, 1e-6
    plant = DiskChain(arm(n), draws_of(n, **effects), q)
    plant.step(
        np.array([1.0, 0.0])[None, :, None].repeat(3, 0),
        h * np.array([[[0.5], [0.0]], [[1.0], [0.0]]]),
        h,
    )
    return (plant.q - q)[2:, 0] / h, plant


@pytest.mark.parametrize("case", CHAINS)
def test_a_chain_of_six(case: tuple[float, float, float, float, tuple[float, float]]) -> None:
    first, second, C, eps, loads = case
    system, angles = arm(3), np.deg2rad([first, second])
    k = system.k_g * system.K
    exact, _ = simulated(angles, C, eps, k[0] * np.array(loads), [k[1] / k[0]])
    q = np.array([0.0, *angles, 0.1])[:, None]
    rates, plant = rates_of(q, **effects_of(C, eps, loads))
    assert rates == pytest.approx(k[0] * exact, abs=1e-4)
    assert (plant.slipping[0] >= 0) == (min(rates) == 0)


@pytest.mark.parametrize("case", CHAINS[:5])
def test_a_chain_of_six_with_inertia(case: Any) -> None:
    first, second, C, eps, loads = case
    system, angles = arm(3), np.deg2rad([first, second])
    k = system.k_g * system.K
    light = {"viscous_friction_nms_per_rad": 0.0, "link_inertia_kgm2": 1e-3}
    stiff = {"shaft_stiffness_nm_per_rad": 100.0, "shaft_damping_nms_per_rad": 0.1}
    firm = {"servo_gain_nms_per_rad": 50.0}
    plant = chain(3, **{**SOFT, **light, **stiff, **firm}, **effects_of(C, eps, loads))
    plant._y[plant._place.q][1:3, 0] = angles
    drive(plant, 1000, constant(0.02, 0.0), 1.0)
    exact, felt = simulated(plant.q[1:3, 0], C, eps, k[0] * np.array(loads), [k[1] / k[0]])
    rates = plant._y[plant._place.bodies.passive][:, 0] / plant.motor_rates[0, 0]
    assert rates == pytest.approx(k[0] * exact, rel=1e-3, abs=1e-4)
    torque = plant._y[plant._place.torque][0, 0]  # of the gearhead of motor 1
    assert torque == pytest.approx(felt, rel=3e-3)  # slip in a branch counts as a smaller ratio


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0, 31.0])
def test_plain_disks_turn_a_joint_by_the_cosine_of_three_angles(degrees: float) -> None:
    """Equal contacts without load, at any force: not cos³θ, and standstill from 30 degrees."""
    system, q = arm(2), np.array([0.0, np.deg2rad(degrees), 0.1])[:, None]
    for C in (0.5, 5.0):
        rates, _ = rates_of(q, friction_capacity_nm=C, lateral_friction=1.0)
        ratio = rates[0] / (system.k_g * system.K[0])
        assert ratio == pytest.approx(max(0.0, np.cos(3 * np.deg2rad(degrees))), abs=1e-5)
    exact, _ = simulated(np.deg2rad([degrees]), C, 1.0, [0.0])
    assert exact[0] == pytest.approx(ratio, abs=2e-4)


@pytest.mark.parametrize("fidelity", ["quasi-static", "dynamic"])
def test_gross_slip_is_told_with_contact_joint_and_time(fidelity: str) -> None:
    """Plain disks, and θ₁ that turns from 5 degrees on: P1 at joint 1, which carries most."""
    speeds = inputs(([0.3], [0.2]), breaks=[0.0, 4.0])
    plan = plan_from(arm_problem([5.0, 5.0, 5.0], end=4.0), speeds, pieces=20)
    effects = {"lateral_friction": 1.0, "friction_capacity_nm": 2.0, "coulomb_friction_nm": 0.02}
    machine = planner.Machine.ideal(**effects, shaft_stiffness_nm_per_rad=20.0, fidelity=fidelity)
    run = planner.replay(plan, machine, record_s=0.01)
    assert run.slip_contact[0] == 0
    assert run.slip_words.startswith(
        "gross slip on 1 of 1 machine, first of contact P1 at joint 1 at "
    )
    # From the load of the plan up to then, to a few hundredths of a second.
    until = [plan.t[plan.t <= run.slip_begin[0] + d] for d in (-0.3, 0.3)]
    shares = [float(contact_load(_first_part(plan, t[-1]), machine).share[0]) for t in until]
    assert shares[0] < 1 < shares[1]
    assert run.slip_s[0] == pytest.approx(4.0 - run.slip_begin[0], abs=0.1)
    still = run.t > run.slip_begin[0] + 0.3
    assert np.ptp(run.q[0, still][:, 2:], axis=0) == pytest.approx([0, 0], abs=1e-3)
    assert run.slip_words in repr(run)
    assert run.to_dict()["slip_machines"] == 1
    free = planner.replay(plan, machine.with_(lateral_friction=0.1))
    assert (free.slip_words, free.slip_s[0]) == ("", 0.0)
    assert np.isnan(free.slip_begin[0])


def _first_part(plan: planner.Plan, end: float) -> planner.Plan:
    speeds = inputs(([0.3], [0.2]), breaks=[0.0, float(end)])
    return plan_from(arm_problem([5.0, 5.0, 5.0], end=float(end)), speeds, pieces=20)


@pytest.mark.parametrize("n", [2, 4])
def test_the_prototypes_friction_goes_on_with_its_last_joint(n: int) -> None:
    friction = planner.Machine.prototype().mean("coulomb_friction_nm", n)
    listed = planner.Machine.prototype().mean("coulomb_friction_nm").tolist()
    assert friction.tolist() == [*listed, listed[-1]][: n - 1]
    speeds = inputs(([0.3], [0.2]), breaks=[0.0, 1.0])
    plan = plan_from(arm_problem([5.0] * 4, end=1.0), speeds, pieces=5)
    machine = planner.Machine.prototype(coulomb_friction_nm=[0.1, 0.2])
    with pytest.raises(planner.InputError, match=r" 2 \D* 3\b"):
        planner.replay(plan, machine)
