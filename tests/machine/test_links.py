"""The links of the dynamic arm as a planar chain, against mechanics derived otherwise."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from driven import INERTIA, Driven, arm, chain, constant, drive, start
from handmade import draws_of
from scipy.integrate import solve_ivp

from planner import InputError
from planner.machine.march import LEAST_DRAG
from planner.machine.stepwise import DynamicChain
from planner.systems.manipulator import (
    centrifugal_torques,
    chain_inertia,
    mass_matrix,
    on_joints,
)

MASS, LENGTH, CENTRE, OWN = [0.9, 0.7, 0.5], [0.3, 0.25, 0.2], [0.15, 0.1, 0.12], [4e-3, 3e-3, 2e-3]
"""Of three links: kg, m, m from the joint to the centre of mass, kg m^2 about that."""


def effects() -> dict[str, Any]:
    """The same links as the machine counts them: each with what it carries at its end."""
    mass, length, centre = (np.array(x) for x in (MASS, LENGTH, CENTRE))
    carried = np.append(np.cumsum(mass[::-1])[::-1][1:], 0.0)
    return {
        "link_inertia_kgm2": list(OWN + mass * centre**2 + carried * length**2),
        "link_moment_kgm": list(mass * centre + carried * length),
        "link_length_m": LENGTH,
    }


def kinetic(theta: Any, rates: Any) -> Any:
    """Energy of the links from the speeds of their centres of mass, for CasADi or NumPy, J."""
    x = y = psi = turn = energy = 0.0
    for i in range(3):
        psi, turn = psi + theta[i], turn + rates[i]
        at = CENTRE[i] * turn
        vx, vy = x - at * ca.sin(psi), y + at * ca.cos(psi)
        energy += MASS[i] * (vx**2 + vy**2) / 2 + OWN[i] * turn**2 / 2
        x, y = x - LENGTH[i] * turn * ca.sin(psi), y + LENGTH[i] * turn * ca.cos(psi)
    return energy


def exact_motion(theta: np.ndarray, rates: np.ndarray, times: np.ndarray) -> np.ndarray:
    """θ of free links at these times by Lagrange's equations, (T, 3), rad."""
    q, v = ca.SX.sym("q", 3), ca.SX.sym("v", 3)
    energy = kinetic(ca.vertsplit(q), ca.vertsplit(v))
    momentum = ca.gradient(energy, v)
    force = ca.gradient(energy, q) - ca.jtimes(momentum, q, v) - LEAST_DRAG * v
    law = ca.Function("law", [q, v], [ca.solve(ca.jacobian(momentum, v), force)])

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[3:], np.array(law(state[:3], state[3:])).ravel()])

    ends = (0.0, times[-1])
    return solve_ivp(slope, ends, [*theta, *rates], "DOP853", times, rtol=1e-11, atol=1e-12).y[:3].T


def free_links(**more: Any) -> Driven:
    """Three links thrown into motion in the middle of wide play, touched by nothing."""
    plant = chain(3, **effects(), gearhead_backlash_deg=45, backlash_deg=45, **more)
    plant._y[plant._place.bodies.links, 0] = [1.0, -2.0, 1.5]
    return plant


