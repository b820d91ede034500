"""The tables of a problem file for `system.kind = "manipulator"`."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from planner.schema.base import Table
from planner.schema.file import GoalTable, ProblemFile, Travel
from planner.systems.base import Array
from planner.systems.manipulator import Gear, Manipulator

Positive = Annotated[float, Field(gt=0)]
AngleDeg = Annotated[float, Field(gt=-90, lt=90)]


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
    joints: Annotated[int, Field(ge=2, le=20)] = Field(description="Number of joints n.")
    K: list[Positive] | None = Field(None, description="K2 ... Kn, n-1 numbers.")
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


class JointStart(Table):
    """Where the arm starts."""

    theta_deg: list[AngleDeg] = Field(description="Joint angles in degrees, each within (-90, 90).")
    phi_rad: float = Field(0.0, description="Disk angle in radians.")


class JointGoal(GoalTable):
    """Where the arm ends."""

    theta_deg: list[AngleDeg] = Field(description="Joint angles in degrees, each within (-90, 90).")
    travel: Travel = Field("free", description="Change of the disk angle in radians, or 'free'.")


class ManipulatorFile(ProblemFile):
    """A problem file for the manipulator."""

    system: ManipulatorTable
    start: JointStart
    goal: JointGoal

    @model_validator(mode="after")
    def _lengths(self) -> ManipulatorFile:
        n = self.system.joints
        for name, angles in (("start", self.start.theta_deg), ("goal", self.goal.theta_deg)):
            if len(angles) != n:
                raise ValueError(
                    f"{name}.theta_deg has {len(angles)} angles but system.joints = {n}"
                )
        limit = self.limits.joint_deg
        if isinstance(limit, list) and len(limit) != n:
            raise ValueError(f"limits.joint_deg has {len(limit)} values but system.joints = {n}")
        return self

    def build_system(self) -> Manipulator:
        """The system described."""
        return self.system.build()

    def start_state(self) -> Array:
        """q(0), shape (n+1,), radians."""
        return np.array([self.start.phi_rad, *np.deg2rad(self.start.theta_deg)])

    def goal_state(self) -> Array:
        """q(T), shape (n+1,), radians; NaN first, since `travel` speaks of that coordinate."""
        return np.array([np.nan, *np.deg2rad(self.goal.theta_deg)])

    def joint_limits(self) -> Array:
        """Largest |q|, shape (n+1,), radians; infinite where there is none."""
        limit = np.inf if self.limits.joint_deg is None else np.deg2rad(self.limits.joint_deg)
        return np.concatenate([[np.inf], np.broadcast_to(limit, self.system.joints)])
