"""The data of all figures of plans; Matplotlib pictures, the page and the explorer draw them.

A figure consists of panels. A `TimePanel` shows curves over time, a `PlanePanel` paths in a plane.
`PLAN_FIGURES` lists the figures. Titles and names are words, or names of coordinates such as
"theta1", which the drawing code formats. `screen_data` converts a panel to JSON data with the same
keys for the browser.

Panels with the same `id` can be drawn as one (see `merge`). Angles are in degrees. Times are in
seconds since the start of the path; they are negative during the preparatory motion of a
compensated plan. Undefined numbers are NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from planner.machine.machine import Machine
from planner.plan.measures import worst_margin
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.figures.style import readable_name, to_display, unit_of
from planner.support.arrays import Array, jsonable
from planner.systems.chained_form import chained_form
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import Coordinate, TriangularSystem

DRAWN_LIMIT_SHARE = 0.75
"""Share of a limit that values must reach for the limit to be drawn."""

OVERSHOOT = 1.6
"""Largest value that a panel shows, as a multiple of the limit or, if larger, of 1.5 times the
usual values; peaks beyond are cut off and noted."""

PEAK_RATIO = 5.0
"""Multiple of the usual values above which peaks are cut off if an input has no limit."""

Pair = Sequence[float]  # coordinates of a point, or the least and the greatest value of a range


@dataclass(frozen=True, eq=False)
class Series:
    """A curve of a panel.

    Attributes:
        plan: Index of the curve's plan among the drawn plans.
        y: Vertical values (m,).
        x: Horizontal values (m,) in a `PlanePanel`; None in a `TimePanel`.
        t: Times (m,), seconds; None for the times of the plan.
        name: Name; None for that of the plan.
        colour: Index of the curve's colour; None for the colour of the plan.
        machine: Whether the curve is the motion of the machine with median error, drawn at the
            times at which this motion is stored.
    """

    plan: int
    y: Array
    x: Array | None = None
    t: Array | None = None
    name: str | None = None
    colour: int | None = None
    machine: bool = False


@dataclass(frozen=True, eq=False)
class Shade:
    """A shaded range of a panel, from `low` to `high` (m,), at the times of the first series."""

    low: Array
    high: Array
    name: str | None = None


@dataclass(frozen=True)
class Peak:
    """Value of largest magnitude of a plan's curve, outside the view, and its time, s."""

    plan: int
    t: float
    value: float


@dataclass(frozen=True, eq=False)
class Panel:
    """Common base of `TimePanel` and `PlanePanel`.

    Attributes:
        id: Identifier; panels with the same identifier can be drawn as one.
        title: Title.
        unit: Unit of the values.
        series: The curves.
        note: A few words beside the title.
    """

    id: str
    title: str
    unit: str
    series: Sequence[Series]
    _: KW_ONLY
    note: str | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class TimePanel(Panel):
    """A panel whose curves run over time.

    Attributes:
        band: A shaded range.
        limits: Limits, drawn as horizontal lines.
        floor: The panel is shaded below this value.
        zero: Whether the browser's axis includes zero.
        ends: Values at start and goal, drawn as dots.
        stops: Waypoints, as points (t, value).
        marks: Points (t, value) where the path leaves or enters the domain.
        view: Range of the values shown; None for all.
        notes: Peaks outside the view.
    """

    band: Shade | None = None
    limits: Sequence[float] = ()
    floor: float | None = None
    zero: bool = False
    ends: Sequence[float] = ()
    stops: Sequence[Pair] = ()
    marks: Sequence[Pair] = ()
    view: Pair | None = None
    notes: Sequence[Peak] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanePanel(Panel):
    """A panel whose curves are paths in a plane; both axes have the unit of the panel.

    Attributes:
        names: Names of the axes.
        ends: Points at start and goal.
        view: Range shown of each axis; None for all. Pictures are at equal scale; in the browser a
            view fills the frame.
        region: Range of each axis; the plane outside this box is shaded.
        limits: Limits, drawn as lines: pairs (index of the axis, value).
        poses: Poses of the arm or vehicle, each a list of points.
        discs: Obstacles: x, y, radius.
        tips: Points that the tip must pass or reach.
        key: Entries of the legend: pairs of what is drawn and its meaning. "below" is the plane
            outside the region, "limit" the limits, "path" the curves, "ramp" the poses.
    """

    names: Sequence[str]
    ends: Sequence[Pair] = ()
    view: Sequence[Pair] | None = None
    region: Sequence[Pair] | None = None
    limits: Sequence[tuple[int, float]] = ()
    poses: Sequence[Sequence[Pair]] = ()
    discs: Sequence[Sequence[float]] = ()
    tips: Sequence[Pair] = ()
    key: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True, eq=False)
