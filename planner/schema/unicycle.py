"""The tables of a problem file for `system.kind = "unicycle"`."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from planner.schema.base import Table
from planner.schema.limits import Positive, bound_deg
from planner.schema.vehicle import VehicleFile, VehicleLimits
from planner.systems.base import Array
from planner.systems.unicycle import Unicycle


class UnicycleTable(Table):
    """The unicycle; it has no constants."""

    kind: Literal["unicycle"]


class UnicycleLimits(VehicleLimits):
    """Limits every plan must keep at all times; each may be left out."""

    turn_rate_rad_s: Positive | None = Field(None, description="Largest turn rate in rad/s.")
    turn_acceleration_rad_s2: Positive | None = Field(
        None, description="Largest rate of the turn rate in rad/s^2."
    )

    def turn(self) -> tuple[float | None, float | None]:
        """Limits of the turn rate."""
        return self.turn_rate_rad_s, self.turn_acceleration_rad_s2


class UnicycleFile(VehicleFile):
    """A problem file for the unicycle."""

    system: UnicycleTable
    limits: UnicycleLimits = Field(default_factory=UnicycleLimits)

    def build_system(self) -> Unicycle:
        """The system described."""
        return Unicycle()

    def angles_deg(self, at: Any) -> list[float]:
        """The heading."""
        return [at.heading_deg]

    def joint_limits(self) -> Array:
        """Largest |q|, shape (3,): only the heading has one."""
        return np.array([np.inf, *bound_deg(self.limits.heading_deg, 1), np.inf])
