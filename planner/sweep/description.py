"""A sweep: the base problem, the methods and the points, checked before anything runs.

The checks: whether the varied keys exist, accept their values, and affect a case.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from planner.errors import InputError
from planner.methods.registry import parse_specs
from planner.plan.spec import Spec
from planner.problem.conditions import with_changes
from planner.problem.problem import Problem, load_problem
from planner.problem.tables.kinds import FILES, parse_file
from planner.support.arrays import Frozen, plain
from planner.support.files import read_toml
from planner.support.tables import line
from planner.support.user_tables import parse
from planner.sweep.sweep_file import Point, ReplayTable, SweepFile, flatten, points, varied_keys


@dataclass(frozen=True, eq=False)
class Sweep(Frozen):
    """Many variants of one problem, and the methods that plan them; made by `load` or `from_dict`.

    Attributes:
        name: Title, or the file's name.
        base: The problem whose keys vary.
        methods: The methods; each plans every point.
        keys: The dotted keys that vary, in the order of the description.
        points: Values of the keys, one dictionary per point.
        replay: Replays on the emulated machine, if any.
        plans: Whether plans are saved in the database.
    """

    name: str
    base: Problem
    methods: tuple[Spec, ...]
    keys: tuple[str, ...]
    points: tuple[Point, ...]
    replay: ReplayTable
    plans: bool
    _data: Mapping[str, Any]

    def __len__(self) -> int:
        """Return the number of cases: points times methods."""
        return len(self.points) * len(self.methods)

    @classmethod
    def load(cls, path: str | Path) -> Sweep:
        """Read a sweep file (TOML).

        Raises:
            InputError: If the file is missing, not TOML, or has an invalid key or value.
        """
        return cls.from_dict(read_toml(path, "a sweep file"), str(path))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "sweep") -> Sweep:
        """Build a sweep from the tables of a sweep file.

        Args:
            data: The tables; `problem` may also be a `Problem`. NumPy values and tuples are
                allowed.
            source: The file of the tables, or a name for messages. A relative `problem` path is
                relative to this file.

        Raises:
            InputError: If a key or value is wrong, nothing varies, or a varied key does not exist,
                has an impossible value, or affects no case.
        """
        table = parse(SweepFile, _flatten_blocks(plain_tables(data)), source)
        base = base_problem(data["problem"], table.changes, source)
        methods = parse_specs(base, table.methods)
        sweep_points = points(table, source)
        check_keys(base, table, sweep_points, [m.method for m in methods], source)
        return cls(
            name=line(table.title) or line(Path(source).stem),
            base=base,
            methods=tuple(methods),
            keys=tuple(varied_keys(table)),
            points=tuple(sweep_points),
            replay=table.replay,
            plans=table.plans,
            _data=table.model_dump(mode="json", by_alias=True, exclude_unset=True),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of a sweep file that reproduces this sweep, including the problem."""
        data = {key: value for key, value in self._data.items() if key != "set"}
        return {**data, "problem": self.base.to_dict()}


def _flatten_blocks(data: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a sweep file with the problem's nested keys written as dotted keys."""
    out = dict(data)
    for block in ("set", "grid", "sample"):
        if isinstance(out.get(block), dict):
            out[block] = flatten(out[block])
    if isinstance(out.get("cases"), list):
        out["cases"] = [flatten(row) if isinstance(row, dict) else row for row in out["cases"]]
    return out


def plain_tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a sweep or design file as plain data, also those of a `Problem`."""
    return {str(k): plain(v.to_dict() if isinstance(v, Problem) else v) for k, v in data.items()}


def base_problem(
    problem: Problem | str | Mapping[str, Any], changes: Mapping[str, Any], source: str
) -> Problem:
    """Return the problem that a sweep or design file names, with changes.

    Args:
        problem: The problem, its file (relative to `source`), or its tables.
        changes: Dotted keys to change.
        source: The sweep or design file, or a name for messages.

    Raises:
        InputError: If the problem file is missing or invalid, or a change is invalid.
    """
    if isinstance(problem, Problem):
        return problem.changed(changes)
    if isinstance(problem, str):
        path = os.path.normpath(Path(source).parent / problem)
        if not os.path.exists(path):
            raise InputError(
                f"{source}: 'problem' = {problem!r}: there is no file {path}; the name is"
                f" relative to the folder of {source}"
            )
        try:
            return load_problem(path, changes)
        except InputError as error:
            load_problem(path)  # which explains what is wrong in the file itself
            hint = any(isinstance(value, list) for value in changes.values())
            advice = "; a list of values to vary belongs under [grid]" if hint else ""
            raise InputError(f"{source} [set]: {error}{advice}") from None
    return Problem.from_dict(problem, f"{source} [problem]").changed(changes)


def check_keys(
    base: Problem, table: SweepFile, points: Sequence[Point], methods: Sequence[str], source: str
) -> None:
    """Refuse keys and values that are invalid in every case.

    A combination that is invalid although each value is valid is left to its case. Each row of
    `cases` is tried as a whole; every other key is tried alone, with the other values of the first
    point.

    Raises:
        InputError: If a key does not exist, has an impossible value, or affects no case.
    """
    keys = varied_keys(table)
    _refuse_idle(keys, table.replay.samples, methods, source)
    rows = table.cases or [{}]
    row_keys = {key for row in rows for key in row}
    first = {key: value for key, value in points[0].items() if key not in row_keys}
    for row in rows:
        _refuse_impossible(base, {**first, **row}, source)
    for key in keys:
        for value in () if key in row_keys else _extreme_values(p[key] for p in points):
            _refuse_impossible(base, {**first, **rows[0], key: value}, source)


def _extreme_values(values: Iterable[Any]) -> list[Any]:
    """Return the smallest and the largest finite number, and every value of another kind once."""
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
    if model is None or any(_blames_key(error, point) for error in _errors(model, data)):
        parse_file(data, source)


def _errors(model: type[BaseModel], data: Any) -> Sequence[Any]:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return error.errors()
    return ()


def _blames_key(error: Any, point: Point) -> bool:
    """Return whether an error is about an unknown key or about the value of a varied key."""
    if error["type"] == "extra_forbidden":
        return True
    for key in point:
        location = map(str, error["loc"])  # has tags of unions between the keys
        if all(part in location for part in key.split(".")):
            return True
    return False


def _refuse_idle(keys: list[str], samples: int, methods: Sequence[str], source: str) -> None:
    for key in keys:
        table, _, rest = key.partition(".")
        if table == "machine" and samples == 0:
            raise InputError(
                f"{source}: '{key}' varies, but no plan is replayed on a machine; add [replay]"
                " samples = 200"
            )
        method = rest.partition(".")[0]
        if table == "method" and method and method not in methods:
            raise InputError(
                f"{source}: '{key}' varies, but '{method}' is not one of the methods"
                f" ({', '.join(dict.fromkeys(methods))}); add it or leave the key out"
            )
