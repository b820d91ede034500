"""One mesh interval in symbols: the next state, the cost, and the labelled rows.

All intervals are equal, so the whole problem repeats one interval (see `transcription`).

The file also decides which collocation values are unknowns. A collocation method is implicit. But
if no coordinate's rate depends on that coordinate, directly or through others, the equations can be
solved one coordinate after the other: the manipulator's θ₁ from the input, θ₂ from θ₁, and so on.
To break cycles of dependencies, some coordinates are lifted: their values at the collocation points
are unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.augmented import Augmented, MovingSystem, backs_off
from planner.methods.collocation.transcription.follower import MIDDLES, PARTS
from planner.methods.collocation.transcription.form import Form, Units
from planner.plan.measures import EDGE_MARGIN, INTEGRALS
from planner.problem.requirements.requirement import MotionPoint
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem

RowKind = Literal["motion", "carried", "defect", "kept", "final"]


@dataclass(frozen=True, eq=False)
class Rows:
    """A group of rows with one meaning.

    Attributes:
        kind: The family. motion: the next state is the end of this interval; carried: the
            duration and a linear input's corner continue in the next interval; defect: a lifted
            coordinate obeys its rate at the collocation points; kept: a part of a requirement;
            final: a part of a requirement at the end, active only in the last interval.
        index: Index of the coordinate or input, or of the part among all parts of the family.
        tau: Position of each row in the interval, shape (m,), in [0, 1].
        positions: Positions of the rows among those of the interval.
    """

    kind: RowKind
    index: int
    tau: Array
    positions: slice


@dataclass(frozen=True, eq=False)
class Stage:
    """The symbols of one interval.

    Attributes:
        state: The state y at the left edge, see `unknowns`.
        control: The control c of the interval.
        width: The interval's share of the duration.
        weights: The interval's parameters, see `Form.parameters`.
        inside: Inputs, coordinates and their rates at the collocation points, as columns of
            symbols.
        meaning: Definition of each column of `inside` by state, control and earlier columns.
        cost: The interval's share of the objective, which may depend on `inside`.
        end: Additional cost of the last state of the mesh.
        after: State at the right edge; the first rows are the next state minus `after`.
        rows: The rows that follow the first rows.
        points: Coordinates at the collocation points, N × d.
        labels: Meaning of all rows, including the first rows.
    """

    state: Any
    control: Any
    width: Any
    weights: Any
    inside: tuple[Any, ...]
    meaning: tuple[Any, ...]
    cost: Any
    end: Any
    after: Any
    rows: Any
    points: Any
    labels: tuple[Rows, ...]

    @property
    def height(self) -> int:
        """Number of rows of an interval."""
        return int(self.after.numel() + self.rows.numel())


class _Symbols:
    """Unknowns of an interval by name, in natural units; u(τ) is linear from u_left to u_right."""

    def __init__(self, system: MovingSystem, form: Form, lifted: tuple[int, ...]) -> None:
        self.X, self.width = ca.SX.sym("X", system.size), ca.SX.sym("h")
        self.weights = ca.SX.sym("weights", form.parameters)
        self.T = ca.SX.sym("T") if form.free_duration else self.weights[-1]
        self.lifted = ca.SX.sym("P", len(lifted), form.degree)
        self.seconds = self.width * self.T
        first = ca.SX.sym("U", 2)
        state, control = [self.X], [first]
        if form.free_duration:
            state.append(self.T)
        self.u_left = self.u_right = first
        if form.input == "linear":
            self.u_left = ca.SX.sym("V", 2)
            self.u_right = self.u_left + self.seconds * first
            state.append(self.u_left)
        self.joints = ca.SX.sym("B", form.follower.size if form.follower else 0)
        state.append(self.joints)
        self.state = ca.vertcat(*state)
        self.control = ca.vertcat(*control, ca.vec(self.lifted))

    def input_at(self, tau: float) -> Any:
        return self.u_left + tau * (self.u_right - self.u_left)


class _RowList:
    """A growing list of rows together with their labels."""

    def __init__(self) -> None:
        self.expressions: list[Any] = []
        self.labels: list[Rows] = []

    def add(self, kind: RowKind, index: int, tau: Array, expressions: list[Any]) -> None:
        first = len(self.expressions)
        self.labels.append(Rows(kind, index, tau, slice(first, first + len(tau))))
        self.expressions += expressions


def stage(system: TriangularSystem, form: Form, order: Order) -> Stage:
    """Build the symbols of one interval for a system and a form."""
    model = form.augmented or system
    x, rows = _Symbols(model, form, order.lifted), _RowList()
    points, rates, defects, inside = _collocation(model, form, order, x)
    after = _motion(model, form, x, rates, rows)
    if form.follower:
        scale = x.seconds * form.units.time_s * ca.DM(form.units.inputs) / PARTS
        ways = [scale * x.input_at(middle) for middle in MIDDLES]
        smoothing = x.weights[form.parameters - 1 - (not form.free_duration)]
        joints, named = form.follower.step(model, x.joints, ways, smoothing)
        rows.add("carried", 0, np.ones(form.follower.size), joints)
        after, inside = ca.vertcat(after, *joints), inside + named
    for i, residuals in defects.items():
        rows.add("defect", i, form.scheme.points, residuals)
    columns = [ca.vertcat(*column) for column in points]
    _limit_rows(system, form, x, columns, after, rows)
    if form.augmented and form.augmented.backoff:
        _backed_off_rows(form, form.augmented, [*columns, after[: model.size]], rows)
    cost = _cost(system, form, x, columns)
    end = form.augmented.end_cost_expr(x.X) if form.augmented else ca.SX(0)
    if form.follower:
        end += form.follower.end_cost_expr(x.joints) / form.units.objective
    return Stage(
        state=x.state,
        control=x.control,
        width=x.width,
        weights=x.weights,
        inside=tuple(symbols for symbols, _ in inside),
        meaning=tuple(meaning for _, meaning in inside),
        cost=cost,
        end=end,
        after=after,
        rows=ca.vertcat(*rows.expressions[after.numel() :]),
        points=ca.horzcat(*columns),
        labels=tuple(rows.labels),
    )


def _collocation(
    system: MovingSystem, form: Form, order: Order, x: _Symbols
) -> tuple[list[list[Any]], dict[int, list[Any]], dict[int, list[Any]], list[tuple[Any, Any]]]:
    """Express values and rates at the collocation points, one coordinate after the other.

    Returns:
        Values, whose first index is the point; rates of each coordinate at the points; for each
        lifted coordinate, the differences of its values from its integrated rates, which must
        vanish; and the symbols of inputs, rates and other values, each with its definition.
    """
    s, places = form.scheme, range(form.degree)
    inputs = [ca.SX.sym(f"u{j}", 2) for j in places]
    wanted = [x.input_at(tau) for tau in s.points.tolist()]
    inside = [(ca.vertcat(*inputs), ca.vertcat(*wanted))]
    points = [[ca.SX.sym(f"q{i}_{j}") for i in range(system.size)] for j in places]
    for row, i in enumerate(order.lifted):
        for j in places:
            points[j][i] = x.lifted[row, j]
    rates: dict[int, list[Any]] = {}
    defects = {}
    for i, rate in zip(order.sequence, _rates(system, order.sequence, form.units), strict=True):
        columns = [ca.vertcat(*column) for column in points]
        r = ca.SX.sym(f"r{i}", form.degree)
        meant = [rate(q, u) for q, u in zip(columns, inputs, strict=True)]
        inside.append((r, ca.vertcat(*meant)))
        value = x.X[i] + x.seconds * (ca.DM(s.integration) @ r)
        rates[i] = ca.vertsplit(r)
        if i in order.lifted:
            defects[i] = [points[j][i] - value[j] for j in places]
        else:
            inside.append((ca.vertcat(*(points[j][i] for j in places)), value))
    return points, rates, defects, inside


def _rates(system: MovingSystem, coordinates: tuple[int, ...], units: Units) -> list[Any]:
    """Return one function of (q, u) per coordinate that gives its rate, in natural units."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    rates = system.rates_expr(q, u * ca.DM(units.inputs))
    return [ca.Function("rate", [q, u], [units.time_s * rates[i]]) for i in coordinates]


