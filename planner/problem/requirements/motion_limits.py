"""Limits at all times: on inputs, their rates, coordinates and z₂; and the chart's domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from planner.errors import Violation
from planner.problem.requirements.requirement import Demand, MotionPoint, Part, Requirement
from planner.support.arrays import Array
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import Coordinate, TriangularSystem


@dataclass(frozen=True)
class ChartDomain(Demand):
    """The chart's margins are positive on the start's branch, so that real coordinates exist.

    Attributes:
        start: q(0), whose branch of the chart the motion must not leave.
    """

    start: tuple[float, ...]
    in_chart: ClassVar[bool] = True
    physical: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"q"})

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the least margin, which must be greater than zero."""
        return (Part("chart domain", "", 0.0, np.inf, 1.0),)

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Return no advice, because no key of the problem file widens the chart's domain."""
        return ""

    def branch(self, system: TriangularSystem) -> Array:
        """Return the chart's branch on which the start lies, shape (N,)."""
        return system.branch(np.array(self.start))

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return the chart's margins as expressions; empty for a system without them."""
        return point.system.chart_margins_expr(point.q, self.branch(point.system))

    def contradiction(self, name: str, q: Array, system: TriangularSystem) -> str | None:
        """Describe why no motion in the chart can begin or end at q (N,); None if a motion can."""
        branch = self.branch(system)
        margins = system.chart_margins(q, branch)
        worst = int(np.argmin(margins))
        if margins[worst] > 0:
            return None
        i, label = system.margin_labels[worst]
        coordinate, states = system.coordinates[i], np.array([self.start[i], q[i]])
        unit = "deg" if coordinate.unit == "rad" else coordinate.unit
        start, here = np.rad2deg(states) if unit == "deg" else states
        if branch[i] == 0 or abs(margins[worst]) < 1e-15:
            return (
                f"the {name} has {coordinate.name} = {here:.6g} {unit},"
                " where the chained-form chart is singular"
            )
        if worst in system.zero_margins:
            return f"{coordinate.name} changes sign, which no path in the chart can do"
        return (
            f"{coordinate.name} goes from {start:.6g} to {here:.6g} {unit}, past an edge of the"
            f" chained-form chart ({label}), which no path in the chart can do"
        )


SMALLEST_Z2 = 1e-3
"""Least scale of a z₂ margin: a margin near zero must not exaggerate an excess, since z₂ itself
is near 1."""

WIDEST_DEG, WIDEST_HEADING_DEG = 88.0, 360.0
"""Values to which the limits on angles can be widened, degrees: at 90 most lose their chart."""

WIDER = 1e-3
"""Share by which the limit that advice names exceeds the value that a motion needs."""


@dataclass(frozen=True)
class SymmetricLimit(Requirement):
    """Some inputs or coordinates keep their limits, |value| ≤ most.

    Attributes:
        words: Prefix of the parts' labels, as in "input u2".
        quantities: All inputs or coordinates, with names and units.
        most: The limit of each quantity; infinite without a limit.
        keys: The dotted key of the problem file that sets the limit of each quantity.
    """

    words: ClassVar[str]
    quantities: tuple[Coordinate, ...]
    most: tuple[float, ...]
    keys: tuple[str, ...]

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """One part for each limited input or coordinate."""
        names = [named.name.replace("_", " ") for named in self.quantities]
        every = enumerate(zip(names, self.quantities, self.most, self.keys, strict=True))
        return tuple(
            Part(f"{self.words} {name}", self._unit(named), -most, most, most, i, key)
            for i, (name, named, most, key) in every
            if np.isfinite(most)
        )

    def _unit(self, named: Coordinate) -> str:
        return named.unit

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise the values of the keys that would permit the breaches."""
        if not all(v.part.key for v in breaches):
            return super().easing(breaches)
        limit: SymmetricLimit = breaches[0].demand
        needed = {v.part.index: (1 + WIDER) * abs(v.value) for v in breaches}
        out = []
        for key in dict.fromkeys(v.part.key for v in breaches):
            parts = [part for part in limit.parts if part.key == key]
            values = [max(part.high, needed.get(part.index, 0.0)) for part in parts]
            if key.endswith("_deg"):
                values = np.rad2deg(values).tolist()
            if len({part.high for part in parts}) == 1:
                values = [max(values)]
            shown = ", ".join(f"{value:.4g}" for value in values)
            shown = f"[{shown}]" if len(values) > 1 else shown
            fits = max(values) <= widest(key)
            out.append(f"{key} = {shown} or more" if fits else f"leave out {key}")
        return " and ".join(out)


def widest(key: str) -> float:
    """Return the value to which a limit on coordinates can be widened, by its dotted key."""
    if not key.endswith("_deg"):
        return np.inf
    return WIDEST_HEADING_DEG if key == "limits.heading_deg" else WIDEST_DEG


class InputLimit(SymmetricLimit):
    """The inputs keep their limits, |uᵢ| ≤ most."""

    words, reads, speed_power = "input", frozenset({"u"}), 1


class RateLimit(SymmetricLimit):
    """The inputs' rates keep their limits, |duᵢ/dt| ≤ most; a jump has an infinite rate."""

    words, reads, speed_power = "rate of input", frozenset({"du"}), 2

    def _unit(self, named: Coordinate) -> str:
        return named.rate_unit


