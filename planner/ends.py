"""The start and the goal of a problem, seen in the chained-form chart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.chained import chained_form
from planner.problem import Problem
from planner.systems.base import Array


@dataclass(frozen=True)
class End:
    """One end of the motion.

    Attributes:
        name: "start" or "goal".
        q: Coordinates, shape (N,); NaN for a free path coordinate.
        z: Chained coordinates, shape (N,); NaN for a free path coordinate.
        branch: The chart's branch it lies on, shape (N,).
        margins: Distance from each edge of the chart, on the start's branch: label to value,
            negative beyond the edge.
        singular: Names of the coordinates that lie on a singularity of the chart.
        crossed: Names of the coordinates whose branch differs from the start's.
    """

    name: str
    q: Array
    z: Array
    branch: Array
    margins: dict[str, float]
    singular: tuple[str, ...]
    crossed: tuple[str, ...]

    @property
    def in_chart(self) -> bool:
        """Whether a chart method can begin or end here."""
        return not self.singular and not self.crossed

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form (NaN where undefined)."""
        return {
            "q": self.q.tolist(),
            "z": self.z.tolist(),
            "branch": self.branch.tolist(),
            "margins": self.margins,
            "singular": list(self.singular),
            "crossed": list(self.crossed),
            "in_chart": self.in_chart,
        }


def chart_ends_report(problem: Problem) -> tuple[End, End]:
    """The start and the goal."""
    return _end("start", problem, problem.start), _end("goal", problem, problem.target)


def _end(name: str, problem: Problem, q: Array) -> End:
    system, home = problem.system, problem.branch
    known = np.where(np.isnan(q), 0.0, q)
    z = chained_form(system).z(known)
    z[0] = q[0]
    branch = system.branch(known)
    names = [c.name for c in system.coordinates]
    labels = [label for _, label in system.margin_labels]
    margins = system.chart_margins(known, home)
    moved = (branch != home) & (branch != 0) & (home != 0)
    return End(
        name=name,
        q=q,
        z=z,
        branch=branch,
        margins=dict(zip(labels, (float(m) for m in margins), strict=True)),
        singular=tuple(n for n, b in zip(names, branch, strict=True) if b == 0),
        crossed=tuple(n for n, m in zip(names, moved, strict=True) if m),
    )
