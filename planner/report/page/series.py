"""What the page's scripts draw: curves of every plan, panels, motions; JSON-ready."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.comparison.comparison import Comparison
from planner.plan.measures import worst_margin
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.charts.panels import (
    Panel,
    band,
    curve,
    near,
    over_time,
    to_screen_digits,
    unit_of,
)
from planner.report.figures.arm import body, drawable, tips_to_pass
from planner.report.figures.on_the_machine import far_apart, spread
from planner.report.figures.over_time import has_band, view
from planner.report.figures.style import Curve, curves, shown, times
from planner.report.page.words import places, subscripted
from planner.support.arrays import Array, jsonable
from planner.verification.summary import effort_unit

POINTS = 500
"""About how many times a curve is drawn at."""

PICTURES = 240
"""Pictures of a motion; the page moves evenly between them."""


def page_data(comparison: Comparison, replays: Mapping[str, Any]) -> dict[str, Any]:
    """Plans with their times and motions, and figures with their panels.

    Args:
        comparison: With its plans.
        replays: What `load_replays` gives.
    """
    found = {row.label: row.plan for row in comparison.rows if row.plan is not None}
    if not found:
        return {"plans": [], "figures": []}
    drawn, place = curves(found), places(comparison)
    closed = {row.label for row in comparison.rows if row.feedback}
    plans = [
        {**_plan(c, replays.get(c.label)), "colour": place[c.label], "closed": c.label in closed}
        for c in drawn
    ]
    sampled = [(k, c.plan, _times(c.plan)) for k, c in enumerate(drawn) if c.label not in closed]
    real = [s for s in sampled if s[1].executable]
    figures = [
        _z(sampled),
        *([_joints(real, replays, drawn), _inputs(real, drawn)] if real else []),
    ]
    figures += _spreads(comparison, drawn, replays)
    problem = comparison.problem
    length = "link lengths" if hasattr(problem.system, "arm_points") else "m"
    space = {
        "discs": [[*disc.centre, disc.radius] for disc in problem.obstacles],
        "tips": tips_to_pass(problem) if drawable(problem.system) else [],
    }
    return dict(jsonable({"plans": plans, "figures": figures, "length": length, "space": space}))


Sampled = tuple[int, Plan, Array]


def _plan(drawn: Curve, kept: Mapping[str, Any] | None) -> dict[str, Any]:
    plan = drawn.plan
    out = {
        "label": drawn.label,
        "refused": drawn.refused,
        "duration": plan.duration,
        "t": to_screen_digits(_times(plan)),
    }
    if plan.executable and drawable(plan.problem.system):
        even = np.linspace(0, plan.duration, PICTURES)
        out["motion"] = _motion(plan.problem, even, plan.q(even))
        path = body(plan.problem, plan.q(_times(plan)))[:, -1]
        out["path"] = to_screen_digits(path)
        if kept is not None:
            run = kept["median"]
            out["machine"] = _motion(plan.problem, np.array(run["t"]), np.array(run["q"]))
    return out


def _motion(problem: Problem, t: Array, q: Array) -> dict[str, Any]:
    """Points of the body, and each angle in words' units, over time."""
    tail = problem.system.coordinates[1:]
    values = np.column_stack([shown(q[:, i + 1], c.unit) for i, c in enumerate(tail)])
    return {
        "t": to_screen_digits(t),
        "points": np.round(body(problem, q), 4),
        "values": np.round(values, 3),
        "names": [subscripted(c.name) for c in tail],
        "units": [unit_of(c) for c in tail],
    }


# -- figures over time --------------------------------------------------------------------------


def _z(sampled: Sequence[Sampled]) -> dict[str, Any]:
    system = sampled[0][1].problem.system
    panels = []
    if has_band(system):
        panels += [
            over_time("z₂", "", [curve(k, plan.z(t)[:, 1])], **band(plan, t))
            for k, plan, t in sampled
        ]
    else:
        panels.append(_each("z₂", "", [(k, plan.z(t)[:, 1]) for k, plan, t in sampled]))
    if not has_band(system) or system.size > 4:
        margins = [(k, worst_margin(plan.trajectory.margins(t))) for k, plan, t in sampled]
        panels.append({**_each("least margin of the domain", "", margins), "floor": 0.0})
    for i in range(2, system.size):
        values = [(k, plan.z(t)[:, i]) for k, plan, t in sampled]
        panels.append(_each(subscripted(f"z{i + 1}"), "", values))
    caption = _BAND if has_band(system) else _MARGIN
    return {"id": "z", "caption": caption, "panels": panels}


