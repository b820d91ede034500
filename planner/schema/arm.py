"""What the problem files of both arms share: start, goal and limits in joint angles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from planner.schema.base import Table
from planner.schema.file import Free, GoalTable, ProblemFile
from planner.schema.limits import ArmLimits, bound_deg
from planner.schema.workspace import MOST_OBSTACLES, MOST_WAYPOINTS, JointWaypoint, ObstacleTable
from planner.systems.base import Array

AngleDeg = Annotated[float, Field(gt=-90, lt=90)]
MAX_TRAVEL_RAD = 8 * np.pi

MOST_JOINTS = 8
"""The expressions of the chained form are three times as long with each joint more: with eight a
choice of travel takes half a minute already, with twelve nothing answers in that time."""

MOST_RATIO = 1000.0
"""Ratios of an arm's gears are about one; with 1e8 a search goes on for minutes in vain."""

Ratio = Annotated[float, Field(gt=0, le=MOST_RATIO)]
Joints = Annotated[int, Field(ge=2, le=MOST_JOINTS)]


class JointStart(Table):
    """Where the arm starts."""

    theta_deg: list[AngleDeg] = Field(description="Joint angles in degrees, each within (-90, 90).")
    phi_rad: float = Field(0.0, description="Disk angle in radians.")


class JointGoal(GoalTable):
    """Where the arm ends."""

    theta_deg: list[AngleDeg] = Field(description="Joint angles in degrees, each within (-90, 90).")
    travel: Free | float = Field(
        "free", description="Change of the disk angle in radians, or 'free'."
    )

    @field_validator("travel")
    @classmethod
    def _plausible(cls, travel: Free | float) -> Free | float:
        if isinstance(travel, float | int) and abs(travel) > MAX_TRAVEL_RAD:
            raise ValueError(
                f"is in radians and at most {MAX_TRAVEL_RAD:.4g} either way;"
                f" {travel:g} looks like degrees ({np.deg2rad(travel):.4g} rad)"
            )
        return travel


class ArmFile(ProblemFile):
    """A problem file for an arm of `system.joints` joints."""

    start: JointStart
    goal: JointGoal
    limits: ArmLimits = Field(default_factory=ArmLimits)
    waypoints: list[JointWaypoint] = Field(
        default_factory=list,
        max_length=MOST_WAYPOINTS,
        description="Places the motion must pass through.",
    )
    obstacles: list[ObstacleTable] = Field(
        default_factory=list,
        max_length=MOST_OBSTACLES,
        description="Discs in the plane that the links must clear.",
    )

    @model_validator(mode="after")
    def _lengths(self) -> ArmFile:
        n = self.system.joints
        given: list[tuple[str, Sequence[float | str]]] = [
            ("start", self.start.theta_deg),
            ("goal", self.goal.theta_deg),
            *((f"waypoints[{k}]", w.theta_deg) for k, w in enumerate(self.waypoints)),
        ]
        for name, angles in given:
            if len(angles) != n:
                raise ValueError(
                    f"{name}.theta_deg has {len(angles)} angles but system.joints = {n}"
                )
        limit = self.limits.joint_deg
        if isinstance(limit, list) and len(limit) != n:
            raise ValueError(f"limits.joint_deg has {len(limit)} values but system.joints = {n}")
        return self

    def start_state(self) -> Array:
        """q(0), shape (n+1,), radians."""
        return np.array([self.start.phi_rad, *np.deg2rad(self.start.theta_deg)])

    def goal_state(self) -> Array:
        """q(T), shape (n+1,), radians; NaN first, since `travel` speaks of that coordinate."""
        return np.array([np.nan, *np.deg2rad(self.goal.theta_deg)])

    def path_travel(self) -> float | None:
        """Change of the disk angle, radians, or None when free."""
        return None if self.goal.travel == "free" else float(self.goal.travel)

    def travel_change(self, travel: float | None) -> dict[str, Any]:
        """The key that sets the travel, and its value."""
        return {"goal.travel": "free" if travel is None else travel}

    def joint_limits(self) -> Array:
        """Largest |q|, shape (n+1,), radians; infinite where there is none."""
        return np.array([np.inf, *bound_deg(self.limits.joint_deg, self.system.joints)])

    def waypoint_states(self, coordinates: list[str]) -> list[Array]:
        """q of each waypoint, shape (n+1,), radians, NaN where free."""
        out = []
        for point in self.waypoints:
            travel = np.nan if point.travel is None else point.travel
            angles = [np.nan if isinstance(a, str) else np.deg2rad(a) for a in point.theta_deg]
            out.append(np.array([self.start.phi_rad + travel, *angles]))
        return out

    def discs(self) -> list[ObstacleTable]:
        """Obstacles."""
        return self.obstacles
