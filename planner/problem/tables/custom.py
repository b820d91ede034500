"""Problem files whose start, goal and limits name coordinates, for systems of users' own classes.

These names are user coordinates. Only this module converts them to triangular ones. If a place
gives all user coordinates, they determine q. Otherwise only those that are also triangular
determine a part of q, and each of the others becomes a requirement
(`planner.problem.requirements.ends`).

The module also has the tables for `system.kind = "custom"`, a system given by expressions, and for
the coin.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
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
)
from planner.support.arrays import Array
from planner.support.tables import line
from planner.support.user_tables import Pair, Positive, Table, allowed_hint
from planner.systems.coin import Coin
from planner.systems.custom import CustomSystem
from planner.systems.triangular_system import Coordinate, TriangularSystem
from planner.systems.user_map import ROUND_TRIP, pairs_of

Names = Annotated[list[str], Field(min_length=2, max_length=2)]


class UserTable(Table):
    """User-defined coordinates of a problem file, with the map to and from the triangular ones."""

    coordinates: list[str]
    """Names of the user coordinates, as many as there are triangular ones."""
    units: list[str]
    """Their units; 'rad' is shown in degrees."""
    expressions: list[str]
    """Each user coordinate as an expression of the triangular coordinates."""
    inverse: list[str]
    """Each triangular coordinate as an expression of the user coordinates, in triangular order."""

    def as_lines(self) -> dict[str, list[str]]:
        """Return the table as a dict, each text reduced to one line."""
        return {key: list(map(line, texts)) for key, texts in self.model_dump().items()}


class CustomTable(Table):
    """A system q1' = drive * u1, q2' = u2, qi' = slope_i * q1', given by expressions."""

    kind: Literal["custom"]
    name: str = "custom system"
    """Name of the system."""
    coordinates: Annotated[list[str], Field(min_length=3)]
    """Names of the coordinates in triangular order."""
    units: list[str]
    """Their units; 'rad' is shown in degrees."""
    slopes: list[str]
    """f3 ... fN as expressions of the coordinates; f_i may depend on q_(i-1) and later ones."""
    drive: str = "1.0"
    """Expression of gamma, with q1' = gamma u1."""
    intervals: dict[str, Pair] = Field(default_factory=dict)
    """Open interval of each coordinate but first and last; angles have a default."""
    inputs: Names = Field(default_factory=lambda: ["u1", "u2"])
    """Names of the inputs."""
    input_units: Names = Field(default_factory=lambda: ["", ""])
    """Their units."""

    user: UserTable | None = None
    """Your own coordinates, if the file does not use the triangular ones."""

    @model_validator(mode="after")
    def _check_expressions(self) -> CustomTable:
        if len(self.units) != len(self.coordinates):
            raise ValueError(
                f"units has {len(self.units)} entries for {len(self.coordinates)} coordinates"
            )
        assert self.built
        return self

    @cached_property
    def built(self) -> CustomSystem:
        """The system that the table describes."""
        named = zip(self.coordinates, map(line, self.units), strict=True)
        first, second = zip(map(line, self.inputs), map(line, self.input_units), strict=True)
        return CustomSystem(
            line(self.name),
            [Coordinate(*pair) for pair in named],
            self.slopes,
            self.drive,
            intervals=self.intervals,
            inputs=(Coordinate(*first), Coordinate(*second)),
            user=None if self.user is None else self.user.as_lines(),
        )


class CustomStart(Table):
    """Where the system starts."""

    q: dict[str, float]
    """Each coordinate by name, in its unit."""


class CustomGoal(GoalTable):
    """Where the system ends."""

    q: dict[str, Free | float]
    """Each coordinate but the first by name, in its unit; user coordinates may be 'free'."""
    travel: Free | float = "free"
    """Change of the first triangular coordinate, or 'free'."""


class CustomLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    inputs = "input", "input"
    rates = "input_rate", "input_rate"

    input: PerInput = None
    """Largest |u1|, |u2|: one number for both, or two."""
    input_rate: PerInput = Field(None, examples=[[5.0, 5.0]])
    """Largest |du/dt|, one number or two: with it, inputs are continuous."""
    q: dict[str, Positive] = Field(default_factory=dict)
    """Largest |coordinate| by name, in its unit."""
    z2_margin: Annotated[float, Field(ge=0)] | None = None
    """Least |z2|; z2 keeps the sign it has at the start."""


