"""What the friction contacts of the manipulator's disk chain pass on under load.

Disk Bⱼ drives disk A of its joint at contact P₁; that drives the next disk, φ̇ⱼ₊₁ = ρⱼ cosθⱼ φ̇ⱼ,
and, through P₂ and P₃, joint j+1: θ̇ⱼ₊₁ = κ cos³θⱼ φ̇ⱼ (paper, Fig. 2). By geometry κ = k₂ and
ρⱼ = kⱼ₊₂/kⱼ₊₁ = r₁/(λR).

Every contact loses the fraction creep + creep_per_nm · |torque| of its rate, and passes at most its
capacity: what needs more is slowed to what the capacity can drive, or stopped. Torques are referred
to the driving disk B of the stage by virtual work: P₁ carries its joint and all later ones, P₂ and
P₃ their joint alone. One capacity stands for all, since the paper does not print the other radii.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.machine.draw import Draws
from planner.machine.play import Play
from planner.systems.base import Array

TINY_NM = 1e-30


@dataclass(frozen=True, eq=False)
class Passed:
    """Parts of the motion that are passed on, 0 … 1.

    Attributes:
        stage: By creep at P₁ of each stage, (n−1, S or 1).
        branch: To joints 2 … n, by creep at P₂ and P₃ and by slip anywhere before, likewise.
        disk: To disk Bₙ₋₁, by slip before it, (S,) or a number.
    """

    stage: Array
    branch: Array
    disk: Array | float


class Contacts:
    """The friction contacts of S manipulators.

    Args:
        draws: The machines.
        k: Gear constants k₂ … kₙ of each, (n−1, S).
    """

    def __init__(self, draws: Draws, k: Array) -> None:
        self._k, self._ratio = k, k[1:] / k[:-1]
        self._creep = draws["creep"]
        self._creep_per_nm = draws["creep_per_nm"]
        self._capacity = draws["friction_capacity_nm"]
        self._loaded = draws.on("friction_capacity_nm") or draws.on("creep_per_nm")
        kept = np.repeat(1 - self._creep, len(k), axis=0)
        self._unloaded = Passed(kept, kept**2, 1.0) if draws.on("creep") else None

    def passed(self, joints: list[Play], cosines: Array, speed: Array) -> Passed | None:
        """What is passed on now; None when all is.

        Args:
            joints: The connections of joints 2 … n, which know the torques.
            cosines: Of θ₁ … θₙ₋₁, (n−1, S).
            speed: Of motor 1, (S,), rad/s.
        """
        if not self._loaded:
            return self._unloaded
        turning = np.sign(speed)
        steady = self._at_contacts(np.stack([j.torque(turning) for j in joints]), cosines)
        rising = self._rising(joints, cosines, turning, speed)
        whole = steady if rising is None else steady + rising
        carried = np.minimum(np.abs(whole), self._capacity)
        kept = np.maximum(1.0 - self._creep - self._creep_per_nm * carried, 0.0)
        branch = kept[1] * kept[1]
        if not (whole >= self._capacity).any():
            return Passed(kept[0], branch, 1.0)
        share = self._share(steady, rising)
        before = np.minimum.accumulate(share[0], axis=0)
        disk = before[-2] if len(before) > 1 else 1.0
        return Passed(kept[0], branch * np.minimum(before, share[1]), disk)

    def _at_contacts(self, torques: Array, cosines: Array) -> Array:
        """Torques (n−1, S) of joints 2 … n as disk B of each stage feels them, (2, n−1, S).

        First those that pass P₁, of the stage's joint and all later ones; then those that pass P₂
        and P₃, of the stage's joint alone.
        """
        out = np.empty((2, *torques.shape))
        out[1] = self._k[0] * cosines * cosines * cosines * torques
        out[0, -1] = out[1, -1]
        for j in range(len(torques) - 2, -1, -1):
            out[0, j] = out[1, j] + self._ratio[j] * cosines[j] * out[0, j + 1]
        return out

    def _rising(
        self, joints: list[Play], cosines: Array, turning: Array, speed: Array
    ) -> Array | None:
        """What the joints' damping adds at full speed, (2, n−1, S); None where there is none."""
        if not any(joint.damped for joint in joints):
            return None
        torques, disk = np.empty_like(cosines), np.abs(speed)
        for j, joint in enumerate(joints):
            torques[j] = joint.damping(turning) * self._k[j] * cosines[j] ** 3 * disk
            disk = disk * cosines[j]
        return self._at_contacts(torques, cosines)

    def _share(self, steady: Array, rising: Array | None) -> Array:
        """Part of the speed at which each contact's torque stays within the capacity."""
        if rising is None:
            return np.asarray(steady < self._capacity, dtype=float)
        room = (self._capacity - steady) / np.maximum(rising, TINY_NM)
        return np.asarray(np.minimum(np.maximum(room, 0.0), 1.0))