def _motion(
    system: MovingSystem, form: Form, x: _Symbols, rates: dict[int, list[Any]], rows: _RowList
) -> Any:
    """Add the rows that link an interval to the next; return the state at the right edge."""
    weights, end = ca.DM(form.scheme.quadrature), np.ones(1)
    after = []
    for i in range(system.size):
        after.append(x.X[i] + x.seconds * ca.dot(weights, ca.vertcat(*rates[i])))
        rows.add("motion", i, end, [after[-1]])
    if form.free_duration:
        after.append(x.T)
        rows.add("carried", 0, end, [x.T])
    if form.input == "linear":
        for i in range(2):
            after.append(x.u_right[i])
            rows.add("carried", i, end, [after[-1]])
    return ca.vertcat(*after)


LIMITED_PLACES = [0.0, 0.25, 0.5, 0.75, 1.0]
"""Positions in an interval at which functions of linear inputs are limited. With three a product on
15 intervals exceeds its limit by a fifth in between, with five by a twentieth."""


def _limit_rows(
    system: TriangularSystem, form: Form, x: _Symbols, points: list[Any], after: Any, rows: _RowList
) -> None:
    """Add the rows of requirements other than bounds on unknowns.

    Coordinates at edges and lifted coordinates are unknowns. An input is constant or linear in an
    interval, so a requirement on inputs alone has one row, or rows at a few positions.
    """
    at_points = form.scheme.points.tolist() if form.inner else []
    state = {0.0: x.X, 1.0: after, **dict(zip(form.scheme.points.tolist(), points, strict=True))}
    units, seconds = ca.DM(form.units.inputs), form.units.time_s
    part, first = 0, INTEGRALS
    for blank in form.kept:
        last = first + len(blank.row_fields)
        requirement, first = blank.with_row_fields(ca.vertsplit(x.weights[first:last])), last
        places = [*[0.0] * (not blank.is_direct), *at_points]
        if "q" not in blank.reads:
            places = LIMITED_PLACES if "u" in blank.reads and form.input == "linear" else [0.0]
        elif blank.reads != {"q"}:
            places = sorted({*places, 1.0})  # inputs may jump at the next edge
        rows_at = []
        for tau in places:
            q, u = state.get(tau, x.X)[: system.size], units * x.input_at(tau)
            du = units / seconds * ((x.u_right - x.u_left) / x.seconds)
            rows_at.append(requirement.rows(MotionPoint(system, q, u, du)))
        for k in range(len(blank.parts)):
            parts = [seconds**blank.speed_power * values[k] for values in rows_at]
            rows.add("kept", part, np.array(places), parts)
            part += 1
    part = 0
    for blank in form.final:
        last = first + len(blank.row_fields)
        requirement, first = blank.with_row_fields(ca.vertsplit(x.weights[first:last])), last
        for row in requirement.rows(MotionPoint(system, after[: system.size])):
            rows.add("final", part, np.ones(1), [row])
            part += 1


