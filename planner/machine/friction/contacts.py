"""A friction contact whose wheels are turned against each other, and the chain of such contacts.

At a contact turned by θ the driving rim moves at V along its own direction. The driven rim can take
V cosθ of it; V |sinθ| is left, and the rims slide on each other sideways. Friction opposes the
whole sliding velocity. So a load X at the driven rim makes it slide along its own direction too,
and sliding sideways drags on the driver. With C the largest torque μ N r₁ that friction transmits,
ε the ratio of sideways to driving friction, and sinψ = X/C,

    driven rim         V' = V cosθ − ε |V sinθ| tanψ
    driver's torque    X cosθ + ε C cosψ |sinθ|, against its motion
    gross slip         X ≥ C cosθ / √(cos²θ + ε² sin²θ): the driven rim stands still

These are the forces of greatest dissipation with friction inside an ellipse of axes C and ε C
(S. Goyal, A. Ruina, J. Papadopoulos, Wear 143, 1991, 307). ε = 1 is a plain disk; rollers have
less. All torques are forces at the rims times r₁, the radius of disk B.

Along the chain (paper, Fig. 2) disk B of stage j drives disk A at P₁. That carries the next disk B,
φ̇ⱼ₊₁ = ρⱼ cosθⱼ φ̇ⱼ, and drives joint j+1 through P₂ and P₃, θ̇ⱼ₊₁ = κ cos³θⱼ φ̇ⱼ. By geometry κ = k₂
and ρⱼ = kⱼ₊₂/kⱼ₊₁ = r₁/(λR). So with τ the torque of joint j+1, the loads at the driven rims are

    X₃ = κ τ
    X₂ = driver's torque at P₃
    X₁ = driver's torque at P₂ + ρ · driver's torque at P₁ of the next stage.

Every contact also loses the fraction creep + creep_per_nm · |X| of its rate. One capacity stands
for all contacts, since the paper prints no contact force.
"""

from __future__ import annotations

import numpy as np

from planner.machine.machine import Draws
from planner.support.arrays import Array

UNBOUNDED_TORQUE_NM = 1e30
"""A torque that nothing reaches, N m."""

LEAST_COSINE = 1e-9
"""A contact that is turned nearer to a right angle counts as turned so far."""

MOST_SHARE = 0.99
"""Share of the capacity up to which tanψ follows a load that pushes on: one that needs all of it
slides by itself, which takes masses to compute."""

LEAST_TORQUE_NM = 1e-30

SLIP_SPEED_RAD_S = 1e-3
"""Speed of motor 1 from which gross slip counts: below one motor rpm behind 1:100 a servo only
settles."""

MOST_TRIES, RATE_TOLERANCE = 60, 1e-12
"""Of Newton's method for the part of a rate that a contact passes on; most need five."""


MOST_CAPACITY_NM = 1e5
"""From this capacity on a contact counts as one without: what stands for infinity lies above."""


def lateral_friction(draws: Draws) -> Array:
    """ε of each machine, (1, S or 1); 0 where no capacity says how large friction is."""
    known = draws["friction_capacity_nm"] < MOST_CAPACITY_NM
    return np.asarray(np.where(known, draws["lateral_friction"], 0.0))


def friction_capacity(draws: Draws) -> Array:
    """C of each machine, (1, S or 1), N m; `UNBOUNDED_TORQUE_NM` where there is none."""
    return np.minimum(draws["friction_capacity_nm"], UNBOUNDED_TORQUE_NM)