class PlanCurves:
    """A plan and the times at which it is drawn.

    Attributes:
        number: Index of the plan among the drawn plans.
        plan: The plan.
        t: Times (m,), seconds from the plan's beginning.
        machine: The machine whose effects figures show; None for the machine of the plan's problem.
    """

    number: int
    plan: Plan
    t: Array
    machine: Machine | None = None

    @cached_property
    def q(self) -> Array:
        """Coordinates, shape (m, N)."""
        return self.plan.q(self.t)

    @cached_property
    def z(self) -> Array:
        """Chained coordinates, shape (m, N)."""
        return self.plan.z(self.t)

    @cached_property
    def u(self) -> Array:
        """Inputs, shape (m, 2)."""
        return self.plan.u(self.t)


DrawnPlans = Sequence[PlanCurves]


@dataclass(frozen=True)
class PlanFigure:
    """A figure of plans: its panels and texts.

    Attributes:
        id: Name, for files and on the page.
        panels: Function that returns the figure's panels for plans of one problem.
        title: Title.
        caption: Explanation on the page.
        executable: Whether folders and pages draw the figure only for executable plans. The
            explorer draws it for all, so the panels must accept NaN.
        columns: Whether a picture has one column per plan.
        fits: Function that returns whether a system has this figure.
    """

    id: str
    panels: Callable[[DrawnPlans], Sequence[Panel]]
    title: str
    caption: str
    executable: bool = True
    columns: bool = False
    fits: Callable[[TriangularSystem], bool] = lambda system: True


# -- chained coordinates ------------------------------------------------------------------------


def chained_panels(drawn: DrawnPlans) -> list[TimePanel]:
    """Return panels of the chained coordinates z₂, z₃ … z_N over time.

    For a manipulator, z₂ has one panel per plan, which shows its domain. Where the domain of the
    chart has more conditions (n > 3, and other systems), a panel shows the least margin of all.
    """
    system = drawn[0].plan.problem.system
    if isinstance(system, Manipulator):
        panels = [_z2_panel(one) for one in drawn]
    else:
        panels = [TimePanel("z2", "z2", "", [Series(one.number, one.z[:, 1]) for one in drawn])]
    if not isinstance(system, Manipulator) or system.size > 4:
        margins = [worst_margin(one.plan.trajectory.margins(one.t)) for one in drawn]
        series = [Series(one.number, y) for one, y in zip(drawn, margins, strict=True)]
        panels.append(TimePanel("margin", "least margin of the domain", "", series, floor=0.0))
    return panels + [
        TimePanel("z", f"z{i + 1}", "", [Series(one.number, one.z[:, i]) for one in drawn])
        for i in range(2, system.size)
    ]


def z2_band(plan: Plan, t: Array) -> Array:
    """Return the range of z₂ in which a real θ₁ exists, given θ₂ … θₙ of a manipulator.

    z₂ is affine in cos²θ₁ (n = 2: monotone in cosθ₁), so the band runs between θ₁ = 0 and θ₁ = 90°.

    Args:
        plan: A plan for a `Manipulator`.
        t: Times (m,), seconds.

    Returns:
        Lower and upper edge, shape (2, m); NaN where θ₂ … θₙ are not real.
    """
    form = chained_form(plan.problem.system)
    q = plan.q(t)
    edges = []
    for theta1 in (0.0, np.pi / 2):
        q[:, 1] = theta1
        edges.append(form.z(q)[:, 1])
    return np.sort(np.array(edges), axis=0)


