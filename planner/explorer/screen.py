"""The logic of the explorer, without any widget.

A `Screen` holds the settings and the plan for them. `set` applies new settings, `plan_anew` plans,
and `picture` returns what the browser shows.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from planner.comparison.rows import Row
from planner.errors import InputError, PlannerError
from planner.explorer.control import OBSTACLES_KEY, Control, task_controls
from planner.explorer.controls import (
    POINTS_KEY,
    limit_controls,
    machine_controls,
    motion_controls,
    option_controls,
)
from planner.explorer.outcome import ScreenOutcome, errors, judge, path
from planner.explorer.state import State, code, problem_file
from planner.machine.replay import STATISTICS, Replay
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.figures.arm import body_points, can_draw, tips_to_pass
from planner.report.figures.mechanism import mechanism_svg
from planner.report.figures.on_the_machine import median_sample
from planner.report.figures.style import colour_numbers, length_unit, times
from planner.report.page.series import motion_data
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
from planner.robustness.sensitivity import REFERENCE, Sensitivity, sensitivity, size_of
from planner.support.arrays import jsonable
from planner.support.user_tables import allowed_hint
from planner.systems.manipulator import Manipulator
from planner.verification.summary import figures


class Screen:
    """The settings on the screen and the result of planning with them.

    Attributes:
        state: The current settings.
        outcome: The result of planning with these settings.
        controls: The current controls, by name.
    """

    def __init__(self, state: State) -> None:
        self.state = self._first = state
        self.controls: Mapping[str, Control] = {}
        self.outcome: ScreenOutcome
        self.plan_anew()

    def set(self, changes: Sequence[tuple[str, Any]]) -> bool:
        """Set controls by name, without planning; the value None switches a control off.

        Returns:
            Whether the screen now has other controls than before.

        Raises:
            InputError: If there is no such control.
        """
        for name, value in changes:
            if name not in self.controls:
                raise InputError(f"no control '{name}'; {allowed_hint(name, list(self.controls))}")
            control = self.controls[name]
            now = self.state.value(control.key)
            if control.part and isinstance(now, type(control.whole)):
                control = replace(control, whole=now)
            self.state = self.state.with_value(control.key, control.new_value(value))
            # Show the value even if it makes the problem invalid: `_rebuild` is skipped then.
            state = {"on": False} if value is None else {"on": True, "shown": value}
            self.controls = {**self.controls, name: replace(self.controls[name], **state)}
        before = list(self.controls)
        with suppress(InputError):
            self._rebuild(self.state.problem(), None)
        return before != list(self.controls)

    def plan_anew(self) -> None:
        """Plan with the current settings, and update outcome and controls."""
        began = time.perf_counter()
        self.outcome = path(self.state)
        self._took_s = time.perf_counter() - began
        if self.outcome.problem is not None:  # else keep the controls for undoing
            self._rebuild(self.outcome.problem, self.outcome.plan)

    def reset(self) -> None:
        """Return to the settings first shown, and plan."""
        self.state = self._first
        self.plan_anew()

    def judge(self) -> None:
        """Verify the plan on the screen."""
        self.outcome = judge(self.outcome)

    def picture(self) -> dict[str, Any]:
        """Return all panels, controls and texts that the browser shows for the current outcome."""
        return {
            **picture(self.outcome),
            "controls": self.shown_controls(),
            "system": self._system(),
            **self.words(),
        }

    def shown_controls(self) -> list[dict[str, Any]]:
        """Return the current controls as plain data."""
        return [control.to_dict() for control in self.controls.values()]

    def words(self) -> dict[str, Any]:
        """Return the kind of outcome, the text of a refusal, and a line of facts about the path."""
        outcome = self.outcome
        early = "" if outcome.plan is None else str(outcome.plan.notes.get("ended_early", ""))
        return {
            "kind": outcome.kind,
            "text": early if outcome.error is None else str(outcome.error),
            "facts": path_line(outcome, self._took_s),
        }

    def errors(self) -> dict[str, Any]:
        """Return the panel of errors, the motion of the machine with median E, a plan's row, and
        its sensitivities.

        Panel and motion are None without a replay; `why` says why feedback cannot follow the plan.
        """
        run, plan, why = None, self.outcome.plan, ""
        try:
            run = errors(self.outcome)
        except PlannerError as error:
            why = str(error)
        found = None
        if plan is not None and plan.executable:
            found = sensitivity(plan, SENSITIVITY_STEPS)
        shown: dict[str, Any] = {"error": error_panel(run), "machine": None, "why": why}
        shown |= {"row": plan_row(plan, found, run), "bars": sensitivity_bars(found)}
        if run is not None and shown["error"]:
            t = run.t[run.t <= run.plan.duration]
            motion = motion_data(run.plan, t, run.motion(median_sample(run))[: len(t)])
            shown["machine"] = jsonable(motion)
        return shown

    def second(self) -> dict[str, Any]:
        """Plan by the method of comparison, and return all that the browser shows of its plan."""
        method = SECOND.get(self.state.method, "polynomial")
        other = Screen(self.state.with_value("method", method).with_value(POINTS_KEY, "auto"))
        other.judge()
        label = other.outcome.plan.label if other.outcome.plan else method
        return {"second": {"label": label, **other.picture(), **other.errors()}}

    def mechanism(self) -> dict[str, str]:
        """Return the drawing of the mechanism (SVG, "" if there is none) and its system as text."""
        problem = self.outcome.problem
        return {
            "mechanism": "" if problem is None else mechanism_svg(problem.system),
            "drawn": self._system(),
        }

    def _system(self) -> str:
        """Return the constants of the system as text; "" if its mechanism cannot be drawn."""
        problem = self.outcome.problem
        if problem is None or not isinstance(problem.system, Manipulator):
            return ""
        return str(problem.to_dict()["system"])

    def texts(self) -> dict[str, str]:
        """Return the Python code and the problem file of the current settings."""
        try:
            return {"code": code(self.state), "file": problem_file(self.state)}
        except InputError as error:
            return {"code": f"# {error}", "file": f"# {error}"}

    def plan(self) -> Plan:
        """Verify the plan on the screen and return it.

        Raises:
            PlannerError: The refusal on the screen, if the plan is refused.
        """
        self.judge()
        if self.outcome.error is not None:
            raise self.outcome.error
        assert self.outcome.plan is not None
        return self.outcome.plan

    def _rebuild(self, problem: Problem, plan: Plan | None) -> None:
        state = self.state
        controls = [
            *task_controls(state, problem.travel_key),
            *motion_controls(state, problem, plan),
            *limit_controls(state, problem),
            *option_controls(state, plan),
            *machine_controls(state, problem),
        ]
        self.controls = {control.name: control for control in controls}


SECOND = {"polynomial": "collocation"}
"""Method of the second plan by the first plan's method; for all others the polynomial with
constraint points that it chooses."""


def plan_row(plan: Plan | None, found: Sensitivity | None, run: Replay | None) -> list[list[Any]]:
    """Return the plan's figures in comparisons and its sensitivity, each as title, unit and number;
    none without a motion."""
    if plan is None or found is None:
        return []
    known = figures(Row)
    values = dict[str, Any](effort=plan.effort, peak_u=plan.peak_u, duration_s=plan.duration)
    for name, one in STATISTICS.items():
        if one.percent == 50:
            values[name] = np.nan if run is None else one.of(run)
    row = [
        [heading.title, heading.unit_of(plan.problem.system), number]
        for name, value in values.items()
        for heading, number in zip(known[name].headings, np.ravel(value), strict=True)
    ]
    row.append(["sensitivity", "deg", found.passive_block_deg()])
    return list(jsonable(row))


def sensitivity_bars(found: Sensitivity | None) -> list[list[Any]]:
    """Return each error, its usual size in words, and how far it moves the angles at the end, deg;
    none without a motion."""
    if found is None:
        return []
    ends = np.linalg.norm(found.contribution_deg(REFERENCE), axis=0)
    sizes = map(size_of, found.reference(REFERENCE), found.units)
    return [list(each) for each in zip(found.parameters, sizes, jsonable(ends), strict=True)]


def path_line(outcome: ScreenOutcome, took_s: float) -> str:
    """Return one line of facts about the path: reservations and the planning time."""
    plan, parts = outcome.plan, list[str]()
    if plan is None:
        return ""
    if plan.verified and not plan.domain.ok:
        parts.append("leaves the chart, as this method may")
    if plan.is_compensated:
        errors_deg = plan.notes["compensation"]
        now, plain = (f"{errors_deg[key]:.3g} deg" for key in ("E_deg", "plain_E_deg"))
        if not errors_deg["E_deg"] < errors_deg["plain_E_deg"]:
            parts.append(f"path error {now}, no better than {plain} uncompensated")
    parts += plan.reservations
    parts.append(f"planned in {took_s:.2g} s")
    return ", ".join(parts)


CURVE_SAMPLES = 160
"""Least number of instants at which a plan's curves are sampled, for plans with few nodes."""

