"""Whether the keys of a sweep exist, can have their values, and change what is run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from planner.errors import InputError
from planner.problem import Problem, with_changes
from planner.schema import FILES, parse_file
from planner.schema.sweep import SweepFile
from planner.sweep.points import Point, varied


def check_keys(
    base: Problem, table: SweepFile, points: Sequence[Point], methods: Sequence[str], source: str
) -> None:
    """Refuse what no case could use; values that only clash with others are left to their cases.

    Each row of `cases` is tried as a whole, each other key by itself beside the first point.

    Raises:
        InputError: For a key that does not exist, a value it can never have, or a key that has no
            effect on any case.
    """
    keys = varied(table)
    _refuse_idle(keys, table.replay.samples, methods, source)
    rows = table.cases or [{}]
    together = {key for row in rows for key in row}
    first = {key: value for key, value in points[0].items() if key not in together}
    for row in rows:
        _refuse_impossible(base, {**first, **row}, source)
    for key in keys:
        for value in () if key in together else _telling(p[key] for p in points):
            _refuse_impossible(base, {**first, **rows[0], key: value}, source)


def _telling(values: Iterable[Any]) -> list[Any]:
    """Every kind of value that there is; of ordinary numbers only the least and the greatest."""
    numbers, others = [], {}
    for value in values:
        if type(value) in (int, float) and math.isfinite(value):
            numbers.append(value)
        else:
            others[repr(value)] = value
    return [*others.values(), *([min(numbers), max(numbers)] if numbers else [])]


def _refuse_impossible(base: Problem, point: Point, source: str) -> None:
    try:
        data = with_changes(base.to_dict(), point)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    system = data.get("system")
    model = FILES.get(str(system.get("kind"))) if isinstance(system, dict) else None
    if model is None or any(_blames(error, point) for error in _errors(model, data)):
        parse_file(data, source)


def _errors(model: type[BaseModel], data: Any) -> Sequence[Any]:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return error.errors()
    return ()


def _blames(error: Any, point: Point) -> bool:
    """Whether the error says that a key is unknown, or lies in the value of a varied key."""
    if error["type"] == "extra_forbidden":
        return True
    for key in point:
        location = map(str, error["loc"])  # holds tags of unions beside the keys
        if all(part in location for part in key.split(".")):
            return True
    return False


def _refuse_idle(keys: list[str], samples: int, methods: Sequence[str], source: str) -> None:
    for key in keys:
        table, _, rest = key.partition(".")
        if table == "machine" and samples == 0:
            raise InputError(
                f"{source}: '{key}' varies, but no plan meets a machine; add [replay] samples = 200"
            )
        method = rest.partition(".")[0]
        if table == "method" and method and method not in methods:
            raise InputError(
                f"{source}: '{key}' varies, but '{method}' is not one of the methods"
                f" ({', '.join(dict.fromkeys(methods))}); add it or leave the key out"
            )
