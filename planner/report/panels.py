"""Figures of plans as panels of plain data, which pictures, the page and the explorer draw.

`PLAN_FIGURES` lists the figures. A panel is a dictionary with `id`, `kind`, `title`, `unit` and
`series`. Titles and names of series are the problem's names of coordinates, or words; the code that
draws formats them. A series belongs to the plan with number `plan`; it has a `name` and a `colour`
only if these differ from the plan's.

In a panel of kind "time", a series has values `y` at the plan's times or at its own `t`. The panel
may have

- `band`: `low` and `high` at the times of the first series, optionally with a `name`,
- `limits`: values of horizontal lines; `floor`: shade below this value; `zero`: show zero,
- `ends`: values at start and end; `stops` and `marks`: points [t, value] of waypoints, and where
  the path leaves or enters the domain,
- `view`: least and greatest value shown; `notes`: peaks beyond it,
- `note`: a few words beside the title.

In a panel of kind "plane", a series has a path `x`, `y` at the plan's times. The panel has `across`
(label of the x axis), `names` of both axes, which share its unit; `ends`; `view` of both axes;
`region`: a box outside of which is shaded, or null; `limits`: pairs [axis, value]. It may have
`poses`, `discs`, `tips`, and a `key`: pairs of a kind of line and its meaning.

Panels with the same `id` can be drawn as one, see `merge`. Angles are in degrees, times in seconds
from the plan's beginning; undefined numbers are NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from planner.plan.measures import worst_margin
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.figures.style import readable_name, to_display, unit_of
from planner.support.arrays import Array, jsonable
from planner.systems.chained_form import chained_form
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import Coordinate, TriangularSystem

Panel = dict[str, Any]

DRAWN_LIMIT_SHARE = 0.75
"""A limit is drawn if the values reach this share of it."""

OVERSHOOT = 1.6
"""The view extends to this multiple of the limit; peaks beyond it are named."""

PEAK_RATIO = 5.0
"""Without a limit, peaks are cut off only above this multiple of the usual values."""


@dataclass(frozen=True, eq=False)
class PlanCurves:
    """A plan and the times at which it is drawn.

    Attributes:
        number: Its index among the drawn plans.
        plan: The plan.
        t: Times (m,), seconds.
    """

    number: int
    plan: Plan
    t: Array

    @cached_property
    def q(self) -> Array:
        """Coordinates, shape (m, N)."""
        return self.plan.q(self.t)

    @cached_property
    def user(self) -> Array:
        """User coordinates, shape (m, N)."""
        return self.plan.user(self.t)

    @cached_property
    def z(self) -> Array:
        """Chained coordinates, shape (m, N)."""
        return self.plan.z(self.t)

    @cached_property
    def u(self) -> Array:
        """Inputs, shape (m, 2)."""
        return self.plan.u(self.t)

    def curve(self, values: Array, **more: Any) -> Panel:
        """Build a series of a panel over time."""
        return {"plan": self.number, "y": values, **more}


DrawnPlans = Sequence[PlanCurves]


@dataclass(frozen=True)
class PlanFigure:
    """A figure of plans: its panels and texts.

    Attributes:
        id: Name, for files and on the page.
        panels: Builds its panels for plans of one problem.
        title: Title.
        caption: Explanation on the page.
        executable: Whether it shows only executable plans.
        columns: Whether a picture has one column per plan.
        fits: Tells which systems have it.
    """

    id: str
    panels: Callable[[DrawnPlans], list[Panel]]
    title: str
    caption: str
    executable: bool = True
    columns: bool = False
    fits: Callable[[TriangularSystem], bool] = lambda system: True


# -- chained coordinates ------------------------------------------------------------------------


def chained_panels(drawn: DrawnPlans) -> list[Panel]:
    """z₂ with its domain (one panel per plan), the least margin if it adds something, z₃ … z_N."""
    system = drawn[0].plan.problem.system
    panels = []
    if has_band(system):
        panels += [
            time_panel("z2", "z2", "", [one.curve(one.z[:, 1])], **_domain(one)) for one in drawn
        ]
    else:
        panels.append(time_panel("z2", "z2", "", [one.curve(one.z[:, 1]) for one in drawn]))
    if not has_band(system) or system.size > 4:
        margins = [one.curve(worst_margin(one.plan.trajectory.margins(one.t))) for one in drawn]
        title = "least margin of the domain"
        panels.append(time_panel("margin", title, "", margins, floor=0.0))
    return panels + [
        time_panel("z", f"z{i + 1}", "", [one.curve(one.z[:, i]) for one in drawn])
        for i in range(2, system.size)
    ]


def has_band(system: TriangularSystem) -> bool:
    """Whether `z2_band` is defined for a system."""
    return isinstance(system, Manipulator)


def z2_band(plan: Plan, t: Array) -> Array:
    """The values of z₂ for which a real θ₁ exists, given the later angles of a manipulator.

    z₂ is affine in cos²θ₁ (n = 2: monotone in cosθ₁), so the band runs between θ₁ = 0 and θ₁ = 90°.

    Args:
        plan: A plan for a `Manipulator`.
        t: Times (m,), seconds.

    Returns:
        Lower and upper edge, shape (2, m); NaN if the later angles are not real.
    """
    form = chained_form(plan.problem.system)
    q = plan.q(t)
    edges = []
    for theta1 in (0.0, np.pi / 2):
        q[:, 1] = theta1
        edges.append(form.z(q)[:, 1])
    return np.sort(np.array(edges), axis=0)


def _domain(one: PlanCurves) -> Mapping[str, Any]:
    """The band in which a real θ₁ exists, and the points where the path leaves or enters it."""
    plan = one.plan
    low, high = z2_band(plan, one.t)
    out = np.array([] if plan.executable else plan.domain.exits_s)
    marks = np.stack([out, plan.z(out)[:, 1]], axis=1).tolist()
    return {"band": {"low": low, "high": high}, "marks": marks}


# -- coordinates and inputs ---------------------------------------------------------------------


def shown_coordinates(system: TriangularSystem) -> list[tuple[int, Coordinate]]:
    """The user coordinates that are drawn, with their indices.

    All of them; if they are the triangular ones, all but the first, which is the path coordinate.
    """
    every = list(enumerate(system.user_coordinates))
    return every if system.has_user_coordinates else every[1:]


def joint_panels(drawn: DrawnPlans) -> list[Panel]:
    """The user coordinates, with start, goal, waypoints, and limits that are close."""
    problem = drawn[0].plan.problem
    panels, start = [], problem.system.user(problem.start)
    for i, coordinate in shown_coordinates(problem.system):
        unit = coordinate.unit
        series = [one.curve(to_display(one.user[:, i], unit)) for one in drawn]
        (limit,) = to_display(problem.limits.user[i : i + 1], unit).tolist()
        stops = [
            [point.time_s, float(to_display(point.user[i : i + 1], unit)[0])]
            for point in problem.waypoints
            if point.time_s is not None and np.isfinite(point.user[i])
        ]
        panel = time_panel("joints", coordinate.name, unit_of(coordinate), series)
        panel["limits"] = near_limits(np.concatenate([s["y"] for s in series]), limit)
        panel["ends"] = to_display(np.array([start[i], problem.user_goal[i]]), unit).tolist()
        panels.append({**panel, "stops": stops})
    return panels


def input_panels(drawn: DrawnPlans) -> list[Panel]:
    """u₁ and u₂ with their limits; peaks far beyond are cut off and noted."""
    problem = drawn[0].plan.problem
    panels = []
    for i, coordinate in enumerate(problem.system.inputs):
        limit = float(problem.limits.input[i])
        values = [(one, one.t, np.nan_to_num(one.u[:, i])) for one in drawn]
        low, high = view_range(values, limit)
        panel = time_panel(
            "inputs", coordinate.name, coordinate.unit, [one.curve(one.u[:, i]) for one in drawn]
        )
        panel |= {"limits": [-limit, limit] if np.isfinite(limit) else [], "view": [low, high]}
        panel["notes"] = [
            {"plan": one.number, "t": float(t[k] - one.plan.lead_s), "value": float(u[k])}
            for one, t, u in values
            for k in [int(np.argmax(np.abs(u)))]
            if not low <= u[k] <= high
        ]
        panels.append(panel)
    return panels


def near_limits(values: Array, limit: float) -> list[float]:
    """±limit if the values come close to it; a distant line would only shrink the curves."""
    reach = [(side, np.nanmax(side * values, initial=-np.inf)) for side in (-1, 1)]
    if not np.isfinite(limit):
        return []
    return [side * limit for side, most in reach if most > DRAWN_LIMIT_SHARE * limit]


def view_range(values: Sequence[tuple[Any, Array, Array]], limit: float) -> tuple[float, float]:
    """Lowest and highest value to show of inputs (plan, times, values) with a limit."""
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


def map_panels(drawn: DrawnPlans) -> list[Panel]:
    """Paths in the plane (θ₁, θ₂), and the edges of the chart that contains the start."""
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
    panel = {
        "id": "map",
        "kind": "plane",
        "title": f"{readable_name(names[1])} over {readable_name(names[0])}",
        "unit": "deg",
        "across": f"{readable_name(names[0])} (deg)",
        "names": names,
        "series": [
            {"plan": one.number, "x": path[:, 0], "y": path[:, 1]}
            for one, path in zip(drawn, paths, strict=True)
        ],
        "ends": ends.tolist(),
        "view": frame,
        "region": sides if all(sides) else None,
        "limits": [[k, line] for k, line in lines if np.isfinite(line)],
        "note": "" if all(sides) else "the start lies on the chart's edge",
        "key": [["below", "outside the chart"], ["limit", "joint limits"]],
    }
    return [panel]


MAP_MARGIN_DEG, NO_EDGE_DEG = 6.0, 1e4
"""Margin of the map around its content, degrees; and the value that stands for no edge."""


def _chart_range(problem: Problem, i: int) -> tuple[float, float] | None:
    """Range of coordinate i alone inside the chart around the start, degrees; None on an edge."""
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
"""All figures of plans by name, in order; pictures, page and explorer draw every entry."""


def time_panel(id: str, title: str, unit: str, series: Sequence[Panel], **more: Any) -> Panel:
    """Build a panel over time; see the module's docstring."""
    values = {"kind": "time", "title": title, "unit": unit, "series": list(series)}
    return {"id": id, **values, **more}


