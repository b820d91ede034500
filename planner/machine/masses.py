"""The bodies of the dynamic arm, their inertias, and what connects them.

    motor 1 -gear- disk B1 -P1- stage 1 -P1- stage 2 ...          motor 2 -gear- link 1
                                   |P2,P3       |P2,P3
                                 axis 2       axis 3
                                   |shaft       |shaft
                                 link 2       link 3

Every axis that the planner knows is two masses, the driven axis and the link, with play and a soft
shaft between. A stage is disk A of joint j with disk B of the next; its speed is counted without
the constant gear ratio before it, as that of B1 times the cosines on the way.

Rows of all arrays of speeds: motors (2), axes (m), disk B1, links (1 + m), stages (m), with m = n−1
passive joints. So the first 2 + m connect to the next 2 + m through play: two gearheads, m shafts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from planner.machine.draw import Draws
from planner.systems.base import Array

STICK = 1e8
"""What holds rigidly slips by 1 rad/s for so many N m."""

RIGID = 1e5
"""A gearhead, or a shaft without softness, N m/rad."""

DEAD = 100.0
"""Damping of such, N m s/rad: rigid teeth meet without bouncing."""

UNBOUNDED = 1e30
"""A torque that nothing reaches, N m."""


class Rows:
    """Where the bodies are, for m passive joints."""

    def __init__(self, m: int) -> None:
        self.m = m
        self.motors, self.axes = slice(0, 2), slice(2, 2 + m)
        self.before, self.after = slice(0, 2 + m), slice(2 + m, 4 + 2 * m)
        self.disk, self.links = 2 + m, slice(3 + m, 4 + 2 * m)
        self.geared, self.passive = slice(2 + m, 4 + m), slice(4 + m, 4 + 2 * m)
        self.stages = slice(4 + 2 * m, 4 + 3 * m)
        self.drivers = [self.disk, *range(4 + 2 * m, 3 + 3 * m)]
        self.count = 4 + 3 * m


class Place:
    """Rows of the state, for m passive joints: speeds first, then what they move.

    Attributes:
        bodies: Rows of the speeds.
        behind: How far the motors are behind their references, (2), rad.
        twist: Of gearheads and shafts, (2+m), rad.
        gap: Where they are in their play, (2+m), rad.
        reference: Speeds that the motors aimed at last, (2), rad/s.
        q: Coordinates (φₙ₋₁, θ₁ … θₙ), rad.
        torque: Of gearheads and shafts, (2+m), N m.
    """

    def __init__(self, m: int) -> None:
        self.bodies = Rows(m)
        start = self.bodies.count
        self.v = slice(0, start)
        self.behind = slice(start, start + 2)
        self.twist = slice(start + 2, start + 4 + m)
        self.gap = slice(start + 4 + m, start + 6 + 2 * m)
        self.reference = slice(start + 6 + 2 * m, start + 8 + 2 * m)
        self.q = slice(start + 8 + 2 * m, start + 10 + 3 * m)
        self.torque = slice(start + 10 + 3 * m, start + 12 + 4 * m)
        self.count = start + 12 + 4 * m


@dataclass(frozen=True, eq=False)
class Masses:
    """Parameters of S arms; every array is (rows, S).

    Attributes:
        inertia: Of all bodies, kg m^2.
        gain: Torque of the velocity loops for each rad/s behind, (2, S), N m s/rad.
        integral: And for each rad, (2, S), N m/rad.
        limit: Largest torque of the motors, (2, S), N m.
        stiffness: Of gearheads and shafts, (2+m, S), N m/rad.
        damping: Likewise, N m s/rad.
        half_gap: Half of the play before them, (2+m, S), rad.
        coulomb: Friction of the links, (1+m, S), N m.
        viscous: Of the passive links, (m, S), N m s/rad.
        k: Gear constants k2 … kn, (m, S).
        disk: Speed of disk B of each stage over that of the stage before, constant part, (m, S).
        kept: Part of the rate that a contact passes on without load, (1, S).
        creep: Part that it loses for each N m, (1, S), 1/(N m).
        capacity: Largest torque of a contact, at its disk B, (1, S), N m.
    """

    inertia: Array
    gain: Array
    integral: Array
    limit: Array
    stiffness: Array
    damping: Array
    half_gap: Array
    coulomb: Array
    viscous: Array
    k: Array
    disk: Array
    kept: Array
    creep: Array
    capacity: Array

    def part(self, chosen: NDArray[np.intp]) -> Masses:
        """Those of some samples."""
        return Masses(**{f.name: getattr(self, f.name)[:, chosen] for f in fields(self)})


def masses(draws: Draws, k: Array) -> Masses:
    """Parameters of drawn machines.

    Args:
        draws: The machines.
        k: Gear constants k2 … kn of each, (m, S).
    """
    m, count = k.shape

    def rows(name: str, size: int, most: float = np.inf) -> Array:
        return np.minimum(np.broadcast_to(draws[name], (size, count)), most)

    play = np.concatenate([rows("gearhead_backlash_deg", 2), rows("backlash_deg", m)])
    stiff = np.full((2 + m, count), RIGID)
    stiff[2:] = rows("shaft_stiffness_nm_per_rad", m, RIGID)
    damping = np.zeros((2 + m, count))
    damping[2:] = rows("shaft_damping_nms_per_rad", m)
    gain = rows("servo_gain_nms_per_rad", 2, STICK)
    disk = k / k[0]
    bodies = [
        rows("motor_inertia_kgm2", 2),
        rows("axis_inertia_kgm2", m),
        np.zeros((1, count)),
        rows("link_inertia_kgm2", 1 + m),
        rows("disk_inertia_kgm2", m) * disk**2,
    ]
    return Masses(
        inertia=np.concatenate(bodies),
        gain=gain,
        integral=np.where(gain < STICK, gain / rows("servo_integral_time_s", 2), 0.0),
        limit=rows("torque_limit_nm", 2, UNBOUNDED),
        stiffness=stiff,
        damping=np.where(stiff < RIGID, damping, DEAD),
        half_gap=np.deg2rad(play) / 2,
        coulomb=np.concatenate([rows("base_friction_nm", 1), rows("coulomb_friction_nm", m)]),
        viscous=rows("viscous_friction_nms_per_rad", m),
        k=k,
        disk=disk,
        kept=1 - rows("creep", 1),
        creep=rows("creep_per_nm", 1),
        capacity=rows("friction_capacity_nm", 1, UNBOUNDED),
    )
