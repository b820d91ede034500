"""Places a motion must pass through, and discs that the links of an arm must clear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from planner.errors import Violation
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.support.arrays import Array, frozen
from planner.support.casadi import ca
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class Waypoint(Demand):
    """The motion passes through a place.

    Attributes:
        number: Number in the problem file, from 1.
        user: User coordinates, shape (N,), NaN if free.
        time_s: Time of passing, s; None if free.
        unit: Unit of the given coordinates; empty if they differ.
        system: The system.
    """

    number: int
    user: Array
    time_s: float | None
    unit: str
    system: TriangularSystem

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the distance from the waypoint."""
        return (Part(f"distance from waypoint {self.number}", self.unit, -np.inf, 0.0, 1.0),)

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise to leave out the waypoints that the motion misses."""
        numbers = sorted({v.demand.number for v in breaches})
        return f"leave out [[waypoints]] {' and '.join(map(str, numbers))}"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change that removes all waypoints."""
        return {"waypoints": []}, "", "the waypoints"

    @cached_property
    def q(self) -> Array:
        """Coordinates q that the waypoint determines, shape (N,); NaN if free."""
        return frozen(self.system.fixed_by(self.user))

    @cached_property
    def beside_q(self) -> tuple[int, ...]:
        """Indices of given user coordinates that are not triangular; empty if all are given."""
        indices = np.flatnonzero(~np.isnan(self.user)).tolist()
        some = len(indices) < len(self.user)
        return tuple(i for i in indices if some and i not in self.system.shared)

    def distance(self, q: Array) -> Array:
        """Return the largest error of the given user coordinates at q (…, N), shape (…,)."""
        return np.asarray(np.nanmax(np.abs(self.system.user(q) - self.user), axis=-1))


@dataclass(frozen=True)
class Obstacle(Requirement):
    """The links of an arm keep clear of a disc.

    Attributes:
        number: Number in the problem file, from 1.
        links: Number of the arm's links.
        x: x of the centre, metres.
        y: y of the centre, metres.
        radius: Radius, metres.
        clearance: Least distance between links and disc, metres.
        reach: Length of the stretched arm, metres, by which an excess is divided.
    """

    number: int
    links: int
    x: float
    y: float
    radius: float
    clearance: float = 0.0
    reach: float = 1.0

    reads = frozenset({"q"})
    row_fields = ("x", "y", "radius", "clearance")
    divides, smooth, solid = True, False, True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part per link: the link's distance from the disc."""
        words = f"from obstacle {self.number}"
        return tuple(
            Part(f"clearance of link {link} {words}", "m", self.clearance, np.inf, self.reach)
            for link in range(1, 1 + self.links)
        )

    @property
    def thickness(self) -> float:
        """Least distance between links and the disc's centre, metres."""
        return self.radius + self.clearance

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise a smaller clearance; name the discs if links touch them."""
        if touched := {v.demand.number for v in breaches if v.value <= 0}:
            several = "s" if len(touched) > 1 else ""
            return f"obstacle{several} {' and '.join(map(str, sorted(touched)))} elsewhere"
        return f"obstacles.clearance_m = {0.999 * min(v.value for v in breaches):.4g} or less"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change that removes all obstacles."""
        return {"obstacles": []}, "", "the obstacles"

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return for each link an expression close to the link's distance near the clearance.

        For a link from P in direction e with length l and the centre C, the nearest point is at t =
        clip((C − P)·e, 0, l), and the squared distance is |P − C|² + 2t (P − C)·e + t². Let R be
        radius plus clearance. (distance² − R²)/(2R) is smooth where the distance is zero, and has
        the slope of the distance where the distance is R. The clearance is added.
        """
        system: Any = point.system
        offset: list[Any] = [-self.x, -self.y]
        apart = self.thickness
        heading: Any = 0.0
        out = []
        for i, length in enumerate(system.link_lengths, 1):
            heading = heading + point.q[i]
            c, s = ca.cos(heading), ca.sin(heading)
            along = offset[0] * c + offset[1] * s
            t = ca.fmin(ca.fmax(-along, 0.0), length)
            square = offset[0] ** 2 + offset[1] ** 2 + 2 * t * along + t**2
            out.append((square - apart**2) / (2 * apart) + self.clearance)
            offset = [offset[0] + length * c, offset[1] + length * s]
        return out

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return the distance of each link from the disc, negative inside, metres."""
        system: Any = point.system
        return list(np.moveaxis(self.clearances(system.arm_points(point.states[..., 1:])), -1, 0))

    def contradiction_text(self, name: str, v: Violation) -> str:
        """Return words on a link too near at start, goal or waypoint, and what to change."""
        link = next(k for k, part in enumerate(self.parts, 1) if part.label == v.label)
        if v.value > 0:
            near = f"is {v.value:.3g} m from obstacle {self.number}, clearance_m = {v.limit:g}"
            lower = f"lower clearance_m to {0.999 * v.value:.4g} or less"
            return f"at the {name} link {link} {near}; move the {name} or the obstacle, or {lower}"
        into = f"{-v.value:.3g} m into obstacle {self.number}"
        return f"at the {name} link {link} reaches {into}; move the {name} or the obstacle"

    def values_out_of_reach(self, system: TriangularSystem) -> Sequence[float] | None:
        """Return a lower bound of each link's distance if no link can reach the disc; else None."""
        reach = float(np.sum(system.link_lengths))  # type: ignore[attr-defined]
        near = float(np.hypot(self.x, self.y)) - self.radius
        free = near - self.clearance > reach * (1 + 1e-9)
        return [near - reach] * self.links if free else None

    @property
    def centre(self) -> Array:
        """Centre of the disc, shape (2,), metres."""
        return np.array([self.x, self.y])

    def clearances(self, points: Array) -> Array:
        """Return the distance of each link from the disc, negative inside, shape (…, L).

        Args:
            points: Ends of the links in order, shape (…, L+1, 2), metres.
        """
        nearest = nearest_on_segment(self.centre, points[..., :-1, :], points[..., 1:, :])
        return np.asarray(np.linalg.norm(nearest - self.centre, axis=-1) - self.radius)


def nearest_on_segment(point: Array, first: Array, last: Array) -> Array:
    """Return the point of a segment that is nearest to a given point; all of shape (…, 2)."""
    step = last - first
    length = np.sum(step**2, axis=-1)
    share = np.sum((point - first) * step, axis=-1) / np.where(length > 0, length, 1.0)
    return np.asarray(first + np.clip(share, 0.0, 1.0)[..., None] * step)
