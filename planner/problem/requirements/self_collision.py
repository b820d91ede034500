"""Keep the links of an arm clear of each other.

If two links do not cross, their closest points include an end of one of them. So links keep a
distance c > 0 if the ends of each keep that distance from the other: before the links could cross,
an end of one would have to touch the other. The requirement therefore limits the distances of
joints (and the tip) from links. Neighbours share a joint and are not checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import Violation
from planner.problem.requirements.places import nearest_on_segment
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.support.arrays import Array, frozen
from planner.support.casadi import ca
from planner.systems.triangular_system import TriangularSystem, arm_points_expr

Pair = tuple[int, int]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class SelfCollision(Requirement):
    """Links of an arm that are not neighbours stay apart.

    Attributes:
        links: Number of the arm's links; with fewer than three, all are neighbours.
        clearance: Least distance, metres.
    """

    links: int
    clearance: float

    reads = frozenset({"q"})
    row_fields = ("clearance",)
    smooth = False
    key = "self_clearance_m"

    @classmethod
    def of(cls, value: Any, system: TriangularSystem) -> SelfCollision:
        """Build the requirement from the clearance `value`, metres.

        Raises:
            ValueError: If all links are neighbours, or a link between two is too short.
        """
        lengths = system.link_lengths  # type: ignore[attr-defined]
        if len(lengths) < 3:
            raise ValueError(f"an arm of {len(lengths)} links has only neighbouring links")
        if value >= (least := float(np.min(lengths[1:-1]))):
            raise ValueError(
                f"{value:g} m must be less than the shortest inner link, {least:g} m: the links at"
                " the two ends of that link are never farther apart"
            )
        return cls(len(lengths), float(value))

    @cached_property
    def link_pairs(self) -> list[Pair]:
        """Pairs of links that are not neighbours, numbered from 1."""
        pairs = product(range(1, self.links + 1), repeat=2)
        return frozen([(i, j) for i, j in pairs if j >= i + 2])

    @cached_property
    def joint_link_pairs(self) -> dict[Pair, list[Pair]]:
        """Pairs of a joint (from 0; the last is the tip) and a link (from 1) that stay apart.

        Each pair maps to the pairs of links that could cross if joint and link touched.
        """
        out: dict[Pair, list[Pair]] = {}
        for i, j in self.link_pairs:
            for end in _joints_of_pair((i, j)):
                out.setdefault(end, []).append((i, j))
        return frozen(dict(sorted(out.items())))

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part for each pair of a joint (or the tip) and a link that is not adjacent."""
        limit = Part("", "m", self.clearance, np.inf, self.clearance, key=f"limits.{self.key}")
        names = (" from ".join(self._names(pair)) for pair in self.joint_link_pairs)
        return tuple(replace(limit, label=f"clearance of {each}") for each in names)

    def _names(self, pair: Pair) -> tuple[str, str]:
        place, link = pair
        return "the tip" if place == self.links else f"joint {place + 1}", f"link {link}"

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise a smaller clearance of the links, or another motion if links cross."""
        least = min(v.value for v in breaches)
        if least > 0:
            return f"limits.{cls.key} = {0.999 * least:.4g} or less"
        return "another start or goal"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change of the problem file that removes the links' clearance."""
        return {f"limits.{self.key}": None}, "", "the links' clearance"

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return for each part an expression that is close to the distance near the clearance c.

        (distance² + c²)/(2c) is smooth where the distance is zero; at distance c it has the value
        and slope of the distance. If two links cross, the distance counts as negative and is that
        of the nearest of their ends, which is the shortest way to separate them.
        """
        system: Any = point.system
        points = arm_points_expr([point.q[i] for i in range(1, system.size)], system.link_lengths)
        square = {
            (place, link): _squared_distance(points[place], points[link - 1], points[link])
            for place, link in self.joint_link_pairs
        }
        cross, deep = {}, {}
        for i, j in self.link_pairs:
            a, b, c, d = points[i - 1], points[i], points[j - 1], points[j]
            apart = _side(a, b, c) * _side(a, b, d), _side(c, d, a) * _side(c, d, b)
            cross[i, j] = ca.logic_and(apart[0] < 0, apart[1] < 0)
            ends = [square[end] for end in _joints_of_pair((i, j))]
            deep[i, j] = ca.fmin(ca.fmin(ends[0], ends[1]), ca.fmin(ends[2], ends[3]))
        out = []
        for end, pairs in self.joint_link_pairs.items():
            value = square[end]
            for pair in pairs:
                value = ca.if_else(cross[pair], -deep[pair], value)
            out.append((value + self.clearance**2) / (2 * self.clearance))
        return out

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return the distance of each part, metres; negative if the links cross."""
        system: Any = point.system
        return list(self.distances(system.arm_points(point.states[..., 1:])))

    def distances(self, points: Array) -> Array:
        """Return the distances of the R parts, shape (R, …), as in `values`.

        Args:
            points: Base, joints and tip, shape (…, n+1, 2), metres.
        """
        i, j = np.array(self.link_pairs).T
        a, b, c, d = (points[..., k, :] for k in (i - 1, i, j - 1, j))
        one = _cross_product(b - a, c - a) * _cross_product(b - a, d - a)
        other = _cross_product(d - c, a - c) * _cross_product(d - c, b - c)
        place, link = np.array(list(self.joint_link_pairs)).T
        spot = points[..., place, :]
        gap = nearest_on_segment(spot, points[..., link - 1, :], points[..., link, :]) - spot
        away, (ends, pairs) = np.linalg.norm(gap, axis=-1), self._numbers
        inside = np.where((one < 0) & (other < 0), np.min(away[..., ends], axis=-1), np.inf)
        deep = np.min(inside[..., pairs], axis=-1)
        return np.moveaxis(np.where(np.isfinite(deep), -deep, away), -1, 0)

    @cached_property
    def _numbers(self) -> tuple[Index, Index]:
        """Indices of the four parts of each pair of links, (P, 4); and of the first and the last
        pair of links that each part belongs to, (R, 2)."""
        parts, pairs = list(self.joint_link_pairs), self.link_pairs
        ends = [[parts.index(end) for end in _joints_of_pair(pair)] for pair in pairs]
        near = self.joint_link_pairs.values()
        first_and_last = [[pairs.index(each[0]), pairs.index(each[-1])] for each in near]
        return np.array(ends), np.array(first_and_last)

    def contradiction_text(self, name: str, v: Violation) -> str:
        """Return words on links too near at start, goal or waypoint, and what to change."""
        names = self._names(list(self.joint_link_pairs)[self.parts.index(v.part)])
        change = f"move the {name} or lower limits.{self.key}"
        if v.value <= 0:
            return (
                f"at the {name} links cross (near {' and '.join(names)}); move the {name} or leave"
                f" out limits.{self.key}"
            )
        is_ = f"the {v.label} is {v.value:.3g} m, allowed {v.limit:g} m"
        return f"at the {name} {is_}; {change}"

    def nearest_pair(self, points: Array) -> tuple[Array, Array, float]:
        """Return the joint and the point of a link that are nearest to each other in one pose.

        Args:
            points: Base, joints and tip, shape (n+1, 2), metres.

        Returns:
            Both points, shape (2,), and their distance as in `distances`.
        """
        values = self.distances(points)
        places = [
            (points[place], nearest_on_segment(points[place], points[link - 1], points[link]))
            for place, link in self.joint_link_pairs
        ]
        distances = np.linalg.norm([one - other for one, other in places], axis=-1)
        k = int(np.lexsort((distances, values))[0])  # smallest value, then smallest distance
        return (*places[k], float(values[k]))


def _joints_of_pair(pair: Pair) -> list[Pair]:
    """Return the four ends of two links (as joints, from 0), each paired with the other link."""
    i, j = pair
    return [(i - 1, j), (i, j), (j - 1, i), (j, i)]


def _cross_product(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _squared_distance(point: Any, first: Any, last: Any) -> Any:
    """Return the squared distance of a point from a segment, as an expression."""
    step, off = (last[0] - first[0], last[1] - first[1]), (point[0] - first[0], point[1] - first[1])
    share = (off[0] * step[0] + off[1] * step[1]) / (step[0] ** 2 + step[1] ** 2)
    share = ca.fmin(ca.fmax(share, 0.0), 1.0)
    return (off[0] - share * step[0]) ** 2 + (off[1] - share * step[1]) ** 2


def _side(a: Any, b: Any, c: Any) -> Any:
    """Return a number: positive if point c lies left of the line from a to b, negative if right."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
