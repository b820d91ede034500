"""The paper's manipulator: n joints, two motors, friction disks (eqs 6–7)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import PlanarArm, positive


@dataclass(frozen=True)
class Gear:
    """Gear geometry of a stage of the friction-disk chain (paper, text under eq. 6).

    Attributes:
        r1: Radius of wheel B, any length unit.
        R: Distance from the axle of disk A to its contacts P₁ and P₂, same unit.
        r3: Distance from the axle of disk A' to its contact P₃, same unit.
        lam: Speed ratio of disk A to the next wheel B, α̇ᵢ/φ̇ᵢ₊₁: teeth of the driven gear over
            teeth of the driving gear.
        eta: Speed ratio of disk A' to the joint, β̇ᵢ/θ̇ᵢ₊₁: diameter of the joint's (driven) pulley
            over that of the pulley of A'.
    """

    r1: float
    R: float
    r3: float
    lam: float
    eta: float

    @property
    def rho(self) -> float:
        """Transmission ρ = r₁/(λR): turns of the next stage's wheel B per turn, joints at 0."""
        return self.r1 / (self.lam * self.R)

    def k(self, i: int) -> float:
        """Return the constant kᵢ = (λR/(ηr₃)) ρ^{i−1} of joint i (2 … n) for equal stages."""
        return self.lam * self.R / (self.eta * self.r3) * self.rho ** (i - 1)


PROTOTYPE_K, PROTOTYPE_K_G = (0.870125, 0.711625), 0.668811
"""Constants K₂, K₃ and k_g of the paper's prototype, derived from the z(0) that it prints."""


def prototype_ratios(joints: int) -> list[float]:
    """Return K₂ … Kₙ of a prototype with n joints; beyond K₃ each is K₃/K₂ times the previous K."""
    first, second = PROTOTYPE_K
    return [round(first * (second / first) ** i, 6) for i in range(joints - 1)]