def _backed_off_rows(form: Form, model: Augmented, places: list[Any], rows: _RowList) -> None:
    """Add rows for backed-off limits on coordinates at collocation points and the right edge."""
    system, q = model.system, ca.SX.sym("q", model.system.size)
    tau, part = np.repeat(np.append(form.scheme.points, 1.0), 2), 0
    for blank in form.kept:
        limits = blank.rows(MotionPoint(system, q)) if backs_off(blank) else []
        for k, row in enumerate(limits, part):
            rows.add("kept", k, tau, model.sides(q, row, places))
        part += len(blank.parts)


def _cost(system: TriangularSystem, form: Form, x: _Symbols, points: list[Any]) -> Any:
    """Return an interval's share of the objective, whose terms are those of `Objective`.

    Closeness (`planner.plan.measures.closeness`) is a sum over the margins of the chart's domain,
    in which the least margin dominates. Closeness grows towards an edge from both sides, so it is
    the same on every branch and is also defined outside the chart.
    """
    square = x.u_left**2  # mean of u^2 over the interval, exact for both kinds of input
    if form.input == "linear":
        square = (x.u_left**2 + x.u_left * x.u_right + x.u_right**2) / 3
    rate = ca.dot(x.weights[1:3], square)
    if form.input == "linear":
        slope = (x.u_right - x.u_left) / x.seconds
        rate += ca.dot(x.weights[3:5], slope**2)
    cost = x.width * x.T * (x.weights[0] + rate)
    if form.edge:
        ones = np.ones(system.size)
        margins = [system.chart_margins_expr(q, ones) for q in points]
        nearness = [sum(ca.exp(-ca.fabs(m) / EDGE_MARGIN) for m in each) for each in margins]
        means = zip(form.scheme.quadrature, nearness, strict=True)
        cost += x.width * sum(w * (x.weights[5] * each) for w, each in means)
    if form.augmented:
        pairs = zip(form.scheme.quadrature, map(form.augmented.path_cost_expr, points), strict=True)
        cost += x.width * sum(w * each for w, each in pairs)
    return cost


@dataclass(frozen=True)
class Order:
    """The order in which the collocation values of coordinates are computed from the inputs.

    Attributes:
        sequence: All coordinates; the rate of each depends only on earlier and lifted coordinates.
        lifted: Coordinates whose collocation values are unknowns of the programme, since they
            cannot be computed from earlier ones; in increasing order.
    """

    sequence: tuple[int, ...]
    lifted: tuple[int, ...]


def order(system: MovingSystem) -> Order:
    """Choose the order in which to compute a system's coordinates, with few unknowns (`lifted`)."""
    needs = _dependencies(system)
    sequence: list[int] = []
    lifted: set[int] = set()
    while waiting := [i for i in range(system.size) if i not in sequence]:
        known = lifted | set(sequence)
        ready = [i for i in waiting if needs[i] <= known]
        sequence += ready
        if not ready:
            open_ends = [i for i in waiting if i not in lifted]
            itself = [i for i in open_ends if i in needs[i]]
            lifted.add((itself or open_ends)[0])
    return Order(tuple(sequence), tuple(sorted(lifted)))


def _dependencies(system: MovingSystem) -> list[set[int]]:
    """Return for each coordinate of a system the set of coordinates on which its rate depends."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    rates = ca.vertcat(*system.rates_expr(q, u))
    rows, columns = ca.jacobian(rates, q).sparsity().get_triplet()
    out: list[set[int]] = [set() for _ in range(system.size)]
    for i, j in zip(rows, columns, strict=True):
        out[i].add(j)
    return out
