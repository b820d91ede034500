"""Conditions on a motion: one class per kind, used by planners and verification."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from planner.errors import Part as Part
from planner.errors import Violation
from planner.support.arrays import Array, Frozen, locked
from planner.support.casadi import ca
from planner.systems.triangular_system import TriangularSystem

ROUNDING = 1e-9
"""Excess over a limit, relative to its scale, that is taken for rounding of a place in a file; the
judge allows a motion a thousand times as much."""


@dataclass(frozen=True, eq=False)
class MotionPoint:
    """The point of a motion at which a requirement is evaluated: symbols, or many states at once.

    Attributes:
        system: The system.
        q: Coordinates: a CasADi vector (N), or an array (N, …).
        u: Inputs: a CasADi vector (2), or an array (2, …).
        du: Rates of the inputs, in the form of `u`.
        z: Chained coordinates, an array (N, …), if already computed.
    """

    system: TriangularSystem
    q: Any = None
    u: Any = None
    du: Any = None
    z: Any = None

    @classmethod
    def of(cls, system: TriangularSystem, *last: Array) -> MotionPoint:
        """Return the point of arrays q, u, du (or fewer) whose last axis is N or 2 long."""
        return cls(system, *(np.moveaxis(values, -1, 0) for values in last))

    @property
    def states(self) -> Array:
        """The coordinates, shape (…, N); for arrays only."""
        return np.moveaxis(self.q, 0, -1)


class Demand(Frozen, ABC):
    """A condition on a motion: at an end, at a waypoint, or (a `Requirement`) at all times.

    Attributes:
        in_chart: Whether the demand applies only to motions in chained coordinates.
        at_goal: Whether a motion that breaks the demand misses the goal.
        physical: Whether a machine that breaks the demand may break something; False if the demand
            limits chained coordinates, which are the methods' own.
        key: Key in the `[limits]` table, for a kind that applies to all systems.
        solid: Whether the demand keeps bodies apart. Leaving it out only tells what is in the way.
    """

    in_chart: ClassVar[bool] = False
    at_goal: ClassVar[bool] = False
    physical: ClassVar[bool] = True
    key: ClassVar[str] = ""
    solid: ClassVar[bool] = False

    @property
    @abstractmethod
    def parts(self) -> tuple[Part, ...]:
        """The R limited values of the demand."""

    def limit_name(self, part: Part) -> str:
        """Return the name of a part for a list of limits."""
        return part.label

    @classmethod
    def easing(cls, breaches: Sequence[Violation]) -> str:
        """Describe a change of the problem file that would permit all of the `breaches`."""
        peaks = []
        for v in breaches:
            above = v.limit == v.part.high
            value = v.value + (1e-3 if above else -1e-3) * abs(v.value)
            shown, _, unit = replace(v, value=value).shown(4)
            side = "least" if above else "most"
            peaks.append(f"{v.demand.limit_name(v.part)} at {side} {shown}{unit}")
        keys = dict.fromkeys(f"limits.{v.demand.key}" for v in breaches if v.demand.key)
        return f"wider {' and '.join(keys) or 'limits'}: {', '.join(peaks)}"

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change of the problem file that removes this demand.

        Returns:
            Dotted keys with new values; the advice in words ("" if naming the keys is enough); and
            the name of what is removed. None if the demand cannot be removed.
        """
        return None