class Manipulator(PlanarArm):
    """A nonholonomic manipulator of n ≥ 2 joints with state q = (φₙ₋₁, θ₁, …, θₙ).

    θ̇₁ = u₂,  φ̇ₙ₋₁ = k_g ∏_{j≤n−2} cosθⱼ u₁,  θ̇ᵢ = kᵢ cos³θᵢ₋₁ ∏_{j≤i−2} cosθⱼ u₁  (eq. 6).

    Args:
        K: The ratios Kᵢ = kᵢ/k_g for i = 2 … n (n − 1 positive numbers). The path of the
            joints depends on these only, not on k_g.
        k_g: Turns of the last disk per turn of motor 1 with every joint at 0; u₁ and its limit
            refer to the motor.
        link_lengths: Lengths of the n links, for drawing and obstacles; by default 1 each.
        k_g_rule: How k_g was determined, for reports.

    Raises:
        InputError: If a constant is not a positive finite number or the lengths do not match.
    """

    kind: ClassVar[str] = "manipulator"
    disk: ClassVar[int] = -1

    def __init__(
        self,
        K: ArrayLike,
        k_g: float = 1.0,
        link_lengths: ArrayLike | None = None,
        k_g_rule: str = "given",
    ) -> None:
        super().__init__(K, k_g, link_lengths)
        self.k_g_rule = k_g_rule
        self.gear: Gear | None = None  # set by `from_gear` if stages are equal; not used in rates

    @classmethod
    def from_gear(
        cls,
        n: int,
        gear: Gear | Sequence[Gear],
        *,
        k_g: float | None = None,
        rule: str = "chain",
        link_lengths: ArrayLike | None = None,
    ) -> Manipulator:
        """Build a manipulator of n joints from gear geometry.

        Args:
            n: Number of joints.
            gear: Radii and ratios, one for all stages or one for each of the n − 1 stages.
            k_g: Turns of the last disk per turn of motor 1; by default from `rule`.
            rule: "chain" sets k_g = ρ₁ … ρₙ₋₂, for the n − 2 stages between φ₁ and φₙ₋₁.
                "printed" sets k_g = ρ², a misprint of the paper: for n = 2, for example, no stage
                lies between, and eq. (6) gives φ̇₁ = u₁, so that k_g must be 1.
            link_lengths: As in the constructor.

        Raises:
            InputError: If n < 2, a length is not positive, there are not n − 1 stages, or the rule
                is unknown, or is "printed" although stages differ.
        """
        if n < 2:
            raise InputError(f"a manipulator has at least 2 joints, not {n}")
        stages = [gear] * (n - 1) if isinstance(gear, Gear) else list(gear)
        if len(stages) != n - 1:
            raise InputError(f"{n} joints have {n - 1} stages of gears, not {len(stages)}")
        for each in stages:
            positive("gear", [each.r1, each.R, each.r3, each.lam, each.eta])
        first, alike = stages[0], all(each == stages[0] for each in stages)

        def turned(i: int) -> float:
            """Return the turns of wheel B of stage i + 1 per turn of motor 1."""
            return first.rho**i if alike else prod(each.rho for each in stages[:i])

        product = "rho^(n-2)" if alike else "rho_1 ... rho_(n-2)"
        rules = {
            "chain": (turned(n - 2), f"chain: {product}"),
            "printed": (first.rho**2, "printed: rho^2, a misprint"),
        }
        if rule not in rules:
            raise InputError(f"k_g_rule = {rule!r} is unknown; use 'chain' or 'printed'")
        if rule == "printed" and not alike:
            raise InputError("k_g_rule = 'printed' needs equal stages, but these differ")
        value, said = (k_g, "given") if k_g is not None else rules[rule]
        K = [each.k(1) * turned(i) / value for i, each in enumerate(stages, 1)]
        manipulator = cls(K, value, link_lengths, said)
        manipulator.gear = first if alike else None
        return manipulator

    def shorter(self) -> Manipulator:
        """Return the arm that consists of joints 2 … n of this arm.

        For n ≥ 3 and joint 1 at rest, the rates of this arm are cosθ₁ times those of the shorter
        arm, except θ̇₂.

        Raises:
            InputError: If this arm has 2 joints.
        """
        return Manipulator(self.K[1:].tolist(), self.k_g, self.link_lengths[1:].tolist())

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slopes θᵢ' = dθᵢ/dφₙ₋₁ for i = 2 … n as CasADi expressions."""
        theta = [None, *(q[i] for i in range(1, self.n + 1))]
        out = []
        for i in range(2, self.n):
            later = [ca.cos(theta[j]) for j in range(i, self.n - 1)]
            out.append(self.K[i - 2] * ca.cos(theta[i - 1]) ** 2 / prod(later))
        out.append(self.K[self.n - 2] * ca.cos(theta[self.n - 1]) ** 3)
        return out

    def drive_expr(self, q: Any) -> Any:
        """Return γ = φ̇ₙ₋₁/u₁ = k_g ∏_{j≤n−2} cosθⱼ as a CasADi expression."""
        return self.k_g * prod([ca.cos(q[j]) for j in range(1, self.n - 1)])

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        """Return the rates q̇ of eq. (6) as CasADi expressions, which are finite at every angle."""
        c = [ca.cos(q[j]) for j in range(self.n + 1)]
        passive = [
            self.k_g * self.K[i - 2] * c[i - 1] ** 3 * prod(c[1 : i - 1]) * u[0]
            for i in range(2, self.n + 1)
        ]
        return [self.drive_expr(q) * u[0], u[1], *passive]

    # -- numeric form --------------------------------------------------------------------------

    def slopes(self, q: Array) -> Array:
        """Return the slopes θᵢ' = dθᵢ/dφₙ₋₁ for i = 2 … n, shape (…, n−1)."""
        c = np.cos(q[..., 1:-1])
        driven = c**3 * np.cumprod(np.concatenate([np.ones_like(c[..., :1]), c[..., :-1]], -1), -1)
        path = np.prod(c[..., : self.n - 2], axis=-1, keepdims=True)
        return np.asarray(self.K * driven / path)

    def drive(self, q: Array) -> Array:
        """Return γ = φ̇ₙ₋₁/u₁, the turns of disk n − 1 per turn of motor 1, shape (…,)."""
        return np.asarray(self.k_g * np.prod(np.cos(q[..., 1 : self.n - 1]), axis=-1))

    def rates(self, q: Array, u: Array) -> Array:
        """Return the rates q̇ of eq. (6), shape (…, n+1)."""
        c = np.cos(q[..., 1:-1])
        out = np.empty((*np.broadcast_shapes(q.shape[:-1], u.shape[:-1]), self.size))
        speed = self.k_g * u[..., 0]
        for i in range(self.n - 1):  # a loop: NumPy's products along a short axis are slow
            cosine = c[..., i]
            out[..., i + 2] = self.K[i] * cosine * cosine * cosine * speed
            if i < self.n - 2:
                speed = speed * cosine
        out[..., 0], out[..., 1] = speed, u[..., 1]
        return out

    # -- the chart -----------------------------------------------------------------------------

    def branch(self, q: Array) -> Array:
        """Return the branch numbers (n+1,): the signs of θ₁ … θₙ₋₁, and 1 for φ and θₙ."""
        signs = np.ones(self.size)
        signs[1:-1] = np.sign(q[1:-1])
        return signs

    def _cos2(self, i: int, slope: Array, q: Array) -> Array:
        """Return the cos²θᵢ for which dθᵢ₊₁/dφ = slope, (…,); outside [0, 1] no θᵢ solves it."""
        if i == self.n - 1:
            ratio = slope / self.K[-1]
            return np.asarray(np.sign(ratio) * np.abs(ratio) ** (2 / 3))
        later = np.prod(np.cos(q[..., i + 1 : self.n - 1]), axis=-1)
        return np.asarray(slope * later / self.K[i - 1])

    def link_from_slope(self, i: int, slope: Array, q: Array, branch: Array) -> Array:
        """Return the angle θᵢ, (…,), rad, for which dθᵢ₊₁/dφ = slope; NaN if there is none."""
        w = self._cos2(i, slope, q)
        with np.errstate(invalid="ignore"):
            angle = np.arctan2(np.sqrt(1 - w), np.sqrt(w))
        return np.asarray(branch[i] * angle)

    def link_expr(self, i: int, slope: Any, q: list[Any], branch: Any) -> Any:
        """Return the angle θᵢ for which dθᵢ₊₁/dφ = slope as a CasADi expression."""
        ratio = slope / self.K[i - 1]
        w = ratio * prod([ca.cos(q[j]) for j in range(i + 1, self.n - 1)])
        if i == self.n - 1:
            w = ca.sign(ratio) * ca.fabs(ratio) ** (2 / 3)
        return branch[i] * ca.atan2(ca.sqrt(1 - w), ca.sqrt(w))

    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Return the margins 1 − cos²θᵢ and cos²θᵢ, the distances of θᵢ from 0 and from 90°."""
        w = self._cos2(i, slope, q)
        return [np.asarray(1 - w), w]

    def chart_margins(self, q: Array, branch: Array) -> Array:
        """Return ±sin²θᵢ, ±cos²θᵢ for i = 1 … n−1, (…, 2(n−1)); negative if θᵢ left its branch."""
        s, c = np.sin(q[..., 1:-1]), np.cos(q[..., 1:-1])
        pairs = np.stack([branch[1:-1] * s * np.abs(s), c * np.abs(c)], axis=-1)
        return np.asarray(pairs.reshape(*q.shape[:-1], 2 * (self.n - 1)))

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """Return the margins ±sin²θᵢ and ±cos²θᵢ of `chart_margins` as CasADi expressions."""
        out = []
        for i in range(1, self.n):
            s, c = branch[i] * ca.sin(q[i]), ca.cos(q[i])
            out += [s * ca.fabs(s), c * ca.fabs(c)]
        return out

    @property
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """Array index of the coordinate and meaning of each margin, ordered as `chart_margins`."""
        labels = []
        for i in range(1, self.n):
            labels.append((i, f"1 - cos^2(theta{i}): distance from theta{i} = 0"))
            labels.append((i, f"cos^2(theta{i}): distance from theta{i} = 90 deg"))
        return tuple(labels)

    @property
    def zero_margins(self) -> Collection[int]:
        """Numbers of the margins that are zero where their coordinate is zero: every other one."""
        return range(0, 2 * (self.n - 1), 2)


def gravity_torques(weights: Array, theta: Array) -> Array:
    """Return the torque of gravity on each joint of an arm on an inclined plane.

    The potential energy is Σ weightⱼ sin(θ₁ + … + θⱼ); the plane rises along the y axis of the
    base.

    Args:
        weights: Torque of each link's weight and load about its own joint when the link lies
            across the slope, (n, …), N m.
        theta: Joint angles, (n, …), rad.

    Returns:
        Torques, (n, …), positive if they increase the angle, N m.
    """
    return -on_joints(weights * np.cos(np.cumsum(theta, axis=0)))


def chain_inertia(inertia: Array, lengths: Array, moments: Array, angles: Array) -> Array:
    """Return the matrix of the kinetic energy of a planar chain of links, (n, n, S), kg m^2.

    With the links' angles ψᵢ = θ₁ + … + θᵢ the energy is

        T = ½ Σⱼₖ Aⱼₖ cos(ψⱼ − ψₖ) ψ̇ⱼ ψ̇ₖ,   Aⱼⱼ = Jⱼ,   Aⱼₖ = lⱼ sₖ for j < k

    where each link includes the mass that it carries at its end. For two links, α, β and δ of
    R. M. Murray, Z. Li, S. S. Sastry (A Mathematical Introduction to Robotic Manipulation, 1994,
    section 4.2) are α = A₁₁ + A₂₂, β = A₁₂, δ = A₂₂.

    Args:
        inertia: J, moments of inertia of the links about their own joints, (n, S), kg m^2.
        lengths: l, from each joint to the next, (n, S), m.
        moments: s, mass of each link times the distance of its centre from its joint, (n, S), kg m.
        angles: ψ of the links, (n, S), rad.

    Returns:
        The matrix Aⱼₖ cos(ψⱼ − ψₖ).
    """
    out = np.zeros((len(inertia), *inertia.shape))
    for j in range(len(inertia)):
        out[j, j] = inertia[j]
        out[j, j + 1 :] = lengths[j] * moments[j + 1 :] * np.cos(angles[j] - angles[j + 1 :])
        out[j + 1 :, j] = out[j, j + 1 :]
    return out


def centrifugal_torques(lengths: Array, moments: Array, angles: Array, rates: Array) -> Array:
    """Return the centrifugal torques Σₖ Aⱼₖ sin(ψⱼ − ψₖ) ψ̇ₖ² on the links' angles ψ, (n, S), N m.

    The sum is the velocity term of Lagrange's equations, with A as in `chain_inertia`.

    Args:
        lengths, moments, angles: As for `chain_inertia`.
        rates: ψ̇, (n, S), rad/s.
    """
    out = np.zeros_like(angles)
    for j in range(len(angles)):
        for k in range(j + 1, len(angles)):
            pull = lengths[j] * moments[k] * np.sin(angles[j] - angles[k])
            out[j] += pull * rates[k] ** 2
            out[k] -= pull * rates[j] ** 2
    return out


def on_joints(of_links: Array) -> Array:
    """Convert torques on the links' angles ψ, (n, …), to torques on the joints, (n, …)."""
    return np.asarray(np.cumsum(of_links[::-1], axis=0)[::-1])


