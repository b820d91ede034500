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


@dataclass(frozen=True)
class Passed:
    """Parts of the motion that are passed on, 0 … 1; lists have an entry (S,) a stage, n−1 in all.

    Attributes:
        stage: By creep at P₁ of each stage.
        branch: To joints 2 … n, by creep at P₂ and P₃ and by slip anywhere before.
        disk: To disk Bₙ₋₁, by slip before it.
    """

    stage: list[Array]
    branch: list[Array]
    disk: Array


@dataclass(frozen=True)
class Torque:
    """What one contact has to transmit, (S,), N m.

    Attributes:
        steady: The part that does not depend on the speed.
        rising: The part proportional to it, at full speed; None where there is none.
    """

    steady: Array
    rising: Array | None


class Contacts:
    """The friction contacts of S manipulators.

    Args:
        draws: The machines.
        k: Gear constants k₂ … kₙ of each, (n−1, S).
    """

    def __init__(self, draws: Draws, k: Array) -> None:
        self._k = list(k)
        self._ratio = list(k[1:] / k[:-1])
        self._creep = draws["creep"][0]
        self._creep_per_nm = draws["creep_per_nm"][0]
        self._capacity = draws["friction_capacity_nm"][0]
        self._loaded = draws.on("friction_capacity_nm") or draws.on("creep_per_nm")
        n, kept = len(k), 1 - self._creep
        even = Passed([kept] * n, [kept**2] * n, np.ones(1))
        self._unloaded = even if draws.on("creep") else None

    def passed(self, joints: list[Play], cosines: list[Array], speed: Array) -> Passed | None:
        """What is passed on now; None when all is.

        Args:
            joints: The connections of joints 2 … n, which know the torques.
            cosines: Of θ₁ … θₙ₋₁, (S,) each.
            speed: Of motor 1, (S,), rad/s.
        """
        if not self._loaded:
            return self._unloaded
        stage, branch = self._torques(joints, cosines, speed)
        shares, to_joint, share = [], [], np.ones(1)
        for first, second in zip(stage, branch, strict=True):
            share = np.minimum(share, self._share(first))
            shares.append(share)
            kept = self._kept(second)
            to_joint.append(kept * kept * np.minimum(share, self._share(second)))
        to_disk = shares[-2] if len(shares) > 1 else np.ones(1)
        return Passed([self._kept(torque) for torque in stage], to_joint, to_disk)

    def _torques(
        self, joints: list[Play], cosines: list[Array], speed: Array
    ) -> tuple[list[Torque], list[Torque]]:
        """At P₁ of each stage, and at P₂ and P₃ of each branch."""
        turning, disk = np.sign(speed), np.abs(speed)
        stage, branch = self._referred([joint.torque(turning) for joint in joints], cosines)
        if not any(joint.damped for joint in joints):
            return [Torque(t, None) for t in stage], [Torque(t, None) for t in branch]
        rising = []
        for joint, k, c in zip(joints, self._k, cosines, strict=True):
            rising.append(joint.damping(turning) * k * c**3 * disk)
            disk = disk * c
        more_stage, more_branch = self._referred(rising, cosines)
        return (
            [Torque(t, r) for t, r in zip(stage, more_stage, strict=True)],
            [Torque(t, r) for t, r in zip(branch, more_branch, strict=True)],
        )

    def _referred(
        self, torques: list[Array], cosines: list[Array]
    ) -> tuple[list[Array], list[Array]]:
        """Torques (S,) of joints 2 … n at disk B of each stage: of all from there on; of its own."""
        branch = [self._k[0] * c * c * c * t for c, t in zip(cosines, torques, strict=True)]
        stage = branch[-1:]
        for j in range(len(branch) - 2, -1, -1):
            stage.insert(0, branch[j] + self._ratio[j] * cosines[j] * stage[0])
        return stage, branch

    def _share(self, torque: Torque) -> Array:
        """Part of the speed at which the torque stays within the capacity."""
        if torque.rising is None:
            return np.asarray(torque.steady < self._capacity)
        room = (self._capacity - torque.steady) / np.maximum(torque.rising, TINY_NM)
        return np.asarray(np.minimum(np.maximum(room, 0.0), 1.0))

    def _kept(self, torque: Torque) -> Array:
        """Part of the rate that creep leaves."""
        whole = torque.steady if torque.rising is None else torque.steady + torque.rising
        lost = self._creep + self._creep_per_nm * np.minimum(np.abs(whole), self._capacity)
        return np.asarray(np.maximum(1.0 - lost, 0.0))
