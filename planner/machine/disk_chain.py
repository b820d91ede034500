"""The manipulator in motion: motor 2 turns joint 1, motor 1 the chain of friction disks (eq. 6).

    axis of joint i:  kᵢ cos³θᵢ₋₁ ∏_{j≤i−2} cosθⱼ · ω₁ · (fraction that the contacts transmit)

The motion of joint i passes i + 1 friction contacts: P₁ of the stages 1 … i−1, then P₂ and P₃ of
its branch; that of φₙ₋₁ passes the n − 2 contacts P₁ before it (see `contacts`). Bevel gears, belt
and shaft drive each of joints 2 … n (see `Play`). Joint 1 is driven through the gearhead of motor
2 alone, and the first disk through that of motor 1.

The system is triangular, so one joint is integrated after the other: with θᵢ₋₁ known at the points
of a step, the travel of axis i to each of them follows by quadrature, of order four with three
points and of order two with two.

Between a driven axis and its joint are backlash and a soft shaft that friction winds up.

With m the angle of the driven axis and θ that of the joint, quasi-static balance of the joint is

    d θ̇ = k · dz(m − θ, w),   w = backlash/2 + coulomb/k,   dz(e, w) = e − clip(e, −w, w)

for stiffness k and viscous friction d. The joint rests while m − θ stays within the play and the
wind-up that Coulomb friction can hold; beyond, it follows with the time constant d/k. Without
viscous friction, or with a rigid shaft, this is the play operator θ ← clip(θ, m − w, m + w); with
every effect off it is θ = m.

On an inclined plane gravity loads joint i with G = −∂V/∂θᵢ, V = g sin(incline) Σ momentⱼ sinψⱼ,
ψⱼ = θ₁ + … + θⱼ. The joint then rests while the shaft's torque lies between −coulomb − G and
coulomb − G. Where gravity overcomes friction, the link moves to the other side of its play. The
arm starts settled. We assume that friction holds the disk behind motor 1's gearhead.
"""

from __future__ import annotations

import numpy as np

from planner.machine.friction.contact_load import gear_constants, weights
from planner.machine.friction.contacts import (
    SLIP_SPEED_RAD_S,
    VARYING_EFFECTS,
    chain_loads,
    friction_capacity,
    lateral_friction,
)
from planner.machine.machine import Draws
from planner.machine.servos import integrals, to_end
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator, gravity_torques