_BAND = (
    "Shaded: where a real θ₁ exists, given the later angles. A curve outside has no arm that"
    " follows it."
)
_MARGIN = "Where the least margin is below zero the path has left the domain of the chart."


def _joints(
    real: Sequence[Sampled], replays: Mapping[str, Any], drawn: Sequence[Curve]
) -> dict[str, Any]:
    problem = real[0][1].problem
    panels = []
    for i, coordinate in enumerate(problem.system.coordinates):
        if i == 0:
            continue
        unit = coordinate.unit
        values = [(k, shown(plan.q(t)[:, i], unit)) for k, plan, t in real]
        panel = _each(subscripted(coordinate.name), unit_of(coordinate), values)
        limit = float(shown(problem.limits.joint[i : i + 1], unit)[0])
        ends = shown(np.array([problem.start[i], problem.goal[i]]), unit)
        machine = [
            curve(k, shown(_kept(replays, one)[:, i], unit), machine=True)
            for k, one in enumerate(drawn)
            if one.label in replays
        ]
        panel["series"] += machine
        on_the_way = [
            [w.time_s, float(shown(w.q[i : i + 1], unit)[0])]
            for w in problem.waypoints
            if w.time_s is not None and np.isfinite(w.q[i])
        ]
        lines = near(np.concatenate([v for _, v in values]), limit)
        panels.append({**panel, "limits": lines, "ends": list(ends), "stops": on_the_way})
    return {"id": "joints", "panels": panels}


def _kept(replays: Mapping[str, Any], drawn: Curve) -> Array:
    return np.asarray(replays[drawn.label]["median"]["q"], dtype=float)


def _inputs(real: Sequence[Sampled], drawn: Sequence[Curve]) -> dict[str, Any]:
    problem = real[0][1].problem
    panels = []
    for i, coordinate in enumerate(problem.system.inputs):
        limit = float(problem.limits.input[i])
        values = [(drawn[k], t, plan.u(t)[:, i]) for k, plan, t in real]
        low, high = view(values, limit)
        panel = _each(
            subscripted(coordinate.name),
            coordinate.unit,
            [(k, u) for (k, _, _), (_, _, u) in zip(real, values, strict=True)],
        )
        panel |= {"limits": [-limit, limit] if np.isfinite(limit) else [], "view": [low, high]}
        panel["notes"] = [
            {"plan": k, "t": float(t[m]), "value": float(u[m])}
            for (k, _, _), (_, t, u) in zip(real, values, strict=True)
            for m in [int(np.argmax(np.abs(u)))]
            if not low <= u[m] <= high
        ]
        panels.append(panel)
    return {"id": "inputs", "panels": panels}


def _each(title: str, unit: str, values: Sequence[tuple[int, Array]]) -> Panel:
    return over_time(title, unit, [curve(k, y) for k, y in values])


# -- figures over machines ----------------------------------------------------------------------


def _spreads(
    comparison: Comparison, drawn: Sequence[Curve], replays: Mapping[str, Any]
) -> list[dict[str, Any]]:
    known = [(k, one.label) for k, one in enumerate(drawn) if one.label in replays]
    if not known:
        return []
    errors = {k: np.sort(np.asarray(replays[label]["E_deg"], dtype=float)) for k, label in known}
    low, high = spread(list(errors.values()))
    series = [{"plan": k, "values": to_screen_digits(values)} for k, values in errors.items()]
    rows = {k: comparison[label] for k, label in known if np.isfinite(comparison[label].effort)}
    points = [
        {"plan": k, "x": row.effort, "y": row.E_median_deg, "high": row.E_p95_deg}
        for k, row in rows.items()
    ]
    shares: Panel = {"kind": "share", "title": "Share of machines", "unit": "", "series": series}
    shares |= {"across": "E (deg)", "span": [low, high], "log": far_apart([low, high])}
    unit = effort_unit(comparison.problem.system)
    trade: Panel = {"kind": "points", "title": "E", "unit": "deg", "points": points}
    trade |= {"across": f"effort ({unit})", "effort_unit": unit}
    trade["log"] = [far_apart([p[axis] for p in points] or [1.0]) for axis in ("x", "y")]
    return [{"id": "trade", "panels": [trade]}, {"id": "errors", "panels": [shares]}]


def _times(plan: Plan) -> Array:
    """Times that show a plan: many where it has corners, and not too many in all."""
    every = times(plan, POINTS)
    if len(every) <= 2 * POINTS:
        return every
    some = np.linspace(0, len(every) - 1, 2 * POINTS).round().astype(int)
    return np.asarray(every[some])