def _z2_panel(one: PlanCurves) -> TimePanel:
    """Return a panel of z₂ with the band in which θ₁ is real, and marks where the path crosses the
    band's edge."""
    plan = one.plan
    out = np.array([] if plan.executable else plan.domain.exits_s)
    return TimePanel(
        "z2", "z2", "", [Series(one.number, one.z[:, 1])], band=Shade(*z2_band(plan, one.t)),
        marks=np.stack([out - plan.lead_s, plan.z(out)[:, 1]], axis=1).tolist(),
    )  # fmt: skip


# -- coordinates and inputs ---------------------------------------------------------------------


def shown_coordinates(system: TriangularSystem) -> list[tuple[int, Coordinate]]:
    """Return the user coordinates that are drawn, with their indices.

    The first coordinate is left out if the user coordinates are those of the triangular system,
    whose first coordinate is the path coordinate.
    """
    every = list(enumerate(system.user_coordinates))
    return every if system.has_user_coordinates else every[1:]


def joint_panels(drawn: DrawnPlans) -> list[TimePanel]:
    """Return a panel of each user coordinate, with start, goal, waypoints, and limits if close."""
    problem = drawn[0].plan.problem
    panels, start = [], problem.system.user(problem.start)
    user = [(one, one.plan.user(one.t)) for one in drawn]
    for i, coordinate in shown_coordinates(problem.system):
        unit = coordinate.unit
        series = [Series(one.number, to_display(w[:, i], unit)) for one, w in user]
        (limit,) = to_display(problem.limits.user[i : i + 1], unit).tolist()
        stops = [
            [point.time_s, float(to_display(point.user[i : i + 1], unit)[0])]
            for point in problem.waypoints
            if point.time_s is not None and np.isfinite(point.user[i])
        ]
        limits = near_limits(np.concatenate([curve.y for curve in series]), limit)
        ends = to_display(np.array([start[i], problem.user_goal[i]]), unit).tolist()
        panels.append(TimePanel(
            "joints", coordinate.name, unit_of(coordinate), series,
            limits=limits, ends=ends, stops=stops,
        ))  # fmt: skip
    return panels


def input_panels(drawn: DrawnPlans) -> list[TimePanel]:
    """Return panels of u₁ and u₂ with their limits; peaks far beyond are cut off and noted."""
    problem = drawn[0].plan.problem
    panels = []
    for i, coordinate in enumerate(problem.system.inputs):
        limit = float(problem.limits.input[i])
        values = [(one, one.t, np.nan_to_num(one.u[:, i])) for one in drawn]
        low, high = view_range(values, limit)
        notes = [
            Peak(one.number, float(t[k] - one.plan.lead_s), float(u[k]))
            for one, t, u in values
            for k in [int(np.argmax(np.abs(u)))]
            if not low <= u[k] <= high
        ]
        series = [Series(one.number, one.u[:, i]) for one in drawn]
        panels.append(TimePanel(
            "inputs", coordinate.name, coordinate.unit, series,
            limits=[-limit, limit] if np.isfinite(limit) else [], view=(low, high), notes=notes,
        ))  # fmt: skip
    return panels


def near_limits(values: Array, limit: float) -> list[float]:
    """Return those of −limit and limit that values come close to; far lines would shrink curves."""
    reach = [(side, np.nanmax(side * values, initial=-np.inf)) for side in (-1, 1)]
    return [side * limit for side, most in reach if most > DRAWN_LIMIT_SHARE * limit]


def view_range(values: Sequence[tuple[Any, Array, Array]], limit: float) -> tuple[float, float]:
    """Return the lowest and highest value of an input to show.

    Args:
        values: The plan, times and values of each curve.
        limit: Limit of the input; infinite if it has none.
    """
    every = np.concatenate([u for _, _, u in values])
    most = float(np.max(np.abs(every)))
    # Times are denser near the ends of pieces, so a quantile over them would follow the peaks.
    evenly = (np.interp(np.linspace(t[0], t[-1], 400), t, u) for _, t, u in values)
    usual = max(float(np.quantile(np.abs(u), 0.9)) for u in evenly)
    bound = OVERSHOOT * max(limit if np.isfinite(limit) else 0.0, 1.5 * usual)
    if not np.isfinite(limit) and most < PEAK_RATIO * usual:
        bound = 1.08 * most
    bound = min(bound, 1.08 * max(most, 1.02 * limit if np.isfinite(limit) else 0.0))
    bound = max(bound, 1e-9)
    one_sided = float(np.min(every)) > -0.02 * bound and not np.isfinite(limit)
    return (-0.05 * bound if one_sided else -bound), bound