class DiskChain:
    """Motion of S manipulators without inertia.

    Args:
        system: The manipulator as the planner knows it.
        draws: The machines.
        q: Coordinates at the start, (N, S).

    Attributes:
        q: Coordinates (φₙ₋₁, θ₁ … θₙ), shape (N, S), rad.
        slipping: Number of the contact in gross slip, (S,), see `contacts.contact_name`; −1 if
            none.
    """

    def __init__(self, system: Manipulator, draws: Draws, q: Array) -> None:
        self.slipping = np.full(draws.count, -1.0)
        k = gear_constants(system, draws)
        self._k, self._k_g = k, system.k_g
        self._creep, self._creep_per_nm = draws["creep"], draws["creep_per_nm"]
        self._lateral, self._capacity = lateral_friction(draws), friction_capacity(draws)
        self._loaded = any(draws.has_effect(name) for name in VARYING_EFFECTS)
        shares = np.repeat(1 - self._creep, len(k), axis=0)
        self._unloaded = (shares, shares**2) if draws.has_effect("creep") else None
        self._motor = Play.gearhead(draws, 0, np.zeros(draws.count))
        self._motor.settle()
        self._joints = [Play.gearhead(draws, 1, q[1].copy())]
        self._joints += [Play.passive(draws, i, theta) for i, theta in enumerate(q[2:].copy())]
        self._cosines = np.cos(q[1:-1])
        self.q = q.copy()
        self._weights = weights(draws, len(self._joints))
        self._load()
        for joint in self._joints:
            joint.settle()

    @property
    def axes(self) -> Array:
        """Angles of the driven axes, counted like the joint angles, (n, S), rad."""
        return np.stack([joint.axis for joint in self._joints])

    @property
    def disk(self) -> Array:
        """Angles of the first disk and of motor 1 (at its gearhead's output), (2, S), rad."""
        return np.stack([self._motor.theta, self._motor.axis])

    @property
    def lead(self) -> Array:
        """Angles of motor 1 before the first disk, and of each axis before its joint, (1+n, S)."""
        return np.concatenate([np.diff(self.disk, axis=0), self.axes - self.q[1:]])

    def shares(self, lead: Array) -> Array:
        """Return where gears rest, as in `Draws.start`, (1+n, S), that lead the first disk and the
        joints at the present pose by `lead` (1+n, S), rad; 0 where an axis has no room."""
        plays = [self._motor, *self._joints]
        return np.stack([play.share(each) for play, each in zip(plays, lead, strict=True)])

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance the manipulators by one time step.

        Args:
            speed: Motor speeds at the step's P points (2 or 3), (P, 2, S), rad/s.
            travel: Motor travel from the start to each later point, (P−1, 2, S), rad.
            h: Length of the step, s.
        """
        last = len(self._k) - 1
        self._load()
        disk = self._geared_speed(speed[:, 0], travel[-1, 0], h)
        passed = self._transmission(disk[-1]) if self._loaded else self._unloaded
        ways = list(travel[:, 1])
        for j, k in enumerate(self._k):
            c = self._turn(j, ways, h)
            if j == last:
                self.q[0] += self._k_g * to_end(disk, h)
            disk = disk * c
            gain = k
            if passed is not None:
                disk *= passed[0][j]
                gain = k * passed[1][j]
            driven = disk * c
            driven *= c
            ways = [gain * way for way in integrals(driven, h)]
        self.q[last + 2] = self._joints[last + 1].move(ways[-1], h)

    def _load(self) -> None:
        """Apply the torques of gravity at the present angles to the joints."""
        if self._weights is not None:
            loads = gravity_torques(self._weights, self.q[1:])
            for joint, load in zip(self._joints, loads, strict=True):
                joint.apply_load(load)

    def _geared_speed(self, speed: Array, travel: Array, h: float) -> Array:
        """Return the speed of the first disk, (P, S), rad/s: the speed of motor 1 less what the
        gearhead's play takes up."""
        if self._motor.exact:
            return speed
        before = self._motor.theta
        turned = self._motor.move(travel, h) - before
        still = travel == 0
        return np.asarray(speed * np.where(still, 1.0, turned / np.where(still, 1.0, travel)))

    def _transmission(self, speed: Array) -> tuple[Array, Array]:
        """Return the fractions of the ideal rate V cosθ that contact P₁, and contacts P₂ and P₃
        together, transmit in each stage, (n−1, S).

        Args:
            speed: Speed of the first disk, (S,), rad/s.
        """
        cosines, joints = self._cosines, self._joints[1:]
        # A joint at more than 90 degrees reverses the direction of what it drives.
        turning: Array = np.sign(speed) * np.cumprod(np.sign(cosines), axis=0)
        steady = np.stack([joint.torque(way) for joint, way in zip(joints, turning, strict=True)])
        rising = self._rising(turning, speed) if any(joint.damped for joint in joints) else None
        lateral, capacity = self._lateral, self._capacity
        loads, parts, _ = chain_loads(cosines, self._k, steady, lateral, capacity, rising)
        slips = (parts <= 0.0) & (np.abs(speed) > SLIP_SPEED_RAD_S)
        flat = np.swapaxes(slips, 0, 1).reshape(-1, slips.shape[-1])
        self.slipping = np.where(flat.any(axis=0), flat.argmax(axis=0), -1.0)
        carried = np.minimum(np.abs(loads), capacity)
        parts *= np.maximum(1.0 - self._creep - self._creep_per_nm * carried, 0.0)
        return parts[0], parts[1] * parts[2]

    def _rising(self, turning: Array, speed: Array) -> Array:
        """Return the torques that viscous friction of the joints adds if no contact slips, (n−1,
        S), N m."""
        torques, disk = np.empty_like(self._cosines), np.abs(speed)
        for j, joint in enumerate(self._joints[1:]):
            c = np.abs(self._cosines[j])
            torques[j] = joint.damping(turning[j]) * self._k[j] * c * c * c * disk
            disk = disk * c
        return torques

    def _turn(self, i: int, ways: list[Array], h: float) -> Array:
        """Turn axis i by its travels to the later points; return cosθᵢ at all points, (P, S)."""
        joint, part = self._joints[i], h / len(ways)
        c = np.empty((len(ways) + 1, len(joint.theta)))
        c[0] = self._cosines[i]
        np.cos(joint.move(ways[0], part), out=c[1])
        if len(ways) > 1:
            np.cos(joint.move(ways[1] - ways[0], part), out=c[2])
        self.q[i + 1] = joint.theta
        self._cosines[i] = c[-1]
        return c


