"""The `[feedback]` table: the tracker that closes the loop."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from planner.schema.base import Table


class FeedbackTable(Table):
    """Options of the receding-horizon tracker."""

    period_s: Annotated[float, Field(gt=0, le=1)] = Field(
        0.1, description="Time between two readings of the encoders, seconds."
    )
    latency_s: Annotated[float, Field(ge=0, le=1)] = Field(
        0.01,
        description="Time from a reading to the first command that follows from it, seconds;"
        " rounded up to the machine's control period.",
    )
    horizon_s: Annotated[float, Field(gt=0, le=60)] = Field(
        1.0,
        description="How far ahead limits are looked at, seconds. The cost looks to the end.",
    )
    overtime_s: Annotated[float, Field(ge=0, le=60)] = Field(
        0.3,
        description="How long it goes on correcting after the plan's end, seconds; no longer than a"
        " replay's settle time, or the rest is cut off.",
    )
    run_up: Literal["auto"] | bool = Field(
        "auto",
        description="Whether the arm goes back and returns before the plan's start, so that play"
        " and wind-up are taken up. auto: where the machine's passive joints have any, there are at"
        " most two of them, and the plan's drive keeps one direction.",
    )
    path_error_deg: Annotated[float, Field(gt=0)] = Field(
        0.1,
        description="Error on the way that weighs as much as one unit of correction, degrees (a"
        " length in metres counts as an angle in radians).",
    )
    goal_error_deg: Annotated[float, Field(gt=0)] = Field(
        0.02,
        description="The same at the end, degrees: the smaller, the further theta1 leaves its path"
        " so that all joints arrive.",
    )
    correction: Annotated[float, Field(gt=0)] = Field(
        0.2, description="Unit of correction, as a part of each input's limit (or of its peak)."
    )
    correction_step: Annotated[float, Field(gt=0)] = Field(
        0.05,
        description="Unit of its change from one period to the next, likewise: the smaller, the"
        " less the joints' shafts are made to swing.",
    )
    least_speed: Annotated[float, Field(ge=0, le=1)] = Field(
        0.5,
        description="Least speed along the path, as a part of the plan's: the drive neither stops"
        " nor turns back on its way, since turning back costs all play.",
    )
    take_up_play: bool = Field(
        True, description="Whether commands that reverse a motor first cross its gearhead's play."
    )
    max_iterations: Annotated[int, Field(ge=10)] = Field(
        2000, description="Iterations after which a quadratic programme counts as late."
    )