class OwnFile(NamedFile):
    """A problem file for a system of your own class, with start, goal and limits by name.

    A subclass gives `summary`, `example`, the table `system`, and `build_system`.
    """

    start: CustomStart
    goal: CustomGoal
    limits: CustomLimits = Field(default_factory=CustomLimits)

    @cached_property
    def built(self) -> TriangularSystem:
        """The system that the tables describe, built once."""
        return self.build_system()

    @property
    def names(self) -> list[str]:
        """Names of the user coordinates."""
        return [c.name for c in self.built.user_coordinates]

    @property
    def path_index(self) -> int | None:
        """Index of the user coordinate that is the path coordinate q₁; None without one."""
        return next((i for i, j in self.built.shared.items() if j == 0), None)

    @model_validator(mode="after")
    def _check_names(self) -> OwnFile:
        every, path = self.names, self.path_index
        rest = [name for i, name in enumerate(every) if i != path]
        limited = rest if not self.built.has_user_coordinates else every
        tables: dict[str, tuple[Mapping[str, Any], list[str]]] = {
            "start.q": (self.start.q, every),
            "goal.q": (self.goal.q, rest),
        }
        for key, (given, names) in {**tables, "limits.q": (self.limits.q, limited)}.items():
            for name in given:
                if name not in names:
                    raise ValueError(
                        f"{key} has no coordinate '{name}'; {allowed_hint(name, names)}"
                    )
        for key, (given, names) in tables.items():
            missing = [name for name in names if name not in given]
            if missing:
                raise ValueError(f"{key} lacks {', '.join(missing)}")
        self._check_goal(path)
        return self

    def _check_goal(self, path: int | None) -> None:
        free = [name for name, value in self.goal.q.items() if value == "free"]
        if free and not self.built.has_user_coordinates:
            raise ValueError(f"goal.q.{free[0]} = 'free': give it a number")
        if path is None and self.goal.travel != "free":
            raise ValueError(
                "leave out goal.travel; goal.q determines it, since"
                f" {self.built.coordinates[0].name} is not a user coordinate"
            )
        if np.all(np.isnan(self.user_goal())):
            raise ValueError("goal.q leaves every coordinate free; give at least one")
        for key, w in (("start.q", self._user_start()), ("goal.q", self.user_goal())):
            if np.all(np.isfinite(w)):
                again = self.built.user(self.built.from_user(w))
                if not np.all(np.abs(again - w) <= ROUND_TRIP * (1 + np.abs(w))):
                    raise ValueError(
                        f"{key}: the map to triangular coordinates and back gives another point,"
                        f" {pairs_of(self.built.user_coordinates, again)}"
                    )

    def _user_start(self) -> Array:
        return np.array([self.start.q[name] for name in self.names])

    def start_state(self) -> Array:
        """Return q(0), shape (N,)."""
        return self.built.from_user(self._user_start())

    def user_goal(self) -> Array:
        """Return the goal in user coordinates, shape (N,), NaN if free."""
        values = {name: value for name, value in self.goal.q.items() if value != "free"}
        w = np.array([values.get(name, np.nan) for name in self.names], dtype=float)
        if (path := self.path_index) is not None and self.goal.travel != "free":
            w[path] = self.start.q[self.names[path]] + self.goal.travel
        return w

    def path_key(self) -> tuple[str, float]:
        """Return the dotted key that sets q₁(T), if q₁ is a user coordinate, and its zero."""
        key, zero = super().path_key()
        return "" if self.path_index is None else key, zero

    def joint_limits(self) -> Array:
        """Return the largest |q|, shape (N,); infinite without a limit."""
        most = np.full(len(self.names), np.inf)
        shared = self.built.shared
        most[list(shared.values())] = self.user_limits()[list(shared)]
        return most

    def user_limits(self) -> Array:
        """Return the largest |user coordinate|, shape (N,); infinite without a limit."""
        return np.array([self.limits.q.get(name, np.inf) for name in self.names])

    def limit_key(self, coordinate: str) -> str:
        """Return the key of a coordinate's limit."""
        return f"q.{coordinate}"


class CustomFile(OwnFile):
    """A problem file for the user's own system, given by expressions."""

    summary: ClassVar[str] = "any triangular two-input system, given by its expressions"

    system: CustomTable

    def build_system(self) -> CustomSystem:
        """Build the system that the tables describe."""
        return self.system.built


class CoinTable(Table):
    """Constants of the coin."""

    kind: Literal["coin"]
    radius_m: Positive
    """Radius of the coin in m."""


class CoinFile(OwnFile):
    """A problem file for the coin; its coordinates are x, y, heading and roll."""

    summary: ClassVar[str] = "coin that rolls upright, in the position of its contact"

    system: CoinTable

    def build_system(self) -> Coin:
        """Build the system that the tables describe."""
        return Coin(self.system.radius_m)


FILES: dict[str, type[ProblemFile]] = {"custom": CustomFile, "coin": CoinFile}
"""Classes of the problem files of this module, by `system.kind`."""
