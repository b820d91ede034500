"""The panels of the picture as plain data: what the browser draws, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.explorer.controls import POINTS
from planner.explorer.outcome import Outcome
from planner.machine.replay import Replay
from planner.plan.plan import Plan
from planner.report.figures.arm import body, drawable
from planner.report.figures.over_time import z2_band
from planner.report.figures.style import shown, times
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import Coordinate

SAMPLES = 240
"""Instants a curve is drawn by, where it is not finer by itself."""

POSES = 10


def panels(outcome: Outcome) -> list[dict[str, Any]]:
    """The panels that a path alone fills, in the order of the screen.

    Each has `id`, `title`, `kind` ("time" or "plane") and, over time, `t` with `lines` (`name`,
    `y`), `bands` (`low`, `high`), `limits`, `marks` and `points`; in the plane `poses`, `path` and
    `discs`.
    Numbers that do not exist are None.
    """
    plan = outcome.plan
    if plan is None:
        return []
    t = times(plan, SAMPLES)
    z, q, u = plan.z(t), plan.q(t), plan.u(t)
    found = [_z2(plan, t, z), *_rest(t, z), _angles(plan, t, q), _inputs(plan, t, u)]
    if drawable(plan.problem.system):
        found.append(_plane(plan, q))
    return found


def error_panel(run: Replay | None) -> dict[str, Any] | None:
    """The largest error of any angle over time, on the machines: median and 90 % of them."""
    if run is None or not run.angles:
        return None
    planned = run.plan.q(run.t)
    error = np.rad2deg(np.abs(run.q - planned)[:, :, list(run.angles)]).max(axis=2)
    low, middle, high = np.percentile(error, [5, 50, 95], axis=0)
    return {
        **_over_time("error", "error (deg)", run.t),
        "lines": [_line("median machine", middle)],
        "bands": [{"low": short(low), "high": short(high), "name": "90 % of the machines"}],
        "note": f"E median {run.percentile(50):.3g} deg, 95 % {run.percentile(95):.3g} deg",
        "zero": True,
    }


def _over_time(name: str, title: str, t: Array) -> dict[str, Any]:
    return {"id": name, "kind": "time", "title": title, "t": short(t)}


def _line(name: str, values: Array) -> dict[str, Any]:
    return {"name": name, "y": short(values)}


def short(values: Array) -> list[Any]:
    """Six significant digits are more than a screen shows, and halve what is sent."""
    finite = np.isfinite(values)
    size = float(np.max(np.abs(values), where=finite, initial=0.0))
    digits = int(np.clip(6 - np.log10(size), 0, 12)) if size > 0 else 0
    numbers: list[Any] = np.round(values, digits).tolist()
    if not finite.all():
        for k in np.flatnonzero(~finite):
            numbers[k] = None
    return numbers


def _z2(plan: Plan, t: Array, z: Array) -> dict[str, Any]:
    panel = {
        **_over_time("z2", "z2 and its domain", t),
        "lines": [_line("z2", z[:, 1])],
        "zero": True,
        "points": _points(plan),
    }
    if isinstance(plan.problem.system, Manipulator):
        low, high = z2_band(plan, t)
        name = "domain: a real theta1 exists"
        panel["bands"] = [{"low": short(low), "high": short(high), "name": name}]
    if not plan.executable:
        out = np.array(plan.domain.exits_s)
        panel["marks"] = np.stack([out, plan.z(out)[:, 1]], axis=1).tolist()
    margin = plan.problem.limits.z2_margin
    if margin:
        panel["limits"] = [plan.problem.z2_sign * margin]
    return panel


def _points(plan: Plan) -> list[dict[str, Any]]:
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


def _rest(t: Array, z: Array) -> list[dict[str, Any]]:
    if z.shape[1] < 3:
        return []
    lines = [_line(f"z{k + 1}", z[:, k]) for k in range(2, z.shape[1])]
    return [{**_over_time("z", "the other chained coordinates", t), "lines": lines}]


def _angles(plan: Plan, t: Array, q: Array) -> dict[str, Any]:
    coordinates = plan.problem.system.coordinates
    kept = [i for i in range(1, len(coordinates)) if coordinates[i].unit == "rad"]
    kept = kept or list(range(1, len(coordinates)))
    limits = np.unique(np.abs(plan.problem.limits.joint[kept]))
    lines = [_line(coordinates[i].name, shown(q[:, i], coordinates[i].unit)) for i in kept]
    return {
        **_over_time("joints", f"joints ({_unit(coordinates[kept[0]])})", t),
        "lines": lines,
        "limits": _both(shown(limits, coordinates[kept[0]].unit)),
    }


def _inputs(plan: Plan, t: Array, u: Array) -> dict[str, Any]:
    inputs, limit = plan.problem.system.inputs, plan.problem.limits.input
    largest = [float(np.nanmax(np.abs(u[:, i]), initial=0.0)) for i in range(2)]
    usual = [float(np.nanquantile(np.abs(_evenly(t, u[:, i])), 0.9)) for i in range(2)]
    most = float(np.max(limit[np.isfinite(limit)], initial=0.0))
    bound = 1.15 * max(min(max(largest), 3 * max(most, *usual)), most, 1e-6)
    peaks = [f"{i.name} {value:.3g}" for i, value in zip(inputs, largest, strict=True)]
    return {
        **_over_time("inputs", f"inputs ({_unit(inputs[0])})", t),
        "lines": [_line(i.name, u[:, k]) for k, i in enumerate(inputs)],
        "limits": _both(np.unique(limit)),
        "range": [-bound, bound],
        "zero": True,
        "note": "peaks: " + ", ".join(peaks),
    }


def _plane(plan: Plan, q: Array) -> dict[str, Any]:
    at = np.linspace(0, plan.duration, POSES)
    poses = body(plan.problem, plan.q(at))
    path = body(plan.problem, q)[:, -1]
    arm = hasattr(plan.problem.system, "arm_points")
    return {
        "id": "plane",
        "kind": "plane",
        "title": "the arm (link lengths)" if arm else "the path (m)",
        "poses": [pose.tolist() for pose in poses if np.isfinite(pose).all()],
        "path": [short(path[:, 0]), short(path[:, 1])],
        "discs": [[*o.centre.tolist(), o.radius] for o in plan.problem.obstacles],
    }


def _evenly(t: Array, values: Array) -> Array:
    return np.interp(np.linspace(t[0], t[-1], 200), t, np.nan_to_num(values))


def _both(limits: Array) -> Sequence[float]:
    finite = limits[np.isfinite(limits)]
    return [*(-finite).tolist(), *finite.tolist()]


def _unit(coordinate: Coordinate) -> str:
    return "deg" if coordinate.unit == "rad" else coordinate.unit
