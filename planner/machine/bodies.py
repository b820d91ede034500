"""The bodies of the dynamic arm, their inertias, and the connections between them.

    motor 1 -gear- disk B1 -P1- stage 1 -P1- stage 2 ...          motor 2 -gear- link 1
                                   |P2,P3       |P2,P3
                                 axis 2       axis 3
                                   |shaft       |shaft
                                 link 2       link 3

Each passive joint of the planner's model is two masses here, the driven axis and the link, with
play and a soft shaft between them. A stage is disk A of joint j with disk B of the next. Its speed
leaves out the constant gear ratio: it is the speed of B1 times the cosines in between.

Rows of all arrays of speeds: motors (2), axes (m), disk B1, links (1 + m), stages (m), with m = n−1
passive joints. So play connects the first 2 + m bodies (motors, axes) to the next 2 + m (disk B1,
links), through two gearheads and m shafts.

The links are a planar chain: each is coupled to the accelerations of all the others; see
`chain_inertia`.

`StageLaws` solves one implicit stage for the speeds and torques at its end. Every connection is a
monotone, piecewise linear law between one relative speed w and one torque, with three pieces:

    limited    T = clip(o + g w, ± limit)       servo, friction contact, Coulomb friction
    play       T = A dz(e + h w, gap/2)         shaft behind play

so the speeds minimise a convex function and are unique. An active-set (semi-smooth Newton) method
finds them: with the piece of every law known, the bodies form a tree of linear equations, solved
from the links to the motors and back. It ends when the pieces agree with the speeds, which in most
steps takes one pass, since pieces seldom change.

The tree includes only the diagonal of the links' mass matrix; N is the rest. Let v₀ be the speeds
that the tree gives without N, G the speeds that it gives for a unit torque on each link, and index
l the links' rows. Then v = v₀ − G N v_l, so (1 + G_l N) v_l = v₀_l, a system of the arm's size.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.friction.contact_load import weights
from planner.machine.friction.contacts import (
    UNBOUNDED_TORQUE_NM,
    friction_capacity,
    lateral_friction,
)
from planner.machine.machine import Draws
from planner.support.arrays import Array
from planner.systems.manipulator import chain_inertia

STICTION_SLOPE = 1e8
"""Torque per relative speed of a connection that sticks, N m s/rad."""

RIGID_STIFFNESS = 1e5
"""Stiffness of gearheads and rigid shafts, N m/rad."""

RIGID_DAMPING = 100.0
"""Damping of gearheads and rigid shafts, N m s/rad: enough that teeth meet without bouncing."""


class BodyRows:
    """Row numbers of all bodies in arrays of speeds, for m passive joints."""

    def __init__(self, m: int) -> None:
        self.m = m
        self.motors, self.axes = slice(0, 2), slice(2, 2 + m)
        self.before, self.after = slice(0, 2 + m), slice(2 + m, 4 + 2 * m)
        self.disk, self.links = 2 + m, slice(3 + m, 4 + 2 * m)
        self.geared, self.passive = slice(2 + m, 4 + m), slice(4 + m, 4 + 2 * m)
        self.stages = slice(4 + 2 * m, 4 + 3 * m)
        self.drivers = [self.disk, *range(4 + 2 * m, 3 + 3 * m)]
        self.count = 4 + 3 * m


class StateRows:
    """Row numbers in the state of a dynamic arm with m passive joints.

    Attributes:
        bodies: Rows of the speeds.
        behind: Reference angles minus motor angles, (2), rad.
        twist: Twist of gearheads and shafts, (2+m), rad.
        gap: Positions of gearheads and shafts in their play, (2+m), rad.
        reference: Last reference speeds of the motors, (2), rad/s.
        q: Coordinates (φₙ₋₁, θ₁ … θₙ), rad.
        torque: Torques of gearheads and shafts, (2+m), N m.
    """

    def __init__(self, m: int) -> None:
        self.bodies = BodyRows(m)
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
class OfSamples:
    """A record of S machines, whose arrays (…, S) have a column for each."""

    def part(self, chosen: NDArray[np.intp]) -> Self:
        """Return the record of the machines with the indices `chosen`."""
        arrays = {k: v[..., chosen] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays)


@dataclass(frozen=True, eq=False)
class Masses(OfSamples):
    """Inertias, stiffnesses, friction and gears of S arms; every array is (rows, S).

    Compiled code reads them in this order. `rows` (a, b) in a field's metadata means a + b m rows
    for m passive joints.

    Attributes:
        inertia: Inertia of all bodies, kg m^2.
        gain: Proportional gain of the velocity loops, (2, S), N m s/rad.
        integral: Integral gain of the velocity loops, (2, S), N m/rad.
        limit: Largest torque of the motors, (2, S), N m.
        stiffness: Stiffness of gearheads and shafts, (2+m, S), N m/rad.
        damping: Damping of gearheads and shafts, (2+m, S), N m s/rad.
        half_gap: Half of the play of gearheads and shafts, (2+m, S), rad.
        coulomb: Coulomb friction of the links, (1+m, S), N m.
        viscous: Viscous friction of the passive links, (m, S), N m s/rad.
        k: Gear constants k2 … kn, (m, S).
        disk: Constant part of the ratio between the speeds of disk B of each stage and of the first
            stage, (m, S).
        kept: Fraction of the rate that a contact transmits without load, (1, S).
        creep: Fraction of the rate that a contact loses per N m of load, (1, S), 1/(N m).
        capacity: Largest torque of a contact, force at the rims times r₁, (1, S), N m.
        lateral: Ratio of sideways to driving friction of a contact, (1, S).
        weights: Torques of the links' weights about their own joints, (1+m, S), N m; see
            `gravity_torques`.
        lengths: Lengths of the links, (1+m, S), m.
        moments: Mass of each link times the distance of its centre from its joint, (1+m, S), kg m.
    """

    inertia: Array = field(metadata={"rows": (4, 3)})
    gain: Array = field(metadata={"rows": (2, 0)})
    integral: Array = field(metadata={"rows": (2, 0)})
    limit: Array = field(metadata={"rows": (2, 0)})
    stiffness: Array = field(metadata={"rows": (2, 1)})
    damping: Array = field(metadata={"rows": (2, 1)})
    half_gap: Array = field(metadata={"rows": (2, 1)})
    coulomb: Array = field(metadata={"rows": (1, 1)})
    viscous: Array = field(metadata={"rows": (0, 1)})
    k: Array = field(metadata={"rows": (0, 1)})
    disk: Array = field(metadata={"rows": (0, 1)})
    kept: Array = field(metadata={"rows": (1, 0)})
    creep: Array = field(metadata={"rows": (1, 0)})
    capacity: Array = field(metadata={"rows": (1, 0)})
    lateral: Array = field(metadata={"rows": (1, 0)})
    weights: Array = field(metadata={"rows": (1, 1)})
    lengths: Array = field(metadata={"rows": (1, 1)})
    moments: Array = field(metadata={"rows": (1, 1)})


def masses(draws: Draws, k: Array) -> Masses:
    """Return the inertias, stiffnesses, friction and gears of drawn machines.

    Args:
        draws: The machines.
        k: Gear constants k2 … kn of each machine, (m, S).

    Raises:
        InputError: If the given inertias are too small for the links' lengths and moments.
    """
    m, count = k.shape

    def rows(name: str, size: int, most: float = np.inf) -> Array:
        return np.minimum(np.broadcast_to(draws[name], (size, count)), most)

    play = np.concatenate([rows("gearhead_backlash_deg", 2), rows("backlash_deg", m)])
    stiff = np.full((2 + m, count), RIGID_STIFFNESS)
    stiff[2:] = rows("shaft_stiffness_nm_per_rad", m, RIGID_STIFFNESS)
    damping = np.zeros((2 + m, count))
    damping[2:] = rows("shaft_damping_nms_per_rad", m)
    gain = rows("servo_gain_nms_per_rad", 2, STICTION_SLOPE)
    disk = k / k[0]
    weighed = weights(draws, 1 + m)
    bodies = [
        rows("motor_inertia_kgm2", 2),
        rows("axis_inertia_kgm2", m),
        np.zeros((1, count)),
        rows("link_inertia_kgm2", 1 + m),
        rows("disk_inertia_kgm2", m) * disk**2,
    ]
    inertia = np.concatenate(bodies)
    lengths, moments = rows("link_length_m", 1 + m), rows("link_moment_kgm", 1 + m)
    _refuse_light_links(inertia[BodyRows(m).links], lengths, moments)
    return Masses(
        inertia=inertia,
        gain=gain,
        integral=np.where(gain < STICTION_SLOPE, gain / rows("servo_integral_time_s", 2), 0.0),
        limit=rows("torque_limit_nm", 2, UNBOUNDED_TORQUE_NM),
        stiffness=stiff,
        damping=np.where(stiff < RIGID_STIFFNESS, damping, RIGID_DAMPING),
        half_gap=np.deg2rad(play) / 2,
        coulomb=np.concatenate([rows("base_friction_nm", 1), rows("coulomb_friction_nm", m)]),
        viscous=rows("viscous_friction_nms_per_rad", m),
        k=k,
        disk=disk,
        kept=1 - rows("creep", 1),
        creep=rows("creep_per_nm", 1),
        capacity=np.broadcast_to(friction_capacity(draws), (1, count)),
        lateral=np.broadcast_to(lateral_friction(draws), (1, count)),
        weights=np.zeros((1 + m, count)) if weighed is None else weighed,
        lengths=lengths,
        moments=moments,
    )


def _refuse_light_links(inertia: Array, lengths: Array, moments: Array) -> None:
    """Refuse link inertias so small that the links' kinetic energy could be negative.

    Only the straight pose need be tested. In any other pose, each entry of the inertia matrix is
    multiplied by the cosine of a difference of angles. These cosines form a positive semidefinite
    matrix, so the entrywise product stays positive semidefinite (Schur product theorem).
    """
    if not (lengths[:-1] * moments[1:]).any():
        return
    straight = chain_inertia(inertia, lengths, moments, np.zeros_like(inertia))
    least = np.linalg.eigvalsh(np.moveaxis(straight, -1, 0))[:, 0]
    if np.any(least < -ROUNDING * inertia.max(axis=0)):
        raise InputError(
            "machine: link_inertia_kgm2 is too small for link_length_m and link_moment_kgm; raise"
            " link_inertia_kgm2 (for each link at least length times moment, as the link carries"
            " mass at the next joint), or reduce link_length_m"
        )


ROUNDING = 1e-12
"""Rounding error of an eigenvalue of the inertia matrix, relative to the largest inertia."""

FULL_PASSES = 12
"""Number of Newton passes with full steps; each later pass searches its step for the minimum."""

MOST_PASSES = 100
HALVINGS, NEAR_END = 40, 1e-6
"""Number of bisections of the line search, and the last fraction of a step, in which the search
returns the end of the step. So near to the end rounding would decide: with rigid laws an error of
1e-12 rad/s in a speed changes a torque by 1e-4 N m."""

EDGE_NM = 1e-8
"""Torque by which a limited law must exceed its present piece before the piece changes, N m."""

EDGE_RAD = 1e-16
"""Twist by which a play law must exceed its present piece before the piece changes, rad."""


@dataclass(frozen=True, eq=False)
class StageLaws(OfSamples):
    """Torque laws of all connections between the bodies in one implicit stage of a time step.

    The letters o, g, e and A are those of the file's docstring. Arrays are (rows, S), speeds as in
    `BodyRows`. Rows of limited laws: servos (2), contacts P1 (m), contacts P2 with P3 (m), friction
    of the links (1+m), drag of contacts that slide sideways on disk B1 and the stages (1+m).

    Attributes:
        rows: Rows of the bodies.
        h: Length of the stage, s.
        drag: Inertia over h plus viscous friction, N m s/rad; for links, the diagonal of M over h.
        coupling: M over h without its diagonal, (1+m, 1+m, S), N m s/rad.
        push: Inertia over h, times the speed that each body would keep, N m.
        reference: Reference speed of the servos, (2, S), rad/s.
        first: Speed of each stage over that of the disk before it, without slip, (m, S).
        second: Speed of each axis over that of its stage, without slip, (m, S).
        offset: o of the limited laws, (4+4m, S), N m.
        slope: g of the limited laws, N m s/rad.
        limit: Limits of the limited laws, N m.
        ahead: e of the play laws, (2+m, S), rad.
        stiff: A of the play laws, N m/rad.
        half_gap: Half of the play, rad.
    """

    rows: BodyRows
    h: float
    drag: Array
    coupling: Array
    push: Array
    reference: Array
    first: Array
    second: Array
    offset: Array
    slope: Array
    limit: Array
    ahead: Array
    stiff: Array
    half_gap: Array

    def solve(self, pieces: Array) -> tuple[Array, Array]:
        """Return the speeds (rows, S) at the end of the stage, and the piece of each law there.

        Args:
            pieces: First guess, limited laws first: −1, 0 or 1 for each law, (6+5m, S).
        """
        v = self._speeds(pieces)
        fresh = self._pieces(v, pieces)
        left = np.flatnonzero((fresh != pieces).any(axis=0))
        if not left.size:
            return v, pieces
        part, before = self.part(left), v[:, left]
        for count in range(MOST_PASSES):
            guess = fresh[:, left]
            new = part._speeds(guess)
            if count >= FULL_PASSES:
                new = part._search(before, new)
            v[:, left] = before = new
            fresh[:, left] = after = part._pieces(new, guess)
            active = np.flatnonzero((after != guess).any(axis=0))
            if not active.size:
                break
            left, part, before = left[active], part.part(active), before[:, active]
        return v, fresh

    # -- the laws ------------------------------------------------------------------------------

    def relative(self, v: Array) -> tuple[Array, Array]:
        """Return the relative speeds of the limited laws, (4+4m, S), and of the play laws, (2+m,
        S), rad/s, at the bodies' speeds v."""
        rows, stages = self.rows, v[self.rows.stages]
        limited = np.concatenate(
            [
                self.reference - v[rows.motors],
                self.first * v[rows.drivers] - stages,
                self.second * stages - v[rows.axes],
                v[rows.links],
                v[rows.disk : rows.disk + 1],
                stages,
            ]
        )
        return limited, v[rows.before] - v[rows.after]

    def torques(self, v: Array) -> tuple[Array, Array]:
        """Return the torques of the limited laws, (4+4m, S), and of the play laws, (2+m, S), N m,
        at the bodies' speeds v."""
        limited, play = self.relative(v)
        ahead = self.ahead + self.h * play
        wound = ahead - np.minimum(np.maximum(ahead, -self.half_gap), self.half_gap)
        asked = self.offset + self.slope * limited
        limited_torque = np.minimum(np.maximum(asked, -self.limit), self.limit)
        return limited_torque, self.stiff * wound

    def _pieces(self, v: Array, before: Array) -> Array:
        """Return the piece of each law at the bodies' speeds v: −1 or 1 beyond its lower or upper
        edge, else 0. A piece of `before` that is valid within rounding is kept."""
        limited, play = self.relative(v)
        value = np.concatenate([self.offset + self.slope * limited, self.ahead + self.h * play])
        edge = np.concatenate([self.limit, self.half_gap])
        rooms = np.full_like(self.limit, EDGE_NM), np.full_like(self.ahead, EDGE_RAD)
        room = np.concatenate(rooms)
        inside = np.abs(value) <= edge + room
        holds = np.where(before == 0, inside, before * value >= edge - room)
        new = np.where(inside, 0.0, np.sign(value))
        new[: len(limited)][before[: len(limited)] * new[: len(limited)] < 0] = 0.0
        new = np.where(holds, before, new)
        new[len(limited) :][self.half_gap == 0] = 1.0
        return new

    def _lines(self, pieces: Array) -> tuple[Array, Array, Array, Array]:
        """Return each law's torque on its piece as a line c + s w: c and s of the limited laws,
        then c and s of the play laws."""
        count = len(self.limit)
        limited_pieces, touching = pieces[:count], pieces[count:]
        moving = limited_pieces == 0
        pressed = self.stiff * np.abs(touching)
        return (
            np.where(moving, self.offset, limited_pieces * self.limit),
            np.where(moving, self.slope, 0.0),
            pressed * (self.ahead - touching * self.half_gap),
            pressed * self.h,
        )

    # -- the tree ------------------------------------------------------------------------------

    def _speeds(self, pieces: Array) -> Array:
        """Return the speeds (rows, S) of all bodies if every law stays on its given piece."""
        rows, lines = self.rows, self._lines(pieces)
        v = self._tree(lines, self.push, self.reference)
        if not self.coupling.any():
            return v
        n, none = 1 + rows.m, np.zeros_like(self.reference)
        freed = (np.zeros_like(lines[0]), lines[1], np.zeros_like(lines[2]), lines[3])
        units = np.zeros((n, *self.push.shape))
        units[np.arange(n), rows.links.start + np.arange(n)] = 1.0
        answers = np.stack([self._tree(freed, unit, none) for unit in units], axis=1)
        system = np.einsum("ijs,jks->sik", answers[rows.links], self.coupling) + np.eye(n)
        rates = np.linalg.solve(system, v[rows.links].T[..., None])[..., 0].T
        pull = np.einsum("jks,ks->js", self.coupling, rates)
        return np.asarray(v - np.einsum("ijs,js->is", answers, pull))

    def _tree(self, lines: tuple[Array, ...], all_push: Array, reference: Array) -> Array:
        """Return the speeds (rows, S) of all bodies without the coupling between links; `lines` is
        the result of `_lines`."""
        rows, m = self.rows, self.rows.m
        c, s, c_play, s_play = lines
        one, two = self.first, self.second
        p23, rub = slice(2 + m, 2 + 2 * m), slice(2 + 2 * m, 3 + 3 * m)
        disk, slid = 3 + 3 * m, slice(4 + 3 * m, None)

        links, links_push = self.drag[rows.links] + s[rub], all_push[rows.links] - c[rub]
        base, base_push = links[0], links_push[0]
        links, links_push = links[1:], links_push[1:]
        load, more = _reflected_load(c_play[2:], s_play[2:], links, links_push)
        axes, axes_push = self.drag[rows.axes] + more, all_push[rows.axes] - load
        load, more = _reflected_load(c[p23], s[p23], axes, axes_push)
        stages = self.drag[rows.stages] + s[slid] + two * two * more
        stages_push = all_push[rows.stages] - c[slid] - two * load
        geared = np.stack([self.drag[rows.disk] + s[disk], base])
        geared_push = np.stack([all_push[rows.disk] - c[disk], base_push])
        for j in range(m - 1, -1, -1):
            load, more = _reflected_load(c[2 + j], s[2 + j], stages[j], stages_push[j])
            body, push = (stages, stages_push) if j else (geared, geared_push)
            body[max(j - 1, 0)] += one[j] * one[j] * more
            push[max(j - 1, 0)] -= one[j] * load
        load, more = _reflected_load(c_play[:2], s_play[:2], geared, geared_push)

        v = np.empty_like(self.drag)
        servo = all_push[rows.motors] - load + c[:2] + s[:2] * reference
        v[rows.motors] = servo / (self.drag[rows.motors] + more + s[:2])
        pull = c_play[:2] + s_play[:2] * v[rows.motors]
        v[rows.geared] = (geared_push + pull) / (geared + s_play[:2])
        for j, driver in enumerate(rows.drivers):
            pull = c[2 + j] + s[2 + j] * one[j] * v[driver]
            v[rows.stages.start + j] = (stages_push[j] + pull) / (stages[j] + s[2 + j])
        pull = c[p23] + s[p23] * two * v[rows.stages]
        v[rows.axes] = (axes_push + pull) / (axes + s[p23])
        pull = c_play[2:] + s_play[2:] * v[rows.axes]
        v[rows.passive] = (links_push + pull) / (links + s_play[2:])
        return v

    # -- the convex function -------------------------------------------------------------------

    def _search(self, start: Array, end: Array) -> Array:
        """Return the speeds between `start` and `end` that minimise the stage's convex function."""
        way = end - start
        low, high = np.zeros(start.shape[1]), np.ones(start.shape[1])
        falling = self._slope_along(end - NEAR_END * way, way) <= 0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            rising = self._slope_along(start + middle * way, way) > 0
            low, high = np.where(rising, low, middle), np.where(rising, middle, high)
        return np.asarray(start + np.where(falling, 1.0, (low + high) / 2) * way)

    def _slope_along(self, v: Array, way: Array) -> Array:
        limited_torque, pressed = self.torques(v)
        limited, play = self.relative(way)
        limited[:2] -= self.reference
        inertial = np.sum(way * (self.drag * v - self.push), axis=0)
        coupled = np.einsum("jks,ks->js", self.coupling, v[self.rows.links])
        inertial += np.sum(way[self.rows.links] * coupled, axis=0)
        inertial = inertial + np.sum(limited * limited_torque, axis=0)
        return np.asarray(inertial + np.sum(play * pressed, axis=0))


def _reflected_load(c: Array, s: Array, drag: Array, push: Array) -> tuple[Array, Array]:
    """Return a, N m, and b, N m s/rad, of the load a + b v that a body puts on its driver.

    The torque between the two is c + s w, where w = v − body's speed, and v is the driver's speed
    times the gear ratio. With all bodies behind it, the body obeys drag · speed = push + torque.
    """
    share = 1.0 / (drag + s)
    return (c * drag - s * push) * share, s * drag * share
