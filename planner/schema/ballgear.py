"""The tables of a problem file for `system.kind = "ball-gear"`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from planner.schema.arm import MOST_JOINTS, MOST_RATIO, ArmFile, Joints, Ratio
from planner.schema.base import Table
from planner.schema.limits import Positive
from planner.systems.ballgear import BallGear


class BallGearTable(Table):
    """Nakamura's manipulator."""

    kind: Literal["ball-gear"]
    joints: Joints = Field(description=f"Number of joints n, at most {MOST_JOINTS}.")
    K: list[Ratio] = Field(description=f"K2 ... Kn, n-1 numbers, at most {MOST_RATIO:g}.")
    k_g: Positive = Field(1.0, description="Drive constant; it only scales u1.")
    link_lengths: list[Positive] | None = Field(None, description="Link lengths for drawing.")

    @model_validator(mode="after")
    def _consistent(self) -> BallGearTable:
        n = self.joints
        if len(self.K) != n - 1:
            raise ValueError(
                f"joints = {n} needs {n - 1} values in K (K2 ... K{n}), not {len(self.K)}"
            )
        if self.link_lengths is not None and len(self.link_lengths) != n:
            raise ValueError(f"link_lengths needs {n} values, not {len(self.link_lengths)}")
        return self


class BallGearFile(ArmFile):
    """A problem file for the ball-gear manipulator."""

    system: BallGearTable

    def build_system(self) -> BallGear:
        """The system described."""
        return BallGear(self.system.K, self.system.k_g, self.system.link_lengths)
