"""A friction contact whose wheels are turned against each other, and the chain of such contacts.

At a contact turned by θ the driving rim moves at V along its own direction. The driven rim follows
its component V cosθ; the component V |sinθ| remains, and the rims slide on each other sideways.
Friction opposes the whole sliding velocity. So a load X at the driven rim makes it slide along its
own direction too, and sideways sliding drags on the driver. With C the largest torque μ N r₁ that
friction transmits, ε the ratio of sideways to driving friction, and sinψ = X/C,

    driven rim         V' = V cosθ − ε |V sinθ| tanψ
    driver's torque    X cosθ + ε C cosψ |sinθ|, against its motion
    gross slip         X ≥ C cosθ / √(cos²θ + ε² sin²θ): the driven rim stands still

Of all friction forces inside an ellipse of axes C and ε C these dissipate most (S. Goyal, A. Ruina,
J. Papadopoulos, Wear 143, 1991, 307). A plain disk has ε = 1; rollers have less. All torques are
forces at the rims times r₁, the radius of disk B.

Along the chain (paper, Fig. 2) each stage has three contacts, P₁, P₂ and P₃. Disk B of stage j, at
angle φⱼ, drives disk A at P₁. Disk A turns the next disk B, φ̇ⱼ₊₁ = ρⱼ cosθⱼ φ̇ⱼ, and drives joint
j+1 through P₂ and P₃, θ̇ⱼ₊₁ = κ cos³θⱼ φ̇ⱼ. By geometry κ = k₂ and ρⱼ = kⱼ₊₂/kⱼ₊₁ = r₁/(λR), with
kᵢ the gear constant of joint i, R the distance of P₁ from the axle of disk A, and λ the ratio of
the bevel gears. So with τ the torque of joint j+1, the loads at the driven rims are

    X₃ = κ τ
    X₂ = driver's torque at P₃
    X₁ = driver's torque at P₂ + ρ · driver's torque at P₁ of the next stage.

Every contact also loses the fraction creep + creep_per_nm · |X| of its rate. All contacts have the
same capacity, since the paper gives no contact forces.
"""

from __future__ import annotations

import numpy as np

from planner.machine.machine import Draws
from planner.support.arrays import Array

UNBOUNDED_TORQUE_NM = 1e30
"""Number that stands for an unlimited torque, N m."""

LEAST_COSINE = 1e-9
"""Least |cosθ| of a contact; smaller values are raised to this value."""

MOST_SHARE = 0.99
"""Largest load that drives a contact, as a fraction of its capacity. With more load the contact
slides by itself, which only a model with inertia can compute."""

LEAST_TORQUE_NM = 1e-30

SLIP_SPEED_RAD_S = 1e-3
"""Least speed of motor 1 at which gross slip counts. Slower motion (below one motor rpm with a
1:100 gearhead) is the servo settling."""

MOST_TRIES, RATE_TOLERANCE = 60, 1e-12
"""Most iterations and tolerance of Newton's method in `share`, which mostly takes five."""

MOST_CAPACITY_NM = 1e5
"""Capacity from which a contact counts as unlimited; all values used for infinity are larger."""


def lateral_friction(draws: Draws) -> Array:
    """Return ε, sideways over driving friction, (1, S or 1); 0 where the capacity is unlimited."""
    is_finite = draws["friction_capacity_nm"] < MOST_CAPACITY_NM
    return np.asarray(np.where(is_finite, draws["lateral_friction"], 0.0))


def friction_capacity(draws: Draws) -> Array:
    """Return a contact's largest torque C, (1, S or 1), N m; `UNBOUNDED_TORQUE_NM` if unlimited."""
    return np.minimum(draws["friction_capacity_nm"], UNBOUNDED_TORQUE_NM)


