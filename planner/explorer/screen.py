"""The logic of the explorer, without any widget: what is asked and what is answered.

A `Screen` holds a state; `change` takes what a user did, `answer` gives what to show of it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.explorer.control import Control, task_controls
from planner.explorer.controls import (
    limit_controls,
    machine_controls,
    motion_controls,
    option_controls,
)
from planner.explorer.outcome import ScreenOutcome, errors, judge, path
from planner.explorer.picture import error_panel, picture
from planner.explorer.state import State, code, problem_file
from planner.plan.measures import effort, effort_unit
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.figures.mechanism import mechanism_svg
from planner.support.user_tables import allowed_hint
from planner.systems.manipulator import Manipulator


class Screen:
    """A state that changes, with what became of it.

    Attributes:
        state: What is set.
        outcome: What became of it.
        controls: What can be set now, by name.
    """

    def __init__(self, state: State) -> None:
        self.state = state
        self.controls: Mapping[str, Control] = {}
        self.outcome: ScreenOutcome
        self.plan_anew()

    def set(self, changes: Sequence[tuple[str, Any]]) -> bool:
        """Set controls by name (None switches one off), without planning; whether others belong.

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
            # What makes the problem impossible is shown too: `_rebuild` does nothing then.
            known = {"on": False} if value is None else {"on": True, "shown": value}
            self.controls = {**self.controls, name: replace(self.controls[name], **known)}
        before = list(self.controls)
        with suppress(InputError):
            self._rebuild(self.state.problem(), None)
        return before != list(self.controls)

    def change(self, changes: Sequence[tuple[str, Any]]) -> None:
        """Set controls by name, then plan.

        Raises:
            InputError: If there is no such control.
        """
        self.set(changes)
        self.plan_anew()

    def plan_anew(self) -> None:
        """Plan with the current settings."""
        began = time.perf_counter()
        self.outcome = path(self.state)
        self._took_s = time.perf_counter() - began
        if self.outcome.problem is not None:  # what is impossible must stay possible to take back
            self._rebuild(self.outcome.problem, self.outcome.plan)

    def reset(self) -> None:
        """Back to the problem the exploration started from."""
        now = self.state
        self.state = State.from_problem(now.base, now.method, now.samples, now.time_limit_s)
        self.plan_anew()

    def judge(self) -> None:
        """Verify the path on the screen."""
        self.outcome = judge(self.outcome)

    def picture(self) -> dict[str, Any]:
        """Panels, controls and words for what is known by now."""
        return {
            **picture(self.outcome),
            "controls": self.shown_controls(),
            "system": self._system(),
            **self.words(),
        }

    def shown_controls(self) -> list[dict[str, Any]]:
        """What can be set now, as plain data."""
        return [control.to_dict() for control in self.controls.values()]

    def words(self) -> dict[str, Any]:
        """What there is to say: the kind of outcome, and the refusal in full."""
        outcome = self.outcome
        early = "" if outcome.plan is None else str(outcome.plan.notes.get("ended_early", ""))
        return {
            "kind": outcome.kind,
            "text": early if outcome.error is None else str(outcome.error),
            "facts": path_line(outcome, self._took_s),
        }

    def errors(self) -> dict[str, Any] | None:
        """The panel of errors on the machine."""
        return error_panel(errors(self.outcome))

    def mechanism(self) -> dict[str, str]:
        """The drawing of the mechanism (SVG), and the `system` of `picture` that it shows."""
        problem = self.outcome.problem
        return {
            "mechanism": "" if problem is None else mechanism_svg(problem.system),
            "drawn": self._system(),
        }

    def _system(self) -> str:
        """The constants of a system whose mechanism can be drawn; empty for all others."""
        problem = self.outcome.problem
        if problem is None or not isinstance(problem.system, Manipulator):
            return ""
        return str(problem.to_dict()["system"])

    def texts(self) -> dict[str, str]:
        """The Python code and the problem file of what is on the screen."""
        try:
            return {"code": code(self.state), "file": problem_file(self.state)}
        except InputError as error:
            return {"code": f"# {error}", "file": f"# {error}"}

    def plan(self) -> Plan:
        """The verified plan on the screen.

        Raises:
            PlannerError: The refusal on the screen, when there is no plan.
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


def path_line(outcome: ScreenOutcome, took_s: float) -> str:
    """One line about the path: travel, duration, effort, the time it took."""
    plan = outcome.plan
    if plan is None:
        return ""
    unit = plan.problem.system.coordinates[0].unit
    parts = [f"travel {plan.travel:.5g} {unit}", f"duration {plan.duration:.4g} s"]
    spent = effort(plan.trajectory) if plan.compensates is not None else plan.objective
    if plan.objective_name.startswith("effort") and np.isfinite(spent):
        parts.append(f"effort {spent:.4g} {effort_unit(plan.problem.system)}")
    if plan.verified and not plan.domain.ok:
        parts.append("leaves the chart (allowed)")
    if plan.compensates is not None:
        made = plan.notes["compensation"]
        now, plain = (f"{made[key]:.3g} deg" for key in ("E_deg", "plain_E_deg"))
        if not made["E_deg"] < made["plain_E_deg"]:
            parts.append(f"{now} off the path, no better than {plain} uncompensated")
    parts.append(f"planned in {took_s:.2g} s")
    return ", ".join(parts)
