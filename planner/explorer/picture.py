"""The panels of the picture as plain data: what the browser draws, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.explorer.controls import POINTS
from planner.explorer.outcome import ScreenOutcome
from planner.machine.replay import Replay
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
from planner.report.figures.over_time import view
from planner.report.figures.style import colour_numbers, shown, times
from planner.report.page.words import subscripted
from planner.support.arrays import Array

SAMPLES = 160
"""Instants a curve is drawn by, where it is not finer by itself."""

POSES = 10


def picture(outcome: ScreenOutcome) -> dict[str, Any]:
    """The plan, and the panels that a path alone fills in the order of the screen.

    See `planner.report.charts.panels`; besides, each panel has an `id`, and that of z2 `handles`:
    constraint points [t, z2], `at`, those that can be dragged with the `names` of their controls.
    Panels of kind "plane" have a `path` [xs, ys] at the plan's times, its `names`, and `poses`.
    """
    plan = outcome.plan
    if plan is None:
        return {"plans": [], "panels": []}
    name = f"{plan.method} compensated" if plan.compensates else plan.method
    t = times(plan, SAMPLES)
    z, q, u = plan.z(t), plan.q(t), plan.u(t)
    found = [_z2(plan, t, z), *_rest(z), _angles(plan, q), _inputs(plan, t, u)]
    if drawable(plan.problem.system):
        found.append(_plane(plan, q))
    if hasattr(plan.problem.system, "arm_points"):
        found.append(_map(plan, q))
    drawn = {
        "label": plan.method,
        "refused": outcome.error is not None,
        "colour": colour_numbers([name])[name],
        "duration": plan.duration,
        "t": to_screen_digits(t),
    }
    return {"plans": [drawn], "panels": found}


def error_panel(run: Replay | None) -> dict[str, Any] | None:
    """The largest error of any angle over time, on the machines: median and 90 % of them."""
    if run is None or not run.angles:
        return None
    wanted = run.plan.wanted(run.t)  # not a number while a compensated plan prepares
    begun = np.isfinite(wanted).all(axis=1)
    error = np.rad2deg(np.abs(run.q - wanted)[:, begun][:, :, list(run.angles)]).max(axis=2)
    low, middle, high = np.percentile(error, [5, 50, 95], axis=0)
    return over_time(
        "error",
        "deg",
        [curve(0, middle, name="median machine", t=to_screen_digits(run.t[begun]))],
        id="error",
        band={
            "low": to_screen_digits(low),
            "high": to_screen_digits(high),
            "name": "90 % of the machines",
        },
        note=f"E median {run.percentile(50):.3g} deg, 95 % {run.percentile(95):.3g} deg",
        zero=True,
    )


def _z2(plan: Plan, t: Array, z: Array) -> Panel:
    margin = plan.problem.limits.z2_margin
    return over_time(
        "z₂ and its domain",
        "",
        [curve(0, z[:, 1], name="z₂")],
        id="z2",
        zero=True,
        handles=_handles(plan),
        limits=[plan.problem.z2_sign * margin] if margin else [],
        **band(plan, t, name="a real θ₁ exists"),
    )


def _handles(plan: Plan) -> list[dict[str, Any]]:
    """Constraint points; those that the problem gives can be dragged, by the controls' names."""
    if plan.method != "polynomial":
        return []
    options = plan.options["points"]
    given = isinstance(options, list)
    points = options if given else plan.notes.get("points", [])
    return [
        {"at": list(point), "names": [f"{POINTS}:{k}:0", f"{POINTS}:{k}:1"] if given else None}
        for k, point in enumerate(points)
    ]


def _rest(z: Array) -> list[Panel]:
    if z.shape[1] < 3:
        return []
    lines = _lines([f"z{k + 1}" for k in range(2, z.shape[1])], z[:, 2:])
    return [over_time("the other chained coordinates", "", lines, id="z")]


def _angles(plan: Plan, q: Array) -> Panel:
    coordinates = plan.problem.system.coordinates
    kept = [i for i in range(1, len(coordinates)) if coordinates[i].unit == "rad"]
    kept = kept or list(range(1, len(coordinates)))
    unit = coordinates[kept[0]].unit
    limits = np.unique(np.abs(plan.problem.limits.joint[kept]))
    values = shown(q[:, kept], unit)
    near_ones = [line for most in shown(limits, unit) for line in near(values, float(most))]
    lines = _lines([coordinates[i].name for i in kept], values)
    return over_time("joints", unit_of(coordinates[kept[0]]), lines, id="joints", limits=near_ones)


