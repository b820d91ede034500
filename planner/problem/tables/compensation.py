"""The `[compensation]` table: which errors of the machine a plan's commands allow for."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from planner.support.user_tables import Table


class CompensationTable(Table):
    """What a compensated plan does about the mean machine."""

    on: bool = Field(
        False,
        description="Whether plans are compensated for the problem's machine with every spread off:"
        " their inputs are what the motors are commanded, their motion is the one predicted on it.",
    )
    aim: bool = Field(
        True,
        description="Whether the plan is made anew for a goal that is shifted until the predicted"
        " motion ends at the goal itself.",
    )
    preparation: Literal["forward", "jump", False] = Field(
        "forward",
        description="How the joints' backlash and shaft torsion are taken up. forward: before the"
        " plan starts, by a drive that does not turn back, which takes some seconds. jump: at its"
        " start, at the limit of input 1. false: not at all.",
    )
    back_off: bool = Field(
        True,
        description="Whether the drive turns back after the plan's end, as far as no joint of the"
        " nominal machine follows: on machines that lose less motion joints have gone too far, and"
        " come back. It takes about a second; not where goal.travel is given, or where the drive"
        " turns back on its way.",
    )
    lag: bool = Field(
        True,
        description="Whether commands come earlier by the lag of hold, delay, servo and friction.",
    )
    gearheads: bool = Field(
        True, description="Whether a motor that reverses crosses its gearhead's backlash at once."
    )
