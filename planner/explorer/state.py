"""What is set on the screen: a problem, changes to it, a method and a number of machines.

The Python code and the problem file of what is on the screen.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from pprint import pformat
from typing import Any

import tomli_w

from planner.problem.problem import Problem

QUICK: Mapping[str, Any] = {
    "method.collocation.starts": 1,
    "method.collocation.attempts": 2,
    "machine.step_s": 0.01,
}
"""While it is explored, collocation searches less and the machine is simulated in coarser steps,
so that answers come in time; the problem file and the code say so, as of any other change."""


JOINTS = "system.joints"

PER_JOINT = {
    "system.K": 1,
    "system.link_lengths": 0,
    "start.theta_deg": 0,
    "goal.theta_deg": 0,
    "limits.joint_deg": 0,
}
"""Lists of an arm, and how many entries fewer than joints they have."""


@dataclass(frozen=True)
class State:
    """All that the picture depends on; immutable.

    Attributes:
        base: The problem the exploration started from.
        method: Name of the method.
        changes: Dotted keys of the problem file to values, in the order they were first made.
        samples: Machines that the plan is replayed on; 0 for none.
        time_limit_s: Seconds for planning, unless the problem's options set a limit; None for no
            limit.
    """

    base: Problem
    method: str = "polynomial"
    changes: Mapping[str, Any] = field(default_factory=dict)
    samples: int = 20
    time_limit_s: float | None = None

    @classmethod
    def of(
        cls, problem: Problem, method: str, samples: int, time_limit_s: float | None = None
    ) -> State:
        """The state an exploration starts from."""
        data = problem.to_dict()
        quick = {key: value for key, value in QUICK.items() if value_at(data, key) is None}
        return cls(problem, method, quick, samples, time_limit_s)

    def value(self, key: str, otherwise: Any = None) -> Any:
        """Present value of a dotted key; `otherwise` where the problem does not say it."""
        if key in self.changes:
            return self.changes[key]
        found = value_at(self._data, key)
        return otherwise if found is None else found

    def with_value(self, key: str, value: Any) -> State:
        """This state with one key set."""
        if key == "method":
            return replace(self, method=value)
        if key == "samples":
            return replace(self, samples=int(value))
        more = self._resized(int(value)) if key == JOINTS else {}
        return replace(self, changes={**self.changes, **more, key: value})

    def _resized(self, joints: int) -> dict[str, Any]:
        """What else changes with the number of joints: a joint more is like the last one."""
        found: dict[str, Any] = {}
        for key, lacking in PER_JOINT.items():
            now, base, count = self.value(key), value_at(self._data, key), joints - lacking
            if not isinstance(now, list):
                continue
            now = [*now, *(base[len(now) :] if isinstance(base, list) else [])]
            # The gears of a chain are alike: each ratio is the one before times the same number.
            ratio = now[-1] / now[-2] if lacking and len(now) > 1 else None
            while len(now) < count:
                now.append(now[-1] * ratio if ratio else now[-1])
            found[key] = now[:count]
        if points := self.value("waypoints"):
            free = ["free"] * joints
            found["waypoints"] = [
                {**point, "theta_deg": [*point["theta_deg"], *free][:joints]} for point in points
            ]
        return found

    def problem(self) -> Problem:
        """The problem on the screen, without the changes to options of other methods.

        Raises:
            InputError: If a change makes it impossible.
        """
        return self.base.changed(self._concerning())

    def told(self) -> dict[str, Any]:
        """The changes worth telling: those of `problem` that differ from the base."""
        return {
            key: value
            for key, value in self._concerning().items()
            if value_at(self._data, key) != value
        }

    def _concerning(self) -> dict[str, Any]:
        """Changes that concern this method."""
        return {
            key: value
            for key, value in self.changes.items()
            if not key.startswith("method.") or key.split(".")[1] == self.method
        }

    @cached_property
    def _data(self) -> Mapping[str, Any]:
        return self.base.to_dict()


def value_at(data: Mapping[str, Any], dotted: str) -> Any:
    """Value of a dotted key, None where there is none."""
    value: Any = data
    for key in dotted.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return None
        value = value[key]
    return value


def code(state: State) -> str:
    """Python code that makes the plan on the screen."""
    lines = ["import planner", "", *_problem(state)]
    lines += [f'plan = planner.solve(problem, "{state.method}")', "check = planner.verify(plan)"]
    if state.samples:
        lines.append(f"replay = planner.replay(plan, samples={state.samples}, seed=0)")
    return "\n".join(lines) + "\n"


def _problem(state: State) -> list[str]:
    told = state.told()
    if Path(state.base.source).is_file():
        source = state.base.source.replace("\\", "/")
        if not told:
            return [f'problem = planner.load_problem("{source}")']
        return [
            f"changes = {_written(told)}",
            f'problem = planner.load_problem("{source}", changes)',
        ]
    return [
        f"data = {_written(without_none(state.problem().to_dict()))}",
        "problem = planner.Problem.from_dict(data)",
    ]


def _written(value: Any) -> str:
    text = pformat(value, width=92, sort_dicts=False)
    return text if "\n" not in text else "{\n " + text[1:-1] + ",\n}"


def problem_file(state: State) -> str:
    """The problem on the screen as a problem file; `planner plan FILE --method M` plans it.

    Raises:
        InputError: If a change makes the problem impossible.
    """
    data = without_none(state.problem().to_dict())
    return f"# planner plan FILE --method {state.method}\n" + _one_line(tomli_w.dumps(data))


_LIST = re.compile(r"\[\n((?: +[^\n\[\]]*,\n)+) *\]")
_LIST_OF_LISTS = re.compile(r"\[\n((?: +\[[^\n\[\]]*\],\n)+) *\]")


def _one_line(text: str) -> str:
    """TOML with each list of numbers or words on one line, and lists of such lists likewise."""

    def joined(found: re.Match[str]) -> str:
        return "[" + " ".join(line.strip() for line in found[1].splitlines()).rstrip(",") + "]"

    return _LIST_OF_LISTS.sub(joined, _LIST.sub(joined, text))


def without_none(data: Mapping[str, Any]) -> dict[str, Any]:
    """Tables without the keys that say nothing: TOML has no null."""
    return {
        key: without_none(value) if isinstance(value, Mapping) else value
        for key, value in data.items()
        if value is not None
    }
