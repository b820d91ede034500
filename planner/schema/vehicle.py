"""What the problem files of all vehicles share: positions in m, headings in degrees, x as path."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from planner.schema.base import Table
from planner.schema.file import Free, GoalTable, NamedFile
from planner.schema.limits import BaseLimits, Positive, bound
from planner.systems.base import Array

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
        None, description="Largest rate of the speed in m/s^2."
    )
    heading_deg: Annotated[float, Field(gt=0, le=360)] | None = Field(
        None, description="Largest |heading| in degrees."
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
