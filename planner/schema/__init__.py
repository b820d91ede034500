"""The problem file's tables: what a user may write, with types, ranges and descriptions."""

from typing import Any, Union

from pydantic import TypeAdapter

from planner.errors import InputError
from planner.schema.ballgear import BallGearFile
from planner.schema.base import nearest, parse
from planner.schema.car import CarFile
from planner.schema.custom import CustomFile
from planner.schema.feedback import FeedbackTable
from planner.schema.file import ProblemFile
from planner.schema.limits import LimitsTable
from planner.schema.machine import MachineTable
from planner.schema.manipulator import ManipulatorFile
from planner.schema.methods import CollocationOptions, MethodsTable, PolynomialOptions
from planner.schema.trailers import TrailersFile
from planner.schema.unicycle import UnicycleFile

FILES: dict[str, type[ProblemFile]] = {
    "manipulator": ManipulatorFile,
    "ball-gear": BallGearFile,
    "unicycle": UnicycleFile,
    "car": CarFile,
    "trailers": TrailersFile,
    "custom": CustomFile,
}

__all__ = [
    "FILES",
    "CollocationOptions",
    "FeedbackTable",
    "LimitsTable",
    "MachineTable",
    "MethodsTable",
    "PolynomialOptions",
    "ProblemFile",
    "json_schema",
    "nearest",
    "parse",
    "parse_file",
]


def parse_file(data: dict[str, Any], source: str) -> ProblemFile:
    """Validate a problem file's tables.

    Raises:
        InputError: One line an error; see `parse`.
    """
    system = data.get("system")
    if not isinstance(system, dict) or "kind" not in system:
        raise InputError(f"{source}: missing key 'system.kind'; allowed: {', '.join(FILES)}")
    kind = system["kind"]
    if not isinstance(kind, str) or kind not in FILES:
        raise InputError(f"{source}: 'system.kind' = {kind!r}: {nearest(str(kind), list(FILES))}")
    return parse(FILES[kind], data, source)


def json_schema() -> dict[str, Any]:
    """JSON Schema of a problem file, for editors."""
    kinds: Any = Union[tuple(FILES.values())]  # noqa: UP007
    return TypeAdapter(kinds).json_schema()
