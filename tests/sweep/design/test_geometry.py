"""Which mechanisms can be built: the inequalities against the parts themselves, bent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

import planner

Build = Callable[..., planner.Design]

BENDS = (70.0, 80.0, 60.0)
BASE = {"r1": 30.0, "R": 36.0, "r3": 25.0, "lambda": 1.3, "eta": 1.4}


@pytest.fixture
def build(quick: dict[str, Any]) -> Build:
    """The design of a study of one."""

    def built(
        r1: float, R: float, r3: float, links: Sequence[float] | None = None, **more: Any
    ) -> planner.Design:
        case = {"r1": r1, "R": R, "r3": r3} | ({"link_lengths": links} if links else {})
        limits = {"input_rad_s": 0.8, "joint_deg": more.pop("bends", BENDS)}
        problem = {
            "system": {"kind": "manipulator", "joints": 3, "K": [0.8, 0.8], "k_g": 0.7},
            "start": {"theta_deg": [10, 10, 10]},
            "goal": {"theta_deg": [30, 30, 30], "duration": 0.01},
            "limits": {key: value for key, value in limits.items() if value is not None},
        }
        tables = {**quick, "problem": problem, "cases": [case], **more}
        return planner.design_study(tables, workers=0).rows[0].design

    return built


def refusal(build: Build, *gear: float, **more: Any) -> str:
    with pytest.raises(planner.InputError, match="no design can be built") as info:
        build(*gear, **more)
    return str(info.value).split(": ", 2)[2]


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
def test_disks_are_refused_where_they_collide_when_bent(build: Build, radius: float) -> None:
    least = build(1.0, radius, 1.0).least_link
    assert least_gap(radius, least, np.deg2rad(BENDS[1])) == pytest.approx(0.0, abs=1e-9)
    assert build(1.0, radius, 1.0, [1.001 * least] * 3).refused == ""
    why = refusal(build, 1.0, radius, 1.0, links=[0.999 * least] * 3)
    assert why.startswith("disks A of joints 1 and 2 collide, bent by b = 80 deg: l1 > R (1 - cos")
    assert f"does not hold: l1 = {0.999 * least:.4g}" in why


def test_the_last_ring_counts_as_the_first_disk_does(build: Build) -> None:
    assert "disks A' of joints 1 and 2" in refusal(build, 1.0, 10.0, 36.0, links=[80.0] * 3)
    # Link 3 carries no disk, link 2 the last ones.
    assert build(1.0, 10.0, 36.0, [93.0, 37.0, 1.0]).link_lengths == (93.0, 37.0, 1.0)


def test_large_wheels_are_refused_where_they_meet(build: Build) -> None:
    bend = np.deg2rad(BENDS[0])
    edge = 50.0 * np.sin(bend)
    assert wheels_meet(50.0, 0.99 * edge, bend)
    assert not wheels_meet(50.0, 1.01 * edge, bend)
    why = refusal(build, 50.0, 10.0, 10.0, links=[0.99 * edge] * 3)
    assert "wheels B of joints 1 and 2 collide: l1 > r1 sin 70 deg" in why
    assert build(50.0, 10.0, 10.0, [1.01 * edge] * 3).refused == ""


def test_contacts_that_cannot_meet_their_disk_are_refused(build: Build) -> None:
    why = refusal(build, 1.0, 10.0, 12.0, links=[40.0, 11.0, 5.0])
    says = "contact P3 of joint 2 cannot meet disk A', whose axle would stand beyond"
    assert why.startswith(says)
    assert "l2 > r3 = 12 does not hold: l2 = 11" in why


def test_clearance_is_added_and_wheels_leave_room_for_axles(build: Build) -> None:
    gear = (1.0, 10.0, 10.0)
    assert build(*gear, clearance=0.5).least_link > build(*gear).least_link
    why = refusal(build, *gear, clearance=2.0)
    assert why.startswith("wheel B and the axle of disk A collide where a joint bends by 80 deg")
    assert why.endswith("R cos 80 deg is 1.74 and must be more than 2")
    free = refusal(build, *gear, clearance=0.1, bends=None)
    assert "bends by 90 deg (limits.joint_deg)" in free


def test_ratios_change_the_wheel_and_the_last_contact_alone(quick: dict[str, Any]) -> None:
    cases = [{"rho": 1.1, "kappa": 0.9}, {"lambda": 1.0, "r3": 20.0}]
    tables = {**quick, "gear": BASE, "cases": cases}
    ratios, radii = (row.design.gear for row in planner.design_study(tables, workers=0).rows)
    assert (ratios.R, ratios.lam, ratios.eta) == (36.0, 1.3, 1.4)
    assert ratios.rho == pytest.approx(1.1)
    arm = planner.Manipulator.from_gear(4, ratios)
    assert arm.k_g * arm.K == pytest.approx([0.9 * 1.1, 0.9 * 1.1**2, 0.9 * 1.1**3])
    assert radii == planner.Gear(30.0, 36.0, 20.0, 1.0, 1.4)


def test_a_design_prints_in_a_line(quick: dict[str, Any]) -> None:
    cases = [{"link_lengths": [1.0, 1.0]}, {"link_lengths": [90.0, 1.0]}]
    tables = {**quick, "gear": BASE, "cases": cases}
    short, _ = planner.design_study(tables, workers=0).rows
    shown = repr(short.design)
    assert shown.startswith(
        "Design(link_lengths = [1, 1]: 2 joints, rho 0.641, kappa 1.34; r1 30, R 36, r3 25"
    )
    assert "cannot be built: contact P1 of joint 1" in shown
