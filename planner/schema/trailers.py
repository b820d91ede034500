"""The tables of a problem file for `system.kind = "trailers"`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from planner.schema.base import Table
from planner.schema.car import CarGoal, CarLimits, CarStart
from planner.schema.limits import Positive, bound_deg
from planner.schema.vehicle import HitchDeg, VehicleFile
from planner.systems.base import Array
from planner.systems.trailers import Trailers

_HITCH = "Hitch angles in degrees, first trailer first; all zero when left out."
_HitchLimit = Annotated[float, Field(gt=0, le=180)]


class TrailersTable(Table):
    """The car and its trailers."""

    kind: Literal["trailers"]
    wheelbase_m: Positive = Field(description="Distance of the car's axles in m.")
    trailer_lengths_m: Annotated[list[Positive], Field(min_length=1, max_length=8)] = Field(
        description="From each hitch to the axle of the trailer behind it, in m, in order."
    )


class TrailersStart(CarStart):
    """Where the last trailer's axle starts, and the angles of the vehicle."""

    hitch_deg: list[HitchDeg] | None = Field(None, description=_HITCH)


class TrailersGoal(CarGoal):
    """Where the last trailer's axle ends, and the angles of the vehicle."""

    hitch_deg: list[HitchDeg] | None = Field(None, description=_HITCH)


class TrailersLimits(CarLimits):
    """Limits every plan must keep at all times; each may be left out."""

    hitch_deg: _HitchLimit | list[_HitchLimit] | None = Field(
        None, description="Largest |hitch angle| in degrees: one number, or one a trailer."
    )


class TrailersFile(VehicleFile):
    """A problem file for the car with trailers; x, y and heading are the last trailer's."""

    system: TrailersTable
    start: TrailersStart = Field(default_factory=TrailersStart)
    goal: TrailersGoal
    limits: TrailersLimits = Field(default_factory=TrailersLimits)

    @model_validator(mode="after")
    def _lengths(self) -> TrailersFile:
        n = len(self.system.trailer_lengths_m)
        for name, table in (("start", self.start), ("goal", self.goal), ("limits", self.limits)):
            given = table.hitch_deg
            if isinstance(given, list) and len(given) != n:
                raise ValueError(
                    f"{name}.hitch_deg has {len(given)} values but system.trailer_lengths_m has {n}"
                )
        return self

    def build_system(self) -> Trailers:
        """The system described."""
        return Trailers(self.system.trailer_lengths_m, self.system.wheelbase_m)

    def angles_deg(self, at: Any) -> list[float]:
        """Steering, hitch angles and heading."""
        straight = [0.0] * len(self.system.trailer_lengths_m)
        return [at.steering_deg, *(at.hitch_deg or straight), at.heading_deg]

    def joint_limits(self) -> Array:
        """Largest |q|, shape (N,); x and y have none."""
        limits = self.limits
        hitches = bound_deg(limits.hitch_deg, len(self.system.trailer_lengths_m))
        steering, heading = bound_deg(limits.steering_deg, 1), bound_deg(limits.heading_deg, 1)
        return np.array([np.inf, *steering, *hitches, *heading, np.inf])