# -- the chart ----------------------------------------------------------------------------------


def map_panels(drawn: DrawnPlans) -> list[PlanePanel]:
    """Return a panel of the paths in the plane of θ₁ and θ₂, and of the chart around the start.

    The chart is the region in which the chained coordinates are valid.
    """
    problem = drawn[0].plan.problem
    limits = np.rad2deg(problem.limits.joint[1:3])
    names = [coordinate.name for coordinate in problem.system.coordinates[1:3]]
    paths = [np.rad2deg(one.q[:, 1:3]) for one in drawn]
    goal = np.rad2deg(problem.goal[1:3])
    if len(drawn) == 1:  # use the plan's end for free joints; several plans may end differently
        goal = np.where(np.isnan(goal), paths[0][-1], goal)
    ends = np.array([np.rad2deg(problem.start[1:3]), *([] if np.isnan(goal).any() else [goal])])
    sides = [_chart_range(problem, i) for i in (1, 2)]
    frame = []
    for k in (0, 1):
        edges = [edge for edge in sides[k] or () if abs(edge) < NO_EDGE_DEG]
        values = np.concatenate([*(path[:, k] for path in paths), ends[:, k], edges])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        frame.append([low - MAP_MARGIN_DEG, high + MAP_MARGIN_DEG])
    lines = [[k, side * most] for k, most in enumerate(limits.tolist()) for side in (-1, 1)]
    title = f"{readable_name(names[1])} over {readable_name(names[0])}"
    curves = [Series(one.number, *path.T[::-1]) for one, path in zip(drawn, paths, strict=True)]
    return [PlanePanel(
        "map", title, "deg", curves, names=names, ends=ends.tolist(), view=frame,
        region=[side for side in sides if side] if all(sides) else None,
        limits=[(k, line) for k, line in lines if np.isfinite(line)],
        note=None if all(sides) else "the start lies on the chart's edge",
        key=[("below", "outside the chart"), ("limit", "joint limits")],
    )]  # fmt: skip


MAP_MARGIN_DEG, NO_EDGE_DEG = 6.0, 1e4
"""Margin of the map around its content, and the value that stands for "no edge"; degrees."""


def _chart_range(problem: Problem, i: int) -> tuple[float, float] | None:
    """Return the range (low, high), degrees, that coordinate i can have inside the chart.

    The other coordinates are those of the start. None if the start lies on an edge of the chart.
    """
    system, steps = problem.system, np.arange(0.0, 180.25, 0.5)
    branch = system.branch(problem.start)
    margins = [k for k, (index, _) in enumerate(system.margin_labels) if index == i]
    edges = []
    for side in (-1.0, 1.0):
        angles = np.rad2deg(problem.start[i]) + side * steps
        angles[1:] = np.round(2 * angles[1:]) / 2  # edges are at round angles
        q = np.tile(problem.start, (len(angles), 1))
        q[:, i] = np.deg2rad(angles)
        on_edge = np.any(system.chart_margins(q, branch)[:, margins] < 1e-9, axis=1)
        out = on_edge.nonzero()[0].tolist()
        edges.append(float(angles[out[0]]) if out else side * NO_EDGE_DEG)
        if 0 in out:
            return None
    return edges[0], edges[1]


# -- the list -----------------------------------------------------------------------------------


