"""A sweep: the base problem, the methods, and the points, checked before anything runs.

Whether the keys of a sweep exist, can have their values, and change what is run.
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
from planner.methods.spec import Spec, parse_specs
from planner.problem.conditions import with_changes
from planner.problem.problem import Problem, load_problem
from planner.problem.tables.kinds import FILES, parse_file
from planner.support.arrays import plain
from planner.support.files import read_toml
from planner.support.tables import line
from planner.support.user_tables import parse
from planner.sweep.sweep_file import Point, ReplayTable, SweepFile, flatten, points, varied_keys


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep: many variants of one problem. Build it with `Sweep.load` or `Sweep.from_dict`.

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
        """Number of points times number of methods."""
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
            data: The tables; `problem` may also be a `Problem`. NumPy values and tuples are fine.
            source: The file they came from, which a relative `problem` path is relative to, or a
                name for messages.

        Raises:
            InputError: If a key or value is wrong, nothing varies, a varied key does not exist or
                has an impossible value, or changes nothing of what is run.
        """
        tables = dict(data)
        problem = tables.get("problem")
        if isinstance(problem, Problem):
            tables["problem"] = problem.to_dict()
        table = parse(SweepFile, _flatten_blocks(plain(tables)), source)
        known = problem if isinstance(problem, Problem) else None
        base = base_problem(table.problem, table.changes, source, known)
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
        """The tables of a sweep file that reproduces this sweep, including the problem."""
        data = {key: value for key, value in self._data.items() if key != "set"}
        return {**data, "problem": self.base.to_dict()}


def _flatten_blocks(data: dict[str, Any]) -> dict[str, Any]:
    """The same tables with dotted keys in the blocks that hold keys of the problem."""
    out = dict(data)
    for block in ("set", "grid"):
        if isinstance(out.get(block), dict):
            out[block] = flatten(out[block])
    if isinstance(out.get("sample"), dict):
        settings = {k: v for k, v in out["sample"].items() if not isinstance(v, dict)}
        keys = {k: v for k, v in out["sample"].items() if isinstance(v, dict)}
        out["sample"] = {**settings, **flatten(keys)}
    if isinstance(out.get("cases"), list):
        out["cases"] = [flatten(row) if isinstance(row, dict) else row for row in out["cases"]]
    return out


def base_problem(
    problem: str | dict[str, Any], changes: Mapping[str, Any], source: str, known: Problem | None
) -> Problem:
    """The problem that a sweep or design file names.

    Args:
        problem: A problem file, relative to the file, or its tables.
        changes: Dotted keys to change.
        source: The file, or a name for messages.
        known: The problem itself, where a caller has one.

    Raises:
        InputError: If there is no such file, or it says what cannot be.
    """
    if known is not None:
        return known.changed(changes)
    if isinstance(problem, str):
        path = os.path.normpath(Path(source).parent / problem)
        if not os.path.exists(path):
            raise InputError(
                f"{source}: 'problem' = {problem!r}: there is no file {path}; the name is"
                " relative to the file that says so"
            )
        return load_problem(path, changes)
    return Problem.from_dict(problem, f"{source} [problem]").changed(changes)


def check_keys(
    base: Problem, table: SweepFile, points: Sequence[Point], methods: Sequence[str], source: str
) -> None:
    """Refuse what no case could use; values that only clash with others are left to their cases.

    Each row of `cases` is tried as a whole, each other key by itself beside the first point.

    Raises:
        InputError: For a key that does not exist, a value it can never have, or a key that has no
            effect on any case.
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
    if model is None or any(_blames_key(error, point) for error in _errors(model, data)):
        parse_file(data, source)


def _errors(model: type[BaseModel], data: Any) -> Sequence[Any]:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return error.errors()
    return ()


def _blames_key(error: Any, point: Point) -> bool:
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
                f"{source}: '{key}' varies, but no plan is replayed on a machine; add [replay]"
                " samples = 200"
            )
        method = rest.partition(".")[0]
        if table == "method" and method and method not in methods:
            raise InputError(
                f"{source}: '{key}' varies, but '{method}' is not one of the methods"
                f" ({', '.join(dict.fromkeys(methods))}); add it or leave the key out"
            )
