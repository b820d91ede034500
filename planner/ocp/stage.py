"""One mesh interval as symbols: its cost and its constraint rows, each labelled where it is made.

All intervals are alike, so the whole problem is this one, repeated (see `assembly`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from planner.chained import chained_form
from planner.ocp.form import Form
from planner.systems.base import Array, TriangularSystem

RowKind = Literal["dynamics", "continuity", "rate", "z2"]


@dataclass(frozen=True, eq=False)
class Rows:
    """A labelled constraint: rows of one meaning.

    Attributes:
        kind: Its family.
        index: Coordinate or input it is about.
        label: What it demands, in words.
        unit: Unit of the rows' values.
        scale: A typical size, by which excesses are made comparable.
        tau: Where in the interval each row holds, shape (m,), in [0, 1].
        first: Position of its first row among the interval's rows.
    """

    kind: RowKind
    index: int
    label: str
    unit: str
    scale: float
    tau: Array
    first: int

    @property
    def positions(self) -> Array:
        """Positions among the interval's rows, shape (m,)."""
        return np.asarray(self.first + np.arange(len(self.tau)))


@dataclass(frozen=True, eq=False)
class Stage:
    """The symbols of one interval.

    Attributes:
        unknowns: What the interval touches, in the order of `Layout.stages`.
        width: Its share of the duration.
        weights: Objective weights: of T, and of each input's square.
        cost: Its share of the objective.
        rows: Its constraint rows.
        labels: What the rows mean.
    """

    unknowns: Any
    width: Any
    weights: Any
    cost: Any
    rows: Any
    labels: tuple[Rows, ...]


class _Symbols:
    def __init__(self, system: TriangularSystem, form: Form) -> None:
        N, d = system.size, form.degree
        self.T, self.width = ca.SX.sym("T"), ca.SX.sym("h")
        self.weights = ca.SX.sym("weights", 3)
        self.left, self.u_left = ca.SX.sym("X", N), ca.SX.sym("U", 2)
        linear = form.input == "linear"
        self.u_right = ca.SX.sym("V", 2) if linear else self.u_left
        self.points = ca.SX.sym("P", N, d)
        closed = form.scheme.closed
        self.right = self.points[:, -1] if closed else ca.SX.sym("Y", N)
        parts = [self.T, self.left, self.u_left]
        parts += [self.u_right] if linear else []
        parts += [ca.vec(self.points)]
        parts += [] if closed else [self.right]
        self.unknowns = ca.vertcat(*parts)
        self.values = ca.horzcat(self.left, self.points)

    def input_at(self, tau: float) -> Any:
        return self.u_left + tau * (self.u_right - self.u_left)


class _RowList:
    """Collects rows together with their labels."""

    def __init__(self) -> None:
        self.expressions: list[Any] = []
        self.labels: list[Rows] = []

    def add(
        self,
        kind: RowKind,
        index: int,
        label: str,
        unit: str,
        scale: float,
        tau: Array,
        expressions: list[Any],
    ) -> None:
        first = len(self.expressions)
        self.labels.append(Rows(kind, index, label, unit, scale, tau, first))
        self.expressions += expressions


def stage(system: TriangularSystem, form: Form) -> Stage:
    """Write down one interval of a transcription."""
    x, rows = _Symbols(system, form), _RowList()
    _dynamics(system, form, x, rows)
    if not form.scheme.closed:
        _continuity(system, form, x, rows)
    if form.rate_limits:
        _rates(system, x, rows)
    if form.chart:
        _chart(system, form, x, rows)
    cost = x.width * (x.weights[0] * x.T + x.T * ca.dot(x.weights[1:], _mean_square(x, form)))
    return Stage(
        x.unknowns, x.width, x.weights, cost, ca.vertcat(*rows.expressions), tuple(rows.labels)
    )


def _dynamics(system: TriangularSystem, form: Form, x: _Symbols, rows: _RowList) -> None:
    """Defects: derivative of the interpolant minus T h q̇ at each collocation point."""
    s = form.scheme
    defects = []
    for j, tau in enumerate(s.points):
        rates = ca.vertcat(*system.rates_expr(x.points[:, j], x.input_at(float(tau))))
        defects.append(x.values @ s.differentiation[j] - x.T * x.width * rates)
    for i, coordinate in enumerate(system.coordinates):
        label = f"motion of {coordinate.name}"
        residuals = [defect[i] for defect in defects]
        rows.add("dynamics", i, label, coordinate.unit, 1.0, s.points, residuals)


def _continuity(system: TriangularSystem, form: Form, x: _Symbols, rows: _RowList) -> None:
    """The interpolant's end is the next edge's state (Gauss–Legendre only)."""
    gap = x.values @ form.scheme.end - x.right
    for i, coordinate in enumerate(system.coordinates):
        label = f"continuity of {coordinate.name}"
        rows.add("continuity", i, label, coordinate.unit, 1.0, np.ones(1), [gap[i]])


def _rates(system: TriangularSystem, x: _Symbols, rows: _RowList) -> None:
    """Slopes of a linear input."""
    slope = (x.u_right - x.u_left) / (x.width * x.T)
    for i, coordinate in enumerate(system.inputs):
        label, unit = f"rate of input {coordinate.name}", rate_unit(coordinate.unit)
        rows.add("rate", i, label, unit, 1.0, np.array([0.5]), [slope[i]])


def _chart(system: TriangularSystem, form: Form, x: _Symbols, rows: _RowList) -> None:
    """z₂ at the collocation points and at the interval's end."""
    form_of = chained_form(system)
    places = [x.points[:, j] for j in range(form.degree)]
    tau = form.scheme.points
    if not form.scheme.closed:
        places, tau = [*places, x.right], np.append(tau, 1.0)
    z2 = [form_of.z_expr(q)[1] for q in places]
    rows.add("z2", 1, "z2 margin", "", 1.0, tau, z2)


def rate_unit(unit: str) -> str:
    """Unit of the rate of a quantity ("rad/s" gives "rad/s^2")."""
    return f"{unit}^2" if unit.endswith("/s") else f"{unit}/s"


def _mean_square(x: _Symbols, form: Form) -> Any:
    """Mean of each input's square over the interval, exact for the kind of input."""
    if form.input == "constant":
        return x.u_left**2
    return (x.u_left**2 + x.u_left * x.u_right + x.u_right**2) / 3