@dataclass(frozen=True)
class Requirement(Demand):
    """A condition that holds at all times, or (with `final`) only at the end.

    The fields of an object hold the data of one problem. Problems that differ only in floats (or
    tuples of floats) share compiled rows; a different string or integer compiles new ones.

    Attributes:
        reads: Arguments of the rows, a subset of "q", "u" and "du".
        row_fields: Names of the float fields that the rows read, as in `Obstacle`; a float that
            only `parts` use, as `low` or `high`, is not listed.
        speed_power: Power of the speed with which the `values` grow: 0 for coordinates, 1 for
            inputs, 2 for their rates and products. Unless it is 0, a slow enough motion satisfies
            the requirement. Rows that replace the values may grow with another power.
        divides: Whether paths can pass on different sides, so that several optima exist.
        smooth: Whether the values are differentiable near their limits; if not, they read only "q"
            and the parts must have no upper limit.
        final: Whether the requirement applies only at the end; then it reads "q" and is smooth.
        table: Type and description of that key's value, optionally an example for `planner new`.
    """

    reads: ClassVar[frozenset[str]]
    row_fields: ClassVar[tuple[str, ...]] = ()
    speed_power: ClassVar[int] = 0
    divides: ClassVar[bool] = False
    smooth: ClassVar[bool] = True
    final: ClassVar[bool] = False
    table: ClassVar[tuple[Any, str] | tuple[Any, str, Any] | None] = None

    @classmethod
    def of(cls, value: Any, system: TriangularSystem) -> Self:
        """Build the requirement from the value of its key in the problem file.

        Raises:
            ValueError: If the value is impossible; the message continues after "limits.KEY".
        """
        return cls(value)  # type: ignore[call-arg]

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        """Return R differentiable expressions that must lie between low and high.

        By default these are the inputs, rates or coordinates that the parts' `index` selects.
        """
        (name,) = self.reads
        entries = getattr(point, name)
        return [entries[part.index] for part in self.parts]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        """Return the limited values for verification: R arrays of the shape of `point.q[0]`.

        A class overrides this method if its rows only approximate the values or need CasADi. The
        values may be another quantity on the same side of the limit; then the proof
        (`planner.certify`) shows that the limit is kept, but its guaranteed margin is 0.
        """
        return self.rows(point)

    def removal(self) -> tuple[dict[str, Any], str, str] | None:
        """Return the change that removes the key; None for a limit that depends on the speed."""
        if self.speed_power or not self.key:
            return None
        what = f"the limit on {self.parts[0].label}"
        return {f"limits.{self.key}": None}, f"leave out limits.{self.key}", what

    def contradiction(self, name: str, q: Array, system: TriangularSystem) -> str | None:
        """Describe why no motion may pass through a place; None if a motion may.

        Args:
            name: Name of the place: "start", "goal" or a waypoint.
            q: Coordinates of the place, shape (N,), NaN if free.
            system: The system.
        """
        if self.reads != {"q"}:
            return None
        violations = []
        for part, value in zip(self.parts, self.values(MotionPoint.of(system, q)), strict=True):
            slack = ROUNDING * part.scale
            if value < part.low - slack or value > part.high + slack:  # false for NaN
                limit = part.low if value < part.low else part.high
                violations.append(Violation(part, float(value), limit, demand=self))
        if not violations:
            return None
        return self.contradiction_text(name, max(violations, key=lambda v: v.scaled))

    def contradiction_text(self, name: str, v: Violation) -> str:
        """Return a message that start, goal or waypoint violates the limit, and what to change."""
        value, limit, unit = v.shown(6)
        change = f"move the {name} or change {f'limits.{self.key}' if self.key else 'the limit'}"
        return f"{v.label} at the {name} is {value}{unit}, allowed {limit}{unit}; {change}"

    def values_out_of_reach(self, system: TriangularSystem) -> Sequence[float] | None:
        """Return lower bounds of `values` if no motion can violate the requirement; else None."""
        return None

    @property
    def thickness(self) -> float:
        """Largest depth, in its unit, of a violation, for a requirement that `divides`."""
        return min((part.scale for part in self.parts), default=0.0)

    @cached_property
    def bounds(self) -> tuple[Array, Array, Array]:
        """Least value, largest value and scale of each part, shape (R,) each."""
        numbers = np.array([(p.low, p.high, p.scale) for p in self.parts])
        low, high, scale = locked(numbers.reshape(-1, 3)).T
        return low, high, scale

    def slowing_factor(self, least: Array, most: Array) -> Array:
        """Return the factors (R,) by which to slow a motion whose values range from `least` to
        `most` (R,)."""
        low, high, _ = self.bounds
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(high > 0, most / high, 0.0), np.where(low < 0, least / low, 0.0)
        return np.asarray(np.maximum(*share) ** (1 / self.speed_power))

    @property
    def is_direct(self) -> bool:
        """Whether each row is itself an input, a rate or a coordinate."""
        return type(self).rows is Requirement.rows

    @cached_property
    def template(self) -> Self:
        """Copy of the requirement with all finite floats zero.

        Requirements that differ only in floats have equal templates and share compiled expressions.
        """
        erased = {f.name: _erase_floats(getattr(self, f.name)) for f in fields(self)}
        return replace(self, **{name: value for name, value in erased.items() if value is not None})

    @property
    def row_field_values(self) -> list[float]:
        """Values of the fields that `row_fields` names, in order."""
        return [float(getattr(self, name)) for name in self.row_fields]

    def fault(self, system: TriangularSystem) -> str | None:
        """Describe why fields, parts, rows and values do not fit together; None if they do."""
        try:
            hash(self)
        except TypeError:
            return "has fields that are not strings, integers, floats or tuples of them"
        if not self.smooth and any(part.high < np.inf for part in self.parts):
            return "is not smooth and has an upper limit; give its negative a lower limit"
        places = ca.DM(np.linspace(0.1, 0.4, system.size)), ca.DM([0.3, 0.2]), ca.DM([0.1, 0.5])
        both = self, self.template.with_row_fields(self.row_field_values)
        here = MotionPoint(system, *places)
        whole, rebuilt = ([float(row) for row in each.rows(here)] for each in both)
        if not len(whole) == len(self.parts) == len(self.template.parts):
            return (
                f"has {len(self.parts)} parts and {len(whole)} rows; their numbers must be equal"
                " and not depend on its floats"
            )
        if whole != rebuilt:
            return "has rows that read a float that `row_fields` does not list"
        many = [np.broadcast_to(np.asarray(x).ravel(), (2, 3, x.numel())) for x in places]
        values = [np.asarray(value) for value in self.values(MotionPoint.of(system, *many))]
        real = all(value.dtype.kind in "fiu" for value in values)
        if not real or [value.shape for value in values] != [(2, 3)] * len(self.parts):
            return f"has {len(self.parts)} parts, but its values are not one real array for each"
        return None

    def with_row_fields(self, values: Sequence[Any]) -> Self:
        """Return a copy of the requirement with other numbers or symbols in `row_fields`."""
        new = dict(zip(self.row_fields, values, strict=True))
        return replace(self, **new) if new else self


def _erase_floats(value: Any) -> Any:
    """Return zero for a float, or zeros for a tuple of floats; None for other types.

    An infinite float stays, since it means that there is no limit.
    """
    if isinstance(value, float):
        return value if np.isinf(value) else 0.0
    if isinstance(value, tuple) and all(isinstance(v, float) for v in value):
        return tuple(_erase_floats(v) for v in value)
    return None