def merge(panels: Sequence[Panel]) -> Iterator[Panel]:
    """Merge panels of one plan with the same id and unit into one, with one colour per curve."""
    groups: dict[tuple[str, str], list[Panel]] = {}
    for panel in panels:
        groups.setdefault((panel["id"], panel["unit"]), []).append(panel)
    ids: set[str] = set()
    for (id, unit), same in groups.items():
        colours = [{"colour": k} if len(same) > 1 else {} for k in range(len(same))]
        one = dict(same[0])
        if one["kind"] == "time":
            one["series"] = [
                {**curve, "name": panel["title"], **colour}
                for panel, colour in zip(same, colours, strict=True)
                for curve in panel["series"]
            ]
        if len(same) > 1:
            kept = ("kind", "unit", "series")
            one = {"title": id} | {key: one[key] for key in kept}
            one["limits"] = list(dict.fromkeys(v for p in same for v in p.get("limits", [])))
            views = [panel["view"] for panel in same if "view" in panel]
            if views:
                one["view"] = [min(low for low, _ in views), max(high for _, high in views)]
        one["id"] = f"{id} {unit}" if id in ids else id
        ids.add(id)
        yield one


def span(plan: Plan) -> dict[str, Any]:
    """Times at which a plan begins and ends on an axis whose 0 is the start of its path.

    Also the times at which the clock of a compensated plan is held to take up lost motion.
    """
    lead = plan.lead_s
    holds = [[begin - lead, end - lead] for begin, end in plan.clock.holds]
    return {"begin": -lead, "end": plan.duration - lead, "holds": holds}


