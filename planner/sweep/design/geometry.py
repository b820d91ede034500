"""One design of the mechanism: its radii, ratios and links, and whether it can be built.

The arrangement is that of `planner.report.plot_mechanism`. At joint j the wheel Bⱼ of radius r₁
stands upright on link j−1, above the contact P₁ on the joint's axis. The disks Aⱼ and A'ⱼ lie on
link j; their axles are at distances R and r₃ from that axis. All stages are at one height. With lⱼ
the length of link j, βⱼ the largest bend of joint j and c the clearance, a design can be built if

    lⱼ > R, lⱼ > r₃               P₁, P₂ and P₃ touch the disks: their axles are on link j
    lⱼ > r₁ sin βⱼ + c            wheels Bⱼ and Bⱼ₊₁ do not collide
    lⱼ > R (1 − cos βⱼ₊₁) + √(4 (R + c)² − R² sin² βⱼ₊₁)   nor do disks Aⱼ and Aⱼ₊₁; with r₃: A'
    R cos βⱼ > c                  the axle of Aⱼ does not collide with wheel Bⱼ

The third follows from the distance of the two axles, √((l − R)² + R² + 2R(l − R) cos β) > 2(R + c).
The second and third apply to links between two stages, j ≤ n − 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.support.arrays import Array, Frozen
from planner.support.tables import number
from planner.systems.manipulator import Gear


@dataclass(frozen=True, eq=False)
class Design(Frozen):
    """One mechanism of a study.

    Attributes:
        name: The values of the design's variables, as text.
        values: The varied design variables and their values; empty for the base mechanism.
        joints: Number of joints n.
        gear: Radii and ratios of every stage.
        link_lengths: Distances between neighbouring joints and to the tip, n values in the unit of
            the radii; None if not given, then links are as long as needed.
        least_link: Least length of all links such that no parts collide, in the radii's unit.
        refused: The violated inequality in words; empty if the design can be built.
    """

    name: str
    values: Mapping[str, Any]
    joints: int
    gear: Gear
    link_lengths: tuple[float, ...] | None
    least_link: float
    refused: str

    def __repr__(self) -> str:
        ratios = f"rho {number(self.gear.rho)}, kappa {number(self.gear.k(1))}"
        gear = ", ".join(f"{key} {number(v)}" for key, v in gear_table(self.gear).items())
        state = f"; cannot be built: {self.refused}" if self.refused else ""
        return f"Design({self.name}: {self.joints} joints, {ratios}; {gear}{state})"


def gear_table(gear: Gear) -> dict[str, float]:
    """Return the radii and ratios of a gear by their names in files."""
    return {"r1": gear.r1, "R": gear.R, "r3": gear.r3, "lambda": gear.lam, "eta": gear.eta}


def gear_of(values: Mapping[str, Any], base: Gear) -> Gear:
    """Return the gear `base` with some design variables changed.

    `rho` sets r₁ = ρλR and `kappa` sets r₃ = λR/(ηκ): disks A and purchased gears and belts stay,
    wheel B and the radius of the last contact change.
    """
    lam, eta = values.get("lambda", base.lam), values.get("eta", base.eta)
    R = values.get("R", base.R)
    r1 = values["rho"] * lam * R if "rho" in values else values.get("r1", base.r1)
    r3 = lam * R / (eta * values["kappa"]) if "kappa" in values else values.get("r3", base.r3)
    return Gear(float(r1), float(R), float(r3), float(lam), float(eta))


def design(
    name: str,
    values: Mapping[str, Any],
    gear: Gear,
    bends: Array,
    link_lengths: Sequence[float] | None = None,
    clearance: float = 0.0,
) -> Design:
    """Return a design of the mechanism, with the first inequality that it violates.

    Args:
        name: Name of the design.
        values: The varied design variables.
        gear: Radii and ratios.
        bends: Largest |θ| of joints 1 … n, shape (n,), rad; limited to 90°.
        link_lengths: Lengths of n links, in the unit of the radii; None if not given.
        clearance: Clearance that parts need beyond their radii, in the same unit.
    """
    bends = np.minimum(bends, np.pi / 2)
    links = None if link_lengths is None else tuple(map(float, link_lengths))
    needs = _link_needs(gear, bends, clearance)
    short = (
        f"{what} = {number(least, 4)} does not hold: l{j} = {number(links[j - 1], 4)}"
        for j, least, what in needs
        if links is not None and not links[j - 1] > least
    )
    refused = _hidden_axle(gear, bends, clearance) or next(short, "")
    longest = max(least for _, least, _ in needs)
    return Design(name, dict(values), len(bends), gear, links, longest, refused)


def _hidden_axle(gear: Gear, bends: Array, clearance: float) -> str:
    """Return in words how wheel B and the axle of disk A collide; "" if they do not."""
    widest = float(np.max(bends[:-1]))
    room, bent = gear.R * float(np.cos(widest)), f"{np.rad2deg(widest):.3g} deg"
    if clearance and not room > clearance:
        return (
            f"wheel B and the axle of disk A collide where a joint bends by {bent}"
            f" (limits.joint_deg): R cos {bent} is {number(room)} and must be more than"
            f" {number(clearance)}"
        )
    return ""


def _link_needs(gear: Gear, bends: Array, c: float) -> list[tuple[int, float, str]]:
    """Return each requirement on a link: link number, least length, and inequality in words."""
    out = []
    stages = len(bends) - 1
    plus = f" + {number(c)}" if c else ""
    for j in range(1, stages + 1):
        for radius, name, disk, point in ((gear.R, "R", "A", "P1"), (gear.r3, "r3", "A'", "P3")):
            beyond = f"contact {point} of joint {j} cannot meet disk {disk}, whose axle would stand"
            out.append((j, radius, f"{beyond} beyond link {j}: l{j} > {name}"))
    for j in range(1, stages):
        bend, next_bend = float(bends[j - 1]), float(bends[j])
        bend_text = f"{np.rad2deg(bend):.3g} deg"
        wheels = f"wheels B of joints {j} and {j + 1} collide: l{j} > r1 sin {bend_text}{plus}"
        out.append((j, gear.r1 * float(np.sin(bend)) + c, wheels))
        bend_text = f"{np.rad2deg(next_bend):.3g} deg"
        for radius, name, disk in ((gear.R, "R", "A"), (gear.r3, "r3", "A'")):
            square = 4 * (radius + c) ** 2 - (radius * np.sin(next_bend)) ** 2
            least = radius * (1 - float(np.cos(next_bend))) + float(np.sqrt(square))
            rim = f"({name}{plus})" if c else name
            formula = f"{name} (1 - cos b) + sqrt(4 {rim}^2 - ({name} sin b)^2)"
            words = f"disks {disk} of joints {j} and {j + 1} collide, bent by b = {bend_text}"
            out.append((j, least, f"{words}: l{j} > {formula}"))
    return out
