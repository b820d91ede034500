"""A folder that keeps the finished points of a curve, so that an interrupted one goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from planner.errors import InputError
from planner.files import write_text
from planner.jsonable import jsonable
from planner.loading import load_plan
from planner.pareto.point import Point
from planner.reading import read_json

FORMAT = "planner-trade-off"
VERSION = 1
INDEX = "trade-off.json"


class Store:
    """Points by their place on the curve, in memory and, where a folder is given, on disk.

    Each point is its plan, `plans/NN.json`, and an entry of the index `trade-off.json`; both are
    written at once when the point is found or improved.

    Args:
        path: The folder, made when missing; None keeps nothing.
        asked: What the curve is of; a folder made for something else is refused.

    Raises:
        InputError: If the folder holds another curve or other files, or cannot be written.
    """

    def __init__(self, path: str | Path | None, asked: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.asked = dict(jsonable(asked))
        text = json.dumps(self.asked, sort_keys=True)
        self.key = hashlib.sha256(text.encode()).hexdigest()[:16]
        self.points: dict[int, Point] = {}
        self.facts: dict[str, Any] = {}
        if self.path is not None:
            self._open(self.path)

    def put(self, place: int, point: Point) -> None:
        """Keep a point."""
        self.points[place] = point
        if self.path is not None:
            point.plan.save(self.path / "plans" / f"{place:02d}.json")
            self.write()

    def write(self) -> None:
        """Write the index."""
        if self.path is None:
            return
        data = {
            "format": FORMAT,
            "version": VERSION,
            "key": self.key,
            **self.asked,
            **self.facts,
            "points": {
                f"{place:02d}": jsonable(self.points[place].to_dict())
                for place in sorted(self.points)
            },
        }
        write_text(self.path / INDEX, json.dumps(data, indent=1, allow_nan=False) + "\n")

    def _open(self, path: Path) -> None:
        if path.exists() and not path.is_dir():
            raise InputError(f"{path} is a file; name a folder")
        try:
            (path / "plans").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        index = path / INDEX
        if not index.exists():
            if any(p.name != "plans" for p in path.iterdir()) or any((path / "plans").iterdir()):
                raise InputError(
                    f"{path} holds files that are not from an earlier run; name another folder"
                )
            return
        data = self._read(index)
        for name, entry in data["points"].items():
            known = {f.name for f in fields(Point)} - {"plan"}
            plan = load_plan(path / "plans" / f"{name}.json", strict=True)
            values = {key: entry[key] for key in known}
            self.points[int(name)] = Point(plan=plan, **values)

    def _read(self, index: Path) -> dict[str, Any]:
        try:
            data = read_json(index)
            same = data["format"] == FORMAT and data["key"] == self.key
            points = data["points"]
        except (ValueError, KeyError, TypeError):
            raise InputError(
                f"{index} is not the index of a trade-off; name another folder"
            ) from None
        if not same or not isinstance(points, dict):
            raise InputError(
                f"{index.parent} holds another trade-off (problem, options, points, samples or seed"
                " differ); name another folder"
            )
        return dict(data)