# -- for a browser ------------------------------------------------------------------------------

ROUNDING = 1e-12
"""Smaller numbers are rounding and would be shown with an exponent."""

SCREEN_DIGITS = 5
"""Significant digits for the browser, more than a screen shows."""


def screen_data(panel: Mapping[str, Any]) -> Panel:
    """Convert a panel to JSON data with readable names; arrays are rounded for the screen."""
    out: Panel = {key: _screen_value(value) for key, value in panel.items()}
    out["title"] = readable_name(panel["title"])
    if "names" in panel:
        out["names"] = [readable_name(name) for name in panel["names"]]
    return out


def _screen_value(value: Any) -> Any:
    match value:
        case np.ndarray():
            return to_screen_digits(value)
        case dict():
            inner = {key: _screen_value(item) for key, item in value.items()}
            return inner | {"name": readable_name(value["name"])} if "name" in value else inner
        case list() | tuple():
            return [_screen_value(item) for item in value]
    return jsonable(value)


def to_screen_digits(values: Array) -> list[Any]:
    """Round numbers to the significant digits of a screen; None for numbers that are not finite."""
    values = np.asarray(values, dtype=float)
    finite, size = np.isfinite(values), np.abs(values)
    visible = finite & (size >= ROUNDING)
    scale = 10.0 ** (SCREEN_DIGITS - 1 - np.floor(np.log10(np.where(visible, size, 1.0))))
    short = (np.round(np.where(visible, values, 0.0) * scale) / scale).astype(object)
    short[~finite] = None
    out: list[Any] = short.tolist()
    return out
