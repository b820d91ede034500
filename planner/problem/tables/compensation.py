"""The `[compensation]` table: which errors of the machine are compensated."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from planner.support.user_tables import Table


class CompensationTable(Table):
    """Options of compensated plans."""

    on: bool = Field(
        False,
        description="Whether plans are compensated for the problem's nominal machine (without"
        " spreads): their inputs are the motor commands, their motion is the one"
        " predicted on that machine.",
    )
    aim: bool = Field(
        True,
        description="Whether to plan for a shifted goal, so that the predicted motion ends at"
        " the real goal.",
    )
    preparation: Literal["forward", "jump", False] = Field(
        "forward",
        description="How backlash and shaft torsion of the joints are taken up. forward: by a"
        " preparatory motion of some seconds, without reversal of the drive. jump:"
        " at the start of the plan, at the limit of input 1. false: not at all.",
    )
    back_off: bool = Field(
        True,
        description="Whether the drive turns back after the plan's end, as far as no joint of"
        " the nominal machine follows. On machines with less lost motion than the"
        " mean, joints that overshot come back. It takes about a second. Not used"
        " if goal.travel is given or if the drive reverses during the plan.",
    )
    lag: bool = Field(
        True,
        description="Whether commands are sent earlier by the lag of hold, delay, servo and"
        " friction.",
    )
    gearheads: bool = Field(
        True,
        description="Whether a motor that reverses crosses the backlash of its gearhead at once.",
    )
