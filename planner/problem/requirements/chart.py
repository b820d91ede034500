"""The chart's domain, in which motions given in chained coordinates must stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from planner.problem.requirements.requirement import At, Broken, Demand, Part
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True)
class ChartDomain(Demand):
    """Every margin of the chart is positive, on the start's branch: real coordinates exist.

    Attributes:
        start: q(0).
    """

    start: tuple[float, ...]
    in_chart: ClassVar[bool] = True

    @property
    def parts(self) -> tuple[Part, ...]:
        """One: the least margin. The domain is open, so that zero is outside."""
        return (Part("chart domain", "", 0.0, np.inf, 1.0),)

    @classmethod
    def eased(cls, broken: Sequence[Broken]) -> str:
        """Nothing: no key of the file widens the domain."""
        return ""

    def branch(self, system: TriangularSystem) -> Array:
        """The chart's branch, shape (N,)."""
        return system.branch(np.array(self.start))

    def rows(self, at: At) -> Sequence[Any]:
        """The margins as expressions; none where the system does not write them down."""
        return at.system.chart_margins_expr(at.q, self.branch(at.system))

    def contradiction(self, name: str, q: Array, system: TriangularSystem) -> str | None:
        """Why no motion in the chart begins or ends at q (N,), in words; None where one may."""
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
        if f"{coordinate.name} = 0" in label:
            return f"{coordinate.name} changes sign, which no path in the chart can do"
        return (
            f"{coordinate.name} goes from {start:.6g} to {here:.6g} {unit}, past an edge of the"
            f" chained-form chart ({label}), which no path in the chart can do"
        )
