"""The controls of what is asked: the system's constants, start and goal, from the file's tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from planner.explorer.control import Control, span
from planner.explorer.state import JOINTS, State
from planner.problem.tables.kinds import parse_file
from planner.report.page.words import subscripted

GROUPS = {"system": "System", "start": "Start", "goal": "Goal"}

MOST_SHOWN = 6
"""Joints on the slider: with more of them no answer comes while one looks at the screen."""

REACH: Mapping[str, float] = {"theta": 89.0, "steering": 80.0, "hitch": 120.0, "heading": 180.0}
"""Ends of sliders of angles, degrees."""

UNITS = {"_deg": "deg", "_m": "m", "_rad": "rad"}

ELSEWHERE = frozenset({"phi_rad", "travel", "duration"})
"""Has a control of its own, or (the disk's first angle) changes no motion."""


def task_controls(state: State, travel_key: str) -> list[Control]:
    """One slider a number of the tables `system`, `start` and `goal`."""
    file, first = parse_file(state.base.to_dict(), state.base.source), State(state.base)
    found: list[Control] = []
    for table, group in GROUPS.items():
        fields = getattr(file, table)
        about = {(f.alias or n): f.description or "" for n, f in type(fields).model_fields.items()}
        for name, base in fields.model_dump(by_alias=True).items():
            key = f"{table}.{name}"
            if name in ELSEWHERE or key == travel_key:
                continue
            inner = base if isinstance(base, Mapping) else {"": base}
            for ending, usual in inner.items():
                if ending and isinstance(usual, list):
                    continue
                whole_key = f"{key}.{ending}".rstrip(".")
                now, usual = state.value(whole_key, usual), first.value(whole_key, usual)
                found += _sliders(group, whole_key, now, usual, about[name])
    return found


def _sliders(group: str, key: str, now: Any, usual: Any, help_text: str) -> Iterator[Control]:
    """One for the number under a key, or one for each in its list; none for anything else."""
    name, unit = key.rsplit(".", 1)[-1], ""
    for ending, of in UNITS.items():
        if name.endswith(ending):
            name, unit = name.removesuffix(ending), of
    listed = isinstance(now, list)
    for k, value in enumerate(now if listed else [now]):
        if isinstance(value, bool) or not isinstance(value, int | float):
            if listed and value == "free":
                continue
            return
        size = usual[min(k, len(usual) - 1)] if listed else usual
        size = abs(value if isinstance(size, str) else size)
        label = name.replace("_", " ") if len(name) > 3 else name
        if listed:  # the first joint has a motor of its own, so that gears begin with K2
            number = k + (2 if name == "K" else 1)
            label = (
                subscripted(f"{name}{number}")
                if name in ("theta", "K")
                else f"{label.removesuffix('s')} {number}"
            )
        if key == JOINTS:
            ends: tuple[float, float] = (2, max(MOST_SHOWN, value))
        elif group == GROUPS["system"]:
            ends = span(size, 3.0)
        else:
            reach = max(size, REACH.get(name, 89.0) if unit == "deg" else max(1.0, 2 * size))
            ends = (-reach, reach)
        constant = group == GROUPS["system"] and key != JOINTS
        yield Control(
            group, label, "slider", key, now, (k,) if listed else (), value, *ends,
            log=constant, integer=key == JOINTS, unit=unit, help=help_text,
        )  # fmt: skip
