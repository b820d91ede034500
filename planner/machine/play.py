"""From a driven axis to what it turns: backlash, and a soft shaft wound up by friction.

With m the angle of the driven axis and θ that of the joint, quasi-static balance of the joint is

    d θ̇ = k · dz(m − θ, w),   w = backlash/2 + coulomb/k,   dz(e, w) = e − clip(e, −w, w)

for stiffness k and viscous friction d: the joint rests while the play and the wind-up that Coulomb
friction can hold are not used up, and otherwise follows with the time constant d/k. Without
viscous friction, or with a rigid shaft, this is the play operator θ ← clip(θ, m − w, m + w); with
every effect off it is θ = m.
"""

from __future__ import annotations

import numpy as np

from planner.machine.draw import Draws
from planner.systems.base import Array

Value = float | Array

TOUCH = 1e-9
"""Play that counts as taken up, rad."""


class Play:
    """The connection of one driven axis to what it turns, for S samples.

    Args:
        theta: Angle of the joint at the start, (S,), rad; nothing is wound up then.
        half_gap: Half of the backlash, rad; this and the following are (S,) or a number for all.
        stiffness: Of the shaft, N m/rad; infinite when rigid.
        coulomb: Friction of the joint, N m.
        viscous: Friction of the joint, N m s/rad.
        start: Where in its play the axis starts, −1 … 1; 0 is the middle.

    Attributes:
        theta: Joint angle, (S,), rad.
        axis: Angle of the driven axis, (S,), rad, on the same scale.
        exact: Whether the two are the same.
        damped: Whether the axis feels viscous friction at once, as through a rigid shaft.
    """

    def __init__(
        self,
        theta: Array,
        half_gap: Value = 0.0,
        stiffness: Value = np.inf,
        coulomb: Value = 0.0,
        viscous: Value = 0.0,
        start: Value = 0.0,
    ) -> None:
        self._half_gap, self._stiffness, self._coulomb, self._viscous = (
            np.broadcast_to(value, theta.shape) for value in (half_gap, stiffness, coulomb, viscous)
        )
        self._soft = bool(np.all(np.isfinite(self._stiffness)))
        self._rest = self._half_gap + self._coulomb / self._stiffness
        self._constant = self._viscous / self._stiffness
        self._lagging = bool(self._constant.any())
        self.exact = not self._lagging and not self._rest.any()
        self.damped = not self._soft and bool(self._viscous.any())
        self._wound = np.zeros(theta.shape)
        self._weight: dict[float, tuple[Array, Array]] = {}
        self.theta = theta
        self.axis = theta + start * self._half_gap

    @classmethod
    def gearhead(cls, draws: Draws, motor: int, angle: Array) -> Play:
        """Between motor 0 or 1 and what it turns, from its angle (S,); starts in the middle."""
        return cls(angle, np.deg2rad(_row(draws, "gearhead_backlash_deg", motor)) / 2)

    @classmethod
    def passive(cls, draws: Draws, i: int, theta: Array) -> Play:
        """Into passive joint i (0: the paper's joint 2), from its angle (S,)."""
        return cls(
            theta,
            half_gap=np.deg2rad(_row(draws, "backlash_deg", i)) / 2,
            stiffness=_row(draws, "shaft_stiffness_nm_per_rad", i),
            coulomb=_row(draws, "coulomb_friction_nm", i),
            viscous=_row(draws, "viscous_friction_nms_per_rad", i),
            start=_row(draws, "initial_play", i),
        )

    def move(self, travel: Array, h: float) -> Array:
        """Turn the axis by `travel` (S,), rad, evenly over h seconds; returns θ (S,)."""
        axis = self.axis = self.axis + travel
        if self.exact:
            self.theta = axis
            return axis
        still = self.theta
        least, most = axis - self._rest, axis + self._rest
        moved = np.minimum(np.maximum(still, least), most)
        if self._lagging:
            start, end = self._weight.get(h) or self._weigh(h)
            moved = still + start * self._wound + end * (moved - still)
            self._wound = np.minimum(np.maximum(moved, least), most) - moved
        self.theta = moved
        return np.asarray(moved)

    def _weigh(self, h: float) -> tuple[Array, Array]:
        """How much of the deflection at start and end of a step of length h the joint makes good.

        The deflection is that of the shaft beyond rest, were the joint still. Exact while it
        changes evenly; the step in which play is taken up counts as even from its start, an error
        that dies out with the same time constant.
        """
        lag = self._constant / h
        slow = np.where(lag > 0, lag, 1.0)
        mean = np.where(lag > 0, -slow * np.expm1(-1 / slow), 0.0)
        settled = np.where(lag > 0, -np.expm1(-1 / slow), 1.0)
        self._weight[h] = (settled - (1 - mean), 1 - mean)
        return self._weight[h]

    def torque(self, turning: Array) -> Array:
        """Torque that the joint asks of its driven axis whatever the speed, (S,), N m.

        Positive against the motion; `turning` (S,) is the direction of that, −1, 0 or 1. A soft
        shaft asks for what its twist gives. A rigid one asks for the joint's Coulomb friction once
        its play is taken up.
        """
        ahead = (self.axis - self.theta) * turning
        if self._soft:
            return np.asarray(self._stiffness * _dead_zone(ahead, self._half_gap))
        return np.asarray(self._touching(ahead, turning) * self._coulomb)

    def damping(self, turning: Array) -> Array:
        """Torque that comes on top for each rad/s of the joint, (S,), N m s/rad.

        Only a rigid shaft asks for it; in the twist of a soft one it is contained.
        """
        if not self.damped:
            return np.zeros_like(self.theta)
        ahead = (self.axis - self.theta) * turning
        return np.asarray(self._touching(ahead, turning) * self._viscous)

    def _touching(self, ahead: Array, turning: Array) -> Array:
        return np.asarray((ahead >= self._half_gap - TOUCH) & (turning != 0))


def _row(draws: Draws, name: str, i: int) -> Array:
    values = draws[name]
    return np.asarray(values[i if len(values) > 1 else 0])


def _dead_zone(e: Array, w: Array) -> Array:
    return np.asarray(e - np.minimum(np.maximum(e, -w), w))
