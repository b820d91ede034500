"""Limits and goals in a system's user coordinates, which are functions of q.

User coordinates that are also triangular need none of this: their limit is a `JointLimit`, and
their value at the goal or at a waypoint is that of q.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from planner.problem.requirements.motion_limits import JointLimit
from planner.problem.requirements.requirement import Breach, MotionPoint, Part, Requirement
from planner.systems.triangular_system import Coordinate


class _UserPart(Requirement):
    """A requirement on user coordinates, given by the parts' indices."""

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """These coordinates as expressions."""
        every = point.system.user_expr(point.q)
        return [every[part.index] for part in self.parts]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """The same values, by the system's NumPy code."""
        every = point.system.user(point.states)
        return [every[..., part.index] for part in self.parts]


class UserLimit(_UserPart, JointLimit):
    """|user coordinate| ≤ most, for user coordinates that are not triangular."""


@dataclass(frozen=True)
class UserGoal(_UserPart):
    """User coordinates that are not triangular have given values at the end.

    Attributes:
        coordinates: The given ones.
        indices: Their indices, from 0.
        targets: Their values, in their units.
    """

    coordinates: tuple[Coordinate, ...]
    indices: tuple[int, ...]
    targets: tuple[float, ...]

    reads, final = frozenset({"q"}), True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part per coordinate, with equal lower and upper limits."""
        terms = zip(self.coordinates, self.indices, self.targets, strict=True)
        return tuple(Part(f"goal {c.name}", c.unit, value, value, 1.0, i) for c, i, value in terms)

    @classmethod
    def easing(cls, breaches: Sequence[Breach]) -> str:
        """The goal changed to the place that the motion reaches."""
        reached = (f"{part.label.removeprefix('goal ')} = {v.value:.4g}" for _, part, v in breaches)
        return f"goal.q with {', '.join(reached)}"
