"""The `[limits]` table."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from planner.schema.base import Table

Positive = Annotated[float, Field(gt=0)]


class LimitsTable(Table):
    """Limits every plan must keep at all times; each may be left out."""

    input_rad_s: Positive | list[Positive] | None = Field(
        None, description="Largest |u1|, |u2| in rad/s: one number for both, or two."
    )
    input_rate_rad_s2: Positive | list[Positive] | None = Field(
        None, description="Largest |du/dt| in rad/s^2: one number for both inputs, or two."
    )
    joint_deg: (
        Annotated[float, Field(gt=0, lt=90)] | list[Annotated[float, Field(gt=0, lt=90)]] | None
    ) = Field(None, description="Largest |theta| in degrees, below 90: one number, or one a joint.")
    z2_margin: Annotated[float, Field(ge=0)] | None = Field(
        None, description="Keep z2 at least this far from zero, on the side it starts on."
    )
