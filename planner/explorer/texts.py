"""The Python code and the problem file of what is on the screen."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from pprint import pformat
from typing import Any

import tomli_w

from planner.explorer.state import State


def code(state: State) -> str:
    """Python that makes the plan on the screen anew."""
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
