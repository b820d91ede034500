"""The panels of the figure as plain data for the browser."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.explorer.controls import POINTS_KEY
from planner.explorer.outcome import ScreenOutcome
from planner.machine.replay import Replay
from planner.plan.plan import Plan
from planner.report.figures.arm import body_points, can_draw, tips_to_pass
from planner.report.figures.style import colour_numbers, length_unit, times
from planner.report.panels import (
    PLAN_FIGURES,
    Panel,
    PlanCurves,
    merge,
    screen_data,
    span,
    time_panel,
    to_screen_digits,
)

CURVE_SAMPLES = 160
"""Number of instants at which curves are sampled; a path with more nodes has more."""

POSES = 10

TITLES = {"z2": "z₂ and its domain", "z": "the other chained coordinates"}
"""Titles that replace those of panels with more contents here."""


def picture(outcome: ScreenOutcome) -> dict[str, Any]:
    """Return the plan and the panels that need no replay, in the order of the screen.

    See `planner.report.panels`. The panel of z2 also has `handles`, one per constraint point: its
    position `at` [t, z2] and, if it can be dragged, the `names` of its controls.
    """
    plan = outcome.plan
    if plan is None:
        return {"plans": [], "panels": []}
    name = f"{plan.method} compensated" if plan.compensates else plan.method
    one = PlanCurves(0, plan, times(plan, CURVE_SAMPLES))
    system = plan.problem.system
    fit = [figure for figure in PLAN_FIGURES.values() if figure.fits(system)]
    panels = {p["id"]: p for figure in fit for p in merge(figure.panels([one]))}
    _add_words(panels, one)
    if can_draw(system):
        panels["plane"] = _plane(one)
    curve = {
        "label": plan.method,
        "refused": outcome.error is not None,
        "colour": colour_numbers([name])[name],
        **span(plan),
        "t": to_screen_digits(one.t - plan.lead_s),
    }
    return {"plans": [curve], "panels": [screen_data(panel) for panel in panels.values()]}


def _add_words(panels: dict[str, Panel], one: PlanCurves) -> None:
    """Add what only the screen shows: handles, the limit of the margin, notes and titles."""
    problem = one.plan.problem
    margin = problem.limits.z2_margin
    panels["z2"] |= {
        "zero": True,
        "handles": _handles(one.plan),
        "limits": [problem.z2_sign * margin] if margin else [],
    }
    if "band" in panels["z2"]:
        panels["z2"]["band"]["name"] = "a real θ₁ exists"
    for panel in (p for p in panels.values() if p["id"].startswith("inputs")):
        panel |= {"zero": True, "note": _peaks(panel)}
    if "map" in panels:
        panels["map"]["key"].insert(0, ["path", "path"])
    for key, title in TITLES.items():
        if key in panels and (key == "z2" or len(panels[key]["series"]) > 1):
            panels[key]["title"] = title


def error_panel(run: Replay | None) -> dict[str, Any] | None:
    """Return the panel of the largest joint error over time: median and 90 % band of machines."""
    if run is None or not run.angles:
        return None
    target = run.plan.wanted(run.t)  # NaN during the preparation of a compensated plan
    under_way = np.isfinite(target).all(axis=1)
    error = np.rad2deg(np.abs(run.q - target)[:, under_way][:, :, list(run.angles)]).max(axis=2)
    low, middle, high = np.percentile(error, [5, 50, 95], axis=0)
    t = run.t[under_way] - run.plan.lead_s
    panel = time_panel(
        "error",
        "error",
        "deg",
        [{"plan": 0, "y": middle, "name": "median machine", "t": t}],
        band={"low": low, "high": high, "name": "90 % of the machines"},
        note=f"E median {run.percentile(50):.3g} deg, 95 % {run.percentile(95):.3g} deg"
        + "".join(f"; {words}" for words in (run.slip_words, run.limit_words) if words),
        zero=True,
    )
    return screen_data(panel)


def _handles(plan: Plan) -> list[dict[str, Any]]:
    """Return the constraint points; only points set in the problem have controls to drag."""
    if plan.method != "polynomial":
        return []
    options = plan.options["points"]
    can_drag = isinstance(options, list)
    points = options if can_drag else plan.notes.get("points", [])
    return [
        {
            "at": list(point),
            "names": [f"{POINTS_KEY}:{k}:0", f"{POINTS_KEY}:{k}:1"] if can_drag else None,
        }
        for k, point in enumerate(points)
    ]


def _peaks(panel: Panel) -> str:
    """Return the peak of each input in words."""
    peaks = (
        f"{curve['name']} {np.nanmax(np.abs(curve['y']), initial=0.0):.3g}"
        for curve in panel["series"]
    )
    return "peaks: " + ", ".join(peaks)


def _plane(one: PlanCurves) -> Panel:
    plan = one.plan
    poses = body_points(plan.problem, plan.q(np.linspace(0, plan.duration, POSES)))
    path = body_points(plan.problem, one.q)[:, -1]
    arm = hasattr(plan.problem.system, "arm_points")
    unit = length_unit(plan.problem.system)
    return {
        "id": "plane",
        "kind": "plane",
        "title": "the arm" if arm else "the path",
        "unit": unit,
        "across": f"x ({unit})",
        "names": ["x", "y"],
        "series": [{"plan": 0, "x": path[:, 0], "y": path[:, 1]}],
        "poses": [pose.tolist() for pose in poses if np.isfinite(pose).all()],
        "discs": [[*o.centre.tolist(), o.radius] for o in plan.problem.obstacles],
        "tips": tips_to_pass(plan.problem).tolist(),
        "key": [
            ["ramp", f"from 0 s to {plan.duration:.3g} s"],
            ["path", "path of the tip" if arm else "path"],
        ],
    }
