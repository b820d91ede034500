"""Limits and goals of user coordinates that are not triangular, and so are functions of q.

For a user coordinate that is also triangular, `JointLimit` holds the limit, and q itself holds the
value at the goal or at a waypoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from planner.errors import Violation
from planner.problem.requirements.motion_limits import JointLimit
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.systems.triangular_system import Coordinate


class _UserPart(Requirement):
    """Requirement on user coordinates; a part's `index` is that of its user coordinate."""

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return the user coordinates of the parts as expressions."""
        every = point.system.user_expr(point.q)
        return [every[part.index] for part in self.parts]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return the user coordinates of the parts as arrays, by the system's NumPy code."""
        every = point.system.user(point.states)
        return [every[..., part.index] for part in self.parts]


class UserLimit(_UserPart, JointLimit):
    """User coordinates that are not triangular keep their limits, |user coordinate| ≤ most."""


@dataclass(frozen=True)
class UserGoal(_UserPart):
    """User coordinates that are not triangular have given values at the end.

    Attributes:
        coordinates: The user coordinates whose value is given.
        indices: Indices of these coordinates among all user coordinates, from 0.
        targets: Values of these coordinates, in their units.
    """

    coordinates: tuple[Coordinate, ...]
    indices: tuple[int, ...]
    targets: tuple[float, ...]

    reads, final, at_goal = frozenset({"q"}), True, True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part per coordinate, with equal lower and upper limits."""
        terms = zip(self.coordinates, self.indices, self.targets, strict=True)
        return tuple(Part(f"goal {c.name}", c.unit, value, value, 1.0, i) for c, i, value in terms)

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise to change the goal to the place that the motion reaches."""
        goal: UserGoal = breaches[0].demand
        names = {i: c.name for i, c in zip(goal.indices, goal.coordinates, strict=True)}
        reached = (f"{names[v.part.index]} = {v.value:.4g}" for v in breaches)
        return f"goal.q with {', '.join(reached)}"
