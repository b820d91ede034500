"""The problem file's tables: what a user may write, with types, ranges and descriptions."""

import math
from typing import Any, Union

from pydantic import TypeAdapter

from planner.errors import InputError
from planner.problem.tables.arms import BallGearFile, ManipulatorFile
from planner.problem.tables.custom import CustomFile
from planner.problem.tables.problem_file import ProblemFile
from planner.problem.tables.vehicles import CarFile, TrailersFile, UnicycleFile
from planner.support.tables import brief
from planner.support.user_tables import nearest, parse

FILES: dict[str, type[ProblemFile]] = {
    "manipulator": ManipulatorFile,
    "ball-gear": BallGearFile,
    "unicycle": UnicycleFile,
    "car": CarFile,
    "trailers": TrailersFile,
    "custom": CustomFile,
}


def parse_file(data: dict[str, Any], source: str) -> ProblemFile:
    """Validate a problem file's tables.

    Raises:
        InputError: One line an error; see `parse`.
    """
    _refuse_extremes(data, source)
    system = data.get("system")
    if not isinstance(system, dict) or "kind" not in system:
        raise InputError(f"{source}: missing key 'system.kind'; allowed: {', '.join(FILES)}")
    kind = system["kind"]
    if not isinstance(kind, str) or kind not in FILES:
        hint = nearest(str(kind), list(FILES))
        raise InputError(f"{source}: 'system.kind' = {kind!r:.60}: {hint}")
    return parse(FILES[kind], data, source)


LEAST, MOST = 1e-15, 1e15
"""Sizes of numbers, but zero: no length, time, angle, ratio or tolerance in these units is smaller
or larger, and products of twenty of them, for twenty joints, stay numbers."""


def _refuse_extremes(data: dict[str, Any], source: str) -> None:
    """Refuse numbers that would overflow, or vanish, in the middle of a computation."""
    waiting: list[tuple[str, Any]] = [("", data)]
    while waiting:
        key, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{key}.{name}".lstrip("."), item) for name, item in value.items()]
        elif isinstance(value, list):
            waiting += [(f"{key}[{k}]", item) for k, item in enumerate(value)]
        elif isinstance(value, float | int) and 0 < abs(value) < LEAST:
            name = brief(key)
            raise InputError(f"{source}: '{name}' = {value!r}: too small; 0, or at least {LEAST:g}")
        elif isinstance(value, float | int) and MOST < abs(value) < math.inf:
            few = isinstance(value, float) or value.bit_length() < 200
            shown = repr(value) if few else "a whole number of many digits"
            raise InputError(f"{source}: '{brief(key)}' = {shown}: too large; at most {MOST:g}")


def json_schema() -> dict[str, Any]:
    """JSON Schema of a problem file, for editors."""
    kinds: Any = Union[tuple(FILES.values())]  # noqa: UP007
    return TypeAdapter(kinds).json_schema()
