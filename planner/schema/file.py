"""The problem file: the tables all systems share, and the hooks each system fills in."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from planner.schema.base import Table, nearest
from planner.schema.feedback import FeedbackTable
from planner.schema.limits import BaseLimits
from planner.schema.machine import MachineTable
from planner.schema.methods import MethodsTable
from planner.schema.workspace import MOST_WAYPOINTS, NamedWaypoint, ObstacleTable
from planner.systems.base import Array, TriangularSystem

Free = Literal["free"]


class GoalTable(Table):
    """What every goal says."""

    duration: Free | Annotated[float, Field(gt=0)] = Field(
        10.0, description="Duration in seconds, or 'free'."
    )


class ProblemFile(Table):
    """A problem file; one subclass a system kind, which types the tables left open here."""

    title: str = Field("", description="One line that says what the problem shows.")
    system: Any
    start: Any
    goal: Any
    limits: BaseLimits
    method: MethodsTable = Field(default_factory=MethodsTable)
    machine: MachineTable = Field(default_factory=MachineTable)
    feedback: FeedbackTable = Field(default_factory=FeedbackTable)
    waypoints: Any = Field(default_factory=list, description="Places to pass through.")

    @abstractmethod
    def build_system(self) -> TriangularSystem:
        """The system described."""

    @abstractmethod
    def start_state(self) -> Array:
        """q(0), shape (N,)."""

    @abstractmethod
    def goal_state(self) -> Array:
        """q(T), shape (N,), NaN for the path coordinate."""

    @abstractmethod
    def path_travel(self) -> float | None:
        """q₁(T) − q₁(0), or None when free."""

    @abstractmethod
    def travel_change(self, travel: float | None) -> dict[str, Any]:
        """The dotted key that sets this travel (None: free), and its value."""

    @abstractmethod
    def joint_limits(self) -> Array:
        """Largest |q|, shape (N,), infinite where there is none."""

    @abstractmethod
    def waypoint_states(self, coordinates: list[str]) -> list[Array]:
        """q of each waypoint, shape (N,), NaN where free.

        Raises:
            ValueError: If one names a coordinate that there is not.
        """

    def discs(self) -> list[ObstacleTable]:
        """Obstacles; only arms have links that could touch them."""
        return []


class NamedFile(ProblemFile):
    """A problem file whose waypoints name coordinates."""

    waypoints: list[NamedWaypoint] = Field(
        default_factory=list,
        max_length=MOST_WAYPOINTS,
        description="Places the motion must pass through.",
    )

    def waypoint_states(self, coordinates: list[str]) -> list[Array]:
        """q of each waypoint, shape (N,), NaN where free."""
        for number, point in enumerate(self.waypoints):
            for name in point.q:
                if name not in coordinates:
                    raise ValueError(
                        f"waypoints[{number}].q has no coordinate '{name}';"
                        f" {nearest(name, coordinates)}"
                    )
        return [np.array([p.q.get(name, np.nan) for name in coordinates]) for p in self.waypoints]
