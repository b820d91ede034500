"""The settings on the screen: a problem, changes to it, a method and a number of machines.

This file also writes the Python code and the problem file of these settings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from pprint import pformat
from typing import Any

from planner.errors import InputError
from planner.problem.problem import Problem
from planner.support.files import toml_lines

QUICK_SETTINGS: Mapping[str, Any] = {
    "method.collocation.starts": 2,
    "method.collocation.attempts": 2,
    "machine.step_s": 0.01,
}
"""Settings that make the explorer respond quickly: collocation searches less, and the machine is
simulated in coarser steps. `code` and `problem_file` list them like any other change."""


JOINTS_KEY = "system.joints"

Z2_KEY = "limits.z2_margin"

PER_JOINT = {
    "system.K": 1,
    "system.link_lengths": 0,
    "start.theta_deg": 0,
    "goal.theta_deg": 0,
    "limits.joint_deg": 0,
}
"""Keys of lists with one entry per joint of an arm, and the number of joints without an entry."""


@dataclass(frozen=True)
class State:
    """The settings on the screen, on which all figures depend; immutable.

    Attributes:
        base: The initial problem.
        method: Name of the method.
        changes: Changed values by dotted key of the problem file, in the order of first change.
        samples: Number of random machines on which the plan is replayed; 0 for none.
        feedback: Whether feedback follows the plan on these machines.
        time_limit_s: Seconds for planning, unless the problem's options set a limit; None means no
            limit.
    """

    base: Problem
    method: str = "polynomial"
    changes: Mapping[str, Any] = field(default_factory=dict)
    samples: int = 20
    time_limit_s: float | None = None
    feedback: bool = False

    @classmethod
    def from_problem(
        cls, problem: Problem, method: str, samples: int, time_limit_s: float | None = None
    ) -> State:
        """Return the initial state for a problem."""
        data = problem.to_dict()
        quick = {key: value for key, value in QUICK_SETTINGS.items() if value_at(data, key) is None}
        return cls(problem, method, quick, samples, time_limit_s)

    def value(self, key: str, otherwise: Any = None) -> Any:
        """Return the current value of a dotted key; `otherwise` if the problem does not set it."""
        if key in self.changes:
            return self.changes[key]
        value = value_at(self._data, key)
        return otherwise if value is None else value

    def with_value(self, key: str, value: Any) -> State:
        """Return a copy of the settings with one key set."""
        if key in ("method", "samples", "feedback"):
            return replace(self, **{key: value})
        more = self._resize(int(value)) if key == JOINTS_KEY else {}
        state = replace(self, changes={**self.changes, **more, key: value})
        if key == JOINTS_KEY and self.value(Z2_KEY) is not None:
            try:
                state.problem()
            except InputError:  # z₂ of another number of joints may change its sign
                return replace(state, changes={**state.changes, Z2_KEY: None})
        return state

    def _resize(self, joints: int) -> dict[str, Any]:
        """Return changes that give the lists in `PER_JOINT` and waypoints the length for `joints`.

        New entries come from the initial problem. Beyond these entries, gear constants continue
        geometrically and other lists repeat their last entry; new joints of waypoints are free.
        """
        changes: dict[str, Any] = {}
        for key, lacking in PER_JOINT.items():
            now, base, count = self.value(key), value_at(self._data, key), joints - lacking
            if not isinstance(now, list):
                continue
            now = [*now, *(base[len(now) :] if isinstance(base, list) else [])]
            # The gears of a chain are alike: successive ratios differ by a constant factor.
            ratio = now[-1] / now[-2] if lacking and len(now) > 1 else None
            while len(now) < count:
                now.append(now[-1] * ratio if ratio else now[-1])
            changes[key] = now[:count]
        if points := self.value("waypoints"):
            free = ["free"] * joints
            changes["waypoints"] = [
                {**point, "theta_deg": [*point["theta_deg"], *free][:joints]} for point in points
            ]
        return changes

    def problem(self) -> Problem:
        """Return the problem on the screen, without changes to options of other methods.

        Raises:
            InputError: If a change makes the problem invalid.
        """
        return self.base.changed(self._method_changes())

    def changes_from_base(self) -> dict[str, Any]:
        """Return the keys, with values, in which the problem differs from the initial problem."""
        changes = self._method_changes().items()
        return {key: value for key, value in changes if value_at(self._data, key) != value}

    def _method_changes(self) -> dict[str, Any]:
        """Return the changed keys and values, without options of methods that are not chosen."""
        return {
            key: value
            for key, value in self.changes.items()
            if not key.startswith("method.") or key.split(".")[1] == self.method
        }

    @cached_property
    def _data(self) -> Mapping[str, Any]:
        return self.base.to_dict()


def value_at(data: Mapping[str, Any], dotted: str) -> Any:
    """Return the value of a dotted key in nested tables; None if the key is missing."""
    value: Any = data
    for key in dotted.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return None
        value = value[key]
    return value


def code(state: State) -> str:
    """Return Python code that makes the plan on the screen."""
    lines = ["import planner", "", *_problem(state)]
    lines += [f'plan = planner.solve(problem, "{state.method}")', "check = planner.verify(plan)"]
    if state.samples:
        law = ", feedback=True" * state.feedback
        lines.append(f"replay = planner.replay(plan, samples={state.samples}, seed=0{law})")
    return "\n".join(lines) + "\n"


def _problem(state: State) -> list[str]:
    changes = state.changes_from_base()
    if Path(state.base.source).is_file():
        source = state.base.source.replace("\\", "/")
        if not changes:
            return [f'problem = planner.load_problem("{source}")']
        return [
            f"changes = {_literal(changes)}",
            f'problem = planner.load_problem("{source}", changes)',
        ]
    return [
        f"data = {_literal(drop_none(state.problem().to_dict()))}",
        "problem = planner.Problem.from_dict(data)",
    ]


def _literal(value: Any) -> str:
    text = pformat(value, width=92, sort_dicts=False)
    return text if "\n" not in text else "{\n " + text[1:-1] + ",\n}"


def problem_file(state: State) -> str:
    """Return the problem on the screen as a problem file for `planner plan FILE --method M`.

    Raises:
        InputError: If a change makes the problem invalid.
    """
    data = drop_none(state.problem().to_dict())
    return "\n".join([f"# planner plan FILE --method {state.method}", *toml_lines(data), ""])


def drop_none(data: Mapping[str, Any]) -> dict[str, Any]:
    """Remove keys without a value from tables: TOML has no null."""
    return {
        key: drop_none(value) if isinstance(value, Mapping) else value
        for key, value in data.items()
        if value is not None
    }