def _inputs(plan: Plan, t: Array, u: Array) -> Panel:
    inputs, limits = plan.problem.system.inputs, np.unique(plan.problem.limits.input)
    finite = limits[np.isfinite(limits)]
    peaks = np.nanmax(np.abs(u), axis=0, initial=0.0)
    said = [f"{i.name} {value:.3g}" for i, value in zip(inputs, peaks, strict=True)]
    most = float(np.max(finite, initial=-np.inf))
    drawn = [(None, t, np.nan_to_num(u[:, i])) for i in range(2)]
    return over_time(
        "inputs",
        " and ".join(dict.fromkeys(i.unit for i in inputs)),
        _lines([i.name for i in inputs], u),
        id="inputs",
        limits=[*(-finite).tolist(), *finite.tolist()],
        view=view(drawn, most),
        zero=True,
        note="peaks: " + ", ".join(said),
    )


def _plane(plan: Plan, q: Array) -> Panel:
    at = np.linspace(0, plan.duration, POSES)
    poses = body(plan.problem, plan.q(at))
    path = body(plan.problem, q)[:, -1]
    arm = hasattr(plan.problem.system, "arm_points")
    unit = "link lengths" if arm else "m"
    return {
        "id": "plane",
        "kind": "plane",
        "title": "the arm" if arm else "the path",
        "unit": unit,
        "across": f"x ({unit})",
        "plan": 0,
        "names": ["x", "y"],
        "poses": [pose.tolist() for pose in poses if np.isfinite(pose).all()],
        "path": [to_screen_digits(path[:, 0]), to_screen_digits(path[:, 1])],
        "discs": [[*o.centre.tolist(), o.radius] for o in plan.problem.obstacles],
        "tips": tips_to_pass(plan.problem).tolist(),
        "key": [
            ["ramp", f"from 0 s to {plan.duration:.3g} s"],
            ["path", "path of the tip" if arm else "path"],
        ],
    }


def _map(plan: Plan, q: Array) -> Panel:
    """Where the path runs in (θ₁, θ₂), and where the chart that the start lies in ends."""
    problem, limits = plan.problem, np.rad2deg(plan.problem.limits.joint[1:3])
    names = [subscripted(problem.system.coordinates[i].name) for i in (1, 2)]
    path = np.rad2deg(q[:, 1:3])
    goal = np.where(np.isnan(problem.goal), q[-1], problem.goal)  # free joints: the plan's
    ends = np.rad2deg([problem.start[1:3], goal[1:3]])
    chart = [_inside(problem, i) for i in (1, 2)]
    view = []
    for k in (0, 1):
        near_edges = [edge for edge in chart[k] or () if abs(edge) < BEYOND]
        seen = np.concatenate([path[:, k], ends[:, k], near_edges])
        view.append([float(np.nanmin(seen)) - MARGIN, float(np.nanmax(seen)) + MARGIN])
    lines = [(k, side * most) for k, most in enumerate(limits.tolist()) for side in (-1, 1)]
    return {
        "id": "map",
        "kind": "plane",
        "title": f"{names[1]} over {names[0]}",
        "unit": "deg",
        "across": f"{names[0]} (deg)",
        "plan": 0,
        "names": names,
        "path": [to_screen_digits(path[:, 0]), to_screen_digits(path[:, 1])],
        "ends": ends.tolist(),
        "view": view,
        "region": chart if all(chart) else None,
        "limits": [[k, line] for k, line in lines if np.isfinite(line)],
        "note": "" if all(chart) else "the start lies on the chart's edge",
        "key": [["path", "path"], ["below", "outside the chart"], ["limit", "joint limits"]],
    }


MARGIN, BEYOND = 6.0, 1e4
"""Degrees that the map reaches beyond what is in it; and where an edge is that there is none."""


def _inside(problem: Problem, i: int) -> tuple[float, float] | None:
    """Where coordinate i alone would leave the chart around the start, degrees; None if at once."""
    system, steps = problem.system, np.arange(0.0, 180.25, 0.5)
    branch = system.branch(problem.start)
    own = [k for k, (index, _) in enumerate(system.margin_labels) if index == i]
    found = []
    for side in (-1.0, 1.0):
        at = np.rad2deg(problem.start[i]) + side * steps
        at[1:] = np.round(2 * at[1:]) / 2  # edges lie at round angles
        q = np.tile(problem.start, (len(at), 1))
        q[:, i] = np.deg2rad(at)
        out = np.any(system.chart_margins(q, branch)[:, own] < 1e-9, axis=1).nonzero()[0].tolist()
        found.append(float(at[out[0]]) if out else side * BEYOND)
        if 0 in out:
            return None
    return found[0], found[1]


def _lines(names: Sequence[str], values: Array) -> list[Panel]:
    """A curve a column, each in a colour of its own."""
    return [
        curve(0, column, name=subscripted(name), colour=k)
        for k, (name, column) in enumerate(zip(names, values.T, strict=True))
    ]
