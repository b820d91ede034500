"""The problem file: the tables all systems share, and the hooks each system fills in."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from planner.schema.base import Table
from planner.schema.limits import LimitsTable
from planner.schema.machine import MachineTable
from planner.schema.methods import MethodsTable
from planner.systems.base import Array, TriangularSystem

Travel = Literal["free"] | float
MAX_TRAVEL_RAD = 8 * np.pi


class GoalTable(Table):
    """What every goal says."""

    travel: Travel = "free"
    duration: Literal["free"] | Annotated[float, Field(gt=0)] = Field(
        10.0, description="Duration in seconds, or 'free'."
    )

    @field_validator("travel")
    @classmethod
    def _plausible(cls, travel: Travel) -> Travel:
        if isinstance(travel, float | int) and abs(travel) > MAX_TRAVEL_RAD:
            raise ValueError(
                f"is in radians and at most {MAX_TRAVEL_RAD:.4g} either way;"
                f" {travel:g} looks like degrees ({np.deg2rad(travel):.4g} rad)"
            )
        return travel


class ProblemFile(Table):
    """A problem file; one subclass a system kind."""

    title: str = Field("", description="One line that says what the problem shows.")
    system: Any
    start: Any
    goal: Any
    limits: LimitsTable = Field(default_factory=LimitsTable)
    method: MethodsTable = Field(default_factory=MethodsTable)
    machine: MachineTable = Field(default_factory=MachineTable)

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
    def joint_limits(self) -> Array:
        """Largest |q|, shape (N,), infinite where there is none."""
