"""A sweep: the base problem, the methods, and the points, checked before anything runs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.display import line
from planner.errors import InputError
from planner.problem import Problem, load_problem
from planner.reading import read_toml
from planner.schema import parse
from planner.schema.sweep import ReplayTable, SweepFile
from planner.spec import Spec, parse_specs
from planner.sweep.canonical import plain
from planner.sweep.keys import check_keys
from planner.sweep.points import Point, flat, points, varied


@dataclass(frozen=True, eq=False)
class Sweep:
    """Many cases of one problem. Build it with `Sweep.load` or `Sweep.from_dict`.

    Attributes:
        name: Title, or the file's name.
        base: The problem whose keys vary.
        methods: Each plans every point.
        keys: The dotted keys that vary, in the order of the description.
        points: Values of the keys, one dictionary a point.
        replay: Replays on the emulated machine, if any.
        plans: Whether plans are kept in the database.
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
            InputError: If the file is missing, not TOML, or describes what cannot be.
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
        given = dict(data)
        problem = given.get("problem")
        if isinstance(problem, Problem):
            given["problem"] = problem.to_dict()
        table = parse(SweepFile, _flattened(plain(given)), source)
        base = _base(table, source, problem if isinstance(problem, Problem) else None)
        methods = parse_specs(base, table.methods)
        found = points(table, source)
        check_keys(base, table, found, [m.method for m in methods], source)
        return cls(
            name=line(table.title) or line(Path(source).stem),
            base=base,
            methods=tuple(methods),
            keys=tuple(varied(table)),
            points=tuple(found),
            replay=table.replay,
            plans=table.plans,
            _data=table.model_dump(mode="json", by_alias=True, exclude_unset=True),
        )

    def to_dict(self) -> dict[str, Any]:
        """The tables of a sweep file that give this sweep back, the problem's tables included."""
        data = {key: value for key, value in self._data.items() if key != "set"}
        return {**data, "problem": self.base.to_dict()}


def _flattened(data: dict[str, Any]) -> dict[str, Any]:
    """The same tables with dotted keys in the blocks that hold keys of the problem."""
    out = dict(data)
    for block in ("set", "grid"):
        if isinstance(out.get(block), dict):
            out[block] = flat(out[block])
    if isinstance(out.get("sample"), dict):
        own = {k: v for k, v in out["sample"].items() if not isinstance(v, dict)}
        keys = {k: v for k, v in out["sample"].items() if isinstance(v, dict)}
        out["sample"] = {**own, **flat(keys)}
    if isinstance(out.get("cases"), list):
        out["cases"] = [flat(row) if isinstance(row, dict) else row for row in out["cases"]]
    return out


def _base(table: SweepFile, source: str, given: Problem | None) -> Problem:
    if given is not None:
        return given.changed(table.changes)
    if isinstance(table.problem, str):
        path = os.path.normpath(Path(source).parent / table.problem)
        if not os.path.exists(path):
            raise InputError(
                f"{source}: 'problem' = {table.problem!r}: there is no file {path}; the name is"
                " relative to the sweep file"
            )
        return load_problem(path, table.changes)
    return Problem.from_dict(table.problem, f"{source} [problem]").changed(table.changes)