POSES = 10

SENSITIVITY_STEPS = 200
"""Steps of the integration of sensitivities: six digits of the paper's plans in 5 ms."""

TITLES = {"z2": "z₂ and its domain", "z": "the other chained coordinates"}
"""Titles, by panel id, of panels that show more in the explorer than elsewhere."""


def picture(outcome: ScreenOutcome) -> dict[str, Any]:
    """Return the data of the plan and of all panels that need no replay, in their order.

    `planner.report.panels` describes the data. The panels of z2 and of the plane also have
    `handles`: the position `at` of each and, if it can be dragged, the `names` of the controls that
    dragging sets; the browser leaves out those without controls. With a `pivot` the control is an
    angle around it, from direction `zero` (deg).
    """
    plan = outcome.plan
    if plan is None:
        return {"plans": [], "panels": []}
    name = plan.label
    one = PlanCurves(0, plan, times(plan, CURVE_SAMPLES))
    system = plan.problem.system
    fit = [figure for figure in PLAN_FIGURES.values() if figure.fits(system)]
    panels = [_with_words(p, plan) for figure in fit for p in merge(figure.panels([one]))]
    data = {panel.id: screen_data(panel) for panel in panels}
    data["z2"]["handles"] = _handles(plan)
    if can_draw(system):
        data["plane"] = {**screen_data(_plane(one)), "handles": list(_plane_handles(plan))}
    curve = {
        "label": name,
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
    elif panel.id.startswith("joints") and not hasattr(plan.problem.system, "arm_points"):
        words = "angles" if panel.unit == "deg" else "coordinates"
        return replace(panel, title=words if len(panel.series) > 1 else panel.title)
    one_curve = panel.id == "z" and len(panel.series) == 1
    return panel if one_curve else replace(panel, title=TITLES.get(panel.id, panel.title))


def error_panel(run: Replay | None) -> dict[str, Any] | None:
    """Return the panel of the largest joint error over time: median and 90 % band of machines."""
    if run is None or not run.angles:
        return None
    target = run.plan.reference(run.t)  # NaN during the preparation of a compensated plan
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


def _plane_handles(plan: Plan) -> Iterator[dict[str, Any]]:
    """Yield handles of start, goal and obstacles, for all controls that there may be."""
    problem = plan.problem
    for k, disc in enumerate(problem.obstacles):
        names = [f"{OBSTACLES_KEY}:{k}:centre_m:{i}" for i in (0, 1)]
        yield {"at": disc.centre.tolist(), "names": names}
    for table, q in (("start", plan.q(0.0)), ("goal", plan.q(plan.duration))):
        points, zero = body_points(problem, q).tolist(), 0.0
        for names in ([f"{table}.tip_m:{i}" for i in (0, 1)], [f"{table}.x_m", f"{table}.y_m"]):
            yield {"at": points[-1], "names": names}
        for k, (pivot, at) in enumerate(pairwise(points)):
            names = [f"{table}.theta_deg:{k}"]
            yield {"at": at, "names": names, "pivot": pivot, "zero": zero}
            zero += float(np.rad2deg(q[k + 1]))


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
