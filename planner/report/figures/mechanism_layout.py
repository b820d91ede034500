"""Positions of the mechanism's parts in the drawing."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from planner.support.arrays import Array
from planner.systems.manipulator import Gear, Manipulator, stage_gears

RADII_PER_INCH = 1 / 1.3
"""Largest radii per inch of paper; labels of 9 points then do not overlap."""

NOTE_LETTERS = 62
"""Letters per line of the text beside the view from above, 5 inches wide."""

RIM_RATIO = 1.12
"""Radius of a drawn disk over the distance of its contact, which lies inside the rim."""

THICKNESS = 0.07
"""Thickness of disks and wheels, in largest radii."""

BEND_ANGLE = np.deg2rad(35.0)
"""Angle of joint 1 in the view from above."""


@dataclass(frozen=True)
class MechanismLayout:
    """Positions of all parts, in units of the largest radius of the geometry.

    Attributes:
        gears: Geometry of the stages 1 … n−1.
        unit: The largest radius.
        inferred: Assumptions about the geometry; empty if it was given.
        joints: x of the joints' axes, shape (n,).
    """

    gears: tuple[Gear, ...]
    unit: float
    inferred: str
    joints: Array

    @property
    def r1(self) -> float:
        """Radius of the wheels B, and height of the shafts above P₁."""
        return self.gears[0].r1

    @property
    def r2(self) -> float:
        """Radius of the wheels B'. It cancels out and is not part of the geometry."""
        return 0.6 * self.r1

    @property
    def p3(self) -> float:
        """Height of the contact P₃. P₁ is at zero, P₂ on the other face of A."""
        return -THICKNESS - 2 * self.r2

    @property
    def belt(self) -> float:
        """Height of the belts."""
        return self.p3 - THICKNESS - 0.42

    @property
    def link(self) -> float:
        """Height of the links."""
        return self.belt - 0.3

    @property
    def top_view_z(self) -> float:
        """Height at which the view from above and the notes begin."""
        return self.link - 1.05

    @property
    def contact(self) -> Array:
        """Position of P₁ of joint 1 in the view from above."""
        over = max(1.25 + 0.25 * RADII_PER_INCH, (RIM_RATIO + np.sin(BEND_ANGLE)) * self.gears[0].R)
        return np.array([-0.2, self.top_view_z - 0.25 * RADII_PER_INCH - over])

    notes_x = 2.7
    """x at which the notes begin, to the right of disk and link in the view from above."""

    left = -2.6

    @property
    def right(self) -> float:
        """Right end of the picture."""
        return max(float(self.joints[-1]) + 2.0, self.notes_x + 5.2 * RADII_PER_INCH)

    @property
    def top(self) -> float:
        """Upper end of the picture."""
        return 2 * self.r1 + 0.75

    @property
    def bottom(self) -> float:
        """Lower end of the picture."""
        lines = 17 + len(textwrap.wrap(self.inferred, NOTE_LETTERS))
        disk_bottom = float(self.contact[1]) - max(self.r1, 0.6 * self.gears[0].R)
        note_bottom = self.top_view_z - 0.2 * lines * RADII_PER_INCH
        return min(disk_bottom, note_bottom) - 0.15 * RADII_PER_INCH


def layout(system: Manipulator) -> MechanismLayout:
    """The geometry of a manipulator, given or inferred, and the positions of its stages."""
    stages, inferred = stage_gears(system)
    unit = max(max(g.r1, g.R, g.r3) for g in stages)
    gears = tuple(Gear(g.r1 / unit, g.R / unit, g.r3 / unit, g.lam, g.eta) for g in stages)
    spans = [(1 + RIM_RATIO) * max(g.R, g.r3) + 1 for g in gears]
    return MechanismLayout(gears, unit, inferred, np.concatenate([[0.0], np.cumsum(spans)]))