class Grip:
    """Friction contacts whose wheels are turned against each other by given angles θ.

    Args:
        cosines: Cosines of θ, any shape (…).
        lateral: Ratio ε of sideways to driving friction, of a shape that broadcasts to (…).
        capacity: Largest torque C of a contact, of a shape that broadcasts to (…), N m.

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

    def contact_load(self, load: Array) -> Array:
        """Return the part of a load that the contact carries, N m."""
        return np.maximum(np.minimum(load, self.most), -MOST_SHARE * self._capacity)

    def hold(self, load: Array) -> Array:
        """Return the friction C cosψ that is left for sideways sliding under a load that the
        contact carries, N m."""
        left = np.sqrt(np.maximum(self._capacity * self._capacity - load * load, 0.0))
        return np.maximum(left, LEAST_TORQUE_NM)

    def driver_torque(self, load: Array) -> Array:
        """Return the torque on the driver under a load at the driven rim, N m."""
        load = self.contact_load(load)
        return np.asarray(load * self.cosine + self.sideways * self.hold(load))

    def transmission(self, load: Array) -> Array:
        """Return the fraction of the rate V cosθ transmitted under a load; 0 in gross slip."""
        carried = self.contact_load(load)
        lost = self.sideways * carried / (self.cosine * self.hold(carried))
        return np.where(load < self.most, np.maximum(1.0 - lost, 0.0), 0.0)

    def slope(self, load: Array) -> Array:
        """Return minus the derivative of `transmission` by the load, 1/(N m); 0 beyond the loads
        that the contact carries."""
        carried = self.contact_load(load)
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
    """Compute the loads of all contacts and the fractions they transmit, from the last stage back.

    Args:
        cosines: Cosines of θ₁ … θₙ₋₁, (n−1, …, S).
        k: Gear constants k₂ … kₙ of each machine, (n−1, S).
        torques: Torques of joints 2 … n against their motion, (n−1, …, S), N m.
        lateral: ε, (1, S or 1).
        capacity: C, (1, S or 1), N m.
        rising: Additional torques at full speed, such as viscous friction through rigid shafts,
            (n−1, …, S), N m. A contact then turns as fast as its load allows.

    Returns:
        For P₁, P₂ and P₃ of each stage, (3, n−1, …, S): loads at the driven rim, N m; fractions of
        V cosθ that are transmitted; loads at which gross slip begins, N m.
    """
    loads, parts, most = np.empty((3, 3, *np.broadcast_shapes(torques.shape, cosines.shape)))
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
                (whole, grip.transmission(whole)) if rising is None else share(grip, steady, whole)
            )
            loads[place, j], parts[place, j], most[place, j] = load, part, grip.most
            whole = grip.driver_torque(load)
            steady = whole if rising is None else grip.driver_torque(steady)
        if j:
            later, later_steady = k[j] / k[j - 1] * whole, k[j] / k[j - 1] * steady
    return loads, parts, most


def share(grip: Grip, steady: Array, whole: Array) -> tuple[Array, Array]:
    """Return the load of a contact and the fraction of the rate that it transmits under this load.

    Newton's method within bounds solves fraction = transmission(steady + fraction · (whole −
    steady)). Each sample stops when it has converged, so samples do not affect each other.
    """
    full, rising = grip.transmission(whole), whole - steady
    low, high = np.zeros_like(full), np.ones_like(full)
    free, still = full >= 1, grip.transmission(steady) <= 0
    rate, active = np.where(still & ~free, 0.0, full), ~(free | still)
    for _ in range(MOST_TRIES):
        if not active.any():
            break
        load = steady + rising * rate
        gap = grip.transmission(load) - rate
        low, high = np.where(gap > 0, rate, low), np.where(gap < 0, rate, high)
        guess = rate + gap / (1 + rising * grip.slope(load))
        guess = np.where((guess > low) & (guess < high), guess, (low + high) / 2)
        active &= gap != 0
        change, rate = np.abs(guess - rate), np.where(active, guess, rate)
        active &= change >= RATE_TOLERANCE
    return np.where(free, whole, steady + rising * rate), rate


def contact_name(contact: int) -> str:
    """Return the name of a contact for users, such as "P2 at joint 1". The contact's number is 3 j
    + 0, 1 or 2 for P₁, P₂ or P₃ of stage j, counted from 0 at motor 1."""
    return f"P{contact % 3 + 1} at joint {contact // 3 + 1}"


VARYING_EFFECTS = ("creep_per_nm", "friction_capacity_nm")
"""Effects that make the fraction that a contact transmits vary along the motion."""
