"""Start, goal and duration: what a motion must be at its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.problem.requirements.requirement import Demand, Part
from planner.systems.triangular_system import Coordinate


@dataclass(frozen=True)
class Start(Demand):
    """The motion begins at the start."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """One: the largest distance of a coordinate."""
        return (Part("start", "", -np.inf, 0.0, 1.0),)


@dataclass(frozen=True)
class Goal(Demand):
    """The motion ends at the goal.

    Attributes:
        named: The coordinates.
    """

    named: tuple[Coordinate, ...]

    @property
    def parts(self) -> tuple[Part, ...]:
        """One for each coordinate: its distance."""
        named = enumerate(self.named)
        return tuple(Part(f"goal {c.name}", c.unit, -np.inf, 0.0, 1.0, i) for i, c in named)


@dataclass(frozen=True)
class Duration(Demand):
    """The motion takes as long as is asked for.

    Attributes:
        seconds: How long.
    """

    seconds: float

    @property
    def parts(self) -> tuple[Part, ...]:
        """One: the difference."""
        return (Part("duration", "s", -np.inf, 0.0, self.seconds),)
