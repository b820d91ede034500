"""Data for the page's scripts: curves of every plan, panels, motions; JSON-ready."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.comparison.comparison import Comparison
from planner.machine.machine import Machine
from planner.machine.replay import STATISTICS
from planner.plan.measures import effort_unit
from planner.plan.plan import Plan
from planner.report.figures.arm import body_points, can_draw, tips_to_pass
from planner.report.figures.on_the_machine import error_range, needs_log_axis
from planner.report.figures.style import (
    Curve,
    curves,
    length_unit,
    readable_name,
    times,
    to_display,
    unit_of,
)
from planner.report.page.words import colour_places
from planner.report.panels import (
    PLAN_FIGURES,
    PlanCurves,
    Series,
    screen_data,
    shown_coordinates,
    span,
    to_screen_digits,
)
from planner.support.arrays import Array, jsonable

CURVE_POINTS = 500
"""Approximate number of times at which a curve is drawn."""

MOTION_PICTURES = 240
"""Number of frames of a motion; the page interpolates between the frames."""


def page_data(comparison: Comparison, replays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the page's data: plans with their times and motions, and figures with their panels.

    Args:
        comparison: The comparison with its plans.
        replays: Content of the folder's replays.json (`folders.replay_data`), {} without it.
    """
    plans = {row.label: row.plan for row in comparison.rows if row.plan is not None}
    if not plans:
        return {"plans": [], "figures": []}
    drawn, place = curves(plans), colour_places(comparison)
    closed = {row.label for row in comparison.rows if row.feedback}
    entries = [
        {**_plan(c, replays.get(c.label)), "colour": place[c.label], "closed": c.label in closed}
        for c in drawn
    ]
    figures = list(_figures(comparison.machine, drawn, closed, replays))
    figures += _spreads(comparison, drawn, replays)
    problem = comparison.problem
    length = length_unit(problem.system)
    space = {
        "discs": [[*disc.centre, disc.radius] for disc in problem.obstacles],
        "tips": tips_to_pass(problem) if can_draw(problem.system) else [],
    }
    data = {"plans": entries, "figures": figures, "length": length, "space": space}
    return dict(jsonable(data | {"opening": _opening(comparison)}))


def _opening(comparison: Comparison) -> list[str]:
    """Return the plans' labels in order of preference for what the page shows first."""
    take = comparison.recommended
    labels = [] if take is None else [take.label, take.spec.plain.label]
    labels += ["collocation", *(row.label for row in comparison.rows if row.solved)]
    return list(dict.fromkeys([*labels, *(row.label for row in comparison.rows)]))


def _plan(drawn: Curve, replay: Mapping[str, Any] | None) -> dict[str, Any]:
    plan = drawn.plan
    out = {
        "label": drawn.label,
        "refused": drawn.refused,
        "followed": drawn.followed,
        **span(plan),
        "t": to_screen_digits(_times(plan) - plan.lead_s),
    }
    if plan.executable and can_draw(plan.problem.system):
        even = np.linspace(0, plan.duration, MOTION_PICTURES)
        out["motion"] = motion_data(plan, even, plan.q(even))
        out["path"] = to_screen_digits(body_points(plan.problem, plan.q(_times(plan)))[:, -1])
        if replay is not None:
            run = replay["median"]
            out["machine"] = motion_data(plan, np.array(run["t"]), np.array(run["q"]))
    return out


def motion_data(plan: Plan, t: Array, q: Array) -> dict[str, Any]:
    """Return a motion of arm or vehicle over time: its points, and coordinates in display units."""
    problem = plan.problem
    shown, w = shown_coordinates(problem.system), problem.system.user(q)
    values = np.column_stack([to_display(w[:, i], c.unit) for i, c in shown])
    return {
        "t": to_screen_digits(t - plan.lead_s),
        "points": np.round(body_points(problem, q), 4) if can_draw(problem.system) else [],
        "values": np.round(values, 3),
        "names": [readable_name(c.name) for _, c in shown],
        "units": [unit_of(c) for _, c in shown],
    }


# -- figures of plans ---------------------------------------------------------------------------


def _figures(
    machine: Machine, drawn: Sequence[Curve], closed: Collection[str], replays: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """Yield the data of `PLAN_FIGURES`, except for plans with feedback: their paths are the
    same."""
    system = drawn[0].plan.problem.system
    every = [
        PlanCurves(k, one.plan, _times(one.plan), machine)
        for k, one in enumerate(drawn)
        if one.label not in closed
    ]
    for figure in PLAN_FIGURES.values():
        fit = [one for one in every if one.plan.executable or not figure.executable]
        if not fit or not figure.fits(system):
            continue
        panels = figure.panels(fit)
        if figure.id == "joints":
            panels = [
                replace(panel, series=[*panel.series, *_median_machine(drawn, replays, i)])
                for (i, _), panel in zip(shown_coordinates(system), panels, strict=True)
            ]
        yield {"id": figure.id, "panels": [screen_data(panel) for panel in panels]}


def _median_machine(drawn: Sequence[Curve], replays: Mapping[str, Any], i: int) -> Iterator[Series]:
    """Yield the curve of user coordinate i on the machine with median error, per replayed plan."""
    for k, one in enumerate(drawn):
        if one.label in replays:
            q = np.asarray(replays[one.label]["median"]["q"], dtype=float)
            system = one.plan.problem.system
            unit = system.user_coordinates[i].unit
            yield Series(k, to_display(system.user(q)[:, i], unit), machine=True)


# -- figures over machines ----------------------------------------------------------------------


def _spreads(
    comparison: Comparison, drawn: Sequence[Curve], replays: Mapping[str, Any]
) -> list[dict[str, Any]]:
    pairs = [(k, one.label) for k, one in enumerate(drawn) if one.label in replays]
    if not pairs:
        return []
    errors = {k: np.sort(np.asarray(replays[label]["E_deg"], dtype=float)) for k, label in pairs}
    low, high = error_range(list(errors.values()))
    series = [{"plan": k, "values": to_screen_digits(values)} for k, values in errors.items()]
    rows = {k: comparison[label] for k, label in pairs if np.isfinite(comparison[label].effort)}
    points = [
        {"plan": k, "x": row.effort, "y": row.E_median_deg, "high": row.E_p95_deg}
        for k, row in rows.items()
    ]
    shares = {"kind": "share", "title": "Share of machines", "unit": "", "series": series}
    across = {"across": "E (deg)", "span": [low, high], "log": needs_log_axis([low, high])}
    unit = effort_unit(comparison.problem.system)
    titles = {"middle": STATISTICS["E_median_deg"].title, "high": STATISTICS["E_p95_deg"].title}
    trade = {"kind": "points", "title": "E", "unit": "deg", "points": points, **titles}
    log = [needs_log_axis([p[axis] for p in points] or [1.0]) for axis in ("x", "y")]
    effort = {"across": f"effort ({unit})", "effort_unit": unit, "log": log}
    figures = {"trade": {**trade, **effort}, "errors": {**shares, **across}}
    return [{"id": name, "panels": [panel]} for name, panel in figures.items()]


def _times(plan: Plan) -> Array:
    """Return the times at which the page draws a plan, s: dense near corners, limited in number."""
    every = times(plan, CURVE_POINTS)
    if len(every) <= 2 * CURVE_POINTS:
        return every
    some = np.linspace(0, len(every) - 1, 2 * CURVE_POINTS).round().astype(int)
    return np.asarray(every[some])
