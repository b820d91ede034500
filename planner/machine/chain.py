"""The manipulator in motion: motor 2 turns joint 1, motor 1 the chain of friction disks (eq. 6).

    axis of joint i:  kᵢ cos³θᵢ₋₁ ∏_{j≤i−2} cosθⱼ · ω₁ · (what the contacts on the way pass on)

The motion of joint i passes i + 1 friction contacts: P₁ of the stages 1 … i−1, then P₂ and P₃ of
its branch; that of φₙ₋₁ passes the n − 2 of the stages before it (see `friction`). Into each of
joints 2 … n lead bevel gears, belt and shaft (see `play`). Joint 1 has only the gearhead of motor 2
before it, as the first disk has that of motor 1.

Integration goes down the triangle: with θᵢ₋₁ known at the points of a step, the travel of axis i to
each of them follows by quadrature: fourth order with three points, second with two.
"""

from __future__ import annotations

import numpy as np

from planner.machine.draw import Draws
from planner.machine.friction import Contacts
from planner.machine.play import Play
from planner.machine.quadrature import integrals, to_end
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator


class Chain:
    """S manipulators.

    Args:
        system: The manipulator as the planner knows it.
        draws: The machines.
        q: Coordinates at the start, (N, S).
    """

    def __init__(self, system: Manipulator, draws: Draws, q: Array) -> None:
        k = system.k_g * system.K[:, None] * (1 + draws["gear_ratio_error"])
        k = np.broadcast_to(k, (len(k), draws.count))
        self._k, self._k_g = list(k), system.k_g
        self._contacts = Contacts(draws, k)
        self._motor = Play.gearhead(draws, 0, np.zeros(draws.count))
        self._joints = [Play.gearhead(draws, 1, q[1].copy())]
        self._joints += [Play.passive(draws, i, theta) for i, theta in enumerate(q[2:].copy())]
        self._cosines = np.cos(q[1:-1])
        self._state = q.copy()

    @property
    def q(self) -> Array:
        """Coordinates (φₙ₋₁, θ₁ … θₙ), shape (N, S), rad."""
        return self._state

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by a step.

        Args:
            speed: Of the motors at the step's P points (2 or 3), (P, 2, S), rad/s.
            travel: Of the motors from the start to each later point, (P−1, 2, S), rad.
            h: Length of the step, s.
        """
        last = len(self._k) - 1
        passed = self._contacts.passed(self._joints[1:], self._cosines, speed[-1, 0])
        disk = self._geared(speed[:, 0], travel[-1, 0], h)
        ways = list(travel[:, 1])
        for j, k in enumerate(self._k):
            c = self._turned(j, ways, h)
            if j == last:
                drive = self._k_g if passed is None else self._k_g * passed.disk
                self._state[0] += drive * to_end(disk, h)
            disk = disk * c
            gain = k
            if passed is not None:
                disk *= passed.stage[j]
                gain = k * passed.branch[j]
            driven = disk * c
            driven *= c
            ways = [gain * way for way in integrals(driven, h)]
        self._state[last + 2] = self._joints[last + 1].move(ways[-1], h)

    def _geared(self, speed: Array, travel: Array, h: float) -> Array:
        """Speed of the first disk: of motor 1, less what its gearhead's play takes up, (P, S)."""
        if self._motor.exact:
            return speed
        before = self._motor.theta
        turned = self._motor.move(travel, h) - before
        still = travel == 0
        return np.asarray(speed * np.where(still, 1.0, turned / np.where(still, 1.0, travel)))

    def _turned(self, i: int, ways: list[Array], h: float) -> Array:
        """Turn axis i by the travels to each later point; cosθᵢ at all points, (P, S)."""
        joint, part = self._joints[i], h / len(ways)
        c = np.empty((len(ways) + 1, len(joint.theta)))
        c[0] = self._cosines[i]
        np.cos(joint.move(ways[0], part), out=c[1])
        if len(ways) > 1:
            np.cos(joint.move(ways[1] - ways[0], part), out=c[2])
        self._state[i + 1] = joint.theta
        self._cosines[i] = c[-1]
        return c