class Grip:
    """Contacts turned by given angles, with the law above.

    Args:
        cosines: cosθ, any shape (…).
        lateral: ε, likewise or a shape that fits.
        capacity: C, likewise, N m.

    Attributes:
        cosine: |cosθ|, at least `LEAST_COSINE`.
        sideways: ε |sinθ|.
        most: The load at which gross slip begins, N m.
    """

    def __init__(self, cosines: Array, lateral: Array, capacity: Array) -> None:
        self.cosine = c = np.maximum(np.abs(cosines), LEAST_COSINE)
        self.sideways = s = lateral * np.sqrt(np.maximum(1.0 - cosines * cosines, 0.0))
        self._capacity = capacity
        self.most = capacity * c / np.sqrt(c * c + s * s)

    def carried(self, load: Array) -> Array:
        """The load that the contact carries, N m."""
        return np.maximum(np.minimum(load, self.most), -MOST_SHARE * self._capacity)

    def hold(self, load: Array) -> Array:
        """C cosψ under a load that it carries, N m: what friction has left for sideways."""
        left = np.sqrt(np.maximum(self._capacity * self._capacity - load * load, 0.0))
        return np.maximum(left, LEAST_TORQUE_NM)

    def driver_torque(self, load: Array) -> Array:
        """What the driver feels under a load at the driven rim, N m."""
        load = self.carried(load)
        return np.asarray(load * self.cosine + self.sideways * self.hold(load))

    def passed(self, load: Array) -> Array:
        """V' / (V cosθ) under a load; 0 in gross slip."""
        carried = self.carried(load)
        lost = self.sideways * carried / (self.cosine * self.hold(carried))
        return np.where(load < self.most, np.maximum(1.0 - lost, 0.0), 0.0)

    def slope(self, load: Array) -> Array:
        """By how much that falls for each N m more; 0 beyond the loads that are carried."""
        carried = self.carried(load)
        slope = self.sideways * self._capacity**2 / (self.cosine * self.hold(carried) ** 3)
        return np.where(carried == load, slope, 0.0)


def chain_loads(
    cosines: Array,
    k: Array,
    torques: Array,
    lateral: Array,
    capacity: Array,
    rising: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Loads at the driven rims of all contacts, and what each passes on, from the joints back.

    Args:
        cosines: Of θ₁ … θₙ₋₁, (n−1, …, S).
        k: Gear constants k₂ … kₙ of each machine, (n−1, S).
        torques: Of joints 2 … n against their motion, (n−1, …, S), N m.
        lateral: ε, (1, S or 1).
        capacity: C, likewise, N m.
        rising: What comes on top at full speed, as through rigid shafts with viscous friction,
            (n−1, …, S), N m. A contact then turns as fast as its load allows.

    Returns:
        Of P₁, P₂ and P₃ of each stage, (3, n−1, …, S): loads, N m; parts of V cosθ that are passed
        on; loads at which gross slip begins, N m.
    """
    loads, parts, most = (
        np.empty((3, *np.broadcast_shapes(torques.shape, cosines.shape))) for _ in range(3)
    )
    later = later_steady = np.zeros(1)
    for j in range(len(torques) - 1, -1, -1):
        grip = Grip(cosines[j], lateral[0], capacity[0])
        steady = whole = k[0] * torques[j]
        if rising is not None:
            whole = steady + k[0] * rising[j]
        for place in (2, 1, 0):
            if place == 0:
                steady, whole = steady + later_steady, whole + later
            load, part = (
                (whole, grip.passed(whole)) if rising is None else _share(grip, steady, whole)
            )
            loads[place, j], parts[place, j], most[place, j] = load, part, grip.most
            whole = grip.driver_torque(load)
            steady = whole if rising is None else grip.driver_torque(steady)
        if j:
            later, later_steady = k[j] / k[j - 1] * whole, k[j] / k[j - 1] * steady
    return loads, parts, most


def _share(grip: Grip, steady: Array, whole: Array) -> tuple[Array, Array]:
    """Load and part of the rate where a part of the rate brings that part of `whole − steady`.

    Newton's method within bounds. Each sample stops by itself, whatever the others need.
    """
    full, rising = grip.passed(whole), whole - steady
    low, high = np.zeros_like(full), np.ones_like(full)
    free, still = full >= 1, grip.passed(steady) <= 0
    rate, active = np.where(still & ~free, 0.0, full), ~(free | still)
    for _ in range(MOST_TRIES):
        if not active.any():
            break
        load = steady + rising * rate
        gap = grip.passed(load) - rate
        low, high = np.where(gap > 0, rate, low), np.where(gap < 0, rate, high)
        guess = rate + gap / (1 + rising * grip.slope(load))
        guess = np.where((guess > low) & (guess < high), guess, (low + high) / 2)
        active &= gap != 0
        change, rate = np.abs(guess - rate), np.where(active, guess, rate)
        active &= change >= RATE_TOLERANCE
    return np.where(free, whole, steady + rising * rate), rate


def contact_name(contact: int) -> str:
    """What a user calls a contact, "P2 at joint 1", of its number 3 j + 0, 1, 2 for P₁, P₂, P₃ of
    stage j, the first from motor 1 on."""
    return f"P{contact % 3 + 1} at joint {contact // 3 + 1}"


VARYING_EFFECTS = ("creep_per_nm", "friction_capacity_nm")
"""Effects by which what a contact passes on changes along the motion."""
