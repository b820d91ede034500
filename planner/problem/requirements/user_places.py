"""Limits and places in a system's user coordinates: functions of q, as is the place of a tip.

A user coordinate that is a triangular one too needs none of this: its limit is a `JointLimit`, and
its value at the goal or at a waypoint is q's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from planner.problem.requirements.limits import JointLimit
from planner.problem.requirements.requirement import Breach, MotionPoint, Part, Requirement
from planner.systems.triangular_system import Coordinate


class _UserPart(Requirement):
    """What concerns user coordinates, those of the parts' indices."""

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """These coordinates as expressions."""
        every = point.system.user_expr(point.q)
        return [every[part.index] for part in self.parts]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """The same by the system's NumPy code."""
        every = point.system.user(point.states)
        return [every[..., part.index] for part in self.parts]


class UserLimit(_UserPart, JointLimit):
    """|user coordinate| ≤ most, of those that are no triangular ones."""


@dataclass(frozen=True)
class UserGoal(_UserPart):
    """User coordinates that are no triangular ones have these values at the end.

    Attributes:
        coordinates: Those that are given.
        indices: Which they are, from 0.
        targets: Their values, in their units.
    """

    coordinates: tuple[Coordinate, ...]
    indices: tuple[int, ...]
    targets: tuple[float, ...]

    reads, final = frozenset({"q"}), True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One for each: it lies neither below nor above."""
        given = zip(self.coordinates, self.indices, self.targets, strict=True)
        return tuple(Part(f"goal {c.name}", c.unit, value, value, 1.0, i) for c, i, value in given)

    @classmethod
    def easing(cls, broken: Sequence[Breach]) -> str:
        """The place that the motion reaches."""
        reached = (f"{part.label.removeprefix('goal ')} = {v.value:.4g}" for _, part, v in broken)
        return f"goal.q with {', '.join(reached)}"
