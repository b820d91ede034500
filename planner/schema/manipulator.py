"""The tables of a problem file for `system.kind = "manipulator"`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from planner.schema.arm import MOST_JOINTS, MOST_RATIO, ArmFile, Joints, Ratio
from planner.schema.base import Table
from planner.schema.limits import LimitsTable, Positive
from planner.systems.manipulator import Gear, Manipulator


class GearTable(Table):
    """Gear geometry; lengths share one unit."""

    r1: Positive = Field(description="Radius of disk B.")
    R: Positive = Field(description="Distance from the axle of disk A to its driving contact.")
    r3: Positive = Field(description="Distance from the axle of disk A to the joint's contact.")
    lam: Positive = Field(alias="lambda", description="Bevel and spur gear ratio.")
    eta: Positive = Field(description="Timing belt ratio.")


class ManipulatorTable(Table):
    """The manipulator: its constants, directly or by gear geometry."""

    kind: Literal["manipulator"]
    joints: Joints = Field(description=f"Number of joints n, at most {MOST_JOINTS}.")
    K: list[Ratio] | None = Field(
        None, description=f"K2 ... Kn, n-1 numbers, at most {MOST_RATIO:g}."
    )
    gear: GearTable | None = Field(None, description="Gear geometry in place of K.")
    k_g: Positive | None = Field(
        None, description="Drive constant; needed with K, by rule with gear."
    )
    k_g_rule: Literal["printed", "chain"] = Field(
        "printed",
        description="Default of k_g with gear: rho^2 as printed, or rho^(n-2) by the chain.",
    )
    link_lengths: list[Positive] | None = Field(None, description="Link lengths for drawing.")

    @model_validator(mode="after")
    def _consistent(self) -> ManipulatorTable:
        if (self.K is None) == (self.gear is None):
            raise ValueError("give either K (with k_g) or gear, exactly one of them")
        if self.K is not None and len(self.K) != self.joints - 1:
            raise ValueError(
                f"joints = {self.joints} needs {self.joints - 1} values in K"
                f" (K2 ... K{self.joints}), not {len(self.K)}"
            )
        if self.K is not None and self.k_g is None:
            raise ValueError("K needs k_g beside it")
        if self.link_lengths is not None and len(self.link_lengths) != self.joints:
            raise ValueError(
                f"link_lengths needs {self.joints} values, not {len(self.link_lengths)}"
            )
        return self

    def build(self) -> Manipulator:
        """The system described."""
        if self.gear is not None:
            g = self.gear
            gear = Gear(g.r1, g.R, g.r3, g.lam, g.eta)
            return Manipulator.from_gear(
                self.joints, gear, k_g=self.k_g, rule=self.k_g_rule, link_lengths=self.link_lengths
            )
        assert self.K is not None
        assert self.k_g is not None
        return Manipulator(self.K, self.k_g, self.link_lengths)


class ManipulatorFile(ArmFile):
    """A problem file for the manipulator."""

    system: ManipulatorTable
    limits: LimitsTable = Field(default_factory=LimitsTable)

    def build_system(self) -> Manipulator:
        """The system described."""
        return self.system.build()
