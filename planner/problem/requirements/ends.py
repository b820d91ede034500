"""Conditions at the ends of a motion (start, goal and duration), and on user coordinates.

User coordinates here are those that are not triangular, and so are functions of q. For a user
coordinate that is also triangular, `JointLimit` holds the limit, and q itself holds the value at
the goal or at a waypoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.errors import Violation
from planner.problem.requirements.motion_limits import JointLimit
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.support.arrays import Array
from planner.systems.triangular_system import Coordinate, arm_points_expr


@dataclass(frozen=True)
class Start(Demand):
    """The motion begins at the start.

    Attributes:
        name: Name of the place in messages.
    """

    name: str = "start"

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the largest error of a coordinate at the start."""
        return (Part(self.name, "", -np.inf, 0.0, 1.0),)


@dataclass(frozen=True)
class Goal(Demand):
    """The motion ends at the goal.

    Attributes:
        coordinates: The coordinates.
        free: Indices of coordinates that the goal leaves free.
        name: Name of the place in messages.
    """

    coordinates: tuple[Coordinate, ...]
    free: tuple[int, ...] = ()
    name: str = "goal"
    at_goal = True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part per coordinate that the goal gives: the coordinate's error."""
        pairs = [(i, c) for i, c in enumerate(self.coordinates) if i not in self.free]
        return tuple(Part(f"{self.name} {c.name}", c.unit, -np.inf, 0.0, 1.0, i) for i, c in pairs)


@dataclass(frozen=True)
class TipGoal(Requirement):
    """The tip of an arm ends at a position, its last link in a direction, or both.

    Attributes:
        quantities: Which of "x", "y" (both or neither) and "angle", in this order.
        targets: Values of the quantities, in metres and radians. The angle sums all joint angles.
        reach: Sum of the links' lengths, metres, which scales position errors: turning the first
            joint of the stretched arm by an angle moves the tip by the angle times the reach.
    """

    quantities: tuple[str, ...]
    targets: tuple[float, ...]
    reach: float

    reads, final, at_goal = frozenset({"q"}), True, True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part per quantity of the tip, with equal lower and upper limits."""
        kinds = {"x": ("m", self.reach), "y": ("m", self.reach), "angle": ("rad", 1.0)}
        pairs = zip(self.quantities, self.targets, strict=True)
        return tuple(Part(f"goal tip {k}", kinds[k][0], v, v, kinds[k][1]) for k, v in pairs)

    @property
    def place(self) -> Array | None:
        """Required position of the tip, shape (2,), metres; None if only the direction matters."""
        return np.array(self.targets[:2]) if "x" in self.quantities else None

    @property
    def angle(self) -> float | None:
        """Required direction of the last link, radians; None if it is free."""
        return self.targets[-1] if "angle" in self.quantities else None

    def __str__(self) -> str:
        words = []
        if self.place is not None:
            words.append(f"at ({self.targets[0]:.4g}, {self.targets[1]:.4g}) m")
        if self.angle is not None:
            words.append(f"at {np.rad2deg(self.angle):.4g} deg")
        return "the tip " + ", ".join(words)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return the required quantities of the tip as expressions."""
        system: Any = point.system
        theta = [point.q[i] for i in range(1, system.size)]
        x, y = arm_points_expr(theta, system.link_lengths)[-1]
        every = {"x": x, "y": y, "angle": sum(theta)}
        return [every[name] for name in self.quantities]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return the required quantities of the tip as arrays, by the arm's NumPy code."""
        system: Any = point.system
        theta = point.states[..., 1:]
        tip = system.arm_points(theta)[..., -1, :]
        every = {"x": tip[..., 0], "y": tip[..., 1], "angle": np.sum(theta, axis=-1)}
        return [every[name] for name in self.quantities]

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise to change the goal to the tip pose that the motion reaches."""
        tip: TipGoal = breaches[0].demand
        reached = {v.part: v.value for v in breaches}
        pose = [reached.get(part, part.low) for part in tip.parts]
        keys = [f"goal.tip_m = [{pose[0]:.4g}, {pose[1]:.4g}]"] if "x" in tip.quantities else []
        keys += [f"goal.tip_angle_deg = {np.rad2deg(pose[-1]):.4g}"] * ("angle" in tip.quantities)
        return " and ".join(keys)


@dataclass(frozen=True)
class Duration(Demand):
    """The motion takes the required time.

    Attributes:
        seconds: Required duration, s.
    """

    seconds: float

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the duration of the motion."""
        return (Part("duration", "s", self.seconds, self.seconds, self.seconds),)


@dataclass(frozen=True)
class LongestDuration(Demand):
    """The whole run takes at most the given time.

    Attributes:
        seconds: Longest duration, s, including what compensation adds.
    """

    seconds: float

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the duration of the whole run."""
        return (Part("duration of the whole run", "s", -np.inf, self.seconds, self.seconds),)

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise to raise the limit to the duration of the run."""
        return f"goal.duration_max = {max(v.value for v in breaches) * 1.0001:.4g}"


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
