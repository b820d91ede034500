"""The panels of the figure as plain data for the browser."""

from __future__ import annotations

from dataclasses import replace
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
    PlanePanel,
    Series,
    Shade,
    TimePanel,
    merge,
    screen_data,
    span,
    to_screen_digits,
)

CURVE_SAMPLES = 160
"""Least number of instants at which a plan's curves are sampled, for plans with few nodes."""

POSES = 10

TITLES = {"z2": "z₂ and its domain", "z": "the other chained coordinates"}
"""Titles, by panel id, of panels that show more in the explorer than elsewhere."""


def picture(outcome: ScreenOutcome) -> dict[str, Any]:
    """Return the data of the plan and of all panels that need no replay, in their order.

    `planner.report.panels` describes the data. The panel of z2 also has `handles`, one per
    constraint point: the position `at` [t, z2] and, if the point can be dragged, the `names` of the
    controls that dragging sets.
    """
    plan = outcome.plan
    if plan is None:
        return {"plans": [], "panels": []}
    name = f"{plan.method} compensated" if plan.compensates else plan.method
    one = PlanCurves(0, plan, times(plan, CURVE_SAMPLES))
    system = plan.problem.system
    fit = [figure for figure in PLAN_FIGURES.values() if figure.fits(system)]
    panels = [_with_words(p, plan) for figure in fit for p in merge(figure.panels([one]))]
    if can_draw(system):
        panels.append(_plane(one))
    data = {panel.id: screen_data(panel) for panel in panels}
    data["z2"]["handles"] = _handles(plan)
    curve = {
        "label": plan.method,
        "refused": outcome.error is not None,
        "colour": colour_numbers([name])[name],
        **span(plan),
        "t": to_screen_digits(one.t - plan.lead_s),
    }
    return {"plans": [curve], "panels": list(data.values())}


def _with_words(panel: Panel, plan: Plan) -> Panel:
    """Add to a panel what only the explorer shows: the limit on z₂, names, notes and titles."""
    if isinstance(panel, PlanePanel):
        return replace(panel, key=[("path", "path"), *panel.key])
    assert isinstance(panel, TimePanel)
    if panel.id == "z2":
        margin = plan.problem.limits.z2_margin
        limits = [plan.problem.z2_sign * margin] if margin else []
        band = panel.band and replace(panel.band, name="a real θ₁ exists")
        panel = replace(panel, zero=True, limits=limits, band=band)
    elif panel.id.startswith("inputs"):
        peaks = (f"{c.name} {np.nanmax(np.abs(c.y), initial=0.0):.3g}" for c in panel.series)
        panel = replace(panel, zero=True, note="peaks: " + ", ".join(peaks))
    one_curve = panel.id == "z" and len(panel.series) == 1
    return panel if one_curve else replace(panel, title=TITLES.get(panel.id, panel.title))


def error_panel(run: Replay | None) -> dict[str, Any] | None:
    """Return the panel of the largest joint error over time: median and 90 % band of machines."""
    if run is None or not run.angles:
        return None
    target = run.plan.wanted(run.t)  # NaN during the preparation of a compensated plan
    under_way = np.isfinite(target).all(axis=1) & (run.t >= 0)
    error = np.rad2deg(np.abs(run.q - target)[:, under_way][:, :, list(run.angles)]).max(axis=2)
    low, middle, high = np.percentile(error, [5, 50, 95], axis=0)
    t = run.t[under_way] - run.plan.lead_s
    note = "; ".join(filter(None, [run.error_words, run.slip_words, run.limit_words]))
    series = [Series(0, middle, t=t, name="median machine")]
    band = Shade(low, high, "90 % of the machines")
    return screen_data(TimePanel("error", "error", "deg", series, band=band, note=note, zero=True))


def _handles(plan: Plan) -> list[dict[str, Any]]:
    """Return the handles of constraint points; only points set in the problem can be dragged."""
    if plan.method != "polynomial":
        return []
    options = plan.options["points"]
    can_drag = isinstance(options, list)
    points = options if can_drag else plan.notes.get("points", [])
    return [
        {"at": list(at), "names": [f"{POINTS_KEY}:{k}:{i}" for i in (0, 1)] if can_drag else None}
        for k, at in enumerate(points)
    ]


def _plane(one: PlanCurves) -> PlanePanel:
    plan = one.plan
    poses = body_points(plan.problem, plan.q(np.linspace(0, plan.duration, POSES)))
    path = body_points(plan.problem, one.q)[:, -1]
    arm = hasattr(plan.problem.system, "arm_points")
    unit = length_unit(plan.problem.system)
    return PlanePanel(
        "plane", "the arm" if arm else "the path", unit, [Series(0, *path.T[::-1])],
        names=["x", "y"],
        poses=[pose.tolist() for pose in poses if np.isfinite(pose).all()],
        discs=[[*o.centre.tolist(), o.radius] for o in plan.problem.obstacles],
        tips=tips_to_pass(plan.problem).tolist(),
        key=[("ramp", f"from 0 s to {plan.duration:.3g} s"),
             ("path", "path of the tip" if arm else "path")],
    )  # fmt: skip
