"""Which mechanisms can be built: the inequalities against the parts themselves, bent."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Gear, Manipulator
from planner.sweep.design.geometry import design, gear_of, kappa_of

BASE = Gear(r1=30.0, R=36.0, r3=25.0, lam=1.3, eta=1.4)
BENDS = np.deg2rad([70.0, 80.0, 60.0])


def refusal(gear: Gear, links: list[float] | None, clearance: float = 0.0) -> str:
    return design("d", {}, gear, BENDS, links, clearance).refused


def least_gap(radius: float, link: float, bend: float) -> float:
    """Between two neighbouring disks of that radius and axle distance, over all bends."""
    theta = np.linspace(-bend, bend, 2001)
    axle = np.stack([link + radius * np.cos(theta), radius * np.sin(theta)])
    return float(np.min(np.hypot(axle[0] - radius, axle[1]))) - 2 * radius


def wheels_meet(radius: float, link: float, bend: float) -> bool:
    """Whether wheels B of two joints touch at some bend: segments at the height of the axles."""
    for theta in np.linspace(0, bend, 721)[1:]:
        line = np.array([[-np.sin(theta), 0.0], [np.cos(theta), -1.0]])
        centre = link * np.array([np.cos(theta), np.sin(theta)])
        along, across = np.linalg.solve(line, -centre)
        if max(abs(along), abs(across)) <= radius:
            return True
    return False


@pytest.mark.parametrize("radius", [20.0, 36.0])
def test_disks_are_refused_where_they_collide_when_bent(radius: float) -> None:
    gear = Gear(r1=1.0, R=radius, r3=1.0, lam=1.0, eta=1.0)
    least = design("d", {}, gear, BENDS).least_link
    assert least_gap(radius, least, BENDS[1]) == pytest.approx(0.0, abs=1e-9)
    assert refusal(gear, [1.001 * least] * 3) == ""
    why = refusal(gear, [0.999 * least] * 3)
    assert why.startswith("disks A of joints 1 and 2 collide, bent by b = 80 deg: l1 > R (1 - cos")
    assert f"does not hold: l1 = {0.999 * least:.4g}" in why


def test_the_last_ring_counts_as_the_first_disk_does() -> None:
    gear = Gear(r1=1.0, R=10.0, r3=36.0, lam=1.0, eta=1.0)
    assert "disks A' of joints 1 and 2" in refusal(gear, [80.0] * 3)
    assert refusal(gear, [93.0, 37.0, 1.0]) == ""  # link 3 carries no disk, link 2 the last ones


def test_large_wheels_are_refused_where_they_meet() -> None:
    gear = Gear(r1=50.0, R=10.0, r3=10.0, lam=1.0, eta=1.0)
    edge = 50.0 * np.sin(BENDS[0])
    assert wheels_meet(50.0, 0.99 * edge, BENDS[0])
    assert not wheels_meet(50.0, 1.01 * edge, BENDS[0])
    assert "wheels B of joints 1 and 2 collide: l1 > r1 sin 70 deg" in refusal(
        gear, [0.99 * edge] * 3
    )
    assert refusal(gear, [1.01 * edge] * 3) == ""


def test_contacts_that_cannot_meet_their_disk_are_refused() -> None:
    gear = Gear(r1=1.0, R=10.0, r3=12.0, lam=1.0, eta=1.0)
    why = refusal(gear, [40.0, 11.0, 5.0])
    assert why.startswith(
        "contact P3 of joint 2 cannot meet disk A', whose axle would stand beyond"
    )
    assert "l2 > r3 = 12 does not hold: l2 = 11" in why


def test_clearance_is_added_and_wheels_leave_room_for_axles() -> None:
    gear = Gear(r1=1.0, R=10.0, r3=10.0, lam=1.0, eta=1.0)
    assert (
        design("d", {}, gear, BENDS, None, 0.5).least_link > design("d", {}, gear, BENDS).least_link
    )
    why = refusal(gear, None, 2.0)
    assert why.startswith("wheel B and the axle of disk A collide where a joint bends by 80 deg")
    assert why.endswith("R cos 80 deg > 2 does not hold, it is 1.74")
    free = design("d", {}, gear, np.full(3, np.inf), None, 0.1).refused
    assert "bends by 90 deg (limits.joint_deg)" in free
    assert refusal(gear, None) == ""


def test_without_link_lengths_links_are_as_long_as_is_needed() -> None:
    assert refusal(BASE, None) == ""
    least = design("d", {}, BASE, BENDS).least_link
    assert refusal(BASE, [1.0001 * least] * 3) == ""


def test_ratios_change_the_wheel_and_the_last_contact_alone() -> None:
    gear = gear_of({"rho": 1.1, "kappa": 0.9}, BASE)
    assert (gear.R, gear.lam, gear.eta) == (36.0, 1.3, 1.4)
    assert gear.rho == pytest.approx(1.1)
    assert kappa_of(gear) == pytest.approx(0.9)
    arm = Manipulator.from_gear(4, gear)
    assert arm.k_g * arm.K == pytest.approx([0.9 * 1.1, 0.9 * 1.1**2, 0.9 * 1.1**3])
    assert gear_of({"lambda": 1.0, "r3": 20.0}, BASE) == Gear(30.0, 36.0, 20.0, 1.0, 1.4)


def test_a_design_prints_in_a_line() -> None:
    shown = repr(design("rho = 1", {"rho": 1}, BASE, BENDS, [1.0] * 3))
    assert shown.startswith("Design(rho = 1: 3 joints, rho 0.641, kappa 1.34; r1 30, R 36, r3 25")
    assert "cannot be built: contact P1 of joint 1" in shown