def test_free_links_move_as_lagrange_says() -> None:
    """Second order in the step, and what energy they have they keep."""
    errors, losses = [], []
    for steps in (50, 100, 200):
        plant = free_links()
        begin = plant.stored_J[0]
        assert begin == pytest.approx(float(kinetic(start(3)[1:, 0], [1.0, -2.0, 1.5])), rel=1e-12)
        seen = drive(plant, steps, constant(0, 0), 0.15)[:, 1:]
        exact = exact_motion(start(3)[1:, 0], np.array([1.0, -2.0, 1.5]), np.linspace(0, 0.15, 51))
        errors.append(np.max(np.abs(seen[steps // 50 - 1 :: steps // 50] - exact[1:])))
        losses.append(abs(plant.stored_J[0] + plant.lost_J[0] - begin) / begin)
    assert np.ptp(exact[:, 2]) > 0.15
    order = -np.polyfit(np.log([50, 100, 200]), np.log([errors, losses]).T, 1)[0]
    assert np.all(order > 1.8)
    assert errors[-1] < 2e-6
    assert losses[-1] < 1e-4


def test_two_links_have_the_mass_matrix_of_the_textbook() -> None:
    """Murray, Li, Sastry (1994), section 4.2: α + 2 β cosθ₂, δ + β cosθ₂, δ."""
    m1, m2, l1, r1, r2, i1, i2 = 0.9, 0.7, 0.3, 0.15, 0.1, 4e-3, 3e-3
    alpha, beta = i1 + i2 + m1 * r1**2 + m2 * (l1**2 + r2**2), m2 * l1 * r2
    delta, theta = i2 + m2 * r2**2, np.array([[0.4], [0.9]])
    own, moments = np.array([[alpha - delta], [delta]]), np.array([[m1 * r1 + m2 * l1], [m2 * r2]])
    lengths = np.array([[l1], [0.2]])
    found = mass_matrix(chain_inertia(own, lengths, moments, np.cumsum(theta, axis=0)))[..., 0]
    c = float(np.cos(theta[1, 0]))
    want = [[alpha + 2 * beta * c, delta + beta * c], [delta + beta * c, delta]]
    assert found == pytest.approx(np.array(want), rel=1e-12)


def test_three_links_are_pushed_back_as_lagrange_says() -> None:
    """d/dt ∂T/∂θ̇ − ∂T/∂θ without acceleration; ∂²T/∂θ̇² is the mass matrix."""
    q, v = ca.SX.sym("q", 3), ca.SX.sym("v", 3)
    energy = kinetic(ca.vertsplit(q), ca.vertsplit(v))
    momentum = ca.gradient(energy, v)
    pushed = ca.jtimes(momentum, q, v) - ca.gradient(energy, q)
    of = ca.Function("of", [q, v], [ca.jacobian(momentum, v), pushed])
    own, moments, lengths = (np.array(x)[:, None] for x in effects().values())
    theta, rates = np.array([[0.4], [0.9], [-0.3]]), np.array([[1.0], [-2.0], [1.5]])
    mass, torques = (np.array(x) for x in of(theta, rates))
    angles, turns = np.cumsum(theta, axis=0), np.cumsum(rates, axis=0)
    found = mass_matrix(chain_inertia(own, lengths, moments, angles))[..., 0]
    assert found == pytest.approx(mass, rel=1e-12)
    found = on_joints(centrifugal_torques(lengths, moments, angles, turns))
    assert found == pytest.approx(torques, rel=1e-12)


def test_a_free_joint_stays_behind_when_joint_1_turns() -> None:
    """Link 2, in the middle of its play and without a length before it, keeps its direction."""
    plant = chain(2, **INERTIA, backlash_deg=20.0)
    drive(plant, 200, constant(0.0, 0.5), 0.2)
    turned = plant.q[1:, 0] - start(2)[1:, 0]
    assert turned[0] == pytest.approx(0.1, rel=1e-3)
    assert turned[1] == pytest.approx(-turned[0], rel=1e-4)


def test_joint_1_carries_all_links() -> None:
    """Motor 2 at its torque limit accelerates what the mass matrix says, other joints held."""
    links = effects()
    plant = chain(3, motor_inertia_kgm2=0.02, torque_limit_nm=[100.0, 0.3], **links)
    seen = drive(plant, 50, constant(0.0, 5.0), 0.05, lambda: plant.motor_rates[1, 0])
    own, lengths, moments = (
        np.array(links[f"link_{name}"])[:, None]
        for name in ("inertia_kgm2", "length_m", "moment_kgm")
    )
    angles = np.cumsum(start(3)[1:], axis=0)
    whole = mass_matrix(chain_inertia(own, lengths, moments, angles))[0, 0, 0]
    assert whole > 3 * 0.02
    assert seen[-1] == pytest.approx(0.3 * 0.05 / (0.02 + whole), rel=0.02)


def test_links_that_are_too_light_for_their_length_are_refused() -> None:
    """What no masses at all could have; at the edge is a mass at the end of a chain."""
    draws_of(link_inertia_kgm2=0.04, link_moment_kgm=0.2, link_length_m=0.2)
    edge = {"link_moment_kgm": 0.2, "link_length_m": 0.2, "link_inertia_kgm2": 0.04}
    DynamicChain(arm(3), draws_of(**edge), start(3))
    with pytest.raises(InputError, match="link_inertia_kgm2"):
        DynamicChain(arm(3), draws_of(**{**edge, "link_length_m": 0.21}), start(3))