Value = float | Array

TOUCH_TOLERANCE_RAD = 1e-9
"""Remaining play that counts as taken up, rad."""


class Play:
    """The connection between one driven axis and its joint, for S samples.

    Args:
        theta: Angle of the joint at the start, (S,), rad; the shaft is unwound then.
        half_gap: Half of the backlash, rad; this and the following are (S,) or a number for all.
        stiffness: Stiffness of the shaft, N m/rad; infinite when rigid.
        coulomb: Coulomb friction of the joint, N m.
        viscous: Viscous friction of the joint, N m s/rad.
        start: Position of the axis in its play at the start, −1 … 1; 0 is the middle.
        share: Replaces `start`: position of the axis in the range in which the joint rests,
            −1 … 1; NaN to use `start`.

    Attributes:
        theta: Joint angle, (S,), rad.
        axis: Angle of the driven axis, (S,), rad, on the same scale.
        exact: Whether axis and joint always have the same angle.
        damped: Whether viscous friction acts on the axis directly, as through a rigid shaft.
    """

    def __init__(
        self,
        theta: Array,
        half_gap: Value = 0.0,
        stiffness: Value = np.inf,
        coulomb: Value = 0.0,
        viscous: Value = 0.0,
        start: Value = 0.0,
        share: Value = np.nan,
    ) -> None:
        given = (half_gap, stiffness, coulomb, viscous)
        full = (np.broadcast_to(value, theta.shape) for value in given)
        self._half_gap, self._stiffness, self._coulomb, self._viscous = full
        self._soft = bool(np.all(np.isfinite(self._stiffness)))
        self._rest = self._half_gap + self._coulomb / self._stiffness
        self._least, self._most = -self._rest, self._rest
        self._load: Value = 0.0
        self._constant = self._viscous / self._stiffness
        self._lagging = bool(self._constant.any())
        self.exact = not self._lagging and not self._rest.any()
        self.damped = not self._soft and bool(self._viscous.any())
        self._wound = np.zeros(theta.shape)
        self._start, self._share = start, share
        self._weight: dict[float, tuple[Array, Array]] = {}
        self.theta = theta
        self.axis = theta + start * self._half_gap

    def apply_load(self, load: Array) -> None:
        """Load the joint with a torque (S,), N m, that pushes it forwards from now on."""
        self._load, self.exact = load, False
        self._least, self._most = rest_range(load, self._half_gap, self._coulomb, self._stiffness)

    def settle(self) -> None:
        """Place the axis so that the joint rests at its present angle under its load."""
        middle = self._start * self._half_gap
        self.axis = self.theta + rest_at(self._share, middle, self._least, self._most)

    def share(self, lead: Array) -> Array:
        """Return the position −1 … 1, (S,), of an axis that leads the joint by `lead` (S,), rad, in
        its range at rest; the inverse of `rest_at`."""
        least, most = np.broadcast_arrays(self._least, self._most)
        wide = most - least > 0
        inside = (lead - least) / np.where(wide, most - least, 1.0)
        return np.where(wide, np.clip(2 * inside - 1, -1.0, 1.0), 0.0)

    @classmethod
    def gearhead(cls, draws: Draws, motor: int, angle: Array) -> Play:
        """Return the play of the gearhead of motor 0 or 1 whose output is at `angle` (S,), rad."""
        half_gap = np.deg2rad(_row(draws, "gearhead_backlash_deg", motor)) / 2
        return cls(angle, half_gap, share=draws.start[motor])

    @classmethod
    def passive(cls, draws: Draws, i: int, theta: Array) -> Play:
        """Return the connection between passive joint i (0: the paper's joint 2), at angle `theta`
        (S,), rad, and its axis."""
        return cls(
            theta,
            half_gap=np.deg2rad(_row(draws, "backlash_deg", i)) / 2,
            stiffness=_row(draws, "shaft_stiffness_nm_per_rad", i),
            coulomb=_row(draws, "coulomb_friction_nm", i),
            viscous=_row(draws, "viscous_friction_nms_per_rad", i),
            start=_row(draws, "initial_play", i),
            share=draws.start[i + 2],
        )

    def move(self, travel: Array, h: float) -> Array:
        """Turn the axis by `travel` (S,), rad, evenly over h seconds; return the joint's angle."""
        axis = self.axis = self.axis + travel
        if self.exact:
            self.theta = axis
            return axis
        still = self.theta
        least, most = axis - self._most, axis - self._least
        place = np.minimum(np.maximum(still, least), most)
        if self._lagging:
            start, end = self._weight.get(h) or self._deflection_weights(h)
            place = still + start * self._wound + end * (place - still)
            self._wound = np.minimum(np.maximum(place, least), most) - place
        self.theta = place
        return np.asarray(place)

    def _deflection_weights(self, h: float) -> tuple[Array, Array]:
        """Return two weights: in a step of h seconds the joint moves by the first times the
        deflection at the step's start plus the second times the deflection at the end.

        The deflection is how far the shaft would be beyond rest if the joint stood still. The
        weights are exact for a deflection that changes linearly; the error of the step in which the
        play is taken up decays with the joint's time constant.
        """
        lag = self._constant / h
        slow = np.where(lag > 0, lag, 1.0)
        mean = np.where(lag > 0, -slow * np.expm1(-1 / slow), 0.0)
        settled = np.where(lag > 0, -np.expm1(-1 / slow), 1.0)
        self._weight[h] = (settled - (1 - mean), 1 - mean)
        return self._weight[h]

    def torque(self, turning: Array) -> Array:
        """Return the part of the joint's torque on its driven axis that does not depend on speed,
        (S,), N m.

        The torque is positive against the motion, whose direction is `turning` (S,): −1, 0 or 1. A
        soft shaft transmits the torque of its twist. A rigid one transmits the joint's Coulomb
        friction once the play is taken up.
        """
        ahead = (self.axis - self.theta) * turning
        if self._soft:
            play = np.minimum(np.maximum(ahead, -self._half_gap), self._half_gap)
            return np.asarray(self._stiffness * (ahead - play))
        friction = self._coulomb - self._load * turning
        return np.asarray(self._touching(ahead, turning) * friction)

    def damping(self, turning: Array) -> Array:
        """Return the torque of viscous friction on the driven axis per rad/s of the joint, (S,).

        The unit is N m s/rad. A soft shaft has zero, since its twist includes viscous friction.
        """
        if not self.damped:
            return np.zeros_like(self.theta)
        ahead = (self.axis - self.theta) * turning
        return np.asarray(self._touching(ahead, turning) * self._viscous)

    def _touching(self, ahead: Array, turning: Array) -> Array:
        overrun = self._load * turning > self._coulomb  # gravity holds it on the other side
        touching = (ahead >= self._half_gap - TOUCH_TOLERANCE_RAD) | overrun
        return np.asarray(touching & (turning != 0))


def rest_range(
    load: Value, half_gap: Value, coulomb: Value, stiffness: Value
) -> tuple[Array, Array]:
    """Return the least and the largest angle by which an axis can lead its joint at rest, rad.

    Args:
        load: Torque that pushes the joint forwards, N m; for the others see `Play`.
    """
    least, most = -coulomb - load, coulomb - load
    return (
        np.asarray(least / stiffness + np.where(least > 0, half_gap, -half_gap)),
        np.asarray(most / stiffness + np.where(most < 0, -half_gap, half_gap)),
    )


def rest_at(share: Value, middle: Value, least: Array, most: Array) -> Array:
    """Return the angle by which an axis leads its joint at rest, rad: the position `share` (−1 … 1)
    in the range from `least` to `most`, or where `share` is NaN the angle of that range that is
    nearest to `middle`."""
    there = least + (np.asarray(share) + 1) / 2 * (most - least)
    return np.where(np.isnan(share), np.clip(middle, least, most), there)


def _row(draws: Draws, name: str, i: int) -> Array:
    values = draws[name]
    return np.asarray(values[i if len(values) > 1 else 0])
