"""Problem files whose start, goal and limits name coordinates, for systems of users' own classes.

The tables of a problem file for `system.kind = "custom"`: the user's own system by expressions.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from planner.problem.tables.problem_file import (
    BaseLimits,
    Free,
    GoalTable,
    NamedFile,
    PerInput,
    ProblemFile,
    bound,
)
from planner.support.arrays import Array
from planner.support.tables import line
from planner.support.user_tables import Positive, Table, allowed_hint
from planner.systems.custom import CustomSystem
from planner.systems.triangular_system import Coordinate

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Names = Annotated[list[str], Field(min_length=2, max_length=2)]


class CustomTable(Table):
    """A system q1' = drive * u1, q2' = u2, qi' = slope_i * q1' by its expressions."""

    kind: Literal["custom"]
    name: str = Field("custom system", description="Name of the system.")
    coordinates: Annotated[list[str], Field(min_length=3)] = Field(
        description="Names of the coordinates in triangular order."
    )
    units: list[str] = Field(description="Their units; 'rad' is shown in degrees.")
    slopes: list[str] = Field(
        description="f3 ... fN as expressions of the coordinates; f_i may depend on q_(i-1) and"
        " later ones."
    )
    drive: str = Field("1.0", description="Expression of gamma, with q1' = gamma u1.")
    intervals: dict[str, Pair] = Field(
        default_factory=dict,
        description="Open interval of each coordinate but first and last; angles have a default.",
    )
    inputs: Names = Field(default_factory=lambda: ["u1", "u2"], description="Names of the inputs.")
    input_units: Names = Field(default_factory=lambda: ["", ""], description="Their units.")

    @model_validator(mode="after")
    def _check_expressions(self) -> CustomTable:
        if len(self.units) != len(self.coordinates):
            raise ValueError(
                f"units has {len(self.units)} entries for {len(self.coordinates)} coordinates"
            )
        self.build()
        return self

    def build(self) -> CustomSystem:
        """The system described."""
        named = zip(self.coordinates, map(line, self.units), strict=True)
        first, second = zip(map(line, self.inputs), map(line, self.input_units), strict=True)
        return CustomSystem(
            line(self.name),
            [Coordinate(*pair) for pair in named],
            self.slopes,
            self.drive,
            intervals=self.intervals,
            inputs=(Coordinate(*first), Coordinate(*second)),
        )


class CustomStart(Table):
    """Where the system starts."""

    q: dict[str, float] = Field(description="Each coordinate by name, in its unit.")


class CustomGoal(GoalTable):
    """Where the system ends."""

    q: dict[str, float] = Field(description="Each coordinate but the first by name, in its unit.")
    travel: Free | float = Field("free", description="Change of the first coordinate, or 'free'.")


class CustomLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    input: PerInput = Field(None, description="Largest |u1|, |u2|: one number for both, or two.")
    input_rate: PerInput = Field(
        None,
        description="Largest |du/dt|, one number or two: with it, inputs are continuous.",
        examples=[[5.0, 5.0]],
    )
    q: dict[str, Positive] = Field(
        default_factory=dict, description="Largest |coordinate| by name, in its unit."
    )
    z2_margin: Annotated[float, Field(ge=0)] | None = Field(
        None, description="Least |z2|; z2 keeps the sign it has at the start."
    )

    def inputs(self) -> Array:
        """Largest |u|, shape (2,)."""
        return bound(self.input, 2)

    def input_rates(self) -> Array:
        """Largest |du/dt|, shape (2,)."""
        return bound(self.input_rate, 2)

    def least_z2(self) -> float | None:
        """Least |z₂| on the side of the start."""
        return self.z2_margin


class OwnFile(NamedFile):
    """A problem file for a system of your own class, with start, goal and limits by names.

    A subclass gives `summary`, `example`, the table `system`, and `build_system`.
    """

    start: CustomStart
    goal: CustomGoal
    limits: CustomLimits = Field(default_factory=CustomLimits)

    @property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [c.name for c in self.build_system().coordinates]

    @model_validator(mode="after")
    def _check_names(self) -> OwnFile:
        every, tail = self.names, self.names[1:]
        wanted = {"start.q": (self.start.q, every), "goal.q": (self.goal.q, tail)}
        for key, (given, names) in {**wanted, "limits.q": (self.limits.q, tail)}.items():
            for name in given:
                if name not in names:
                    raise ValueError(
                        f"{key} has no coordinate '{name}'; {allowed_hint(name, names)}"
                    )
        for key, (given, names) in wanted.items():
            missing = [name for name in names if name not in given]
            if missing:
                raise ValueError(f"{key} lacks {', '.join(missing)}")
        return self

    def start_state(self) -> Array:
        """q(0), shape (N,)."""
        return np.array([self.start.q[name] for name in self.names])

    def goal_state(self) -> Array:
        """q(T), shape (N,); NaN first, since `travel` speaks of that coordinate."""
        return np.array([np.nan, *(self.goal.q[name] for name in self.names[1:])])

    def path_travel(self) -> float | None:
        """Change of the first coordinate, or None when free."""
        return None if self.goal.travel == "free" else float(self.goal.travel)

    def travel_change(self, travel: float | None) -> dict[str, Any]:
        """The key that sets the travel, and its value."""
        return {"goal.travel": "free" if travel is None else travel}

    def joint_limits(self) -> Array:
        """Largest |q|, shape (N,); infinite where there is none."""
        return np.array([self.limits.q.get(name, np.inf) for name in self.names])


class CustomFile(OwnFile):
    """A problem file for the user's own system, given by expressions."""

    summary: ClassVar[str] = "any triangular two-input system, given by its expressions"

    system: CustomTable

    @property
    def names(self) -> list[str]:
        """As in the table, before the system is built."""
        return self.system.coordinates

    def build_system(self) -> CustomSystem:
        """The system described."""
        return self.system.build()


FILES: dict[str, type[ProblemFile]] = {"custom": CustomFile}
"""By `system.kind`."""
