"""The controls of the limits, from the keys that the problem's kind has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from planner.explorer.control import Control, span
from planner.explorer.state import State
from planner.problem import Problem
from planner.schema import parse_file

GROUP = "Limits"

UNITS = {
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_deg": "deg",
}
"""Unit by the ending of a key."""

USUAL: Mapping[str, float] = {"deg": 80.0, "": 0.01}
"""Where a limit starts when it is switched on, by unit; 1 of other units."""


def limit_controls(state: State, problem: Problem) -> list[Control]:
    """One slider a limit, or one an input where the problem gives two numbers."""
    table = parse_file(state.base.to_dict(), state.base.source).limits
    found = []
    for name, field in type(table).model_fields.items():
        key = f"limits.{name}"
        whole = state.value(key)
        if isinstance(whole, Mapping):
            continue
        label, unit = worded(name)
        about = {"help": field.description or "", "unit": unit}
        start = value_or(state, key, USUAL.get(unit, 1.0))
        if not isinstance(whole, list):
            shown = _first(start) if whole is None else whole
            off = {"on": whole is not None, "off": None, "off_word": "none"}
            found.append(_slider(label, key, whole, (), shown, _first(start), **about, **off))
            continue
        names = _names(problem, name, len(whole))
        for k, value in enumerate(whole):
            usual = start[k] if isinstance(start, list) and len(start) == len(whole) else value
            found.append(_slider(f"{label} {names[k]}", key, whole, (k,), value, usual, **about))
    return found


def value_or(state: State, key: str, usual: Any) -> Any:
    """Value of the key where the exploration started, or a usual one."""
    base = State(state.base)
    return base.value(key, usual)


def worded(name: str) -> tuple[str, str]:
    """Label and unit of a key: "input_rate_rad_s2" gives ("input rate", "rad/s²")."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return name.removesuffix(ending).replace("_", " "), unit
    return name.replace("_", " "), ""


def _slider(
    label: str, key: str, whole: Any, part: tuple[int, ...], shown: float, usual: float, **rest: Any
) -> Control:
    if rest["unit"] == "deg":
        ends, log = (1.0, max(89.0, usual)), False
    else:
        ends, log = span(usual), True
    return Control(
        GROUP, label, "slider", key, whole, part, shown, low=ends[0], high=ends[1], log=log, **rest
    )


def _names(problem: Problem, name: str, count: int) -> list[str]:
    if name.startswith("input") and count == 2:
        return [i.name for i in problem.system.inputs]
    return [c.name for c in problem.system.coordinates[1 : count + 1]]


def _first(value: Any) -> float:
    return float(value[0] if isinstance(value, list) else value)
