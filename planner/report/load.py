"""A comparison read back from its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from planner.comparison import FORMAT, VERSION, Comparison, Row
from planner.errors import InputError
from planner.machine import Machine
from planner.plan import load_plan
from planner.problem import Problem


def load_comparison(folder: str | Path) -> Comparison:
    """Read the folder that `Comparison.save` wrote.

    Rows and plans come back; replays do not, since the folder keeps their errors only (see
    `load_replays`).

    Raises:
        InputError: If the folder is missing, not that of a comparison, or damaged.
    """
    place = Path(folder)
    data = read_json(place / "comparison.json", f"{folder} is not the folder of a comparison")
    if data.get("format") != FORMAT or data.get("version") != VERSION:
        raise InputError(
            f"{place / 'comparison.json'} is not a comparison this planner reads: format"
            f" {data.get('format')!r}, version {data.get('version')!r}"
        )
    try:
        problem = Problem.from_dict(data["problem"], data["source"])
        return Comparison(
            problem=problem,
            rows=tuple(_row(row, place) for row in data["rows"]),
            machine=Machine.from_table(data["machine"]),
            samples=data["samples"],
            seed=data["seed"],
            complete=data["complete"],
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{place / 'comparison.json'} is damaged: {error!r}") from None


def load_replays(folder: str | Path) -> dict[str, Any]:
    """What the folder keeps of the replays, by label: see `planner.report.folder.replay_data`.

    Empty if the folder holds nothing of the kind.

    Raises:
        InputError: If the file is damaged.
    """
    path = Path(folder) / "replays.json"
    return read_json(path, "") if path.exists() else {}


def read_json(path: Path, otherwise: str) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        InputError: If it cannot be read, or is not one object; starts with `otherwise`.
    """
    prefix = f"{otherwise}: " if otherwise else ""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{prefix}cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{prefix}{path} is not JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{prefix}{path} does not hold one object")
    return data


def _row(data: Mapping[str, Any], place: Path) -> Row:
    known = {field.name: field for field in fields(Row)} | {"peak_u": None}
    given = {**data, "peak_u": data["peak_u_rad_s"]}
    values = {k: _read_back(v) for k, v in given.items() if k in known and k != "replay"}
    values["domain_ok"] = data["domain_ok"]
    plan = data.get("plan_file")
    return Row(**values, plan=None if plan is None else load_plan(place / plan))


def _read_back(value: Any) -> Any:
    """Null is a number that is not defined; a list is a tuple."""
    if isinstance(value, list):
        return tuple(_read_back(item) for item in value)
    return float("nan") if value is None else value
