"""The `[[waypoints]]` and `[[obstacles]]` of a problem file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from planner.schema.base import Table

Free = Literal["free"]
Positive = Annotated[float, Field(gt=0)]
AngleDeg = Annotated[float, Field(gt=-90, lt=90)]


MOST_WAYPOINTS, MOST_OBSTACLES = 50, 100
"""A motion through more places has more parts than a mesh has intervals to begin with; each disc
costs a row for each link at each place, and its share of the verification."""


class WaypointTable(Table):
    """A place the motion must pass through."""

    time: Positive | None = Field(
        None,
        description="When, in seconds; needs a fixed goal.duration. Left out: at any time and, with"
        " others of that kind, in any order.",
    )


class NamedWaypoint(WaypointTable):
    """A waypoint by coordinate names."""

    q: dict[str, float] = Field(
        min_length=1,
        description="Some coordinates by name, in their units (rad, m); the rest is free.",
    )


class JointWaypoint(WaypointTable):
    """A waypoint in joint angles."""

    theta_deg: list[AngleDeg | Free] = Field(
        description="Joint angles in degrees, each within (-90, 90), or 'free'."
    )
    travel: float | None = Field(
        None, description="Change of the disk angle since the start in radians; free if left out."
    )

    @field_validator("theta_deg")
    @classmethod
    def _says_something(cls, angles: list[float | str]) -> list[float | str]:
        if all(isinstance(angle, str) for angle in angles):
            raise ValueError("leaves every joint free; give at least one angle")
        return angles


class ObstacleTable(Table):
    """A disc in the arm's plane that every link must clear; the arm's base is the origin."""

    centre_m: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="Its centre [x, y] in metres (in the unit of system.link_lengths, 1 each)."
    )
    radius_m: Positive = Field(description="Its radius in metres.")
