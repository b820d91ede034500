"""The tables of a problem file for unicycle, car and trailers.

They share positions in m, headings in degrees, and x as the path coordinate.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from planner.problem.tables.problem_file import (
    BaseLimits,
    Free,
    GoalTable,
    NamedFile,
    bound,
    bound_deg,
)
from planner.support.arrays import Array
from planner.support.user_tables import Positive, Table
from planner.systems.vehicles import Car, Trailers, Unicycle

Degrees = Annotated[float, Field(ge=-360, le=360)]
SteeringDeg = Annotated[float, Field(gt=-90, lt=90)]
HitchDeg = Annotated[float, Field(gt=-180, lt=180)]


class PoseStart(Table):
    """Where the vehicle starts."""

    x_m: float = Field(0.0, description="Position along the x axis in m.")
    y_m: float = Field(0.0, description="Position across it in m.")
    heading_deg: Degrees = Field(0.0, description="Heading from the x axis in degrees.")


class PoseGoal(GoalTable):
    """Where the vehicle ends."""

    x_m: Free | float = Field(description="Position along the x axis in m, or 'free'.")
    y_m: float = Field(description="Position across it in m.")
    heading_deg: Degrees = Field(0.0, description="Heading from the x axis in degrees.")


class VehicleLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    speed_m_s: Positive | None = Field(None, description="Largest speed, either way, in m/s.")
    acceleration_m_s2: Positive | None = Field(
        None,
        description="Largest rate of the speed in m/s^2: with it, the speed is continuous.",
        examples=[2.0],
    )
    heading_deg: Annotated[float, Field(gt=0, le=360)] | None = Field(
        None, description="Largest |heading| in degrees.", examples=[80]
    )

    @abstractmethod
    def turn(self) -> tuple[float | None, float | None]:
        """Limit of the turning input and of its rate, rad/s and rad/s²."""

    def inputs(self) -> Array:
        """Largest |u|, shape (2,), m/s and rad/s."""
        return np.array([*bound(self.speed_m_s, 1), *bound(self.turn()[0], 1)])

    def input_rates(self) -> Array:
        """Largest |du/dt|, shape (2,), m/s² and rad/s²."""
        return np.array([*bound(self.acceleration_m_s2, 1), *bound(self.turn()[1], 1)])


class VehicleFile(NamedFile):
    """A problem file whose path coordinate is x: the travel is goal.x_m − start.x_m."""

    start: PoseStart = Field(default_factory=PoseStart)
    goal: PoseGoal

    @abstractmethod
    def angles_deg(self, at: Any) -> list[float]:
        """The angles of `start` or `goal` in triangular order, the heading last."""

    def start_state(self) -> Array:
        """q(0), shape (N,), in m and radians."""
        return np.array([self.start.x_m, *np.deg2rad(self.angles_deg(self.start)), self.start.y_m])

    def goal_state(self) -> Array:
        """q(T), shape (N,); NaN first, since the travel speaks of that coordinate."""
        return np.array([np.nan, *np.deg2rad(self.angles_deg(self.goal)), self.goal.y_m])

    def path_travel(self) -> float | None:
        """goal.x_m − start.x_m in m, or None when free."""
        return None if self.goal.x_m == "free" else float(self.goal.x_m) - self.start.x_m

    def travel_change(self, travel: float | None) -> dict[str, Any]:
        """The key that sets the travel, and its value."""
        return {"goal.x_m": "free" if travel is None else self.start.x_m + travel}


class CarTable(Table):
    """The car."""

    kind: Literal["car"]
    wheelbase_m: Positive = Field(description="Distance between the axles in m.")


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
        None, description="Largest rate of the steering rate in rad/s^2.", examples=[2.0]
    )
    steering_deg: Annotated[float, Field(gt=0, lt=90)] | None = Field(
        None, description="Largest |steering angle| in degrees, below 90."
    )

    def turn(self) -> tuple[float | None, float | None]:
        """Limits of the steering rate."""
        return self.steering_rate_rad_s, self.steering_acceleration_rad_s2


class CarFile(VehicleFile):
    """A problem file for the car."""

    summary: ClassVar[str] = "car, driven at its rear axle and steered at the front"
    example: ClassVar[str] = """
# A car with steered front wheels. x and y are the position of the rear axle.
title = "my car"

[system]
kind = "car"
wheelbase_m = 2.7            # distance between the axles

[start]
x_m = 0.0
y_m = 0.0
heading_deg = 0              # from the x axis
steering_deg = 0

[goal]
x_m = 25.0                   # or "free"
y_m = 3.0
heading_deg = 0
steering_deg = 0
duration = 6.0               # seconds, or "free"

[limits]                     # all are optional
speed_m_s = 5.0
steering_rate_rad_s = 0.5
steering_deg = 35
"""

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


_HITCH = "Hitch angles in degrees, first trailer first; by default all zero."
_HitchLimit = Annotated[float, Field(gt=0, le=180)]


class TrailersTable(Table):
    """The car and its trailers."""

    kind: Literal["trailers"]
    wheelbase_m: Positive = Field(description="Distance between the car's axles in m.")
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
        None, description="Largest |hitch angle| in degrees: one number, or one per trailer."
    )


class TrailersFile(VehicleFile):
    """A problem file for the car with trailers; x, y and heading are the last trailer's."""

    summary: ClassVar[str] = "car with trailers, each hitched to the axle in front of it"
    example: ClassVar[str] = """
# A car with trailers, each hitched to the axle in front of it. x, y and heading belong to the last
# trailer.
title = "my car with trailers"

[system]
kind = "trailers"
wheelbase_m = 2.0            # of the car
trailer_lengths_m = [2.0, 1.5]     # from axle to axle, the first behind the car

[start]
x_m = 0.0
y_m = 0.0
heading_deg = 0              # from the x axis
hitch_deg = [0, 0]           # one angle per trailer
steering_deg = 0

[goal]
x_m = 20.0                   # or "free"
y_m = 3.0
heading_deg = 0
hitch_deg = [0, 0]
steering_deg = 0
duration = 15.0              # seconds, or "free"

[limits]                     # all are optional
speed_m_s = 2.0
steering_rate_rad_s = 1.0
steering_deg = 45
hitch_deg = 60
"""

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


class UnicycleTable(Table):
    """The unicycle; it has no constants."""

    kind: Literal["unicycle"]


class UnicycleLimits(VehicleLimits):
    """Limits every plan must keep at all times; each may be left out."""

    turn_rate_rad_s: Positive | None = Field(None, description="Largest turn rate in rad/s.")
    turn_acceleration_rad_s2: Positive | None = Field(
        None, description="Largest rate of the turn rate in rad/s^2.", examples=[2.0]
    )

    def turn(self) -> tuple[float | None, float | None]:
        """Limits of the turn rate."""
        return self.turn_rate_rad_s, self.turn_acceleration_rad_s2


class UnicycleFile(VehicleFile):
    """A problem file for the unicycle."""

    summary: ClassVar[str] = "robot with two driven wheels"
    example: ClassVar[str] = """
# The unicycle: a robot with two driven wheels. It drives along its heading and turns on the spot.
title = "my unicycle"

[system]
kind = "unicycle"

[start]
x_m = 0.0
y_m = 0.0
heading_deg = 0              # from the x axis

[goal]
x_m = 2.0                    # or "free"
y_m = 1.0
heading_deg = 0
duration = 5.0               # seconds, or "free"

[limits]                     # all are optional
speed_m_s = 1.0
turn_rate_rad_s = 1.0
"""

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
