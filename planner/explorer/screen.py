"""The logic of the explorer, without any widget: what is asked and what is answered.

A `Screen` holds a state; `change` takes what a user did, `answer` gives what to show of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.explorer.control import Control
from planner.explorer.controls import (
    limit_controls,
    machine_controls,
    motion_controls,
    option_controls,
)
from planner.explorer.outcome import Outcome, errors, judge, path
from planner.explorer.picture import error_panel, picture
from planner.explorer.state import State, code, problem_file
from planner.plan.plan import Plan
from planner.support.user_tables import nearest


class Screen:
    """A state that changes, with what became of it.

    Attributes:
        state: What is set.
        outcome: What became of it.
        controls: What can be set now, by name.
    """

    def __init__(self, state: State) -> None:
        self.state = state
        self.outcome = path(state)
        self.controls: Mapping[str, Control] = {}
        self._rebuild()

    def change(self, changes: Sequence[tuple[str, Any]]) -> None:
        """Set controls by name (None switches one off), then plan.

        Raises:
            InputError: If there is no such control.
        """
        for name, value in changes:
            control = self._find(name)
            now = self.state.value(control.key)
            if control.part and isinstance(now, type(control.whole)):
                control = replace(control, whole=now)
            self.state = self.state.with_value(control.key, control.written(value))
        self.outcome = path(self.state)
        self._rebuild()

    def reset(self) -> None:
        """Back to the problem the exploration started from."""
        self.state = State.of(self.state.base, self.state.method, self.state.samples)
        self.outcome = path(self.state)
        self._rebuild()

    def judge(self) -> None:
        """Verify the path on the screen."""
        self.outcome = judge(self.outcome)

    def picture(self) -> dict[str, Any]:
        """Panels, controls and words for what is known by now."""
        return {
            **picture(self.outcome),
            "controls": [control.to_dict() for control in self.controls.values()],
            **self.words(),
        }

    def words(self) -> dict[str, Any]:
        """What there is to say: the kind of outcome, and the refusal in full."""
        outcome = self.outcome
        return {
            "kind": outcome.kind,
            "text": "" if outcome.error is None else str(outcome.error),
            "facts": facts(outcome),
        }

    def errors(self) -> dict[str, Any] | None:
        """The panel of errors on the machine."""
        return error_panel(errors(self.outcome))

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

    def _find(self, name: str) -> Control:
        if name not in self.controls:
            raise InputError(f"no control '{name}'; {nearest(name, list(self.controls))}")
        return self.controls[name]

    def _rebuild(self) -> None:
        state, outcome = self.state, self.outcome
        if outcome.problem is None:  # an impossible setting: it must stay possible to take it back
            return
        found = [
            *motion_controls(state, outcome.problem, outcome.plan),
            *option_controls(state, outcome.plan),
            *limit_controls(state, outcome.problem),
            *machine_controls(state, outcome.problem),
        ]
        self.controls = {control.name: control for control in found}


def facts(outcome: Outcome) -> str:
    """One line about the path: travel, duration, effort, the time it took."""
    plan = outcome.plan
    if plan is None:
        return ""
    unit = plan.problem.system.coordinates[0].unit
    parts = [f"travel {plan.travel:.5g} {unit}", f"duration {plan.duration:.4g} s"]
    if plan.objective_name.startswith("effort") and np.isfinite(plan.objective):
        parts.append(f"effort {plan.objective:.4g}")
    parts.append(f"solved in {1000 * (plan.solve_time_s + plan.build_time_s):.0f} ms")
    return ", ".join(parts)
