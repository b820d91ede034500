"""The tables of a problem file for `system.kind = "car"`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from planner.schema.base import Table
from planner.schema.limits import Positive, bound_deg
from planner.schema.vehicle import PoseGoal, PoseStart, SteeringDeg, VehicleFile, VehicleLimits
from planner.systems.base import Array
from planner.systems.car import Car


class CarTable(Table):
    """The car."""

    kind: Literal["car"]
    wheelbase_m: Positive = Field(description="Distance of the axles in m.")


class CarStart(PoseStart):
    """Where the car's rear axle starts."""

    steering_deg: SteeringDeg = Field(0.0, description="Steering angle in degrees.")


class CarGoal(PoseGoal):
    """Where the car's rear axle ends."""

    steering_deg: SteeringDeg = Field(0.0, description="Steering angle in degrees.")


class CarLimits(VehicleLimits):
    """Limits every plan must keep at all times; each may be left out."""

    steering_rate_rad_s: Positive | None = Field(
        None, description="Largest steering rate in rad/s."
    )
    steering_acceleration_rad_s2: Positive | None = Field(
        None, description="Largest rate of the steering rate in rad/s^2."
    )
    steering_deg: Annotated[float, Field(gt=0, lt=90)] | None = Field(
        None, description="Largest |steering angle| in degrees, below 90."
    )

    def turn(self) -> tuple[float | None, float | None]:
        """Limits of the steering rate."""
        return self.steering_rate_rad_s, self.steering_acceleration_rad_s2


class CarFile(VehicleFile):
    """A problem file for the car."""

    system: CarTable
    start: CarStart = Field(default_factory=CarStart)
    goal: CarGoal
    limits: CarLimits = Field(default_factory=CarLimits)

    def build_system(self) -> Car:
        """The system described."""
        return Car(self.system.wheelbase_m)

    def angles_deg(self, at: Any) -> list[float]:
        """Steering and heading."""
        return [at.steering_deg, at.heading_deg]

    def joint_limits(self) -> Array:
        """Largest |q|, shape (4,); x and y have none."""
        limits = self.limits
        angles = [*bound_deg(limits.steering_deg, 1), *bound_deg(limits.heading_deg, 1)]
        return np.array([np.inf, *angles, np.inf])