PLAN_FIGURES = {
    figure.id: figure
    for figure in (
        PlanFigure(
            "joints",
            joint_panels,
            "Coordinates",
            "Dots: start and goal; diamonds: waypoints with a time. Thin lines: the machine of"
            " median error.",
        ),
        PlanFigure(
            "inputs",
            input_panels,
            "Inputs and limits",
            "Dotted: the limits. Peaks outside the view are named above it.",
        ),
        PlanFigure(
            "map",
            map_panels,
            "Map of the first two joints",
            "Shaded: outside the chart that the start lies in. Dotted: the joints' limits.",
            fits=lambda system: hasattr(system, "arm_points") and system.size > 2,
        ),
        PlanFigure(
            "z",
            chained_panels,
            "Chained coordinates",
            "Shaded around z₂: where a real θ₁ exists, given the later angles. Curves outside, and"
            " margins below zero, are of paths that have left the domain of the chart.",
            executable=False,
            columns=True,
        ),
    )
}
"""All figures of plans, by name; the pictures, the page and the explorer draw each of them."""


def merge(panels: Sequence[Panel]) -> Iterator[Panel]:
    """Yield one plan's panels, merged where id and unit agree, with a colour for each curve."""
    groups: dict[tuple[str, str], list[Panel]] = {}
    for panel in panels:
        groups.setdefault((panel.id, panel.unit), []).append(panel)
    ids: set[str] = set()
    for (id, unit), group in groups.items():
        one, same = group[0], [panel for panel in group if isinstance(panel, TimePanel)]
        series = [
            replace(curve, name=panel.title, colour=k if len(same) > 1 else None)
            for k, panel in enumerate(same)
            for curve in panel.series
        ]
        if len(same) > 1:
            limits = list(dict.fromkeys(value for panel in same for value in panel.limits))
            one = TimePanel(id, id, unit, series, limits=limits, view=common_view(same))
        elif same:
            one = replace(one, series=series)
        yield replace(one, id=f"{id} {unit}" if id in ids else id)
        ids.add(one.id)


def common_view(panels: Sequence[TimePanel]) -> Pair | None:
    """Return the range that includes the views of panels that share an axis; None without views."""
    views = [panel.view for panel in panels if panel.view]
    return (min(low for low, _ in views), max(high for _, high in views)) if views else None


def span(plan: Plan) -> dict[str, Any]:
    """Return `begin` and `end` of a plan on a time axis whose 0 is the start of its path.

    `holds` lists the intervals in which the clock of a compensated plan is held (stands still) to
    take up lost motion.
    """
    lead = plan.lead_s
    holds = [[begin - lead, end - lead] for begin, end in plan.clock.holds]
    return {"begin": -lead, "end": plan.duration - lead, "holds": holds}


# -- for a browser ------------------------------------------------------------------------------

ROUNDING = 1e-12
"""Magnitude below which a number is a rounding error and shown as 0."""

SCREEN_DIGITS = 5
"""Number of significant digits for the browser, more than a screen shows."""


def screen_data(panel: Panel) -> dict[str, Any]:
    """Convert a panel to JSON data with readable names; arrays are rounded for the screen.

    Fields that have their default are left out.
    """
    return {"kind": "time" if isinstance(panel, TimePanel) else "plane", **_screen_value(panel)}


def _screen_value(value: Any) -> Any:
    match value:
        case np.ndarray():
            return to_screen_digits(value)
        case list() | tuple():
            return [_screen_value(item) for item in value]
    if not is_dataclass(value):
        return jsonable(value)
    out = {
        field.name: _screen_value(given)
        for field in fields(value)
        if (given := getattr(value, field.name)) is not field.default
    }
    if "names" in out:
        out["names"] = [readable_name(name) for name in out["names"]]
    return out | {key: readable_name(out[key]) for key in out.keys() & {"title", "name"}}


def to_screen_digits(values: Array) -> list[Any]:
    """Return numbers rounded for the screen, as nested lists; None if not finite."""
    values = np.asarray(values, dtype=float)
    finite, size = np.isfinite(values), np.abs(values)
    visible = finite & (size >= ROUNDING)
    scale = 10.0 ** (SCREEN_DIGITS - 1 - np.floor(np.log10(np.where(visible, size, 1.0))))
    short = (np.round(np.where(visible, values, 0.0) * scale) / scale).astype(object)
    short[~finite] = None
    return list(short.tolist())