class JointLimit(SymmetricLimit):
    """The coordinates keep their limits, |qᵢ| ≤ most."""

    words, reads = "joint", frozenset({"q"})

    def limit_name(self, part: Part) -> str:
        """Return the name of the coordinate that a part limits."""
        return self.quantities[part.index].name

    def contradiction_text(self, name: str, v: Violation) -> str:
        """Return words on how start, goal or waypoint violates the limit, and what to change."""
        value, limit, unit = replace(v, limit=abs(v.limit)).shown(6)
        what = f"{name} {self.quantities[v.part.index].name} = {value}{unit}"
        change = f"move the {name} or widen {v.part.key or 'the limit'}"
        return f"{what} lies outside its limit of {limit}{unit}; {change}"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change that widens the joint limits as far as possible."""
        wide = dict[str, Any]()
        for key in filter(None, (part.key for part in self.parts)):
            if key.endswith("_deg"):
                wide[key] = widest(key)
            else:  # an entry of the table limits.q
                wide[key.rpartition(".")[0]] = {}
        return (wide, "", "the limits on the joints") if wide else None


@dataclass(frozen=True)
class Z2Margin(Requirement):
    """z₂ stays on the start's side of zero, by a margin.

    A machine that crosses z₂ = 0 breaks nothing. Its rates (eq. 6) are smooth in q and do not
    contain z₂. With three joints z₂ = 0 is where ∂z₃/∂θ₂ = 0: only the map from z to q is singular.

    Attributes:
        margin: Least |z₂|.
        side: Sign of z₂ at the start.
    """

    margin: float
    side: int

    reads, physical = frozenset({"q"}), False

    @property
    def parts(self) -> tuple[Part, ...]:
        """One part: the margin of z₂."""
        scale = max(self.margin, SMALLEST_Z2)
        return (Part("z2 margin", "", self.margin, np.inf, scale, key="limits.z2_margin"),)

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Advise a smaller margin of z₂, or no margin if z₂ changes sign."""
        (v,) = breaches
        if v.value > 0:
            return f"limits.z2_margin = {0.999 * v.value:.4g} or less"
        return "leave out limits.z2_margin, so that z2 may change sign"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change of the problem file that removes the margin of z₂."""
        return {"limits.z2_margin": None}, "leave out limits.z2_margin", "the z2 margin"

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return z₂ as an expression, with its sign chosen to be positive at the start."""
        return [self.side * chained_form(point.system).z_expr(point.q)[1]]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return z₂ as an array, with its sign chosen to be positive at the start."""
        z2 = chained_form(point.system).z(point.states)[..., 1] if point.z is None else point.z[1]
        return [self.side * z2]

    def contradiction(self, name: str, q: Array, system: TriangularSystem) -> str | None:
        """Describe why z₂ at start or goal violates the margin; None otherwise."""
        if name not in ("start", "goal"):
            return None
        z2 = float(chained_form(system).z(np.append(np.nan_to_num(q[0]), q[1:]))[1])
        if np.isnan(z2) or (self.side and self.side * z2 >= self.margin):
            return None  # NaN: the goal leaves joints free
        lower = f"lower limits.z2_margin to {0.99 * abs(z2):.3g}, or leave it out"
        out = f"leave out limits.z2_margin, so that z2 may change sign, or move the {name}"
        side = "" if name == "start" else f" ({'positive' if self.side > 0 else 'negative'})"
        return (
            f"z2 at the {name} is {z2:.6g}, but limits.z2_margin = {self.margin:g} requires at"
            f" least that distance from zero, with the sign at the start{side};"
            f" {lower if self.side * z2 > 0 else out}"
        )