def mass_matrix(of_links: Array) -> Array:
    """Convert the matrix A of `chain_inertia` to the mass matrix LᵀA L of the joints.

    L is the lower triangle of ones."""
    return on_joints(on_joints(of_links).swapaxes(0, 1))


def stage_gears(system: Manipulator) -> tuple[tuple[Gear, ...], str]:
    """Return the gears of the stages 1 … n−1, and a note on assumptions ("" if they are given).

    If only K and k_g are given, gears with the same joint rates are inferred: kᵢ₊₁ = κᵢ ρ^i with
    κᵢ = λR/(ηr₃). All stages have the same ρ, and r₃ of each stage is chosen to give its kᵢ₊₁.
    """
    if system.gear is not None:
        return (system.gear,) * (system.n - 1), ""
    K, n = system.K, system.n
    rho = float(K[-1] / K[0]) ** (1 / (n - 2)) if n > 2 else 1.0
    kappa = system.k_g * K / rho ** np.arange(1, n)
    note = "inferred from K and k_g with λ = η = 1 and R = 1" + (" = r₁" if n == 2 else "")
    turned = system.k_g / rho ** (n - 2)
    if abs(turned - 1) > 1e-6:
        times = f"{turned:.3g} times the angle of the last wheel B"
        note += f"; φ of the problem is {times} (k_g is given)"
    return tuple(Gear(rho, 1.0, 1 / k, 1.0, 1.0) for k in kappa.tolist()), note + "."
